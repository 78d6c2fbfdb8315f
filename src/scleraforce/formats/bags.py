"""ROS 1 and ROS 2 bags (sqlite, MCAP): an image topic and a force topic, by the time at which they were captured."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError, InputError, RecordingError
from scleraforce.formats.bag_images import image_pixels
from scleraforce.formats.extra import package_for
from scleraforce.formats.scan import PictureStream, Scan, Times, UnansweredError, check_bytes
from scleraforce.recording.faults import named_faults
from scleraforce.recording.pixels import check_size
from scleraforce.recording.tables import ForceLog
from scleraforce.units import from_si

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection

__all__ = ["Bag", "BagTopics", "read_bag"]

IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
FORCES = ("geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/Vector3Stamped")
SIX, THREE = ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm"), ("fx_n", "fy_n", "fz_n")
SECOND_NS = 1_000_000_000
EARLIEST_MS, LATEST_MS = 1.0, 1000.0  # before and after its stamp, that a message arrives on one clock


@dataclass(frozen=True)
class BagTopics:
    """Which topics are read (None: the only one of its kind), and whether by arrival, where stamps are empty."""

    image: str | None = None
    force: str | None = None
    by_arrival: bool = False


@dataclass(frozen=True, eq=False)
class Bag:
    """What a bag holds: frames, forces (None: no topic of that kind), sentences on its clocks."""

    scan: Scan | None
    log: ForceLog | None
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Clock:
    """Of a topic: when messages were captured and when they arrived, ns."""

    captured_ns: NDArray[np.int64]
    arrived_ns: NDArray[np.int64]

    def time_s(self, path: Path, topic: str, by_arrival: bool) -> NDArray[np.float64]:
        stamps_ns = self.arrived_ns if by_arrival else self.captured_ns
        # A clock may begin at 0, but no more than one message is of that moment.
        if not by_arrival and np.count_nonzero(stamps_ns == 0) >= min(2, len(stamps_ns)):
            raise UnansweredError(
                "--by-arrival", f"{path}: {topic}: messages without a capture stamp (header.stamp is 0): take the "
                "times at which they arrived, which lag behind by an unknown time?"
            )  # fmt: skip
        if (np.diff(stamps_ns) <= 0).any():
            raise RecordingError(f"{path}: {topic}: its stamps do not run forward; the clock must")
        return stamps_ns / float(SECOND_NS)

    def note(self, path: Path, topic: str) -> str:
        """Say how long messages took from their stamp to the bag: other clocks show there."""
        late_ms = from_si((self.arrived_ns - self.captured_ns) / float(SECOND_NS), "ms")
        low, middle, high = np.percentile(late_ms, [5, 50, 95])
        said = f"{path}: {topic}: messages arrived {middle:.1f} ms (median; {low:.1f} to {high:.1f}) after their stamp"
        if low > -EARLIEST_MS and high < LATEST_MS:
            return said
        return f"{said}: its clock is not that of the bag; where the other topic's is, --clock-offset-s corrects it"


def read_bag(path: Path, topics: BagTopics) -> Bag:
    """Return the frames and forces of a bag.

    Raises:
        UnansweredError: several topics of a kind and none chosen, or stamps that are empty.
        InputError: it cannot be read, or has no topic of the kind or name.
    """
    with _opened(path) as bag:
        image = _topic(path, bag, IMAGES, topics.image, "--image-topic")
        force = _topic(path, bag, FORCES, topics.force, "--force-topic")
        if image is None and force is None:
            raise InputError(
                f"{path}: neither a topic of images ({', '.join(IMAGES)}) nor of forces ({', '.join(FORCES)}); there "
                f"are {_listed(bag.connections)}"
            )
        scan, image_notes = (None, ()) if image is None else _scan(path, bag, image, topics.by_arrival)
        log, force_notes = (None, ()) if force is None else _log(path, bag, force, topics.by_arrival)
    return Bag(scan, log, (*image_notes, *force_notes))


@contextmanager
def _opened(path: Path) -> "Iterator[AnyReader]":
    highlevel = package_for(path, "rosbags.highlevel", "a ROS bag")
    typesys = package_for(path, "rosbags.typesys", "a ROS bag")
    # Older ROS 2 bags do not hold the definitions of their messages.
    store = typesys.get_typestore(typesys.Stores.LATEST)
    with named_faults(path, "ROS bag"), highlevel.AnyReader([path], default_typestore=store) as bag:
        yield bag


def _topic(path: Path, bag: "AnyReader", kinds: Sequence[str], told: str | None, option: str) -> "Connection | None":
    """Return the connection of the topic that was told, or the only one of the kinds; None: there is none."""
    found = {each.topic: each for each in bag.connections if each.msgtype in kinds and each.msgcount}
    if told is not None:
        if told not in found:
            raise InputError(f"{path}: {option}: no topic {told} of {' or '.join(kinds)}; {_listed(bag.connections)}")
        return found[told]
    if len(found) > 1:
        raise UnansweredError(option, f"{path}: which topic? There are {', '.join(sorted(found))}")
    return next(iter(found.values()), None)


def _listed(connections: "Sequence[Connection]") -> str:
    return ", ".join(f"{each.topic} ({each.msgtype})" for each in connections) or "no topics"


def _messages(bag: "AnyReader", connection: "Connection") -> Iterator[tuple[int, Any]]:
    """Yield arrival in ns and message of a topic, in the order of arrival."""
    for each, arrived_ns, data in bag.messages([connection]):
        yield arrived_ns, bag.deserialize(data, each.msgtype)


def _stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * SECOND_NS + int(message.header.stamp.nanosec)


def _clock(stamps: Sequence[tuple[int, int]]) -> _Clock:
    captured_ns, arrived_ns = np.array(stamps, dtype=np.int64).reshape(-1, 2).T
    return _Clock(captured_ns, arrived_ns)


def _scan(path: Path, bag: "AnyReader", image: "Connection", by_arrival: bool) -> tuple[Scan, tuple[str, ...]]:
    stamps, shape, bits = [], None, None
    for arrived_ns, message in _messages(bag, image):
        stamps.append((_stamp_ns(message), arrived_ns))
        if shape is None:
            first = image_pixels(message, f"{path}: {image.topic}")
            shape, bits = first.shape, 8 if first.dtype == np.uint8 else None
            check_size(path, *shape)
            check_bytes(path, image.msgcount * first.nbytes)
    assert shape is not None
    clock = _clock(stamps)
    time_s = clock.time_s(path, image.topic, by_arrival)
    scan = Scan(
        names=tuple(f"{path}: {image.topic}[{nth}]" for nth in range(len(stamps))),
        rows=shape[0],
        columns=shape[1],
        pictures=lambda: _pictures(path, image.topic, shape),
        bits=bits,
        times=Times(time_s, f"{'arrival' if by_arrival else 'header.stamp'} of {image.topic}"),
    )
    return scan, (clock.note(path, image.topic),)


def _pictures(path: Path, topic: str, shape: tuple[int, ...]) -> PictureStream:
    with _opened(path) as bag:
        image = next(each for each in bag.connections if each.topic == topic and each.msgtype in IMAGES)
        for _, message in _messages(bag, image):
            pixels = image_pixels(message, f"{path}: {topic}")
            if pixels.shape != shape:
                raise FrameError(f"{path}: {topic}: images of {shape} and of {pixels.shape} pixels")
            yield pixels


def _log(path: Path, bag: "AnyReader", force: "Connection", by_arrival: bool) -> tuple[ForceLog, tuple[str, ...]]:
    stamps, values = [], []
    for arrived_ns, message in _messages(bag, force):
        stamps.append((_stamp_ns(message), arrived_ns))
        vectors = (message.wrench.force, message.wrench.torque) if hasattr(message, "wrench") else (message.vector,)
        values.append([coordinate for vector in vectors for coordinate in (vector.x, vector.y, vector.z)])
    clock = _clock(stamps)
    time_s = clock.time_s(path, force.topic, by_arrival)
    wrench_sc = np.array(values, dtype=np.float64)
    names = np.array(SIX if wrench_sc.shape[1] == len(SIX) else THREE)
    measured = ~np.isnan(wrench_sc).all(axis=0)  # what a sensor does not measure is NaN in ROS
    log = ForceLog(time_s, wrench_sc[:, measured], tuple(names[measured].tolist()))
    return log, (clock.note(path, force.topic),)
