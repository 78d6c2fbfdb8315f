#!/usr/bin/env python3
"""Shows a monitor in 3D Slicer: frames with their walls, the force as a bar and in
words (docs/howto/slicer.md).

It relays every byte between scanner and monitor, at once and unchanged, and serves
Slicer: IMAGE `ForceView`, TRANSFORM `ForceBar`, STRING `ForceText`. For looking at a
session, not for a robot: a robot listens to the monitor itself. Research use only.
"""

import argparse
import json
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any

import numpy as np

from scleraforce.base.units import from_si
from scleraforce.live.network.openigtlink import (
    Decoder,
    Image,
    Message,
    Received,
    Status,
    Text,
    Transform,
    encode,
)
from scleraforce.records.scan import PixelScale
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall import draw_overlay

VIEW = "ForceView"
BAR = "ForceBar"
WORDS = "ForceText"
PIECE = 1 << 16
MM = 1e-3
KEPT_FRAMES = 4
FRAME_WAIT_S = 0.2
FLAT = 0.01  # height of the bar without a force; Slicer refuses a scale of 0
Address = tuple[str, int]


class Latest:
    """The newest reading with its frame, and the status; whoever waits gets them once
    for each reading.
    """

    def __init__(self) -> None:
        self.status = ""
        self._frames: dict[int, Image] = {}
        self._reading: dict[str, Any] | None = None
        self._ended = False
        self._changed = threading.Condition()

    def saw(self, image: Image, frame_id: int) -> None:
        """Keep a frame by its sender's number; the oldest gives way."""
        with self._changed:
            self._frames.pop(frame_id, None)
            self._frames[frame_id] = image
            if len(self._frames) > KEPT_FRAMES:
                del self._frames[next(iter(self._frames))]
            self._changed.notify_all()

    def read(self, reading: dict[str, Any]) -> None:
        """Keep a reading, and wake who waits."""
        with self._changed:
            self._reading = reading
            self._changed.notify_all()

    def end(self) -> None:
        """Let nobody wait any more."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def wait(self) -> tuple[dict[str, Any], Image | None] | None:
        """Return the next reading and its frame, None at the end; a reading that was
        overtaken is left out.

        A frame is handed on before it is looked at, so that its reading can come first:
        it is waited for. A sender that gives neither number nor time has the newest
        frame shown.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._ended or self._reading is not None)
            reading = self._reading
            self._reading = None
            if reading is None or self._ended:
                return None

            frame_id = reading.get("frame_id")
            self._changed.wait_for(
                lambda: self._ended or frame_id in self._frames, FRAME_WAIT_S
            )
            newest = next(reversed(self._frames.values()), None)

            return (
                None if self._ended else (reading, self._frames.get(frame_id, newest))
            )


class Viewers:
    """The connections from Slicer; a new one gets the last messages, one that does not
    read is closed.
    """

    def __init__(self) -> None:
        self._links: list[socket.socket] = []
        self._last: dict[str, bytes] = {}
        self._lock = threading.Lock()

    def add(self, link: socket.socket) -> None:
        """Take a connection, and tell it the newest of each device."""
        link.settimeout(1.0)
        with self._lock:
            self._links.append(link)
            self._send(link, b"".join(self._last.values()))

    def close(self) -> None:
        """End all connections."""
        with self._lock:
            for link in self._links:
                link.close()
            self._links.clear()

    def tell(self, message: Message, device: str) -> None:
        """Send a message to all; Slicer is spoken to in version 1, which every version
        of it reads.
        """
        data = encode(message, device)
        with self._lock:
            self._last[device] = data
            for link in list(self._links):
                self._send(link, data)

    def _send(self, link: socket.socket, data: bytes) -> None:
        try:
            link.sendall(data)
        except OSError:
            self._links.remove(link)
            link.close()


def relay(source: socket.socket, target: socket.socket, latest: Latest) -> None:
    """Hand on all bytes, then look at them; both connections end with the first."""
    decoder = Decoder()
    with suppress(OSError):
        while data := source.recv(PIECE):
            target.sendall(data)
            if not decoder.broken:
                for event in decoder.feed(data):
                    if isinstance(event, Received):
                        notice(event, latest)

    for link in (source, target):
        with suppress(OSError):
            link.shutdown(socket.SHUT_RDWR)


def notice(event: Received, latest: Latest) -> None:
    """Keep what is shown."""
    message = event.message
    device = event.header.device

    if (
        isinstance(message, Image)
        and message.pixels.ndim == 3
        and len(message.pixels) == 1
    ):
        # the decoder's own are overwritten
        own = replace(message, pixels=message.pixels.copy())
        latest.saw(own, event.message_id or int(from_si(event.header.time_s, "us")))
    elif isinstance(message, Status) and device == "ForceMonitor":
        latest.status = message.message
    elif isinstance(message, Text) and device == "ForceReading":
        with suppress(ValueError):
            latest.read(json.loads(message.text))


