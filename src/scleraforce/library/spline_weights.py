"""What a library's states weigh in the splines between them: computed when first needed, whatever the contact."""

from dataclasses import dataclass
from functools import cached_property
from math import prod

import numpy as np
from numpy.typing import NDArray

from scleraforce.library.splines import CubicSpline, tensor_coefficients

__all__ = ["SplineWeights"]

Floats = NDArray[np.float64]
Curves = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class SplineWeights:
    """Spline weights over a library's axes: `thickness_m` (t,), `tension` (p,), `tip_m` (d,). Each is computed once."""

    thickness_m: Floats
    tension: Floats
    tip_m: Floats
    curves_tpdbnc: Curves
    undented_tpbnc: Curves

    @cached_property
    def splines(self) -> tuple[CubicSpline, CubicSpline, CubicSpline]:
        """Splines over log thickness, log tension, tip."""
        return CubicSpline(np.log(self.thickness_m)), CubicSpline(np.log(self.tension)), CubicSpline(self.tip_m)

    @cached_property
    def of_curves(self) -> Curves:
        """Spline weights of the curves (t p d, b n c)."""
        weights = tensor_coefficients(self.splines, self.curves_tpdbnc.astype(np.float64))
        return weights.reshape(prod(self.curves_tpdbnc.shape[:3]), -1).astype(np.float32)

    @cached_property
    def of_undented(self) -> Floats:
        """Spline weights of the walls without the needle (t p, b n c)."""
        weights = tensor_coefficients(self.splines[:2], self.undented_tpbnc.astype(np.float64))
        return weights.reshape(prod(self.undented_tpbnc.shape[:2]), -1)
