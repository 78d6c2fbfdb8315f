"""Whether a library's arrays belong together."""

from typing import TYPE_CHECKING

import numpy as np

from scleraforce.errors import InputError
from scleraforce.library.axes import check_inside
from scleraforce.library.splines import SUPPORT

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