def shown(image: Image) -> Image:
    """Return a frame in colour with its wall drawn in, where the sender placed it."""
    pixels = np.asarray(image.pixels[0])
    lateral_mm, depth_mm = (
        float(np.linalg.norm(image.matrix[3 * n : 3 * n + 3])) for n in (0, 1)
    )
    scale = PixelScale(
        lateral_m=lateral_mm * MM, depth_m=depth_mm * MM, refractive_index=1.0
    )
    picture = draw_overlay(pixels, find_wall(pixels, scale))

    return Image(np.ascontiguousarray(picture[None, ..., ::-1]), image.matrix)


def bar(reading: dict[str, Any]) -> Transform:
    """Return what scales a cube of 1 mm to as many mm as the force has mN."""
    height = max(reading.get("force_mn") or 0.0, FLAT)
    return Transform((1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, height, 0.0, 0.0, 0.0))


def words(reading: dict[str, Any], status: str) -> str:
    """Return the force with its interval, or why there is none, and what the monitor
    says.
    """
    force = reading.get("force_mn")
    ends = reading.get("interval_mn")
    if force is None or ends is None:
        return f"no force: {reading.get('reason') or 'not read'}\n{status}"
    return f"{force:.1f} mN (90 %: {ends[0]:.1f} to {ends[1]:.1f})\n{status}"


def show(latest: Latest, viewers: Viewers) -> None:
    """Send each reading to Slicer at once."""
    while (told := latest.wait()) is not None:
        reading, image = told
        if image is not None:
            with suppress(ValueError):  # a frame of an impossible scale
                viewers.tell(shown(image), VIEW)
        viewers.tell(bar(reading), BAR)
        viewers.tell(Text(words(reading, latest.status)), WORDS)


def serve_scanner(scanner: socket.socket, monitor: Address, latest: Latest) -> None:
    """Relay between a scanner and the monitor; a scanner whose monitor is not there is
    turned away.
    """
    with scanner:
        try:
            link = socket.create_connection(monitor, timeout=5.0)
        except OSError as fault:
            sys.stderr.write(f"error: {monitor[0]}:{monitor[1]}: {fault}\n")
            return

        with link:
            for end in (scanner, link):
                end.settimeout(None)
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

            back = threading.Thread(
                target=relay, args=(link, scanner, latest), daemon=True
            )
            back.start()
            relay(scanner, link, latest)
            back.join()


def accept(listener: socket.socket, take: Callable[[socket.socket], None]) -> None:
    """Take each connection in turn, until the listener is closed."""
    with suppress(OSError):
        while True:
            take(listener.accept()[0])


@contextmanager
def run(
    scanner_port: int, slicer_port: int, monitor: Address
) -> Iterator[tuple[int, int]]:
    """Run the bridge on 127.0.0.1 until the block ends; gives its two ports (0 takes
    free ones).
    """
    latest = Latest()
    viewers = Viewers()
    listeners = [
        socket.create_server(("127.0.0.1", port))
        for port in (scanner_port, slicer_port)
    ]
    takes = (lambda link: serve_scanner(link, monitor, latest), viewers.add)

    for listener, take in zip(listeners, takes, strict=True):
        threading.Thread(target=accept, args=(listener, take), daemon=True).start()

    threading.Thread(target=show, args=(latest, viewers), daemon=True).start()
    try:
        yield listeners[0].getsockname()[1], listeners[1].getsockname()[1]
    finally:
        for listener in listeners:
            with suppress(OSError):
                listener.shutdown(socket.SHUT_RDWR)

            listener.close()

        latest.end()
        viewers.close()


def main() -> None:
    """Run the bridge until Ctrl-C."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument(
        "--scanner-port", type=int, default=18946, help="where the scanner connects"
    )
    parser.add_argument(
        "--slicer-port", type=int, default=18947, help="where 3D Slicer connects"
    )
    parser.add_argument("--monitor-host", default="127.0.0.1")
    parser.add_argument("--monitor-port", type=int, default=18944)
    given = parser.parse_args()

    with run(
        given.scanner_port, given.slicer_port, (given.monitor_host, given.monitor_port)
    ) as ports:
        sys.stdout.write(
            f"scanner: 127.0.0.1:{ports[0]}, 3D Slicer: 127.0.0.1:{ports[1]}\n"
        )
        sys.stdout.flush()
        threading.Event().wait()


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        main()
