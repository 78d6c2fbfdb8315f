"""What a calibration found of an eye beside its modulus, in words: "k 0.031 ± 0.001 mmHg^(1/3)/µl"."""

from math import floor, isfinite, log10

from scleraforce.calibration.assimilation import PARAMETERS, RIGIDITY
from scleraforce.calibration.result import EyeCalibration
from scleraforce.units import HumanUnit, from_si

__all__ = ["found_words"]

# Parameter -> its name for people, its unit, and how that is printed.
PRINTED: dict[str, tuple[str, HumanUnit, str]] = {
    "iop_pa": ("IOP", "mmhg", "mmHg"),
    "thickness_m": ("thickness", "um", "µm"),
    "gap_m": ("gap", "mm", "mm"),
    RIGIDITY: ("k", "mmhg13_per_ul", "mmHg^(1/3)/µl"),
}


def found_words(eye: EyeCalibration) -> tuple[str, ...]:
    """Return mean and standard deviation of each parameter but the modulus, which has a column of its own."""
    found = zip(eye.names, eye.means, eye.sds, strict=True)
    return tuple(_words(name, mean, sd) for name, mean, sd in found if name != PARAMETERS["e"])


def _words(name: str, mean: float, sd: float) -> str:
    """Return one parameter, its mean to the first digit of its standard deviation."""
    words, unit, printed = PRINTED[name]
    mean, sd = from_si(mean, unit), from_si(sd, unit)
    decimals = max(0, -floor(log10(sd))) if isfinite(sd) and sd > 0.0 else 3
    return f"{words} {mean:.{decimals}f} ± {sd:.{decimals}f} {printed}"
