"""Boundaries at the columns of slices, for many sections at once.

`sections.cut_rings` gives X^2 and Y of each ring. Y is taken first at evenly spaced X, the *stations*, for all sections
together; a place between two stations is then found without a search. A section that is turned in its plane meets a
column where X cos(turn) - Y(X) sin(turn) has the column's value: Newton's method finds it. A boundary that folds over
is done alone.
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.library.sections import section_curve

__all__ = ["depths_at_columns"]

Floats = NDArray[np.float64]

STATION_M = 0.05e-3  # where the wall bends with a radius of 1 mm, what lies between two stations is 0.3 um off
NEWTON_STEPS = 4
MIN_NODES = 2


def depths_at_columns(
    square_sbn: Floats, depth_sbn: Floats, columns_sc: Floats, turn_s: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the depth of boundaries in the columns of their slices.

    Args:
        square_sbn: X^2 of the rings (sample, boundary, node), m^2; negative where the plane misses a ring.
        depth_sbn: Y of the rings, m.
        columns_sc: laterals of the columns, after the turn (sample, column), m.
        turn_s: turn of the section about its frame's origin, from lateral to depth (sample,), rad.

    Returns:
        Depths after the turn (sample, boundary, column), m, NaN where there is no wall; where a boundary folds over, of
        the part seen from above. And which samples have such a boundary (sample,).
    """
    reach_m = np.abs(columns_sc).max(axis=1)
    reach_m = reach_m + np.where(turn_s != 0.0, np.abs(np.sin(turn_s)) * np.abs(depth_sbn).max(axis=(1, 2)), 0.0)
    folds_sb = _folds(square_sbn, reach_m)
    curves = _Stations.along(square_sbn, depth_sbn, float(reach_m.max()))
    folds_sb |= curves.hang_over(turn_s, reach_m)
    found = curves.at(np.broadcast_to(columns_sc[:, None], (*folds_sb.shape, columns_sc.shape[1])))
    turned = np.flatnonzero(turn_s)
    if len(turned):
        found[turned] = curves.of(turned).at_turned(columns_sc[turned, None], turn_s[turned, None, None])
    for sample, boundary in np.argwhere(folds_sb):
        rings = square_sbn[sample, boundary], depth_sbn[sample, boundary]
        found[sample, boundary] = _folded(columns_sc[sample], *rings, float(turn_s[sample]))
    return found, np.asarray(folds_sb.any(axis=1))


