"""What forces that are known, beside those that are read, tell of an eye: E, k, and the forces' level and growth.

Linear regression of all four together. Held are E and k by the filter's posterior, with heavy tails, for it may have
been led astray; level and growth by what eyes have of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log

import numpy as np
from numpy.typing import NDArray

from scleraforce.calibration.forces import LABEL_SD_N
from scleraforce.known.discrepancy import beside_middle
from scleraforce.known.eye import Known
from scleraforce.known.globe import OPEN, REFERENCE_RIGIDITY, KnownGlobe

Array = NDArray[np.float64]
Scales = tuple[Array, Array]

OF_MODULUS, OF_RIGIDITY = 0, 1  # places of the four that are found: ln E, k over the reference's, level, growth
# Scales of Cauchy's prior, whose density falls slowly: forces of most eyes hardly lie off (those of uneven ones,
# computed in three dimensions, drift by 0.035 from none to the largest), those of tissue that stiffens do, by up to 1.
SCALES = np.array([0.02, 0.035])  # of level and growth
CAUCHY = 2.0  # scales at which a prior's weight is halved
ROUNDS = 60
BEGINNINGS = (0.0, 0.0, 1.0, 1.0), (1.0, 1.0, 0.0, 0.0)  # of the search: either pair explains much
AS_READ = (False, False, True, True)  # what is sought where E and k stay
CERTAIN = 1e-6  # standard deviation of the k of an open globe
SETTLED = 1e-9
# Of three frames each of 31 virtual eyes of even walls of the library; less than 1, for of the errors of what is read
# the frames share some. And how many frames the prior is worth: with 3 to 8, intervals of 65 such eyes, a half of them
# uneven, were the narrowest at equal coverage.
EXPECTED_SQUARE, SCATTER_FRAMES = 0.17, 5.0


@dataclass(frozen=True, kw_only=True)
class KnownForce:
    """A frame's force as it is known, what is read in it, and the standard deviation of that, all N.

    It was read with `modulus_pa` and `rigidity`, Pa^(1/3)/m^3, each taken for certain; `by_modulus` and `by_rigidity`
    are the slopes of the logarithm of what is read by ln E and by the rigidity over the reference's. `loss` is that of
    its boundaries (`BoundaryFit.loss`).
    """

    force_n: float
    library_n: float
    sd_n: float
    modulus_pa: float
    rigidity: float
    by_modulus: float = 1.0
    by_rigidity: float = 0.0
    loss: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Found:
    """What frames tell of ln E, k over the reference's, level and growth: mean (4,) and covariance (4, 4).

    `loss` is that of the E and k which they were read with. `scatter`: how far the frames are left off all of these,
    in standard deviations of what is expected.
    """

    mean: Array
    covariance: Array
    loss: float
    scatter: float


def regression(frames: Sequence[KnownForce], known: Known, place: Array) -> Found:
    """Return what frames of one eye tell, by reweighted least squares.

    Args:
        frames: as they were read again.
        known: of the eye after the filter.
        place: ln E and k over the reference's (2,) that they were read with.
    """
    center = np.concatenate([place_of(known), np.zeros(2)])
    direction, left, weight = np.zeros((len(frames), 4)), np.zeros(len(frames)), np.zeros(len(frames))
    for row, frame in enumerate(frames):
        beside = float(beside_middle(np.array(frame.library_n)))
        direction[row] = frame.by_modulus, frame.by_rigidity, 1.0, beside
        read_at = np.array([log(frame.modulus_pa), frame.rigidity / REFERENCE_RIGIDITY, 0.0, 0.0])
        left[row] = log(frame.force_n / frame.library_n) - direction[row] @ (center - read_at)
        weight[row] = 1.0 / ((frame.sd_n / frame.library_n) ** 2 + (LABEL_SD_N / frame.force_n) ** 2)
    scales: Scales = np.asarray(np.linalg.inv(_filter_covariance(known))), np.diag(SCALES**-2.0)
    every = np.ones(4, dtype=bool)
    begun = (_reweighted(direction, left, weight, scales, every, begin) for begin in BEGINNINGS)
    mean, covariance = min(begun, key=lambda found: _loss(direction, left, weight, scales, found[0]))
    away = np.concatenate([place, np.zeros(2)]) - center
    there, _ = _reweighted(direction, left - direction @ away, weight, scales, np.array(AS_READ), BEGINNINGS[0])
    loss = _loss(direction, left, weight, scales, there + away)
    rest = left - direction @ mean
    scatter = _scatter(float(weight @ rest**2), len(frames))
    return Found(mean=center + mean, covariance=covariance, loss=loss, scatter=scatter)


def _reweighted(
    direction: Array,
    left: Array,
    weight: Array,
    scales: Scales,
    free: NDArray[np.bool_],
    begin: tuple[float, ...],
) -> tuple[Array, Array]:
    """Return mean (4,) and covariance (4, 4) of what is free; the rest stays 0.

    Args:
        direction: slopes of each frame (frame, 4).
        left: what they are to explain (frame,).
        weight: of the frames (frame,).
        scales: inverse squares of the scales of E with k, and of level with growth, (2, 2) each.
        free: which of the four are sought (4,).
        begin: where the search begins: what is far off there is hardly held.
    """
    normal, gradient = direction.T @ (weight[:, None] * direction), direction.T @ (weight * left)
    found, covariance = np.where(free & bool(len(left)), begin, 0.0), np.zeros((4, 4))
    for _ in range(ROUNDS):
        precision = normal.copy()
        precision[:2, :2] += scales[0] / (1.0 + found[:2] @ scales[0] @ found[:2] / CAUCHY**2)
        precision[2:, 2:] += scales[1] / (1.0 + scales[1] @ found[2:] ** 2 / CAUCHY**2)
        before, covariance[np.ix_(free, free)] = found, np.linalg.inv(precision[np.ix_(free, free)])
        found = covariance @ gradient
        if np.abs(found - before).max() < SETTLED:
            break
    return found, covariance


def _scatter(squares: float, frames: int) -> float:
    """Return by how much more than expected frames scatter, from the sum of their squares over what is expected.

    Before any frame it is 1, sure like `SCATTER_FRAMES` frames (inverse gamma prior: Gelman et al., Bayesian Data
    Analysis, 3rd ed., section 2.6). It is never less: that a few frames agree does not say that others will.
    """
    return max(1.0, float(np.sqrt((SCATTER_FRAMES + squares / EXPECTED_SQUARE) / (SCATTER_FRAMES + frames))))


def _loss(direction: Array, left: Array, weight: Array, scales: Scales, found: Array) -> float:
    """Return the loss of the four: of what they leave of the frames, and of leaving their priors (`_reweighted`)."""
    rest = left - direction @ found
    of_filter = CAUCHY**2 * np.log1p(found[:2] @ scales[0] @ found[:2] / CAUCHY**2)
    of_eyes = CAUCHY**2 * np.log1p(scales[1] @ found[2:] ** 2 / CAUCHY**2).sum()
    return float(weight @ rest**2 + of_filter + of_eyes)


def _filter_covariance(known: Known) -> Array:
    """Return the filter's covariance of ln E and k over the reference's (2, 2)."""
    assert known.modulus is not None  # its own
    globe = globe_of(known)
    sds = np.array([known.modulus.relative_sd, max(globe.sd / REFERENCE_RIGIDITY, CERTAIN)])
    covariance: Array = np.outer(sds, sds) * np.array([[1.0, globe.correlation], [globe.correlation, 1.0]])
    return covariance


def globe_of(known: Known) -> KnownGlobe:
    """Return the globe of an eye; of an unsaid one in linear mechanics, an open one."""
    return OPEN if known.globe is None else known.globe


def place_of(known: Known) -> Array:
    """Return ln E and k over the reference's (2,)."""
    assert known.modulus is not None  # its own
    return np.array([log(known.modulus.mean_pa), globe_of(known).mean / REFERENCE_RIGIDITY])
