"""Recordings and answers as MCAP with messages of ROS 2, which Foxglove shows: images, wrenches, and answers."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scleraforce import __version__
from scleraforce.formats.export.rows import Row
from scleraforce.formats.extra import package_for
from scleraforce.recording.files import Recording
from scleraforce.recording.tables import FORCE_COLUMNS
from scleraforce.whole_files import renamed_when_whole

IMAGE_TOPIC, FORCE_TOPIC, ANSWER_TOPIC = "/oct/image", "/force/wrench", "/scleraforce/answer"
IMAGE, WRENCH, ANSWER = "sensor_msgs/msg/Image", "geometry_msgs/msg/WrenchStamped", "scleraforce_msgs/msg/Answer"
KINDS = {IMAGE_TOPIC: IMAGE, FORCE_TOPIC: WRENCH, ANSWER_TOPIC: ANSWER}
# What is not known is NaN, of a class -1.
ANSWER_DEFINITION = """std_msgs/Header header
string file
bool pierced
bool usable
float64 measured_force_mn
int8 target
float64 predicted_force_mn
float64 interval_low_mn
float64 interval_high_mn
int8 predicted
"""
SECOND_NS = 1_000_000_000
ROS = 2


@dataclass(frozen=True)
class _Message:
    """A message of a topic: when it was captured, and its bytes."""

    topic: str
    time_ns: int
    data: bytes


def write_mcap(recording: Recording, rows: Sequence[Row], origin_s: float, path: Path) -> None:
    """Write frames (mono16), the force log, and the rows of frames, all with the times of the recording.

    Args:
        recording: of the frames and the log.
        rows: of its frames, with answers or without.
        origin_s: where the recording's clock begins on that of its sources.
        path: of the file.

    Raises:
        InputError: a package is not installed, or the file cannot be written.
    """
    writing = package_for(path, "mcap.writer", "MCAP")
    typesys = package_for(path, "rosbags.typesys", "MCAP with ROS messages")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    store.register(typesys.get_types_from_msg(ANSWER_DEFINITION, ANSWER))
    with renamed_when_whole(path) as part, part.open("wb") as file:
        writer = writing.Writer(file)
        writer.start(profile="ros2", library=f"scleraforce {__version__}")
        channels = {
            topic: writer.register_channel(topic, "cdr", _ros_schema(writer, store, kind))
            for topic, kind in KINDS.items()
        }
        for message in _messages(recording, rows, origin_s, store):
            writer.add_message(channels[message.topic], message.time_ns, message.data, message.time_ns)
        writer.finish()


def _messages(recording: Recording, rows: Sequence[Row], origin_s: float, store: Any) -> Iterator[_Message]:
    """Yield all messages in the order of their times; each frame is read when its turn comes."""
    events: list[tuple[int, str, int]] = []
    for nth, entry in enumerate(recording.frames):
        events += [(_ns(entry.time_s, origin_s), IMAGE_TOPIC, nth), (_ns(entry.time_s, origin_s), ANSWER_TOPIC, nth)]
    if recording.forces is not None:
        stamps = recording.forces.time_s.tolist()
        events += [(_ns(time_s, origin_s), FORCE_TOPIC, nth) for nth, time_s in enumerate(stamps)]
    for time_ns, topic, nth in sorted(events):
        if topic == IMAGE_TOPIC:
            data = _image(recording, nth, time_ns, store)
        elif topic == FORCE_TOPIC:
            data = _wrench(recording, nth, time_ns, store)
        else:
            data = _answer(rows[nth], time_ns, store)
        yield _Message(topic, time_ns, data)


def _ns(time_s: float, origin_s: float) -> int:
    return round(time_s * SECOND_NS) + round(origin_s) * SECOND_NS


def _ros_schema(writer: Any, store: Any, kind: str) -> int:
    text, _ = store.generate_msgdef(kind, ros_version=ROS)
    number: int = writer.register_schema(kind, "ros2msg", text.encode())
    return number


def _header(store: Any, time_ns: int) -> Any:
    stamp = store.types["builtin_interfaces/msg/Time"](*divmod(time_ns, SECOND_NS))
    return store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="oct")


def _image(recording: Recording, nth: int, time_ns: int, store: Any) -> bytes:
    pixels = np.ascontiguousarray(recording.frame(recording.frames[nth]), dtype="<u2")
    rows, columns = pixels.shape
    message = store.types[IMAGE](
        header=_header(store, time_ns),
        height=rows,
        width=columns,
        encoding="mono16",
        is_bigendian=0,
        step=2 * columns,
        data=pixels.view(np.uint8).ravel(),
    )
    return bytes(store.serialize_cdr(message, IMAGE))


def _wrench(recording: Recording, nth: int, time_ns: int, store: Any) -> bytes:
    """Return a sample of the log; an axis that it does not have is NaN, as zero would be a measurement."""
    log = recording.forces
    assert log is not None
    found = dict(zip(log.columns, log.wrench_sc[nth].tolist(), strict=True))
    values = [found.get(name, float("nan")) for name in FORCE_COLUMNS[1:]]
    vector = store.types["geometry_msgs/msg/Vector3"]
    wrench = store.types["geometry_msgs/msg/Wrench"](force=vector(*values[:3]), torque=vector(*values[3:]))
    return bytes(store.serialize_cdr(store.types[WRENCH](header=_header(store, time_ns), wrench=wrench), WRENCH))


def _answer(row: Row, time_ns: int, store: Any) -> bytes:
    low_mn, high_mn = row.get("interval_mn") or (None, None)
    numbers = {"measured_force_mn": row.get("measured_force_mn"), "predicted_force_mn": row.get("predicted_force_mn"),
               "interval_low_mn": low_mn, "interval_high_mn": high_mn}  # fmt: skip
    classes = {name: row.get(name) for name in ("target", "predicted")}
    message = store.types[ANSWER](
        header=_header(store, time_ns),
        file=str(row["file"]),
        pierced=bool(row.get("pierced")),
        usable=bool(row.get("usable", False)),
        **{name: float("nan") if value is None else float(value) for name, value in numbers.items()},
        **{name: -1 if value is None else int(value) for name, value in classes.items()},
    )
    return bytes(store.serialize_cdr(message, ANSWER))
