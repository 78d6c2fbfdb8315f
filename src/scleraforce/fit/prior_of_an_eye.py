"""The prior of a fit: the eye as declared, the pose, and the forms that eyes have."""

from dataclasses import dataclass, replace
from math import log, radians, sin, sqrt

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.fit import unknowns
from scleraforce.library.library_plan import LARGEST_POLAR_DEG
from scleraforce.library.moving_base import pole_directions
from scleraforce.records.eye import (
    LEAST_MODULUS_SD,
    NO_DISCREPANCY,
    Eye,
    ForceDiscrepancy,
)
from scleraforce.records.globe import UNKNOWN, Globe
from scleraforce.records.setup import Setup
from scleraforce.records.study import EyeStudy, ReaderStudy

FREE_SD = {
    unknowns.TIP: 10e-3,
    unknowns.LATERAL: 1e-3,
    unknowns.DEPTH: 2e-3,
    unknowns.ROTATION: 0.05,
    unknowns.SIZE: 0.03,
    unknowns.INNER_OFFSET: 15e-6,
}
# Where the surface faces the light its mirror reflection moves the edge found up: by
# 3.0 +- 2.7 um in 716 frames of 60 drawn eyes, with the noise of the fit to each
# (`python -m figures boundary-errors`, 30 eyes, seeds 21, 22).
SHINE_MEAN_M = 3e-6
SHINE_SD_M = 2.3e-6
KNOWN_SD = {
    unknowns.GAP: 30e-6,
    unknowns.THICKNESS: 15e-6,
    unknowns.IOP: 0.05,
}  # of a stated value
LIBRARY_RADIUS_M = EyeStudy().radius_m  # of the study that a library is made for
# relative, of a radius that is given without its uncertainty: a caliper's
RADIUS_SD = 0.02
LEAST_SD = 1e-3  # relative: no fit needs a value more exactly
# standard deviation of the logarithm of the pressure under the needle: the globe's
# rigidity ties it
PRESSURE_SD = 3.0
# At a given dent a force goes as E t^2 IOP^(1/3), in the middle of the library (per
# power of E).
FORCE_BY_LOG_THICKNESS = 2.0
FORCE_BY_LOG_IOP = 1.0 / 3.0
# Place, angle and curvature of either side, and the wedge (`unknowns.FORMS`).
FORM_MEAN = np.array([3.5e-3, 0.0, 0.0, 3.5e-3, 0.0, 0.0, 0.0])
FORM_SD = np.array([1.2e-3, 5e-3, 2.0, 1.2e-3, 5e-3, 2.0, 3e-3])
TYPICAL_POLAR_RAD = radians(35.0)  # of a contact whose place is not stated
FARTHEST_RAD = radians(LARGEST_POLAR_DEG)
POLE_SD = 0.03  # of where the pole lies, where polar angle and direction are stated
UNSURE_POLE_SD = 0.15  # where the direction alone is
# Unknowns with Cauchy's prior, whose density falls slowly: most eyes are even spheres,
# some are far from it; and now and then another layer is taken for the inner boundary.
HEAVY = np.array(
    [unknowns.INNER_OFFSET, *(unknowns.FORM.start + np.array([1, 2, 4, 5, 6]))]
)


@dataclass(frozen=True, eq=False)
class Prior:
    """The prior of the unknowns, in the order of NAMES.

    `mean` and `sd` (unknown,) of each unknown; `precision` (unknown, unknown), the
    inverse of their covariance, without the effect of `same_force` (unknown,): that
    combination of unknowns is as far off its mean as a standard normal number; it is 0
    where it is not used. `globe` is the known globe; `calibrated` (2, 2) the inverse
    covariance of that number and of how far the pressure is off the globe's law, which
    a calibration correlates. `discrepancy` is that of the eye's forces. `wall_sd_m`:
    standard deviation of boundaries that were given, beyond that of those found.
    """

    mean: Floats
    sd: Floats
    precision: Floats
    same_force: Floats
    globe: Globe
    calibrated: Floats
    discrepancy: ForceDiscrepancy
    wall_sd_m: float = 0.0


