"""From the plan to the picture with finite strain: the slices of some samples, drawn from the response library."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from scleraforce.dataset.plan import DatasetPlan
from scleraforce.errors import DatasetError
from scleraforce.library import OUTER, Library
from scleraforce.library.sections import highest_depths
from scleraforce.library.slices import Framing, draw_slices
from scleraforce.study import Study

__all__ = ["unit_drawing"]


def unit_drawing(
    study: Study, youngs_modulus_pa: float, plan: DatasetPlan, library: Library
) -> Callable[[int], NDArray[np.uint8]]:
    """Return what draws a unit of a plan from the library: number to slices (sample, row, column).

    The wall of the library is even and bends the same all around the needle, and gravity is left out: samples differ by
    thickness, force, the contact's polar angle, plane and framing, not by azimuth or by the direction of the plane.
    It raises an InputError, which names the value and the range, where a sample lies outside the library.

    Args:
        study: the study; its IOP and its slice matter here.
        youngs_modulus_pa: Young's modulus.
        plan: the samples.
        library: of the study's eye and needle.

    Raises:
        DatasetError: the library is one of another eye or needle.
    """
    _check(study, library)
    near = library.within(_reach(study, plan))

    def draw(unit: int) -> NDArray[np.uint8]:
        numbers = np.arange(plan.images)[plan.unit(unit)]
        of_contacts = np.split(numbers, np.flatnonzero(np.diff(plan.contact[numbers])) + 1)
        parts = [_slices(study, youngs_modulus_pa, plan, slice(n[0], n[-1] + 1), near) for n in of_contacts]
        return np.concatenate(parts)

    return draw


def _slices(
    study: Study, youngs_modulus_pa: float, plan: DatasetPlan, samples: slice, library: Library
) -> NDArray[np.uint8]:
    """Return the slices of consecutive samples of one contact (sample, row, column), 255 = wall."""
    library = library.for_contact(float(plan.polar_rad[samples.start]))
    thickness_m, gap_m, tilt_rad = plan.thickness_m[samples], plan.gap_m[samples], plan.tilt_rad[samples]
    iop_ratio = np.full(len(thickness_m), study.eye.iop_pa / youngs_modulus_pa)
    resting = library.at_tip(thickness_m, iop_ratio, np.zeros(len(thickness_m)))
    top_m = highest_depths(resting.curves_sbnc[:, OUTER], gap_m, tilt_rad)
    depth_m = study.slice.margin_m + plan.framing_depth_m[samples] - top_m
    framing = Framing.upright(plan.framing_lateral_m[samples], depth_m)
    loaded = library.curves(thickness_m, iop_ratio, plan.force_n[samples] / youngs_modulus_pa)
    return draw_slices(loaded.curves_sbnc, gap_m, tilt_rad, framing, study.slice)


def _reach(study: Study, plan: DatasetPlan) -> float:
    """Distance from the needle axis that all slices together may show, m."""
    lateral_m = 0.5 * study.slice.columns * study.slice.pixel_m + np.abs(plan.framing_lateral_m).max()
    depth_m = study.slice.rows * study.slice.pixel_m + study.eye.radius_m  # below what any tilt makes of it
    offset_m = plan.gap_m.max() + depth_m * np.abs(np.tan(plan.tilt_rad)).max()
    return float(np.hypot(lateral_m, offset_m))


def _check(study: Study, library: Library) -> None:
    eye, needle = study.eye, study.needle
    wanted = (eye.radius_m, eye.poisson_ratio, 0.5 * needle.outer_diameter_m)
    found = (library.radius_m, library.poisson_ratio, library.needle_radius_m)
    if not np.allclose(found, wanted, rtol=1e-12):
        raise DatasetError(f"library: of radius, nu, needle radius {found}; the study has {wanted}")
