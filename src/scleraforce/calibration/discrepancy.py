"""How far an eye's forces lie off the library's, from the frames that it was calibrated on (`known.discrepancy`).

With E and k of the calibration each frame is read once more, as a reader would; its known force over the one that is
read is the discrepancy at that force. Level and growth follow by linear regression, held by what eyes have of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scleraforce.calibration.forces import LABEL_SD_N
from scleraforce.fitting.library_fit import NO_WALL_M, BoundaryFit, fit_boundaries
from scleraforce.fitting.prior import prior_of
from scleraforce.known.discrepancy import ForceDiscrepancy, beside_middle
from scleraforce.known.eye import Known
from scleraforce.known.globe import NINETY_PERCENT
from scleraforce.library import Library
from scleraforce.segmentation.observations import Boundaries
from scleraforce.study import Study

__all__ = ["KnownForce", "fitted_discrepancy", "read_again"]

# Scales of Cauchy's prior, whose density falls slowly: forces of most eyes hardly lie off (those of uneven ones,
# computed in three dimensions, drift by 0.035 from none to the largest), those of tissue that stiffens do, by up to 1.
SCALES = np.array([0.02, 0.035])  # of level and growth
CAUCHY = 2.0  # scales at which a prior's weight is halved
WIDE = 1.0  # where the search begins
ROUNDS = 60
CERTAIN = 0.001  # of a standard deviation: nothing is left of it
SETTLED = 1e-9


@dataclass(frozen=True, kw_only=True)
class KnownForce:
    """A frame's force as it is known, what is read in it, and the standard deviation of that, all N."""

    force_n: float
    library_n: float
    sd_n: float


def read_again(
    frames: Sequence[tuple[Boundaries, float]], known: Known, library: Library, study: Study
) -> list[KnownForce | None]:
    """Return what a calibrated eye's frames read without their forces, each None where it cannot be read.

    What the frames share, E and k, is taken for certain: it is no noise between them.

    Args:
        frames: boundaries, and the force that is known, N.
        known: of the eye, with its own modulus, after the calibration.
        library: for any contact.
        study: of the calibration.
    """
    certain = replace(
        known,
        modulus=None if known.modulus is None else replace(known.modulus, sd_pa=0.0),
        globe=None if known.globe is None else replace(known.globe, sd=CERTAIN * known.globe.sd, correlation=0.0),
        discrepancy=None,
    )
    near, prior = library.nearest_contact(known.polar_rad), prior_of(certain, study.reader)
    smoothing_m = study.calibration.surface_smoothing_m
    fits = (fit_boundaries(near, seen.lateral_m, seen.depth_m, prior, smoothing_m) for seen, _ in frames)
    return [_known_force(fit, force_n) for fit, (_, force_n) in zip(fits, frames, strict=True)]


def _known_force(fit: BoundaryFit | None, force_n: float) -> KnownForce | None:
    if fit is None or fit.misfit_m > NO_WALL_M or not fit.force_n > 0.0:
        return None
    low_n, high_n = fit.interval_n
    return KnownForce(force_n=force_n, library_n=fit.force_n, sd_n=0.5 * (high_n - low_n) / NINETY_PERCENT)


def fitted_discrepancy(frames: Sequence[KnownForce]) -> ForceDiscrepancy:
    """Return what frames of one eye tell of its discrepancy: reweighted least squares, begun from a wide prior."""
    normal, gradient = np.zeros((2, 2)), np.zeros(2)
    for frame in frames:
        direction = np.array([1.0, float(beside_middle(np.array(frame.library_n)))])
        weight = 1.0 / ((frame.sd_n / frame.library_n) ** 2 + (LABEL_SD_N / frame.force_n) ** 2)
        normal += weight * np.outer(direction, direction)
        gradient += weight * np.log(frame.force_n / frame.library_n) * direction
    found = np.full(2, WIDE if frames else 0.0)
    for _ in range(ROUNDS):
        precision = normal + np.diag(1.0 / (SCALES**2 * (1.0 + (found / (CAUCHY * SCALES)) ** 2)))
        before, found = found, np.linalg.solve(precision, gradient)
        if np.abs(found - before).max() < SETTLED:
            break
    covariance = np.linalg.inv(precision)
    level_sd, growth_sd = np.sqrt(np.diag(covariance)).tolist()
    return ForceDiscrepancy(
        level=float(found[0]),
        growth=float(found[1]),
        level_sd=level_sd,
        growth_sd=growth_sd,
        correlation=float(covariance[0, 1] / (level_sd * growth_sd)),
    )
