"""Sampling points of the unscented transform (Moireau and Chapelle 2011, section on the choice of sampling points).

Every rule has zero mean and unit covariance: sum_i alpha_i I_i = 0 and sum_i alpha_i I_i I_i^T = 1.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class SigmaPoints(NamedTuple):
    """A rule of `r` points in `p` dimensions."""

    points_rp: NDArray[np.float64]  # [I*]^T, shape (r, p)
    weights_r: NDArray[np.float64]  # alpha, shape (r,), sums to 1


def simplex(dimension: int) -> SigmaPoints:
    """Return the p + 1 corners of a regular simplex on the sphere of radius sqrt(p), equal weights.

    One parameter takes two points, as in the paper (sec. 3.2):

    >>> simplex(1).points_rp.ravel().tolist()
    [-1.0, 1.0]
    """
    points = np.zeros((dimension + 1, dimension))
    for d in range(1, dimension + 1):
        points[:d, d - 1] = -sqrt((dimension + 1) / (d * (d + 1)))
        points[d, d - 1] = sqrt((dimension + 1) * d / (d + 1))
    return SigmaPoints(points, np.full(dimension + 1, 1 / (dimension + 1)))


def canonical(dimension: int) -> SigmaPoints:
    """Return the 2p points at +- sqrt(p) on the axes, equal weights (Julier and Uhlmann's symmetric set)."""
    axes = sqrt(dimension) * np.eye(dimension)
    return SigmaPoints(np.concatenate([axes, -axes]), np.full(2 * dimension, 1 / (2 * dimension)))


def star(dimension: int) -> SigmaPoints:
    """Return the canonical points, moved out, and the centre: 2p + 1 points of equal weight."""
    outer = sqrt((2 * dimension + 1) / (2 * dimension)) * canonical(dimension).points_rp
    points = np.concatenate([outer, np.zeros((1, dimension))])
    return SigmaPoints(points, np.full(2 * dimension + 1, 1 / (2 * dimension + 1)))


RULES = {"simplex": simplex, "canonical": canonical, "star": star}


def sigma_points(rule: str, dimension: int) -> SigmaPoints:
    """Return the points of a rule by its name in the study.

    Raises:
        ValueError: an unknown rule, or a dimension below 1.
    """
    if rule not in RULES or dimension < 1:
        raise ValueError(f"sigma points {rule!r} in {dimension} dimensions: one of {', '.join(RULES)}, from 1 up")
    return RULES[rule](dimension)
