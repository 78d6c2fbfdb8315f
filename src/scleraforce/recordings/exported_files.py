"""Recordings and answers in the formats of other programs: CSV, JSON, 3D Slicer's
.seq.nrrd and MCAP.
"""

import csv
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from scleraforce.base.errors import InputError
from scleraforce.base.notebook_cards import Row, tidy
from scleraforce.base.optional_packages import package_for
from scleraforce.base.plain_json import parse_json
from scleraforce.base.units import from_si
from scleraforce.base.version import __version__
from scleraforce.base.whole_files import (
    KINDS,
    read_text,
    renamed_when_whole,
    write_whole,
)
from scleraforce.recordings.forces_under_frames import label_frames
from scleraforce.recordings.formats.picture_streams import check_bytes
from scleraforce.recordings.frame_and_force_tables import FORCE_COLUMNS
from scleraforce.recordings.recording_folder import Recording
from scleraforce.records.study import ClassesStudy

# Where spreadsheets see the beginning of a formula ("CSV injection"): at the start of a
# text, and behind what separates cells in another country's tables. The last four signs
# are the wide forms of the first.
FORMULA_BEGIN = re.compile(
    r"(?:^|(?<=[;,|\t\r\n]))(?=\s*[=+\-@\uff1d\uff0b\uff0d\uff20])|^(?=[\t\r\n])"
)


def frame_rows(recording: Recording, classes: ClassesStudy) -> list[Row]:
    """Return file, time, plane if there are several, piercing and label of each frame;
    no label without a force log.
    """
    planes = bool(recording.info.scan.planes)
    each = zip(recording.frames, label_frames(recording, classes), strict=True)
    return [
        {
            "file": frame.file,
            "time_s": frame.time_s,
            **({"plane": frame.plane} if planes else {}),
            "pierced": bool(frame.pierced),
            "measured_force_mn": from_si(trial.measured_force_n, "mn"),
            "target": trial.target,
        }
        for frame, trial in each
    ]


def read_answers(path: Path) -> list[Row]:
    """Return the frames that `evaluate`, `read` or `segment` printed as JSON."""
    try:
        found = parse_json(read_text(path, KINDS["result"]))
    except ValueError as fault:
        raise InputError(f"{path}: {fault}") from fault

    frames = found.get("frames") if isinstance(found, dict) else None
    if not isinstance(frames, list) or not all(
        isinstance(each, dict)
        and isinstance(each.get("file"), str)
        and isinstance(each.get("recording"), str | None)
        for each in frames
    ):
        raise InputError(
            f"{path}: no frames with a file each; give what evaluate, read or segment"
            " print with `json`"
        )

    return frames


def with_answers(
    rows: Sequence[Row], answers: Sequence[Row], recording: Path
) -> list[Row]:
    """Return rows with the answers to their frames; what the recording states stays,
    but a target is the answer's.
    """
    # else folders tell frames of one name apart
    alone = len({Path(row["file"]).name for row in rows}) == len(rows)
    asked, files = (
        [Path(row["file"]).name if alone else row["file"] for row in each]
        for each in (rows, answers)
    )
    here = recording.resolve()

    by_file = {
        file: each
        for file, each in zip(files, answers, strict=True)
        if (named := each.get("recording")) is None
        or Path(named).resolve() == here
        or Path(named).name == here.name
    }
    if not by_file.keys() & set(asked):
        raise InputError(f"{recording}: none of its frames is among the answers")

    found = [by_file.get(file, {}) for file in asked]
    pairs = zip(rows, found, strict=True)
    return [
        {**answer, **row, "target": answer.get("target", row["target"])}
        for row, answer in pairs
    ]


