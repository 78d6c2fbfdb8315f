"""Recordings and answers in the formats of other programs: CSV, JSON, 3D Slicer's .seq.nrrd and MCAP."""

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from scleraforce import __version__
from scleraforce.errors import InputError
from scleraforce.plain_json import parse_json
from scleraforce.recording.folder import Recording
from scleraforce.recording.labels import label_frames
from scleraforce.recording.scan import check_bytes, package_for
from scleraforce.recording.tables import FORCE_COLUMNS
from scleraforce.study import ClassesStudy
from scleraforce.units import from_si
from scleraforce.whole_files import KINDS, read_text, renamed_when_whole

Row = dict[str, Any]

# Lists of two numbers, and the columns that they become.
PAIRS = {"interval_mn": ("interval_low_mn", "interval_high_mn"), "tip_mm": ("tip_lateral_mm", "tip_depth_mm")}
FORMULA_BEGINS = ("=", "+", "-", "@", "\t", "\r", "\n")  # of cells that spreadsheets evaluate ("CSV injection")


def frame_rows(recording: Recording, classes: ClassesStudy) -> list[Row]:
    """Return file, time, piercing and label of each frame; no label without a force log."""
    trials = label_frames(recording, classes)
    return [
        {
            "file": frame.file,
            "time_s": frame.time_s,
            "pierced": frame.pierced,
            "measured_force_mn": from_si(trial.measured_force_n, "mn"),
            "target": trial.target,
        }
        for frame, trial in zip(recording.frames, trials, strict=True)
    ]


def read_answers(path: Path) -> list[Row]:
    """Return the frames that `evaluate --json`, `read --json` or `segment --json` printed."""
    try:
        found = parse_json(read_text(path, KINDS["result"]))
    except ValueError as fault:
        raise InputError(f"{path}: {fault}") from fault
    frames = found.get("frames") if isinstance(found, dict) else None
    if not isinstance(frames, list) or not all(map(_is_answer, frames)):
        raise InputError(f"{path}: no frames with a file each; give what evaluate, read or segment print with --json")
    return frames


def with_answers(rows: Sequence[Row], answers: Sequence[Row], recording: Path) -> list[Row]:
    """Return rows with the answers to their frames added; what the recording states is not replaced.

    A class depends on the model's study: an answer's target takes precedence.
    """
    names = {Path(row["file"]).name for row in rows}
    alone = len(names) == len(rows)  # else folders below frames/ tell frames of one name apart

    def key(row: Row) -> str:
        return Path(row["file"]).name if alone else row["file"]

    by_file = {key(answer): answer for answer in answers if _is_of(answer, recording)}
    if not by_file.keys() & set(map(key, rows)):
        raise InputError(f"{recording}: none of its frames is among the answers")
    pairs = ((row, by_file.get(key(row), {})) for row in rows)
    return [{**answer, **row, "target": answer.get("target", row["target"])} for row, answer in pairs]


