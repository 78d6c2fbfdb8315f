"""Young's modulus of each eye: with and without forces, other parameters, the paper's
mechanics, several eyes.
"""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import scleraforce as sf
from golden.answers import Answers, Record, plain
from golden.inputs import COARSE, MOVING

TOGETHER = "three eyes"
SEVERAL = ("plain", "sealed", "uneven")

Calibrate = Callable[[Path], Any]
WAYS: Mapping[str, Calibrate] = {
    "three frames": lambda path: sf.calibrate(path, frames=3),
    "all frames": lambda path: sf.calibrate(path),
    "without force": lambda path: sf.calibrate(path, without_force=True),
    "linear": lambda path: sf.calibrate(
        path, sf.parse_study(COARSE), frames=3, mechanics="linear"
    ),
    "E and thickness": lambda path: sf.calibrate(
        path, frames=3, parameters=["e", "thickness"]
    ),
}
COSTLY = ("linear", "E and thickness")  # of these recordings only:
COSTLY_OF = ("plain", "sealed", "sample-a")


def answers(name: str, recordings: dict[str, Path], _folder: Path) -> Answers:
    """Return the calibrations of a recording, or of several eyes together."""
    if name == TOGETHER:
        paths = [recordings[eye] for eye in SEVERAL]
        return _calibrations(TOGETHER, lambda: sf.calibrate(paths, frames=3))
    found: Answers = {}
    for words, calibrate in WAYS.items():
        if words not in COSTLY or name in COSTLY_OF:
            way = partial(calibrate, recordings[name])
            found |= _calibrations(f"{name}/{words}", way)
    return found


def _calibrations(name: str, calibrate: Callable[[], Any]) -> Answers:
    """Return the record of each eye of a calibration, and of the population; the
    message where none was found.
    """
    try:
        found = calibrate().to_dict()
    except sf.InputError as fault:
        return {name: {"error": str(fault).rpartition("/")[2]}}
    eyes = {f"{name}/{eye}": _eye(entry) for eye, entry in found["eyes"].items()}
    population = {
        key: plain(found["population"][key]) for key in ("mean_mpa", "sd_mpa", "eyes")
    }
    return {**eyes, f"{name}/population": population}


def _eye(entry: Mapping[str, Any]) -> Record:
    """Return what a calibration says of an eye; other parameters by their names."""
    globe = entry["globe"] or {}
    rigidity = globe.get("rigidity_mmhg13_per_ul") or {}
    relaxation = entry["relaxation"] or {}
    discrepancy = entry["discrepancy"] or {}
    record = {
        "mean_mpa": entry["mean_mpa"],
        "sd_mpa": entry["sd_mpa"],
        "status": entry["status"],
        "updates": entry["updates"],
        "stiffening_parameter": entry["stiffening"],
        "thickness_um": entry["thickness_um"],
        "globe": globe.get("kind"),
        "rigidity_parameter": [rigidity.get("mean"), rigidity.get("sd")],
        "relaxation_share": relaxation.get("shares"),
        "held_share": relaxation.get("held"),
        "discrepancy_share": [discrepancy.get("level"), discrepancy.get("growth")],
        "by_class_mpa": entry["by_class_mpa"],
        "frames": [frame["file"] for frame in entry["frames"]],
        "skipped": [
            f"{step['file']}: {step['skipped']}"
            for step in entry["steps"]
            if step["skipped"]
        ],
    }
    return {key: plain(value) for key, value in record.items()}


def calibration_file(name: str, recording: Path, folder: Path) -> Path | None:
    """Write the calibration that the doors read with; None of a recording that has none
    of its own.
    """
    if name == MOVING:
        return None  # its labels average over more than a hold
    path = folder / f"{name}.calibration.json"
    if not path.exists():
        sf.calibrate(recording, frames=3, out=path)
    return path
