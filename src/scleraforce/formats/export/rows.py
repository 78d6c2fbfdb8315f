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

Row = dict[str, Any]

# Lists of two numbers, and the columns that they become.
PAIRS = {
    "interval_mn": ("interval_low_mn", "interval_high_mn"),
    "tip_mm": ("tip_lateral_mm", "tip_depth_mm"),
}
FORMULA_BEGINS = (
    "=",
    "+",
    "-",
    "@",
    "\t",
    "\r",
    "\n",
)  # of cells that spreadsheets evaluate ("CSV injection")


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
    """Return whether an entry says which file, and if at all in words which recording, it is of."""
    if not isinstance(frame, dict) or not isinstance(frame.get("file"), str):
        return False
    return isinstance(frame.get("recording"), str | None)


def _is_of(answer: Row, recording: Path) -> bool:
    """Return whether an answer is to a frame of a recording; one that names none is taken for it."""
    named = answer.get("recording")
    return named is None or Path(named).resolve() == recording.resolve() or Path(named).name == recording.resolve().name
