"""The same walls in tissue of other stiffenings: a library's states between those of a few values of b (NumPy only).

Every state changes smoothly with ln(1 + 5 b): under deep dents a little stiffening counts. So a library holds its walls
of four values of b or more, and the states of a b between them follow from cubic splines. A model folder has the curves
in a reduced basis: there the splines are through the steps of the basis, and the walls of one b are unpacked at a time.
"""

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.library.plan import stiffening_place
from scleraforce.library.reduced_basis import ReducedRows
from scleraforce.library.splines import SUPPORT, CubicSpline

Floats = NDArray[np.float64]
Curves = NDArray[np.float32]


class StoredCurves(Protocol):
    """Curves of the walls of each stiffening."""

    def mixed(self, weights_b: Floats) -> Curves:
        """Return the sum of the curves by weights (t, p, d, boundary, node, 2), m."""
        ...

    def whole(self) -> Curves:
        """Return all curves (b, t, p, d, boundary, node, 2), m."""
        ...


@dataclass(frozen=True, eq=False)
class WholeCurves:
    """Curves as they were computed (b, t, p, d, boundary, node, 2), m."""

    curves_btpdbnc: Curves

    def __post_init__(self) -> None:
        if not np.isfinite(self.curves_btpdbnc).all():
            raise InputError("library: values that are not finite")

    def mixed(self, weights_b: Floats) -> Curves:
        """See `StoredCurves`."""
        used = np.flatnonzero(weights_b)
        mixed: Curves = self.curves_btpdbnc[used[0]]
        if len(used) > 1:
            mixed = np.tensordot(weights_b.astype(np.float32), self.curves_btpdbnc, axes=1)
        return mixed

    def whole(self) -> Curves:
        """See `StoredCurves`."""
        return self.curves_btpdbnc


@dataclass(frozen=True, eq=False)
class ReducedCurves:
    """Curves in a reduced basis: rows of (b t p d,), and the shape of all (b, t, p, d, boundary, node, 2)."""

    rows: ReducedRows
    shape: tuple[int, ...]

    def mixed(self, weights_b: Floats) -> Curves:
        """See `StoredCurves`."""
        values = self.rows.mixed_rows(weights_b)
        return values.astype(np.float32).reshape(self.shape[1:])

    def whole(self) -> Curves:
        """See `StoredCurves`."""
        return self.rows.rows().astype(np.float32).reshape(self.shape)


@dataclass(frozen=True, eq=False, kw_only=True)
class StiffenedWalls:
    """What a library holds of walls of each stiffening b, `stiffening` (b,), which increase: one, or at least four.

    `force_ratio_btpd`, `displaced_btpd`, `undented_btpbnc` and `curves` are those of `Library`, of each b.
    Of the curves only the first `nodes` are given.
    """

    stiffening: Floats
    force_ratio_btpd: Floats
    displaced_btpd: Floats
    undented_btpbnc: Curves
    curves: StoredCurves
    nodes: int | None = None

    def __post_init__(self) -> None:
        count = len(self.stiffening)
        shapes = {len(self.force_ratio_btpd), len(self.displaced_btpd), len(self.undented_btpbnc)}
        if shapes != {count} or 1 < count < SUPPORT or count == 0:
            raise InputError(f"library: {count} stiffenings of walls of {shapes}; must be one, or at least {SUPPORT}")
        inside = np.isfinite(self.stiffening).all() and self.stiffening[0] >= 0.0
        if not inside or not (np.diff(self.stiffening) > 0.0).all():
            raise InputError("library: stiffenings that do not increase from 0 or more")
        arrays = (self.force_ratio_btpd, self.displaced_btpd, self.undented_btpbnc)
        if not all(np.isfinite(values).all() for values in arrays):
            raise InputError("library: values that are not finite")

    def at(self, stiffening: float) -> dict[str, Any]:
        """Return the arrays of `Library` that change with the stiffening, by name.

        Raises:
            InputError: such tissue is not among them.
        """
        weights = self._weights(stiffening)
        mixed = (np.tensordot(weights, values, axes=1) for values in (self.force_ratio_btpd, self.displaced_btpd))
        force_ratio_tpd, displaced_tpd = mixed
        undented = np.tensordot(weights, self.undented_btpbnc.astype(np.float64), axes=1).astype(np.float32)
        return {
            "force_ratio_tpd": force_ratio_tpd,
            "displaced_tpd": displaced_tpd,
            "undented_tpbnc": undented,
            "curves_tpdbnc": np.ascontiguousarray(self.curves.mixed(weights)[..., : self.nodes, :]),
        }

    @property
    def curves_btpdbnc(self) -> Curves:
        """All curves."""
        return np.ascontiguousarray(self.curves.whole()[..., : self.nodes, :])

    def within(self, nodes: int) -> "StiffenedWalls":
        """Return the walls with the first nodes of their curves."""
        return replace(self, nodes=nodes)

    def _weights(self, stiffening: float) -> Floats:
        """Return what each b weighs at another (b,)."""
        here: Floats = (self.stiffening == stiffening).astype(np.float64)
        if here.any():
            return here
        low, high = float(self.stiffening[0]), float(self.stiffening[-1])
        if not low <= stiffening <= high:  # nor is NaN
            raise InputError(f"stiffening: {stiffening:g} is outside the library's range, {low:g} to {high:g}")
        spline = CubicSpline(stiffening_place(self.stiffening))
        return np.asarray(spline.shares(stiffening_place(np.array([stiffening])))[0])
