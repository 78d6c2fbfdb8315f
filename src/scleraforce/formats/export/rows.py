"""One row for each frame: its time and label from the recording, what was read of it from an answer file."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import Any

from scleraforce.errors import InputError
from scleraforce.plain_json import parse_json
from scleraforce.recording.files import Recording
from scleraforce.recording.labels import label_frames
from scleraforce.study import ClassesStudy
from scleraforce.units import from_si
from scleraforce.whole_files import KINDS, read_text

__all__ = ["Row", "csv_text", "flat", "frame_rows", "read_answers", "with_answers"]

Row = dict[str, Any]


def frame_rows(recording: Recording, classes: ClassesStudy) -> list[Row]:
    """Return file, time, whether it was pierced, and the label of each frame; no label without a force log.

    Raises:
        RecordingError: the log does not go with the frames.
    """
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
    """Return the frames of what `evaluate --json`, `classify --json` or `segment --json` printed.

    Raises:
        InputError: it is no such file.
    """
    try:
        found = parse_json(read_text(path, KINDS["result"]))
    except ValueError as fault:
        raise InputError(f"{path}: {fault}") from fault
    frames = found.get("frames") if isinstance(found, dict) else None
    if not isinstance(frames, list) or not all(map(_is_answer, frames)):
        raise InputError(
            f"{path}: no frames with a file each; give what evaluate, classify or segment print with --json"
        )
    return frames


def with_answers(rows: Sequence[Row], answers: Sequence[Row], recording: Path) -> list[Row]:
    """Return rows with the answers to their frames added; what the recording states is not replaced.

    A class counts as the model's study bounds it: where answers have a target, it is theirs.

    Raises:
        InputError: no answer is to a frame of the recording.
    """
    names = {Path(row["file"]).name for row in rows}
    alone = len(names) == len(rows)  # else folders below frames/ tell frames of one name apart

    def key(row: Row) -> str:
        return Path(row["file"]).name if alone else row["file"]

    by_file = {key(answer): answer for answer in answers if _is_of(answer, recording)}
    if not by_file.keys() & set(map(key, rows)):
        raise InputError(f"{recording}: none of its frames is among the answers")
    return [_with_answer(row, by_file.get(key(row), {})) for row in rows]


def _with_answer(row: Row, answer: Row) -> Row:
    return {**answer, **row, "target": answer.get("target", row["target"])}


def flat(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row whose lists and objects are columns of their own.

    >>> flat({"file": "a.png", "interval_mn": [1.0, 2.0], "needle": {"angle_deg": 30.0}})
    {'file': 'a.png', 'interval_mn_0': 1.0, 'interval_mn_1': 2.0, 'needle_angle_deg': 30.0}
    """
    columns: dict[str, Any] = {}
    for key, value in row.items():
        inner = dict(enumerate(value)) if isinstance(value, list) else value
        if isinstance(inner, Mapping):
            columns |= {f"{key}_{name}": entry for name, entry in flat({str(n): v for n, v in inner.items()}).items()}
        else:
            columns[key] = value
    return columns


def csv_text(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return rows as a table: a column for each key of any row, empty where a row has none."""
    flattened = [flat(row) for row in rows]
    names = dict.fromkeys(name for row in flattened for name in row)
    text = StringIO()
    writer = csv.DictWriter(text, list(names), restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _cell(value) for name, value in row.items()} for row in flattened)
    return text.getvalue()


def _cell(value: Any) -> Any:
    return int(value) if isinstance(value, bool) else "" if value is None else value


def _is_answer(frame: Any) -> bool:
    """Return whether an entry says which file, and if at all in words which recording, it is of."""
    if not isinstance(frame, dict) or not isinstance(frame.get("file"), str):
        return False
    return isinstance(frame.get("recording"), str | None)


def _is_of(answer: Row, recording: Path) -> bool:
    """Return whether an answer is to a frame of a recording; one that names none is taken for it."""
    named = answer.get("recording")
    return named is None or Path(named).resolve() == recording.resolve() or Path(named).name == recording.resolve().name
