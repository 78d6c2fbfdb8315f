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

__all__ = ["IMPORT_RECORD", "answers_like", "import_record"]

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


def _kept(path: Path) -> dict[str, Any]:
    if not path.exists():
        return {}
    try:
        answers = parse_json(read_text(path, KIND))["answers"]
        return {name: answers[name] for name in KEPT if name in answers}
    except (ValueError, TypeError, KeyError) as fault:
        raise RecordingError(f"{path}: not what `scleraforce import` writes: {fault}") from fault
