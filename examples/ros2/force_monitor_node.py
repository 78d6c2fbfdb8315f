#!/usr/bin/env python3
"""A ROS 2 node beside a monitor: B-scans in, force and the order to withdraw out.
docs/howto/ros.md has the topics.

It sends each `sensor_msgs/Image` to a running `scleraforce monitor` and publishes what
the monitor says. The order to withdraw follows the rule of `robot_client.py`, on a
connection of its own. Research use only.
"""

import json
import socket
import sys
import threading
from contextlib import suppress
from pathlib import Path

import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from sensor_msgs.msg import Image as RosImage
from std_msgs.msg import Bool, String

from scleraforce.live.network.openigtlink import Decoder, Image, Received, Text, encode

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import robot_client

# Encoding -> type of a pixel.
ENCODINGS = {"mono8": "u1", "8UC1": "u1", "mono16": "u2", "16UC1": "u2"}
KEPT = 256  # headers of frames that wait for their reading
PERIOD_S = 0.02  # between two orders


def pixels_of(message: RosImage) -> np.ndarray:
    """Return the pixels of an image (row, column); its rows may be longer than its
    columns need.

    Raises:
        ValueError: another encoding, or fewer bytes than stated.
    """
    kind = ENCODINGS.get(message.encoding)
    if kind is None:
        raise ValueError(
            f"encoding {message.encoding!r}; give one of {', '.join(ENCODINGS)}"
        )

    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    rows = np.frombuffer(bytes(message.data), dtype=np.uint8)
    if (
        rows.size < message.height * message.step
        or message.step < message.width * dtype.itemsize
    ):
        raise ValueError(
            f"{rows.size} bytes for {message.height} rows of {message.step}"
        )

    rows = rows[: message.height * message.step].reshape(message.height, message.step)
    wide = np.ascontiguousarray(rows[:, : message.width * dtype.itemsize])
    return wide.view(dtype).astype(dtype.newbyteorder("="))


class ForceMonitorNode(Node):
    """Topics: `image` in; `~/force`, `~/force_low`, `~/force_high`, `~/withdraw`,
    `~/reason` out.
    """

    def __init__(self) -> None:
        super().__init__("force_monitor")
        for name, value in (
            ("host", "127.0.0.1"),
            ("port", 18944),
            ("width_mm", 15.0),
            ("depth_mm", 4.0),
        ):
            self.declare_parameter(name, value)

        self._host = self._told("host")
        self._port = self._told("port")
        self._force, self._low, self._high = (
            self.create_publisher(WrenchStamped, f"~/{name}", 10)
            for name in ("force", "force_low", "force_high")
        )
        self._withdraw = self.create_publisher(Bool, "~/withdraw", 10)
        self._reason = self.create_publisher(String, "~/reason", 10)
        self._order = (False, "nothing heard yet")  # may the needle move on, and why
        self._headers: dict[int, object] = {}
        self._sent = 0
        self._link = socket.create_connection((self._host, self._port), timeout=5.0)
        self._link.settimeout(None)
        self._threads = [
            threading.Thread(target=work, daemon=True)
            for work in (self._obey, self._hear)
        ]

        for thread in self._threads:
            thread.start()

        self.create_subscription(RosImage, "image", self.take, 10)
        self.create_timer(PERIOD_S, self.order)

    def destroy_node(self) -> None:
        """End the scanner's connection."""
        with suppress(OSError):
            self._link.shutdown(socket.SHUT_RDWR)
        self._threads[1].join()
        self._link.close()
        super().destroy_node()

    def _told(self, name: str):
        return self.get_parameter(name).value

    def take(self, message: RosImage) -> None:
        """Send an image to the monitor; the time of its capture goes with it."""
        try:
            pixels = pixels_of(message)
        except ValueError as fault:
            self.get_logger().error(f"image: {fault}")
            return  # no frame: the monitor withdraws after 100 ms

        self._sent += 1
        self._headers[self._sent] = message.header
        self._headers.pop(self._sent - KEPT, None)
        steps_mm = (
            self._told("width_mm") / message.width,
            self._told("depth_mm") / message.height,
        )
        matrix = (
            steps_mm[0],
            0.0,
            0.0,
            0.0,
            steps_mm[1],
            0.0,
            0.0,
            0.0,
            1.0,
            0.0,
            0.0,
            0.0,
        )
        stamp = message.header.stamp
        data = encode(
            Image(pixels[None], matrix),
            "Scanner",
            version=2,
            time_s=stamp.sec + stamp.nanosec * 1e-9,
            message_id=self._sent,
        )

        with suppress(OSError):  # the order follows from the other connection
            self._link.sendall(data)

    def order(self) -> None:
        """Publish whether to withdraw, and why: always, so that silence of this node is
        an order, too.
        """
        go_on, why = self._order
        self._withdraw.publish(Bool(data=not go_on))
        self._reason.publish(String(data=why))

    def _obey(self) -> None:
        """Follow the rule; when the monitor cannot be heard any more, the order
        stays.
        """

        def tell(go_on: bool, why: str) -> None:
            self._order = (go_on, why)
            self.order()

        robot_client.watch(self._host, self._port, tell)

    def _hear(self) -> None:
        decoder = Decoder()
        with suppress(OSError):
            while not decoder.broken and (data := self._link.recv(1 << 16)):
                for event in decoder.feed(data):
                    if (
                        isinstance(event, Received)
                        and isinstance(event.message, Text)
                        and event.header.device == "ForceReading"
                    ):
                        self._tell(json.loads(event.message.text))

    def _tell(self, reading: dict) -> None:
        """Publish a force with the header of its image; a frame without a force
        publishes nothing.
        """
        header = self._headers.pop(reading.get("frame_id"), None)
        if (
            header is None
            or reading.get("force_mn") is None
            or reading.get("interval_mn") is None
        ):
            return

        low_mn, high_mn = reading["interval_mn"]
        forces = (
            (self._force, reading["force_mn"]),
            (self._low, low_mn),
            (self._high, high_mn),
        )

        for publisher, force_mn in forces:
            message = WrenchStamped()
            message.header = header
            message.wrench.force.z = force_mn * 1e-3
            publisher.publish(message)


def main() -> None:
    """Run the node."""
    rclpy.init()
    rclpy.spin(ForceMonitorNode())


if __name__ == "__main__":
    main()