def flat(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row whose lists and objects are columns of their own.

    The ends of an interval and the coordinates of a place have the names that they have in `mcap_log`.

    >>> flat({"file": "a.png", "interval_mn": [1.0, 2.0], "needle": {"tip_mm": [0.5, 3.0]}, "probabilities": [1.0]})
    ... # doctest: +NORMALIZE_WHITESPACE
    {'file': 'a.png', 'interval_low_mn': 1.0, 'interval_high_mn': 2.0, 'needle_tip_lateral_mm': 0.5,
     'needle_tip_depth_mm': 3.0, 'probabilities_0': 1.0}
    """
    columns: dict[str, Any] = {}
    for key, value in row.items():
        if key in PAIRS:
            columns |= zip(PAIRS[key], value if isinstance(value, list) else (None, None), strict=False)
        elif isinstance(value, Mapping | list):
            inner = dict(enumerate(value)) if isinstance(value, list) else value
            columns |= {f"{key}_{name}": entry for name, entry in flat({str(n): v for n, v in inner.items()}).items()}
        else:
            columns[key] = value
    return columns


def csv_text(rows: Iterable[Mapping[str, Any]]) -> str:
    r"""Return rows as a table: a column for each key of any row, empty where a row has none.

    Texts that a spreadsheet would take for a formula get an apostrophe in front.

    >>> csv_text([{"file": "=1+1.png", "force_mn": -2.5}])
    "file,force_mn\n'=1+1.png,-2.5\n"
    """
    flattened = [flat(row) for row in rows]
    every = dict.fromkeys(name for row in flattened for name in row)
    filled = {name for row in flattened for name, value in row.items() if value is not None}
    # What is null in one row and an object in another has the object's columns only.
    names = [name for name in every if name in filled or not any(other.startswith(f"{name}_") for other in every)]
    return _line(names) + "".join(_line(row.get(name) for name in names) for row in flattened)


def _line(cells: Iterable[Any]) -> str:
    """Return a line; `csv` quotes the letters of the line's own end alone, so it is given both."""
    text = StringIO()
    csv.writer(text, lineterminator="\r\n").writerow(map(_cell, cells))
    return text.getvalue().removesuffix("\r\n") + "\n"


def _cell(value: Any) -> Any:
    if isinstance(value, str):
        return f"'{value}" if value.startswith(FORMULA_BEGINS) else value
    return int(value) if isinstance(value, bool) else "" if value is None else value


def _is_answer(frame: Any) -> bool:
    """Return whether an entry names a file and, if it names a recording, does so in words."""
    if not isinstance(frame, dict) or not isinstance(frame.get("file"), str):
        return False
    return isinstance(frame.get("recording"), str | None)


def _is_of(answer: Row, recording: Path) -> bool:
    """Return whether an answer is to a frame of a recording; an answer without a recording is taken as one."""
    named = answer.get("recording")
    return named is None or Path(named).resolve() == recording.resolve() or Path(named).name == recording.resolve().name


SLICE_MM = 0.1  # as thick as a B-scan is drawn; it has no thickness of its own
NOWHERE = [np.nan] * 3


def write_sequence(recording: Recording, path: Path) -> None:
    """Write a recording's frames as NRRD; lateral runs to the patient's left, depth to the back."""
    nrrd = package_for("nrrd", "NRRD")
    oct_info = recording.info.oct
    check_bytes(len(recording.frames) * oct_info.rows * oct_info.columns * 2)
    shape = (oct_info.columns, oct_info.rows, 1, len(recording.frames))
    volume = np.empty(shape, dtype=np.uint16, order="F")
    for nth, entry in enumerate(recording.frames):
        volume[:, :, 0, nth] = recording.frame(entry).T
    lateral_mm = from_si(oct_info.width_m / oct_info.columns, "mm")
    depth_mm = from_si(oct_info.depth_m / oct_info.rows, "mm")
    header = {
        "space": "left-posterior-superior",
        "space directions": np.array([[lateral_mm, 0, 0], [0, depth_mm, 0], [0, 0, SLICE_MM], NOWHERE]),
        "space units": ["mm", "mm", "mm"],
        "space origin": np.zeros(3),
        "kinds": ["domain", "domain", "domain", "list"],
        "labels": ["lateral", "depth", "", "time"],
        "units": ["", "", "", "s"],
        "encoding": "raw",
        "axis 3 index type": "numeric",
        "axis 3 index values": " ".join(f"{entry.time_s:.6f}" for entry in recording.frames),
        "DataNodeClassName": "vtkMRMLScalarVolumeNode",
    }
    with renamed_when_whole(path) as part, part.open("wb") as file:
        nrrd.write(file, volume, header, index_order="F")


IMAGE_TOPIC, FORCE_TOPIC, ANSWER_TOPIC = "/oct/image", "/force/wrench", "/scleraforce/answer"
IMAGE, WRENCH, ANSWER = "sensor_msgs/msg/Image", "geometry_msgs/msg/WrenchStamped", "scleraforce_msgs/msg/Answer"
TOPIC_KINDS = {IMAGE_TOPIC: IMAGE, FORCE_TOPIC: WRENCH, ANSWER_TOPIC: ANSWER}
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
    """Write frames (mono16), the force log, and the frames' rows, all with the recording's times.

    `origin_s` is the beginning of the recording's clock on its sources' clock.
    """
    writing = package_for("mcap.writer", "MCAP")
    typesys = package_for("rosbags.typesys", "MCAP with ROS messages")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    store.register(typesys.get_types_from_msg(ANSWER_DEFINITION, ANSWER))
    with renamed_when_whole(path) as part, part.open("wb") as file:
        writer = writing.Writer(file)
        writer.start(profile="ros2", library=f"scleraforce {__version__}")
        channels = {
            topic: writer.register_channel(topic, "cdr", _ros_schema(writer, store, kind))
            for topic, kind in TOPIC_KINDS.items()
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
