"""What a library's states weigh in the splines between them: computed when first needed, whatever the contact."""

from dataclasses import dataclass, replace
from functools import cached_property
from math import prod

import numpy as np
from numpy.typing import NDArray

from scleraforce.library.splines import CubicSpline, tensor_coefficients

Floats = NDArray[np.float64]
Curves = NDArray[np.float32]

BLOCK = 32  # samples interpolated together: what they gather stays in the cache


@dataclass(frozen=True, eq=False)
class SplineWeights:
    """Spline weights over a library's axes: `thickness_m` (t,), `tension` (p,), `tip_m` (d,). Each is computed once.

    `longer` are those of the same walls with more nodes of the curves, whose first weights are theirs.
    """

    thickness_m: Floats
    tension: Floats
    tip_m: Floats
    curves_tpdbnc: Curves
    undented_tpbnc: Curves
    longer: "SplineWeights | None" = None

    def within(self, curves_tpdbnc: Curves) -> "SplineWeights":
        """Return the weights of the same walls with the first nodes of their curves."""
        return replace(self, curves_tpdbnc=curves_tpdbnc, longer=self)

    @cached_property
    def splines(self) -> tuple[CubicSpline, CubicSpline, CubicSpline]:
        """Splines over log thickness, log tension, tip."""
        return CubicSpline(np.log(self.thickness_m)), CubicSpline(np.log(self.tension)), CubicSpline(self.tip_m)

    @cached_property
    def of_curves(self) -> Curves:
        """Spline weights of the curves (t p d, b n c)."""
        states, (boundaries, nodes, _) = prod(self.curves_tpdbnc.shape[:3]), self.curves_tpdbnc.shape[3:]
        if self.longer is not None:
            longer = self.longer.of_curves.reshape(states, boundaries, -1, 2)
            return np.ascontiguousarray(longer[:, :, :nodes]).reshape(states, -1)
        weights = tensor_coefficients(self.splines, self.curves_tpdbnc.astype(np.float64))
        return weights.reshape(states, -1).astype(np.float32)

    @cached_property
    def of_undented(self) -> Floats:
        """Spline weights of the walls without the needle (t p, b n c)."""
        if self.longer is not None:
            return self.longer.of_undented
        weights = tensor_coefficients(self.splines[:2], self.undented_tpbnc.astype(np.float64))
        return weights.reshape(prod(self.undented_tpbnc.shape[:2]), -1)


def gathered_curves(of_curves: Curves, rows: NDArray[np.intp], weights: Floats) -> Curves:
    """Return the curves (sample, b n c) of states that lie between rows (sample, 64), by their weights."""
    samples, weights32 = len(weights), weights[:, None].astype(np.float32)
    curves = np.empty((samples, 1, of_curves.shape[1]), dtype=np.float32)
    for start in range(0, samples, BLOCK):
        block = slice(start, start + BLOCK)
        alike = rows[block] if (rows[block] != rows[start]).any() else rows[start]  # a fit varies a wall by little
        np.matmul(weights32[block], of_curves[alike], out=curves[block])
    return curves[:, 0]
