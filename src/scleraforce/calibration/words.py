"""What a calibration found of an eye beside its modulus, in words: "k 0.031 ± 0.001 mmHg^(1/3)/µl"."""

from math import exp, floor, isfinite, log10

from scleraforce.calibration.assimilation import PARAMETERS, RIGIDITY
from scleraforce.calibration.result import EyeCalibration
from scleraforce.known.discrepancy import NO_DISCREPANCY, REFERENCE_N
from scleraforce.units import HumanUnit, from_si

# Parameter -> its name for people, its unit, and how that is printed.
PRINTED: dict[str, tuple[str, HumanUnit, str]] = {
    "iop_pa": ("IOP", "mmhg", "mmHg"),
    "thickness_m": ("thickness", "um", "µm"),
    "gap_m": ("gap", "mm", "mm"),
    RIGIDITY: ("k", "mmhg13_per_ul", "mmHg^(1/3)/µl"),
}
SURE = 2.0  # standard deviations, of what is said
MUCH = 2.0  # times what is expected


def found_words(eye: EyeCalibration) -> tuple[str, ...]:
    """Return mean and standard deviation of each parameter but the modulus, which has a column of its own.

    And how much the tissue stiffens, where it does; by how much the eye's forces lie off the library's, where that is
    sure: an uneven wall; and how far its frames scatter, where that is much: a wall that is none of the library's.
    """
    found = zip(eye.names, eye.means, eye.sds, strict=True)
    stiffens = (f"tissue stiffens, b {eye.stiffening:.2g}",) if eye.stiffening > 0.0 else ()
    others = (_words(name, mean, sd) for name, mean, sd in found if name != PARAMETERS["e"])
    return (*others, *stiffens, *_discrepancy_words(eye), *_scatter_words(eye))


def rigidity_words(eye: EyeCalibration) -> str:
    """Return mean and standard deviation of the rigidity of an eye that may be sealed."""
    place = eye.names.index(RIGIDITY)
    return _words(RIGIDITY, eye.means[place], eye.sds[place])


def _discrepancy_words(eye: EyeCalibration) -> tuple[str, ...]:
    mean, sd = (eye.discrepancy or NO_DISCREPANCY).at_reference()
    if abs(mean) <= SURE * sd:
        return ()
    percent = from_si(exp(mean) - 1.0, "percent")
    side = "above" if percent > 0.0 else "below"
    reference = f"{from_si(REFERENCE_N, 'mn'):g} mN"
    return (f"forces {abs(percent):.0f} ± {from_si(sd, 'percent'):.0f} % {side} the library's at {reference}",)


def _scatter_words(eye: EyeCalibration) -> tuple[str, ...]:
    scatter = (eye.discrepancy or NO_DISCREPANCY).scatter
    return (f"forces scatter {scatter:.1f} times as far as expected",) if scatter > MUCH else ()


def _words(name: str, mean: float, sd: float) -> str:
    """Return one parameter, its mean to the first digit of its standard deviation."""
    words, unit, printed = PRINTED[name]
    mean, sd = from_si(mean, unit), from_si(sd, unit)
    decimals = max(0, -floor(log10(sd))) if isfinite(sd) and sd > 0.0 else 3
    return f"{words} {mean:.{decimals}f} ± {sd:.{decimals}f} {printed}"
