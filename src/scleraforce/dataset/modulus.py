"""Young's modulus for a data set, from a calibration file."""

import hashlib
import json
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from scleraforce.errors import CalibrationError

__all__ = ["CalibratedModulus", "read_population_modulus"]


@dataclass(frozen=True)
class CalibratedModulus:
    """The population's Young's modulus, and the file it comes from with its SHA-256."""

    youngs_modulus_pa: float
    path: str
    sha256: str


def read_population_modulus(path: Path) -> CalibratedModulus:
    """Read `population.mean_mpa` from the file that `scleraforce calibrate` writes.

    Raises:
        CalibrationError: the file is missing, is not JSON, or has no usable `population.mean_mpa`.
    """
    try:
        content = path.read_bytes()
    except OSError as fault:
        raise CalibrationError(f"{path}: {fault.strerror}; `scleraforce calibrate` writes this file") from fault
    try:
        mean_mpa = json.loads(content)["population"]["mean_mpa"]
    except ValueError as fault:
        raise CalibrationError(f"{path}: not JSON: {fault}") from fault
    except (KeyError, TypeError) as fault:
        raise CalibrationError(f"{path}: population.mean_mpa is missing; give a file of `calibrate`") from fault
    if isinstance(mean_mpa, bool) or not isinstance(mean_mpa, int | float):
        raise CalibrationError(f"{path}: population.mean_mpa: expected a number, found {mean_mpa!r}")
    if not isfinite(mean_mpa) or not 0.001 <= mean_mpa <= 100.0:
        raise CalibrationError(f"{path}: population.mean_mpa: {mean_mpa:g} is not between 0.001 and 100 MPa")
    return CalibratedModulus(mean_mpa * 1e6, str(path), hashlib.sha256(content).hexdigest())
