"""Young's modulus for a data set, from a calibration file."""

from dataclasses import dataclass
from os import PathLike

from scleraforce.known.calibration_file import read_calibration


@dataclass(frozen=True)
class CalibratedModulus:
    """The population's Young's modulus, the mechanics it was fitted with, and the file it is from with its SHA-256."""

    youngs_modulus_pa: float
    mechanics: str
    path: str
    sha256: str


def read_population_modulus(path: str | PathLike[str]) -> CalibratedModulus:
    """Read the population's mean from the file that `scleraforce calibrate` writes.

    Raises:
        CalibrationError: the file is missing, is not JSON, or has no usable `population.mean_mpa`.
    """
    found = read_calibration(path)
    return CalibratedModulus(found.population_mean_pa, found.mechanics, found.path, found.sha256)