def csv_text(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return rows as a table, empty where a row lacks a key; an apostrophe goes before
    each would-be formula.
    """
    found = tidy(rows)
    return _line(found[0] if found else ()) + "".join(
        _line(row.values()) for row in found
    )


def write_table(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Write rows as CSV, or as Parquet (with pyarrow), by the file's ending, whole or
    not at all.
    """
    if path.suffix.lower() == ".csv":
        write_whole(csv_text(rows), path)
        return

    pyarrow, parquet = (
        package_for(name, ".parquet") for name in ("pyarrow", "pyarrow.parquet")
    )
    with renamed_when_whole(path) as part:
        parquet.write_table(pyarrow.Table.from_pylist(tidy(rows)), part)


def _line(cells: Iterable[Any]) -> str:
    """Return a line; `csv` quotes the letters of the line's own end alone, so it is
    given both.
    """
    text = StringIO()
    csv.writer(text, lineterminator="\r\n").writerow(map(_cell, cells))
    return text.getvalue().removesuffix("\r\n") + "\n"


def _cell(value: Any) -> Any:
    if isinstance(value, str):
        return FORMULA_BEGIN.sub("'", value)
    return int(value) if isinstance(value, bool) else "" if value is None else value


SLICE_MM = 0.1  # as thick as a B-scan is drawn; it has no thickness of its own
NOWHERE = [np.nan] * 3


def write_sequence(recording: Recording, path: Path) -> None:
    """Write a recording's frames as NRRD; lateral runs to the patient's left, depth to
    the back.
    """
    nrrd = package_for("nrrd", "NRRD")
    scan = recording.info.scan
    rows, columns = scan.shape
    check_bytes(len(recording.frames) * rows * columns * 2)
    shape = (columns, rows, 1, len(recording.frames))
    volume = np.empty(shape, dtype=np.uint16, order="F")

    for nth, entry in enumerate(recording.frames):
        volume[:, :, 0, nth] = recording.frame(entry).T

    scale = scan.scale
    sides_mm = np.diag(
        [from_si(scale.lateral_m, "mm"), from_si(scale.depth_m, "mm"), SLICE_MM]
    )
    header = {
        "space": "left-posterior-superior",
        "space directions": np.array([*sides_mm, NOWHERE]),
        "space units": ["mm", "mm", "mm"],
        "space origin": np.zeros(3),
        "kinds": ["domain", "domain", "domain", "list"],
        "labels": ["lateral", "depth", "", "time"],
        "units": ["", "", "", "s"],
        "encoding": "raw",
        "axis 3 index type": "numeric",
        "axis 3 index values": " ".join(
            f"{entry.time_s:.6f}" for entry in recording.frames
        ),
        "DataNodeClassName": "vtkMRMLScalarVolumeNode",
    }

    with renamed_when_whole(path) as part, part.open("wb") as file:
        nrrd.write(file, volume, header, index_order="F")


IMAGE_TOPIC = "/oct/image"
FORCE_TOPIC = "/force/wrench"
ANSWER_TOPIC = "/scleraforce/answer"
IMAGE = "sensor_msgs/msg/Image"
WRENCH = "geometry_msgs/msg/WrenchStamped"
ANSWER = "scleraforce_msgs/msg/Answer"
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


def write_mcap(
    recording: Recording, rows: Sequence[Row], origin_s: float, path: Path
) -> None:
    """Write frames (mono16), force log and rows; the recording's clock begins at
    `origin_s` of its sources'.
    """
    writing = package_for("mcap.writer", "MCAP")
    typesys = package_for("rosbags.typesys", "MCAP with ROS messages")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    store.register(typesys.get_types_from_msg(ANSWER_DEFINITION, ANSWER))

    with renamed_when_whole(path) as part, part.open("wb") as file:
        writer = writing.Writer(file)
        writer.start(profile="ros2", library=f"scleraforce {__version__}")
        channels = {}

        for topic, kind in TOPIC_KINDS.items():
            definition, _ = store.generate_msgdef(kind, ros_version=ROS)
            schema = writer.register_schema(kind, "ros2msg", definition.encode())
            channels[topic] = writer.register_channel(topic, "cdr", schema)

        for time_ns, topic, message in _messages(recording, rows, origin_s, store):
            data = bytes(store.serialize_cdr(message, TOPIC_KINDS[topic]))
            writer.add_message(channels[topic], time_ns, data, time_ns)

        writer.finish()


def _messages(
    recording: Recording, rows: Sequence[Row], origin_s: float, store: Any
) -> Iterator[tuple[int, str, Any]]:
    """Yield time, topic and message in the order of their times; each frame is read
    when its turn comes.
    """
    log = recording.forces
    frames_s = [entry.time_s for entry in recording.frames]
    times_s = {
        IMAGE_TOPIC: frames_s,
        ANSWER_TOPIC: frames_s,
        FORCE_TOPIC: [] if log is None else log.time_s.tolist(),
    }
    origin_ns = round(origin_s) * SECOND_NS
    events = [
        (round(each * SECOND_NS) + origin_ns, topic, nth)
        for topic, topic_times_s in times_s.items()
        for nth, each in enumerate(topic_times_s)
    ]

    for time_ns, topic, nth in sorted(events):
        stamp = store.types["builtin_interfaces/msg/Time"](*divmod(time_ns, SECOND_NS))
        header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="oct")

        if topic == IMAGE_TOPIC:
            pixels = np.ascontiguousarray(
                recording.frame(recording.frames[nth]), dtype="<u2"
            )
            height, width = pixels.shape
            data = pixels.view(np.uint8).ravel()
            yield (
                time_ns,
                topic,
                store.types[IMAGE](header, height, width, "mono16", 0, 2 * width, data),
            )
        elif topic == ANSWER_TOPIC:
            yield time_ns, topic, _answer(rows[nth], header, store)
        elif log is not None:
            found = dict(zip(log.columns, log.wrench_sc[nth].tolist(), strict=True))
            # zero would be a measurement
            values = [found.get(name, np.nan) for name in FORCE_COLUMNS[1:]]
            vector, wrench = (
                store.types[f"geometry_msgs/msg/{name}"]
                for name in ("Vector3", "Wrench")
            )
            sample = wrench(force=vector(*values[:3]), torque=vector(*values[3:]))
            yield time_ns, topic, store.types[WRENCH](header=header, wrench=sample)


def _answer(row: Row, header: Any, store: Any) -> Any:
    low_mn, high_mn = row.get("interval_mn") or (None, None)
    forces = {
        name: row.get(name) for name in ("measured_force_mn", "predicted_force_mn")
    }
    forces |= {"interval_low_mn": low_mn, "interval_high_mn": high_mn}

    return store.types[ANSWER](
        header=header,
        file=str(row["file"]),
        **{name: bool(row.get(name)) for name in ("pierced", "usable")},
        **{
            name: float("nan") if value is None else float(value)
            for name, value in forces.items()
        },
        **{
            name: -1 if row.get(name) is None else int(row[name])
            for name in ("target", "predicted")
        },
    )
