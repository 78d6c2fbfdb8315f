"""What was answered when a recording was imported, kept in its import.json for the next one."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from scleraforce.errors import RecordingError
from scleraforce.plain_json import parse_json
from scleraforce.recording.files import read_info
from scleraforce.units import from_si
from scleraforce.whole_files import FileKind, read_text

IMPORT_RECORD = "import.json"
KIND = FileKind(IMPORT_RECORD, 2**20, "`scleraforce import` writes it", RecordingError)
# Of sources of one laboratory; what is of one session or eye (times, offsets, the eye's name) is asked anew.
KEPT = ("axes", "array", "columns", "image_topic", "force_topic", "grey_range")


def import_record(answers: Mapping[str, Any], told: Mapping[str, Any]) -> str:
    """Return the text of an import.json.

    Args:
        answers: of options on how sources are read, by their names.
        told: what else is to be known: sources, where values come from, clocks, notes.
    """
    kept = {name: answers[name] for name in KEPT if answers.get(name)}
    return json.dumps({**told, "answers": kept}, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def answers_like(folder: Path) -> dict[str, Any]:
    """Return answers by the names of options: another recording's scanner, needle, sensor, and how it was imported.

    Raises:
        RecordingError: its recording.toml or import.json cannot be used.
    """
    info = read_info(folder / "recording.toml")
    found: dict[str, Any] = {
        "width_mm": from_si(info.oct.width_m, "mm"),
        "depth_mm": from_si(info.oct.depth_m, "mm"),
        "refractive_index": info.oct.refractive_index,
        "bits": info.oct.bits,
        "gauge": info.needle.gauge,
        "gap_mm": from_si(info.needle.slice_gap_m, "mm"),
    }
    if info.force is not None:
        force = info.force
        found |= {"axis": force.axis, "contact_sign": str(force.contact_sign), "average_s": force.average_s}
    return found | _kept(folder / IMPORT_RECORD)


def clock_origin_s(folder: Path) -> float:
    """Return where a recording's clock begins on that of the sources it was imported from; else 0.

    Raises:
        RecordingError: its import.json cannot be used.
    """
    origin_s = _read(folder / IMPORT_RECORD).get("clock_origin_s", 0.0)
    if isinstance(origin_s, bool) or not isinstance(origin_s, int | float):
        raise RecordingError(f"{folder / IMPORT_RECORD}: clock_origin_s: {origin_s!r} is not a number")
    return float(origin_s)


def _kept(path: Path) -> dict[str, Any]:
    answers = _read(path).get("answers", {})
    if not isinstance(answers, dict):
        raise RecordingError(f"{path}: answers: expected an object")
    return {name: answers[name] for name in KEPT if name in answers}


def _read(path: Path) -> dict[str, Any]:
    """Return what an import.json says; nothing where there is none."""
    if not path.exists():
        return {}
    try:
        found = parse_json(read_text(path, KIND))
    except ValueError as fault:
        raise RecordingError(f"{path}: {fault}") from fault
    if not isinstance(found, dict):
        raise RecordingError(f"{path}: expected an object, as `scleraforce import` writes it")
    return found
