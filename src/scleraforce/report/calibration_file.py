"""The file of a calibration, written whole or not at all."""

import json
from pathlib import Path
from typing import Any

from scleraforce.calibration.calibrate import Calibration
from scleraforce.calibration.files import calibration_as_json
from scleraforce.whole_files import write_whole

__all__ = ["write_calibration"]


def write_calibration(calibration: Calibration, path: Path) -> dict[str, Any]:
    """Write a calibration as JSON; return what was written.

    Raises:
        InputError: its folder cannot be written to.
    """
    content = calibration_as_json(calibration)
    write_whole(json.dumps(content, indent=1, allow_nan=False) + "\n", path)
    return content
