"""From the plan to the picture with finite strain: the slices of some samples, drawn from the response library."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from scleraforce.dataset.plan import DatasetPlan
from scleraforce.errors import DatasetError
from scleraforce.library import OUTER, Library
from scleraforce.library.sections import highest_depths
from scleraforce.library.slices import Framing, draw_slices
from scleraforce.study import Study


def near_library(study: Study, plan: DatasetPlan, library: Library) -> Library:
    """Return what all slices of a plan together may show of a library.

    Args:
        study: the study.
        plan: all of its samples.
        library: of the study's eye and needle.

    Raises:
        DatasetError: the library is one of another eye or needle.
    """
    _check(study, library)
    return library.within(_reach(study, plan))


def library_slices(study: Study, youngs_modulus_pa: float, plan: DatasetPlan, library: Library) -> NDArray[np.uint8]:
    """Draw the samples of a plan from the library; return their slices (sample, row, column), 255 = wall.

    The wall of the library is even and bends the same all around the needle, and gravity is left out: samples differ by
    thickness, force, the contact's polar angle, plane and framing, not by azimuth or by the direction of the plane.

    Args:
        study: the study; its IOP and its slice matter here.
        youngs_modulus_pa: Young's modulus.
        plan: the samples.
        library: a `near_library` of the whole plan.

    Raises:
        InputError: a sample lies outside the library; names the value and the range.
    """
    bounds = [0, *(np.flatnonzero(np.diff(plan.contact)) + 1), plan.images]
    parts = [_slices(study, youngs_modulus_pa, plan, slice(*contact), library) for contact in pairwise(bounds)]
    return np.concatenate(parts)


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
