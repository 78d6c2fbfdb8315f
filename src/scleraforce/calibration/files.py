"""The file that `calibrate` writes: JSON, with all that is needed to go on from it."""

from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from scleraforce import __version__
from scleraforce.calibration.assimilation import SHARED, EyeState
from scleraforce.calibration.calibrate import Calibration, EyeCalibration, FrameRecord, UsedRecording
from scleraforce.calibration.registration import PoseBelief
from scleraforce.calibration.roukf import Posterior
from scleraforce.calibration.summary import FORMAT, parse_content
from scleraforce.errors import CalibrationError
from scleraforce.whole_files import KINDS, read_text

__all__ = ["calibration_as_json", "parse_calibration", "read_posteriors"]


def calibration_as_json(calibration: Calibration) -> dict[str, Any]:
    """Return a calibration as it stands in its file and in `calibrate --json`."""
    mean_pa, sd_pa = calibration.population
    return {
        "format": FORMAT,
        "scleraforce": __version__,
        "mechanics": calibration.mechanics,
        "study_sha256": calibration.study_sha256,
        "population": {"mean_mpa": mean_pa / 1e6, "sd_mpa": sd_pa / 1e6, "eyes": len(calibration.eyes)},
        "class_bounds_n": list(calibration.bounds_n),
        "eyes": {name: _eye(eye, calibration.bounds_n) for name, eye in calibration.eyes.items()},
    }


def _eye(eye: EyeCalibration, bounds_n: tuple[float, ...]) -> dict[str, Any]:
    posterior, belief = eye.state.posterior, eye.state.belief
    return {
        "mean_mpa": eye.mean_pa / 1e6,
        "sd_mpa": eye.sd_pa / 1e6,
        "thickness_um": eye.thickness_m * 1e6,
        "updates": posterior.updates,
        "status": eye.status,
        "by_class_mpa": [None if value is None else value / 1e6 for value in eye.by_class(bounds_n)],
        "recording": eye.recordings[0].path,
        "frames": [frame.file for frame in eye.used],
        "parameters": {
            name: {"mean": mean, "sd": sd} for name, mean, sd in zip(eye.names, eye.means, eye.sds, strict=True)
        },
        "recordings": [vars(entry) for entry in eye.recordings],
        "steps": [vars(frame) for frame in eye.frames],
        "state": {
            "mean": posterior.mean.tolist(),
            "factor": posterior.factor.tolist(),
            "precision": posterior.precision.tolist(),
            "updates": posterior.updates,
            "recent": [list(entry) for entry in posterior.recent],
            "belief_mean": belief.mean.tolist(),
            "belief_covariance": belief.covariance.tolist(),
            "shared": list(SHARED),
            "sensitivity": eye.state.sensitivity.tolist(),
            "zero_covariance": eye.state.zero_covariance.tolist(),
        },
    }


def read_posteriors(path: str | PathLike[str]) -> Calibration:
    """Read a calibration file whole, to go on from it or to report it.

    Raises:
        CalibrationError: the file cannot be read, or is none of `calibrate`.
    """
    return parse_calibration(read_text(Path(path), KINDS["calibration"]), str(path))


def parse_calibration(text: str, name: str = "calibration") -> Calibration:
    """Read a calibration from its text; `name` stands in the messages.

    Raises:
        CalibrationError: naming the file and the key.
    """
    content = parse_content(text, name)
    try:
        eyes = {eye_id: _parse_eye(eye_id, entry) for eye_id, entry in content["eyes"].items()}
        bounds_n = tuple(float(bound) for bound in content["class_bounds_n"])
        return Calibration(eyes, content["study_sha256"], bounds_n, content["mechanics"])
    except KeyError as fault:
        raise CalibrationError(f"{name}: {fault.args[0]}: missing; give a file of `scleraforce calibrate`") from fault
    except (TypeError, ValueError, AttributeError) as fault:
        raise CalibrationError(f"{name}: {fault}; give a file of `scleraforce calibrate`") from fault


def _parse_eye(eye_id: str, entry: dict[str, Any]) -> EyeCalibration:
    state, parameters = entry["state"], entry["parameters"]
    posterior = Posterior(
        _array(state, "mean"),
        _array(state, "factor"),
        _array(state, "precision"),
        int(state["updates"]),
        tuple((float(nis), int(count)) for nis, count in state["recent"]),
    )
    size = len(parameters)
    shapes = (posterior.mean.shape, posterior.factor.shape, posterior.precision.shape)
    if shapes != ((size,), (size, size), (size, size)):
        raise ValueError(f"eyes.{eye_id}.state: its arrays do not fit {size} parameters")
    if tuple(state["shared"]) != SHARED:
        raise ValueError(f"eyes.{eye_id}.state.shared: expected {', '.join(SHARED)}")
    belief = PoseBelief(_array(state, "belief_mean"), _array(state, "belief_covariance"))
    frames = [FrameRecord(**{**step, "gated": tuple(step["gated"])}) for step in entry["steps"]]
    return EyeCalibration(
        eye_id,
        tuple(parameters),
        tuple(float(value["mean"]) for value in parameters.values()),
        tuple(float(value["sd"]) for value in parameters.values()),
        1e-6 * float(entry["thickness_um"]),
        EyeState(posterior, belief, _array(state, "sensitivity"), _array(state, "zero_covariance")),
        tuple(UsedRecording(**recording) for recording in entry["recordings"]),
        tuple(frames),
    )


def _array(state: dict[str, Any], key: str) -> "np.ndarray[Any, np.dtype[np.float64]]":
    array = np.array(state[key], dtype=np.float64)
    if not np.isfinite(array).all():
        raise ValueError(f"state.{key}: a number that is not finite")
    return array
