"""ROS bags that tests write with rosbags: five frames, and a wrench at 200 Hz."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from foreign_files import FRAMES

pytest.importorskip("rosbags")
pytest.importorskip("mcap")
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, StoragePlugin, Writer as Writer2
from rosbags.typesys import Stores, get_typestore

SECOND_NS = 10**9
START_NS = 1_700_000_000 * SECOND_NS
FRAME_TIMES_S = (0.5, 0.75, 1.0, 1.5, 2.25)
FORCE_TIMES_S = np.arange(500) / 200.0
LATE_S = 0.08  # of images; forces arrive after 1 ms, in the middle of them
ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS2 = get_typestore(Stores.ROS2_HUMBLE)


class Messages:
    """Messages of one generation of ROS."""

    def __init__(self, store) -> None:
        self.store = store
        self.types = store.types

    def header(self, stamp_ns: int):
        stamp = self.types["builtin_interfaces/msg/Time"](
            stamp_ns // SECOND_NS, stamp_ns % SECOND_NS
        )
        fields = {"stamp": stamp, "frame_id": "oct"}
        kind = self.types["std_msgs/msg/Header"]

        return (
            kind(seq=0, **fields)
            if "seq" in kind.__dataclass_fields__
            else kind(**fields)
        )

    def image(
        self,
        stamp_ns: int,
        pixels: np.ndarray,
        encoding: str = "mono16",
        padding: int = 6,
        big: bool = False,
    ):
        lines = np.ascontiguousarray(
            pixels.astype(pixels.dtype.newbyteorder(">")) if big else pixels
        )
        lines = lines.view(np.uint8).reshape(len(pixels), -1)
        lines = np.pad(lines, ((0, 0), (0, padding)))

        return self.types["sensor_msgs/msg/Image"](
            header=self.header(stamp_ns),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=int(big),
            step=lines.shape[1],
            data=lines.ravel(),
        )

    def wrench(self, stamp_ns: int, values):
        vector = self.types["geometry_msgs/msg/Vector3"]
        wrench = self.types["geometry_msgs/msg/Wrench"](
            force=vector(*values[:3]), torque=vector(*values[3:])
        )

        return self.types["geometry_msgs/msg/WrenchStamped"](
            header=self.header(stamp_ns), wrench=wrench
        )


def write_mcap(path: Path, profile: str, channels, messages) -> Path:
    """Write an MCAP of channels of (topic, encoding, schema's name, encoding and data),
    and of messages of (channel, time in ns, data).
    """
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile=profile)
        numbers = [
            writer.register_channel(
                topic, encoding, writer.register_schema(name, kind, data)
            )
            for topic, encoding, name, kind, data in channels
        ]
        for channel, time_ns, data in messages:
            writer.add_message(numbers[channel], time_ns, data, time_ns)
        writer.finish()
    return path


def stamps(times_s) -> list[int]:
    return [START_NS + round(time_s * SECOND_NS) for time_s in times_s]


def write_parts(folder: Path, kind: str, ends_s=(0.0, 1.0, 9.0)) -> Path:
    """Write the parts of a bag as ROS splits it, without metadata.yaml."""
    suffix = {"ros1": ".bag", "sqlite": ".db3", "mcap": ".mcap"}[kind]
    folder.mkdir()
    for nth, span_s in enumerate(pairwise(ends_s)):
        bag = write_bag(folder.with_name(f"{folder.name}-{nth}"), kind, span_s=span_s)
        file = bag if bag.is_file() else next(bag.glob(f"*{suffix}"))
        file.rename(folder / f"bag_{nth}{suffix}")

    return folder


def write_bag(
    path: Path,
    kind: str,
    stamped: bool = True,
    topics=("/oct/image",),
    forces: bool = True,
    packed=None,
    span_s=(-np.inf, np.inf),
) -> Path:
    """A bag of five frames and a wrench at 200 Hz; images arrive late, so that arrival
    has another order. Of it those messages that arrive within `span_s`.
    """
    one = kind == "ros1"
    store = ROS1 if one else ROS2
    messages = Messages(store)
    plugins = {"sqlite": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}
    writer = (
        Writer1(path) if one else Writer2(path, version=9, storage_plugin=plugins[kind])
    )
    serialize = store.serialize_ros1 if one else store.serialize_cdr
    sent = []

    for topic in topics:
        for stamp_ns, frame in zip(stamps(FRAME_TIMES_S), FRAMES, strict=True):
            message = messages.image(stamp_ns if stamped else 0, frame)
            sent.append(
                (
                    stamp_ns + round(LATE_S * SECOND_NS),
                    topic,
                    message,
                    "sensor_msgs/msg/Image",
                )
            )

    for nth, stamp_ns in enumerate(stamps(FORCE_TIMES_S) if forces else []):
        message = messages.wrench(stamp_ns, [nth, 0.5, -nth / 1e3, 0.25, 0.0, 1.0])
        sent.append(
            (
                stamp_ns + SECOND_NS // 1000,
                "/ft/wrench",
                message,
                "geometry_msgs/msg/WrenchStamped",
            )
        )

    begin_ns, end_ns = (START_NS + each * SECOND_NS for each in span_s)
    sent = [each for each in sent if begin_ns <= each[0] < end_ns]
    if packed is not None:
        writer.set_compression(packed, CompressionFormat.ZSTD)

    with writer:
        kinds = {topic: kind for _, topic, _, kind in sent}
        connections = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in kinds.items()
        }

        for arrived_ns, topic, message, name in sorted(sent, key=lambda each: each[0]):
            writer.write(connections[topic], arrived_ns, serialize(message, name))

    return path
