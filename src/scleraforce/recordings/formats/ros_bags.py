"""ROS 1 and ROS 2 bags (sqlite, MCAP): an image topic and a force topic, with their
capture times.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from hashlib import blake2b
from itertools import pairwise, product
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.base import optional_packages
from scleraforce.base.arrays import Flags, Floats, Integers, Places
from scleraforce.base.errors import FrameError, InputError, RecordingError
from scleraforce.base.units import from_si
from scleraforce.recordings.formats import picture_streams
from scleraforce.recordings.formats.image_files import (
    JPEG_SIGNATURE,
    PNG_SIGNATURE,
    read_picture,
)
from scleraforce.recordings.formats.mcap_files import (
    Bag,
    BagConnection,
    McapFile,
    check_whole,
    is_mcap,
    is_of_ros_2,
)
from scleraforce.recordings.formats.picture_streams import (
    FrameTimes,
    PictureSource,
    UnansweredError,
    check_image_size,
)
from scleraforce.recordings.frame_and_force_tables import FORCE_COLUMNS, ForceLog
from scleraforce.records.remark import Remark

# Types of a sample by sensor_msgs/Image's encoding; colours have 3 or 4 of one byte.
GREYS = {
    "mono8": "u1",
    "8UC1": "u1",
    "mono16": "u2",
    "16UC1": "u2",
    "16SC1": "i2",
    "32FC1": "f4",
}
COLOURS = ("rgb8", "bgr8", "rgba8", "bgra8")
# What decides on the meaning of a message's bytes, and stays the same within a topic.
IMAGE_FIELDS = ("encoding", "is_bigendian", "height", "width", "step", "format")
IMAGES = (
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/CompressedImage",
    "foxglove_msgs/msg/RawImage",
    "foxglove_msgs/msg/CompressedImage",
)
FORCES = ("geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/Vector3Stamped")
SECOND_NS = 1_000_000_000
# messages before and after a stamp that runs back, whose delays are compared
NEIGHBOURS = 25
SPLIT = (
    "record or filter them into bags of their own (rosbag filter, ros2 bag convert,"
    " mcap filter)"
)
# Ways to what is left of a damaged bag, by its ending.
RECOVERY = {
    ".bag": "`rosbag reindex {}` finds the messages of a bag that was cut off",
    ".db3": (
        "`sqlite3 {} .recover | sqlite3 whole.db3` keeps the messages of a damaged one"
    ),
}
# before and after its stamp, that a message arrives on one clock
EARLIEST_MS = 1.0
LATEST_MS = 1000.0


def _image_pixels(message: Any, place: str) -> NDArray[Any]:
    """Return the grey pixels (row, column) of a sensor_msgs Image or CompressedImage;
    `place` is for messages.
    """
    if hasattr(message, "format"):
        packed = bytes(message.data)
        if not packed.startswith((PNG_SIGNATURE, JPEG_SIGNATURE)):
            raise FrameError(
                f"{place}: compressed as {message.format!r}; PNG and JPEG are read"
            )

        return read_picture(place, packed)[0]

    if (encoding := message.encoding) not in (*GREYS, *COLOURS):
        raise FrameError(
            f"{place}: encoding {encoding!r}; one of {', '.join((*GREYS, *COLOURS))}"
        )

    big = getattr(message, "is_bigendian", False)  # Foxglove's never are
    kind = np.dtype((">" if big else "<") + GREYS.get(encoding, "u1"))
    rows = int(message.height)
    columns = int(message.width)
    step = int(message.step)
    samples = len(encoding) - 1 if encoding in COLOURS else 1
    packed = message.data
    data = (
        np.frombuffer(packed, dtype=np.uint8)
        if isinstance(packed, bytes)
        else np.asarray(packed, dtype=np.uint8)
    )

    used = columns * samples * kind.itemsize
    if step < used or data.size < rows * step:
        raise FrameError(
            f"{place}: damaged: {data.size} bytes for {rows} rows of {step}"
        )

    lines = np.ascontiguousarray(data[: rows * step].reshape(rows, step)[:, :used])
    pixels = (
        lines.view(kind).astype(kind.newbyteorder("=")).reshape(rows, columns, samples)
    )

    if encoding in GREYS:
        return pixels[..., 0]

    return np.asarray(
        cv2.cvtColor(pixels, getattr(cv2, f"COLOR_{encoding[:-1].upper()}2GRAY"))
    )


class _Heard(NamedTuple):
    """One message: its publisher (a connection's number), capture and arrival in ns,
    coordinate frame.
    """

    publisher: int
    captured_ns: int
    arrived_ns: int
    frame_id: str


def read_bag(
    path: Path,
    image_topic: str | None = None,
    force_topic: str | None = None,
    by_arrival: bool = False,
) -> tuple[PictureSource | None, ForceLog | None]:
    """Return a bag's frames and forces, None without such a topic; `by_arrival` takes
    the times of arrival.
    """
    with _opened(path) as bag:
        image = _topic(bag, IMAGES, image_topic, "image_topic")
        force = _topic(bag, FORCES, force_topic, "force_topic")
        if not image and not force:
            wanted = (
                f"neither a topic of images ({', '.join(IMAGES)}) nor of forces"
                f" ({', '.join(FORCES)})"
            )
            raise InputError(f"{wanted}; there are {_listed(bag.connections)}")

        scan = _scan(path, bag, image, by_arrival) if image else None
        return scan, _log(path, bag, force, by_arrival) if force else None


@contextmanager
def _opened(path: Path) -> Iterator[Bag]:
    with picture_streams.named_faults(path, "ROS bag"):
        highlevel, typesys = (
            optional_packages.package_for(f"rosbags.{name}", "a ROS bag")
            for name in ("highlevel", "typesys")
        )
        if path.is_file() and path.suffix.lower() != ".db3" and is_mcap(path):
            check_whole(path)
            if not is_of_ros_2(path):
                yield McapFile(path)
                return

        # Older ROS 2 bags do not hold the definitions of their messages.
        store = typesys.get_typestore(typesys.Stores.LATEST)

        try:
            reader = highlevel.AnyReader([path], default_typestore=store)
            reader.open()
        except OSError:
            raise
        except Exception as fault:
            way = RECOVERY.get(path.suffix.lower())
            if way is None:
                raise
            words = " ".join(str(fault).split()).rstrip(".")
            raise InputError(f"{words}: {way.format(path.name)}") from fault

        try:
            yield reader
        finally:
            reader.close()


def _topic(
    bag: Bag, kinds: Sequence[str], chosen: str | None, field: str
) -> Sequence[BagConnection]:
    """Return the connections of the chosen topic, or of the only one of the kinds;
    empty without such a topic.
    """
    found = {
        each.topic
        for each in bag.connections
        if each.msgtype in kinds and each.msgcount
    }
    if chosen is not None and chosen not in found:
        raise InputError(
            f"`{field}`: no topic {chosen} of {' or '.join(kinds)};"
            f" {_listed(bag.connections)}"
        )
    if chosen is None and len(found) > 1:
        raise UnansweredError(
            field, f"which topic? There are {', '.join(sorted(found))}"
        )

    topic = chosen or next(iter(found), None)
    connections = [
        each for each in bag.connections if each.topic == topic and each.msgcount
    ]

    for other in connections[1:]:
        if other.msgtype != connections[0].msgtype:
            raise InputError(
                f"{topic}: messages of two types, {connections[0].msgtype} and"
                f" {other.msgtype}; {SPLIT}"
            )

    # A type has one definition when messages are decoded, whichever connection they
    # came by.
    for first, other in product(connections[:1], bag.connections):
        if other.msgtype == first.msgtype and _definition(other) != _definition(first):
            two = " and ".join(
                f"connection {each.id} ({each.topic})" for each in (first, other)
            )
            raise InputError(
                f"{topic}: two definitions of {first.msgtype}, of {two}; {SPLIT}"
            )

    return connections


def _definition(connection: BagConnection) -> str:
    """Return a message's definition without comments and blank lines, which do not
    change its bytes.
    """
    lines = (
        line.partition("#")[0].split() for line in connection.msgdef.data.splitlines()
    )
    return "\n".join(" ".join(words) for words in lines if words)


def _listed(connections: Sequence[BagConnection]) -> str:
    return (
        ", ".join(f"{each.topic} ({each.msgtype})" for each in connections)
        or "no topics"
    )


def _messages(
    bag: Bag, connections: Sequence[BagConnection]
) -> Iterator[tuple[_Heard, Any]]:
    for each, arrived_ns, data in bag.messages(connections):
        message: Any = bag.deserialize(data, each.msgtype)
        header = getattr(message, "header", None)
        stamp = message.timestamp if header is None else header.stamp
        frame_id = getattr(message if header is None else header, "frame_id", "")
        captured_ns = int(stamp.sec) * SECOND_NS + int(stamp.nanosec)
        yield _Heard(each.id, captured_ns, arrived_ns, frame_id), message


def _ordered(
    heard: Sequence[_Heard], content: Callable[[int], bytes], by_arrival: bool
) -> tuple[Floats, Places, tuple[str, ...]]:
    """Return the times of messages without repeated ones, their places in the order of
    arrival, and notes.
    """
    for nth, each in enumerate(heard):
        if each.frame_id != heard[0].frame_id:
            found = (
                f"{heard[0].frame_id!r} in message 0 and {each.frame_id!r} in message"
                f" {nth}"
            )
            raise InputError(f"header.frame_id is {found}; {SPLIT}")

    publisher, captured_ns, arrived_ns = np.array(
        [each[:3] for each in heard], dtype=np.int64
    ).T
    late_ms = from_si((arrived_ns - captured_ns) / float(SECOND_NS), "ms")
    stamps_ns = arrived_ns if by_arrival else captured_ns

    if not by_arrival:
        _check_stamped(captured_ns, late_ms)
        _check_publishers(publisher, late_ms)

    notes = [_late_note(late_ms)]
    if len(counts := np.unique(publisher, return_counts=True)[1]) > 1:
        notes.append(
            f"{len(counts)} publishers, with {' and '.join(map(str, counts))} messages;"
            " merged by their time"
        )

    order = np.argsort(stamps_ns, kind="stable")
    if (moved := np.flatnonzero(np.diff(stamps_ns) < 0) + 1).size:
        _check_one_clock(stamps_ns, late_ms)
        notes.append(
            f"{moved.size} messages arrived later than others with later stamps; sorted"
            " by stamp"
        )

    repeated = np.flatnonzero(np.diff(stamps_ns[order]) == 0)
    for one, other in zip(
        order[repeated].tolist(), order[repeated + 1].tolist(), strict=True
    ):
        if content(one) != content(other):
            found = (
                f"messages {one} and {other} differ and have one stamp,"
                f" {stamps_ns[one] / SECOND_NS:.6f} s"
            )
            raise RecordingError(f"its stamps do not run forward: {found}; {SPLIT}")

    if repeated.size:
        notes.append(
            f"{repeated.size} messages repeat another's stamp and content; they are"
            " left out"
        )

    order = np.delete(order, repeated + 1)
    return stamps_ns[order] / float(SECOND_NS), order, tuple(notes)


def _check_stamped(captured_ns: Integers, late_ms: Floats) -> None:
    empty = captured_ns == 0
    # A clock may begin at 0, but no more than one message is of that moment, and it
    # takes as long as others to arrive.
    others = late_ms[~empty]

    begins = (
        empty.sum() == 1
        and others.size
        and abs(late_ms[empty][0] - np.median(others)) <= LATEST_MS
    )
    if empty.any() and not begins:
        found = (
            f"{empty.sum()} of {empty.size} messages are without a capture stamp"
            " (header.stamp is 0)"
        )
        raise UnansweredError(
            "by_arrival",
            f"{found}: take the times of arrival, which lag by an unknown time?",
        )


def _check_one_clock(stamps_ns: Integers, late_ms: Floats) -> None:
    """Check that late delivery alone reordered stamps: it leaves the shortest delay of
    the neighbours unchanged.
    """
    at = int(np.argmin(np.diff(stamps_ns))) + 1
    back_ms = from_si((stamps_ns[at - 1] - stamps_ns[at]) / SECOND_NS, "ms")
    before_ms = late_ms[max(0, at - NEIGHBOURS) : at]
    after_ms = late_ms[at : at + NEIGHBOURS]

    set_back = after_ms.min() - before_ms.min() > back_ms / 2.0
    if set_back or np.ptp(late_ms) > LATEST_MS:
        pair = ", ".join(
            f"message {nth} is of {stamps_ns[nth] / SECOND_NS:.6f} s"
            for nth in (at - 1, at)
        )
        late = (
            f"late delivery ({late_ms.min():.1f} to {late_ms.max():.1f} ms after the"
            " stamp) does not explain it"
        )
        raise RecordingError(f"its stamps do not run forward: {pair}; {late}; {SPLIT}")


def _check_publishers(publisher: Integers, late_ms: Floats) -> None:
    typical_ms = {
        int(each): float(np.median(late_ms[publisher == each]))
        for each in np.unique(publisher)
    }
    if max(typical_ms.values()) - min(typical_ms.values()) > LATEST_MS:
        listed = " and ".join(
            f"{value:.0f} ms (connection {each})" for each, value in typical_ms.items()
        )
        raise RecordingError(
            f"its publishers are not on one clock: messages arrive {listed} after"
            f" stamps; {SPLIT}"
        )


def _late_note(late_ms: Floats) -> str:
    """Return a sentence on the time from the stamps to the arrival in the bag, which
    shows another clock.
    """
    low, middle, high = np.percentile(late_ms, [5, 50, 95])
    text = (
        f"messages arrived {middle:.1f} ms (median; {low:.1f} to {high:.1f}) after"
        " their stamp"
    )
    if low > -EARLIEST_MS and high < LATEST_MS:
        return text
    return (
        f"{text}: its clock is not that of the bag; where the other topic's is,"
        " `clock_offset_s` corrects it"
    )


def _scan(
    path: Path,
    bag: Bag,
    connections: Sequence[BagConnection],
    by_arrival: bool,
) -> PictureSource:
    topic = connections[0].topic
    heard: list[_Heard] = []
    digests: list[bytes] = []
    stated: dict[str, object] = {}

    for nth, (each, message) in enumerate(_messages(bag, connections)):
        fields = {
            name: getattr(message, name)
            for name in IMAGE_FIELDS
            if hasattr(message, name)
        }
        if not heard:
            stated = fields
            first = _image_pixels(message, topic)
            check_image_size(*first.shape)
            picture_streams.check_bytes(
                sum(each.msgcount for each in connections) * first.nbytes
            )

        for field, value in fields.items():
            if value != stated[field]:
                found = (
                    f"{field} is {stated[field]!r} in message 0 and {value!r} in"
                    f" message {nth}"
                )
                raise FrameError(f"{topic}: {found}; {SPLIT}")

        heard.append(each)
        digests.append(blake2b(message.data).digest())

    with picture_streams.named_faults(topic, "topic"):
        time_s, order, notes = _ordered(heard, digests.__getitem__, by_arrival)

    names = tuple(f"{path}: {topic}[{nth}]" for nth in order.tolist())
    rows, columns = first.shape
    bits = 8 if first.dtype == np.uint8 else None
    times = FrameTimes(
        time_s, f"{'arrival' if by_arrival else 'header.stamp'} of {topic}"
    )
    scan = PictureSource(
        names,
        rows,
        columns,
        lambda: _pictures(path, topic, order.tolist()),
        bits=bits,
        times=times,
    )

    return replace(scan, notes=tuple(f"{topic}: {note}" for note in notes)).of_file(
        path
    )


def _pictures(
    path: Path, topic: str, order: Sequence[int]
) -> picture_streams.PictureStream:
    """Yield pictures in an order; pictures that arrived before their turn wait."""
    waiting: dict[int, NDArray[Any]] = {}
    wanted = set(order)
    turn = iter(order)
    due = next(turn)

    with _opened(path) as bag:
        connections = [
            each for each in bag.connections if each.topic == topic and each.msgcount
        ]
        for nth, (_, message) in enumerate(_messages(bag, connections)):
            if nth not in wanted:
                continue

            waiting[nth] = _image_pixels(message, f"{topic}[{nth}]")
            while due in waiting:
                yield waiting.pop(due)
                due = next(turn, -1)


def _log(
    path: Path,
    bag: Bag,
    connections: Sequence[BagConnection],
    by_arrival: bool,
) -> ForceLog:
    heard = []
    values = []
    topic = connections[0].topic

    for each, message in _messages(bag, connections):
        vectors = (
            (message.wrench.force, message.wrench.torque)
            if hasattr(message, "wrench")
            else (message.vector,)
        )
        values.append(
            [
                coordinate
                for vector in vectors
                for coordinate in (vector.x, vector.y, vector.z)
            ]
        )
        heard.append(each)

    wrench_sc = np.array(values, dtype=np.float64)
    with picture_streams.named_faults(topic, "topic"):
        time_s, order, notes = _ordered(
            heard, lambda nth: wrench_sc[nth].tobytes(), by_arrival
        )

    # what a sensor does not measure is NaN in ROS
    measured: Flags = np.asarray(~np.isnan(wrench_sc).all(axis=0))
    columns = tuple(np.array(FORCE_COLUMNS[1:])[: len(measured)][measured].tolist())

    return ForceLog(
        time_s,
        wrench_sc[order][:, measured],
        columns,
        tuple(Remark("log-mended", f"{path}: {topic}: {note}") for note in notes),
    )


PARTS_APART_S = 2.0  # between the parts of one recording


def joined_logs(logs: Sequence[tuple[Path, ForceLog]]) -> tuple[Path, ForceLog]:
    """Return the logs of a bag's parts as one; refuse those of several recordings."""
    first = logs[0][0]
    parts = sorted(logs, key=lambda part: float(part[1].time_s[0]))

    for (before_path, before), (path, after) in pairwise(parts):
        apart_s = float(after.time_s[0] - before.time_s[-1])
        if after.columns != before.columns or not 0.0 < apart_s <= PARTS_APART_S:
            found = f"its forces begin {apart_s:.3g} s after the end of {before_path}'s"
            if apart_s <= 0.0:
                found = f"its forces begin before those of {before_path} end"
            if after.columns != before.columns:
                found = f"its forces have other columns than those of {before_path}"
            raise InputError(
                f"{path}: {found}: another recording, or a part between them is"
                " missing; import one recording at a time"
            )

    each = [log for _, log in parts]
    return first, ForceLog(
        np.concatenate([log.time_s for log in each]),
        np.concatenate([log.wrench_sc for log in each]),
        each[0].columns,
        tuple(remark for log in each for remark in log.remarks),
    )