class _Stations:
    """Y (sample, boundary, station) at X = 0, STATION_M, 2 STATION_M ...; NaN beyond the last ring.

    Between two stations Y is linear in X^2, as it is between two rings.
    """

    def __init__(self, depth_sbt: Floats) -> None:
        self.depth_sbt = depth_sbt
        squares = (np.arange(depth_sbt.shape[2]) * STATION_M) ** 2
        self.slope_sbt = np.diff(depth_sbt, axis=2) / np.diff(squares)

    @classmethod
    def along(cls, square_sbn: Floats, depth_sbn: Floats, reach_m: float) -> "_Stations":
        stations = int(reach_m / STATION_M) + 2
        nodes, rows = square_sbn.shape[2], square_sbn.shape[0] * square_sbn.shape[1]
        # The last ring at or before each station: count the rings up to it.
        first = np.ceil(np.sqrt(np.maximum(square_sbn, 0.0)) / STATION_M).clip(0, stations).astype(np.intp)
        flat = first.reshape(rows, nodes) + np.arange(rows)[:, None] * (stations + 1)
        count = np.bincount(flat.ravel(), minlength=rows * (stations + 1)).reshape(rows, -1)[:, :stations]
        ring = (np.cumsum(count, axis=1) - 1).clip(0, nodes - 2) + np.arange(rows)[:, None] * nodes
        square, depth = square_sbn.ravel(), depth_sbn.ravel()
        rise = np.diff(square, append=square[-1])
        slope = np.diff(depth, append=depth[-1]) / np.where(rise == 0.0, 1.0, rise)
        wanted = (np.arange(stations) * STATION_M) ** 2
        found = depth[ring] + (wanted - square[ring]) * slope[ring]
        last = square_sbn[..., -1].reshape(rows, 1)
        found[wanted > last] = np.nan
        return cls(found.reshape(*square_sbn.shape[:2], stations))

    def of(self, samples: NDArray[np.intp]) -> "_Stations":
        """Return those of some samples."""
        return _Stations(self.depth_sbt[samples])

    def hang_over(self, turn_s: Floats, reach_m: Floats) -> NDArray[np.bool_]:
        """Whether boundaries run back, on either side, once they are turned (sample, boundary)."""
        steepest = np.abs(np.diff(self.depth_sbt, axis=2)) / STATION_M
        shown = np.arange(steepest.shape[2]) * STATION_M < reach_m[:, None, None]
        return np.asarray((shown & (steepest * np.abs(np.tan(turn_s))[:, None, None] >= 1.0)).any(axis=2))

    def at(self, lateral_sbc: Floats) -> Floats:
        """Return Y at X (sample, boundary, column)."""
        return self._at(lateral_sbc)[0]

    def at_turned(self, columns_sbc: Floats, turn_sbc: Floats) -> Floats:
        """Return the depth at the columns of sections that are turned."""
        c, s = np.cos(turn_sbc), np.sin(turn_sbc)
        lateral = np.broadcast_to(columns_sbc, (*self.depth_sbt.shape[:2], columns_sbc.shape[2]))
        for _ in range(NEWTON_STEPS):
            depth, slope = self._at(lateral)
            lateral = lateral - (c * lateral - s * depth - columns_sbc) / (c - s * slope)
        depth, _ = self._at(lateral)
        return np.asarray(s * lateral + c * depth)

    def _at(self, lateral_sbc: Floats) -> tuple[Floats, Floats]:
        """Y and dY/dX at X (sample, boundary, column)."""
        samples, boundaries, stations = self.depth_sbt.shape
        distance = np.abs(lateral_sbc)
        left = np.nan_to_num(distance / STATION_M, nan=stations).astype(np.intp)
        outside = left > stations - 2
        np.minimum(left, stations - 2, out=left)
        row = np.arange(samples * boundaries).reshape(samples, boundaries, 1)
        slope = self.slope_sbt.ravel()[row * (stations - 1) + left]
        rest = distance**2 - (left * STATION_M) ** 2
        depth = self.depth_sbt.ravel()[row * stations + left] + rest * slope
        depth[outside] = np.nan
        return depth, 2.0 * lateral_sbc * slope


def _folds(square_sbn: Floats, reach_m: Floats) -> NDArray[np.bool_]:
    """Whether boundaries run back where they are shown (sample, boundary)."""
    low, high = square_sbn[..., :-1], square_sbn[..., 1:]
    met = (np.maximum(low, high) >= 0.0) & (low < reach_m[:, None, None] ** 2)
    return np.asarray((met & (high <= low)).any(axis=2))


def _folded(columns: Floats, square: Floats, depth: Floats, turn_rad: float) -> Floats:
    """Depth, seen from above, of a boundary at laterals (column,), from all of its rings."""
    lateral, deep = section_curve(square, depth).T
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    return _seen_from_above(columns, c * lateral - s * deep, s * lateral + c * deep)


def _seen_from_above(wanted: Floats, place: Floats, depth: Floats) -> Floats:
    """Smallest depth of a curve at the wanted places; NaN where it has none. `place` may run back and forth."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(place)))) + 1
    runs = np.split(np.arange(len(place)), turns)
    smallest = np.full(len(wanted), np.nan)
    for number, run in enumerate(runs):
        ends = np.append(run, run[-1] + 1) if number < len(runs) - 1 else run
        if len(ends) < MIN_NODES:
            continue
        order = ends if place[ends[-1]] > place[ends[0]] else ends[::-1]
        smallest = np.fmin(smallest, np.interp(wanted, place[order], depth[order], left=np.nan, right=np.nan))
    return smallest
