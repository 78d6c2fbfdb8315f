"""Which frames Young's modulus was fitted on, from the file that `scleraforce calibrate` writes."""

import json
from pathlib import Path
from typing import Any

from scleraforce.errors import CalibrationError

__all__ = ["read_calibration_frames"]


def read_calibration_frames(path: Path) -> frozenset[tuple[str, str]]:
    """Return the frames that a calibration used, as (eye, file name).

    Raises:
        CalibrationError: the file is missing, not JSON, or does not list `eyes.{id}.frames`.
    """
    eyes = _read_json(path).get("eyes")
    if not isinstance(eyes, dict):
        raise CalibrationError(f"{path}: eyes: missing; give a file of `scleraforce calibrate`")
    return frozenset((eye, file) for eye, entry in eyes.items() for file in _files(path, eye, entry))


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_bytes())
    except OSError as fault:
        raise CalibrationError(f"{path}: {fault.strerror}; `scleraforce calibrate` writes this file") from fault
    except ValueError as fault:
        raise CalibrationError(f"{path}: not JSON: {fault}") from fault
    if not isinstance(content, dict):
        raise CalibrationError(f"{path}: not a JSON object; give a file of `scleraforce calibrate`")
    return content


def _files(path: Path, eye: str, entry: Any) -> list[str]:
    files = entry.get("frames") if isinstance(entry, dict) else None
    if not isinstance(files, list) or not all(isinstance(file, str) for file in files):
        raise CalibrationError(f"{path}: eyes.{eye}.frames: expected the names of the frames that were used")
    return files
