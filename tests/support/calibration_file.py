"""A calibration file with what others read of it."""

import json
from collections.abc import Mapping
from typing import Any


def calibration_text(mean_mpa: Any = 0.27, eyes: Mapping[str, Any] | None = None, **keys: Any) -> str:
    """The JSON text; `eyes` maps ids to what an entry has other than the usual, `keys` replace the file's own."""
    usual = {"mean_mpa": mean_mpa, "sd_mpa": 0.005, "thickness_um": 700.0, "frames": [], "status": "ok"}
    content = {
        "format": 3,
        "mechanics": "finite-strain",
        "population": {"mean_mpa": mean_mpa, "sd_mpa": 0.03},
        "eyes": {name: {**usual, **entry} for name, entry in (eyes or {}).items()},
    }
    return json.dumps({**content, **keys})