def prior_of(
    setup: Setup, trained: ReaderStudy, library_radius_m: float = LIBRARY_RADIUS_M
) -> Prior:
    """Return the prior of a frame's unknowns: the eye, else the ranges that the
    model was trained for.

    A declared uncertainty counts in place of the usual one (`KNOWN_SD`, `RADIUS_SD`).
    """
    eye = setup.eye
    mean = np.zeros(len(unknowns.NAMES))
    sd = np.zeros(len(unknowns.NAMES))
    for place, value in FREE_SD.items():
        sd[place] = value

    mean[unknowns.SHINE] = SHINE_MEAN_M
    sd[unknowns.SHINE] = SHINE_SD_M
    mean[unknowns.FORM] = FORM_MEAN
    sd[unknowns.FORM] = FORM_SD
    mean[unknowns.POLE], sd[unknowns.POLE] = _pole(setup)
    mean[unknowns.GAP], sd[unknowns.GAP] = _stated(
        setup.needle.gap_m, trained.gap_m.bounds, KNOWN_SD[unknowns.GAP]
    )
    mean[unknowns.THICKNESS], sd[unknowns.THICKNESS] = _stated(
        eye.thickness_m,
        trained.thickness_m.bounds,
        eye.thickness_sd_m or KNOWN_SD[unknowns.THICKNESS],
    )
    iop = None if eye.iop_pa is None else log(max(eye.iop_pa, 1.0))
    mean[unknowns.IOP], sd[unknowns.IOP] = _stated(
        iop, _logs(trained.iop_pa.bounds), _log_iop_sd(eye)
    )
    if eye.radius_m is not None:
        mean[unknowns.SIZE] = log(eye.radius_m / library_radius_m)
        sd[unknowns.SIZE] = (
            RADIUS_SD
            if eye.radius_sd_m is None
            else max(eye.radius_sd_m / eye.radius_m, LEAST_SD)
        )
    modulus = None if setup.eye.modulus is None else log(setup.eye.modulus.mean_pa)
    modulus_sd = setup.eye.modulus.relative_sd if setup.eye.modulus else 0.0
    discrepancy = setup.eye.discrepancy or NO_DISCREPANCY

    if setup.eye.modulus is not None and setup.eye.modulus.source == "shape":
        # frames do not tell it once more
        discrepancy = replace(NO_DISCREPANCY, level_sd=modulus_sd)
        modulus_sd = LEAST_MODULUS_SD

    mean[unknowns.MODULUS], sd[unknowns.MODULUS] = _stated(
        modulus, _logs(trained.youngs_modulus_pa.bounds), modulus_sd
    )
    mean[unknowns.PRESSURE] = mean[unknowns.IOP]
    sd[unknowns.PRESSURE] = PRESSURE_SD
    own = setup.eye.has_own_modulus
    same_force = _same_force(mean, sd) if own else np.zeros(len(unknowns.NAMES))
    precision = np.diag(
        np.where(
            own & (np.arange(len(unknowns.NAMES)) == unknowns.MODULUS), 0.0, sd**-2.0
        )
    )
    globe = UNKNOWN if setup.eye.globe is None else setup.eye.globe
    correlation = globe.correlation if own else 0.0
    calibrated = np.asarray(np.linalg.inv([[1.0, correlation], [correlation, 1.0]]))

    return Prior(mean, sd, precision, same_force, globe, calibrated, discrepancy)


def _log_iop_sd(eye: Eye) -> float:
    """Return the standard deviation of the logarithm of a stated IOP."""
    if eye.iop_pa is None or eye.iop_sd_pa is None:
        return KNOWN_SD[unknowns.IOP]
    return max(eye.iop_sd_pa / max(eye.iop_pa, 1.0), LEAST_SD)


def _pole(setup: Setup) -> tuple[Floats | float, float]:
    """Return the pole's direction and its standard deviation: anywhere around if the
    direction is not stated.
    """
    polar_rad = (
        TYPICAL_POLAR_RAD
        if setup.needle.polar_rad is None
        else min(max(setup.needle.polar_rad, 0.0), FARTHEST_RAD)
    )
    if setup.scan.direction_rad is None:
        return 0.0, max(sin(polar_rad) / sqrt(2.0), POLE_SD)

    return pole_directions(polar_rad, setup.scan.direction_rad), (
        POLE_SD if setup.needle.polar_rad is not None else UNSURE_POLE_SD
    )


def _same_force(mean: Floats, sd: Floats) -> Floats:
    """Return the combination of unknowns that an eye's own modulus determines.

    The modulus was fitted to dents and forces at the stated thickness and IOP. If these
    are wrong, so is the modulus, and yet the force that belongs to a dent is right:
    that force is known.
    """
    along = np.zeros(len(unknowns.NAMES))
    along[[unknowns.MODULUS, unknowns.THICKNESS, unknowns.IOP]] = (
        1.0,
        FORCE_BY_LOG_THICKNESS / mean[unknowns.THICKNESS],
        FORCE_BY_LOG_IOP,
    )

    return np.asarray(along / sd[unknowns.MODULUS])


def _stated(
    value: float | None, bounds: tuple[float, float], sd: float
) -> tuple[float, float]:
    """Return mean and standard deviation of a stated value, else of its range."""
    low, high = bounds
    return (
        ((low + high) / 2, max((high - low) / sqrt(12), sd))
        if value is None
        else (value, sd)
    )


def _logs(bounds: tuple[float, float]) -> tuple[float, float]:
    return log(max(bounds[0], 1.0)), log(max(bounds[1], 1.0))


def form_size(unknown: Floats) -> float:
    """Return the deviation of a wall (unknown,) from an even sphere: its form's
    largest, over the known spread.
    """
    return float(
        np.abs(unknown[HEAVY[1:]] / FORM_SD[HEAVY[1:] - unknowns.FORM.start]).max()
    )
