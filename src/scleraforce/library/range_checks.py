"""Whether values are inside the range of a library's axis."""

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import InputError
from scleraforce.base.units import HumanUnit, from_si

SLACK = 1e-9  # relative: two formulas for an end of a range may round otherwise


def check_inside(
    name: str,
    values: Floats,
    low: float,
    high: float,
    unit: HumanUnit,
    printed: str = "",
    whose: str = "the library's",
) -> None:
    """Raise `InputError` for a value outside a range, or that is not a number;
    `printed` is the unit's name.
    """
    values = np.asarray(values)
    # NaN is outside, too
    outside = ~((values >= low - SLACK * high) & (values <= high * (1.0 + SLACK)))
    if outside.any():
        found = from_si(float(values[outside].flat[0]), unit)
        raise InputError(
            f"{name}: {found:.4g} {printed or unit} is outside {whose} range,"
            f" {from_si(low, unit):.4g} to {from_si(high, unit):.4g} {printed or unit}"
        )


def inside_ends(values: Floats, axis: Floats) -> Floats:
    """Return values of a checked range without the rounding beyond its ends."""
    return np.clip(np.asarray(values, dtype=np.float64), axis[0], axis[-1])
