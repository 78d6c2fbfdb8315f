"""Axes of a table: what lies within them, and the weights of two of them together.

Whether a library's arrays belong together.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.library.splines import SUPPORT
from scleraforce.mechanics.burst import burst_tension
from scleraforce.units import HumanUnit, from_si

Floats = NDArray[np.float64]

SLACK = 1e-9  # relative: an end of a range may be computed in two ways


def weight_products(
    first: NDArray[np.intp], of_first: Floats, second: NDArray[np.intp], of_second: Floats, seconds: int
) -> tuple[NDArray[np.intp], Floats]:
    """Return rows (sample, 16) of a table over two axes, the second of a length, and the products of their weights."""
    support = np.arange(SUPPORT)
    rows = (first[:, None] + support)[:, :, None] * seconds + (second[:, None] + support)[:, None]
    weights = of_first[:, :, None] * of_second[:, None]
    return rows.reshape(len(first), SUPPORT**2), weights.reshape(len(first), SUPPORT**2)


def check_inside(name: str, values: Floats, low: float, high: float, unit: HumanUnit, printed: str = "") -> None:
    """Check that all values lie in a range; the message gives them in `unit`s, by another name where `printed`.

    Raises:
        InputError: a value is outside, or no number.
    """
    values = np.asarray(values)
    outside = ~((values >= low - SLACK * high) & (values <= high * (1.0 + SLACK)))  # NaN is outside, too
    if outside.any():
        found = from_si(float(values[outside].flat[0]), unit)
        raise InputError(
            f"{name}: {found:.4g} {printed or unit} is outside the library's range, "
            f"{from_si(low, unit):.4g} to {from_si(high, unit):.4g} {printed or unit}"
        )


def check_tension(
    tension: Floats, thickness_m: Floats, ends: tuple[float, float], radius_m: float, poisson_ratio: float
) -> None:
    """Check that tensions lie between the ends of a library's; the message gives what they are in the wall's IOP/E.

    Raises:
        InputError: one is outside, or no number.
    """
    inside = (tension >= ends[0] * (1.0 - SLACK)) & (tension <= ends[1] * (1.0 + SLACK))
    if inside.all():
        return
    worst = int(np.argmin(inside))  # NaN is outside, too
    thickness = float(np.broadcast_to(thickness_m, tension.shape)[worst])
    low, high, burst = (value * thickness / radius_m for value in (*ends, burst_tension(poisson_ratio)))
    raise InputError(
        f"IOP/E: {tension[worst] * thickness / radius_m:.4g} is outside the library's range for a wall of "
        f"{from_si(thickness, 'um'):.0f} µm, {low:.3g} to {high:.3g}; it bursts at {burst:.3g}"
    )


def inside_ends(values: Floats, axis: Floats) -> Floats:
    """Return values of a range that was checked, without what rounding added."""
    return np.clip(np.asarray(values, dtype=np.float64), axis[0], axis[-1])


if TYPE_CHECKING:
    from scleraforce.library.responses import Library


def check_arrays(library: "Library") -> None:
    """Check the shapes and values of a library.

    Raises:
        InputError: names what does not fit.
    """
    shape = (len(library.thickness_m), len(library.tension), len(library.tip_m))
    if min(shape) < SUPPORT:
        raise InputError(f"library: {shape} thicknesses, tensions, tips; must be at least {SUPPORT} of each")
    if {library.force_ratio_tpd.shape, library.displaced_tpd.shape} != {shape} or library.curves_tpdbnc.shape[:4] != (
        *shape,
        2,
    ):
        raise InputError(f"library: forces {library.force_ratio_tpd.shape}, volumes {library.displaced_tpd.shape} and "
                         f"curves {library.curves_tpdbnc.shape} do not fit the axes {shape}")  # fmt: skip
    if library.stiffness_atpd.shape != (len(library.polar_rad), *shape) or len(library.polar_rad) < SUPPORT:
        raise InputError(f"library: stiffness {library.stiffness_atpd.shape} does not fit {len(library.polar_rad)} "
                         f"polar angles (at least {SUPPORT}) and the axes {shape}")  # fmt: skip
    if library.undented_tpbnc.ndim != 5 or library.undented_tpbnc.shape[:3] != (*shape[:2], 2):
        raise InputError(f"library: walls without the needle {library.undented_tpbnc.shape} do not fit the axes "
                         f"{shape[:2]}")  # fmt: skip
    check_inside(
        "polar angle",
        np.asarray(library.contact_polar_rad),
        float(library.polar_rad[0]),
        float(library.polar_rad[-1]),
        "deg",
    )
    for axis in (library.polar_rad, library.thickness_m, library.tension, library.tip_m):
        if not (np.diff(axis) > 0.0).all():
            raise InputError("library: an axis that does not increase")
    both = (library.curves_tpdbnc, library.undented_tpbnc)
    for walls in both:
        if walls.shape[-2] < 2 or walls.shape[-1] != 2:
            raise InputError(f"library: curves {walls.shape}; at least two points of two coordinates")
    sizes = (
        library.radius_m,
        library.needle_radius_m,
        library.max_force_ratio,
        library.thickness_m[0],
        library.tension[0],
    )
    if not all(0.0 < size < np.inf for size in sizes) or not 0.0 <= library.poisson_ratio < 0.5:
        raise InputError(f"library: radius, needle radius, largest F/E, first thickness and tension {sizes}, "
                         f"Poisson's ratio {library.poisson_ratio}: impossible")  # fmt: skip
    axes = (library.thickness_m, library.tension, library.tip_m, library.polar_rad)
    values = (*axes, library.force_ratio_tpd, library.displaced_tpd, *both, library.stiffness_atpd)
    if not all(np.isfinite(array).all() for array in values):
        raise InputError("library: values that are not finite")
