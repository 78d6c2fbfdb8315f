"""The file of a calibration: read whole, written whole or not at all."""

import json
from os import PathLike
from pathlib import Path
from typing import Any

from scleraforce.calibration.calibrate import Calibration
from scleraforce.calibration.files import calibration_as_json, parse_calibration
from scleraforce.whole_files import KINDS, read_text, write_whole

__all__ = ["read_posteriors", "write_calibration"]


def write_calibration(calibration: Calibration, path: Path) -> dict[str, Any]:
    """Write a calibration as JSON; return what was written.

    Raises:
        InputError: its folder cannot be written to.
    """
    content = calibration_as_json(calibration)
    write_whole(json.dumps(content, indent=1, allow_nan=False) + "\n", path)
    return content


def read_posteriors(path: str | PathLike[str]) -> Calibration:
    """Read a calibration file whole, to go on from it or to report it.

    Raises:
        CalibrationError: the file cannot be read, or `calibrate` has not written it.
    """
    return parse_calibration(read_text(Path(path), KINDS["calibration"]), str(path))
