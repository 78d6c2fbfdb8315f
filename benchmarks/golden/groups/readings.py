"""Force, interval, class and reason of each frame, as `evaluate` answers; tests hold
every other way of reading to these answers.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import scleraforce as sf
from golden.answers import Answers, plain
from golden.groups.calibrations import calibration_file

UNCALIBRATED = " uncalibrated"  # read with no calibration: E is not known
# and the shared
UNCALIBRATED_OF = ("plain", "sealed", "damaged", "relaxing", "leaking")
CLASSIFIER = " by the classifier"  # the paper's model
CLASSIFIER_OF = ("plain",)
# value -> key of a frame in the JSON of `evaluate`
FRAME = {
    "class": "predicted",
    "force_mn": "predicted_force_mn",
    "class_share": "probabilities",
    "used_mpa": "youngs_modulus_mpa",
    **{
        name: name
        for name in (
            "usable",
            "reason",
            "interval_mn",
            "contact_mm",
            "contact_depth_mm",
            "dent_mm",
            "gap_mm",
            "lean_deg",
            "elastic_force_mn",
            "time_to_bound_ms",
            "pressure_pa",
            "conjunctiva_um",
            "contact_xyz_mm",
            "wall",
            "can_calibrate",
            "warnings",
            "measured_force_mn",
            "measured_force_sd_mn",
            "target",
            "calibration",
            "excluded",
            "modulus_source",
        )
    },
}
METRICS = {
    "accuracy_share": "accuracy",
    "confusion": "confusion",
    "error_mn": "mae_mn",
    "coverage_share": "coverage",
    "notes": "notes",
}


def names(recordings: Mapping[str, Path], virtual: Mapping[str, object]) -> list[str]:
    """Return the names of the pieces of work, the longest first."""
    uncalibrated = [
        f"{name}{UNCALIBRATED}"
        for name in recordings
        if name in UNCALIBRATED_OF or name not in virtual
    ]
    classified = [f"{name}{CLASSIFIER}" for name in CLASSIFIER_OF]
    return [*list(recordings)[::-1], *uncalibrated, *classified]


def answers(name: str, recordings: dict[str, Path], folder: Path) -> Answers:
    """Return the answers to a recording's frames, and the metrics of them all."""
    eye = name.removesuffix(UNCALIBRATED).removesuffix(CLASSIFIER)
    recording = recordings[eye]
    is_calibrated = name == eye
    evaluated = sf.evaluate(
        "paper" if name.endswith(CLASSIFIER) else "default",
        recording,
        calibration_file(eye, recording, folder) if is_calibrated else None,
    ).to_dict()
    found = {
        f"{name}/{frame['file']}": _record(FRAME, frame)
        | {"needle_deg": plain((frame["needle"] or {}).get("angle_deg"))}
        for frame in evaluated["frames"]
    }
    return found | {f"{name}/metrics": _record(METRICS, evaluated)}


def _record(names: Mapping[str, str], entry: Mapping[str, Any]) -> dict[str, Any]:
    return {value: plain(entry.get(key)) for value, key in names.items()}
