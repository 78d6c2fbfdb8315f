"""Slices of many walls at once: boundaries at the columns of the slice, and the wall between them (NumPy only).

`sections.cut_rings` gives X^2 and Y of each ring. Y is taken first at evenly spaced X, the *stations*, for all sections
together; a place between two stations is then found without a search. A section that is turned in its plane meets a
column where X cos(turn) - Y(X) sin(turn) has the column's value: Newton's method finds it. A boundary that folds over
is done alone. The motion of `sections.section_motion` moves the stations.

The picture is that of `mechanics.section.fill_section` for the same curves: a pixel is wall where its centre lies in
the wall. Boundaries come separately, so that a segmentation's errors can be added before they are filled.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from scleraforce.arrays import Bytes, Flags, Floats, Places, Reals
from scleraforce.library.sections import ACROSS, ALONG, DOWN, SectionMotion, cut_rings, cut_surfaces, section_curve
from scleraforce.mechanics.contact import Section
from scleraforce.mechanics.section import SNAP, WALL, fill_section, slice_window
from scleraforce.study import SliceStudy

STATION_M = 0.05e-3  # where the wall bends with a radius of 1 mm, what lies between two stations is 0.3 um off
NEWTON_STEPS = 4
MIN_NODES = 2


def depths_at_columns(
    square_sbn: Floats,
    depth_sbn: Floats,
    columns_sc: Floats,
    turn_s: Floats,
    moved: tuple[Floats, SectionMotion] | None = None,
) -> tuple[Floats, Flags]:
    """Return the depth of boundaries in the columns of their slices, and which samples fold over (sample,).

    The depths (sample, boundary, column), m, are after the turn (sample,) of the section about its frame's origin: NaN
    where there is no wall; where a boundary folds over, of the part seen from above. `square_sbn` and `depth_sbn`
    (sample, boundary, node) are X^2 and Y of the rings, X^2 negative where the plane misses one. `moved`: distance of
    the planes (sample,), m, and the motion; X^2 includes the motion of the contact across the plane.
    """
    reach_m = np.abs(columns_sc).max(axis=1)
    reach_m = reach_m + np.where(turn_s != 0.0, np.abs(np.sin(turn_s)) * np.abs(depth_sbn).max(axis=(1, 2)), 0.0)
    if moved:
        reach_m = reach_m + np.abs(moved[1].moved_sbpc[..., ALONG]).max(axis=(1, 2))
    low, high = square_sbn[..., :-1], square_sbn[..., 1:]
    shown = (np.maximum(low, high) >= 0.0) & (low < reach_m[:, None, None] ** 2)
    folds_sb = (shown & (high <= low)).any(axis=2)  # boundaries that run back where they are shown
    curves = _Stations.along(square_sbn, depth_sbn, float(reach_m.max()))
    if moved:
        curves = curves.moved(*moved)
    folds_sb |= curves.hang_over(turn_s, reach_m)
    found = np.empty((*folds_sb.shape, columns_sc.shape[1]))
    upright, turned = np.flatnonzero(turn_s == 0.0), np.flatnonzero(turn_s)
    if len(upright):
        found[upright] = curves.of(upright).at(np.broadcast_to(columns_sc[upright, None], found[upright].shape))
    if len(turned):
        found[turned] = curves.of(turned).at_turned(columns_sc[turned, None], turn_s[turned, None, None])
    for sample, boundary in np.argwhere(folds_sb):
        curve = section_curve(square_sbn[sample, boundary], depth_sbn[sample, boundary])
        if moved:
            curve += moved[1].of(slice(sample, sample + 1)).at(curve[:, 0])[0, boundary][:, [ALONG, DOWN]]
        c, s = np.cos(turn_s[sample]), np.sin(turn_s[sample])
        place, depth = c * curve[:, 0] - s * curve[:, 1], s * curve[:, 0] + c * curve[:, 1]
        found[sample, boundary] = _seen_from_above(columns_sc[sample], place, depth)
    return found, np.asarray(folds_sb.any(axis=1))


class _Stations:
    """Y (sample, boundary, station) at X = 0, STATION_M, 2 STATION_M ...; NaN beyond the last ring.

    Between two stations Y is linear in X^2, as it is between two rings. Sections are symmetric until they are `moved`:
    then stations lie on both sides, and X = 0 is the station number `middle`.
    """

    def __init__(self, depth_sbt: Floats, middle: int = 0) -> None:
        self.depth_sbt, self.middle = depth_sbt, middle
        self.lateral_t = (np.arange(depth_sbt.shape[2]) - middle) * STATION_M
        self.slope_sbt = np.diff(depth_sbt, axis=2) / np.diff(self.lateral_t**2)

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

    def of(self, samples: Places) -> "_Stations":
        """Return the stations of some samples."""
        return _Stations(self.depth_sbt[samples], self.middle)

    def moved(self, gap_s: Floats, motion: SectionMotion) -> "_Stations":
        """Return sections that have moved: each place shows the point that has moved there."""
        last = self.depth_sbt.shape[2] - 1
        lateral = np.arange(-last, last + 1) * STATION_M
        moved = motion.at(lateral)
        # r^2 = (X - along)^2 + (gap - across)^2, and the rings were cut where the contact has come from.
        gap, contact, across = gap_s[:, None, None], motion.across_contact[:, None, None], moved[..., ACROSS]
        square = (lateral - moved[..., ALONG]) ** 2 + (contact - across) * (2.0 * gap - contact - across)
        return _Stations(self.at(np.sqrt(np.maximum(square, 0.0))) + moved[..., DOWN], middle=last)

    def hang_over(self, turn_s: Floats, reach_m: Floats) -> Flags:
        """Return True for boundaries that run back, on either side, once they are turned (sample, boundary)."""
        steepest = np.abs(np.diff(self.depth_sbt, axis=2)) / STATION_M
        shown = np.minimum(np.abs(self.lateral_t[:-1]), np.abs(self.lateral_t[1:])) < reach_m[:, None, None]
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
        from_first = lateral_sbc / STATION_M + self.middle if self.middle else np.abs(lateral_sbc) / STATION_M
        left = np.nan_to_num(from_first, nan=stations).astype(np.intp)
        outside = (left > stations - 2) | (from_first < 0.0)
        np.clip(left, 0, stations - 2, out=left)
        row = np.arange(samples * boundaries).reshape(samples, boundaries, 1)
        slope = self.slope_sbt.ravel()[row * (stations - 1) + left]
        rest = lateral_sbc**2 - self.lateral_t[left] ** 2
        depth = self.depth_sbt.ravel()[row * stations + left] + rest * slope
        depth[outside] = np.nan
        return depth, 2.0 * lateral_sbc * slope


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


BLOCK = 128  # samples cut together: their arrays stay in the cache


@dataclass(frozen=True)
class Framing:
    """The places of sections in their slices; each array is (sample,).

    A section is turned about its frame's origin (the undeformed contact, moved by the gap), from lateral to depth,
    scaled about it, and then moved: `lateral_m` is the origin's place from the middle column, `depth_m` its depth below
    the slice's top edge.
    """

    lateral_m: Floats
    depth_m: Floats
    scale: Floats
    turn_rad: Floats

    @classmethod
    def upright(cls, lateral_m: Floats, depth_m: Floats) -> "Framing":
        """Return the framing that only moves."""
        return cls(lateral_m, depth_m, np.ones_like(depth_m), np.zeros_like(depth_m))

    def place(self, sample: int | np.integer[Any], points: Floats) -> Floats:
        """Return points (point, 2) of a sample's plane, lateral and depth in m, in its slice."""
        c, s = np.cos(self.turn_rad[sample]), np.sin(self.turn_rad[sample])
        turned = points @ np.array([[c, s], [-s, c]])
        return np.asarray(self.scale[sample] * turned + [self.lateral_m[sample], self.depth_m[sample]])


@dataclass(frozen=True)
class WallBoundaries:
    """Boundaries of walls in the columns of their slices.

    `depth_sbc` (sample, boundary, column): depth of the outer and the inner boundary below the slice's top edge at the
    centre of the column, m; NaN where there is none. Where a boundary folds over, the part seen from above. `folded`
    (sample,): some boundary folds over, so that the two depths are not the whole wall.
    """

    depth_sbc: Floats
    folded: Flags


def column_laterals(study: SliceStudy) -> Floats:
    """Return the centres of a slice's columns (column,), m from its middle."""
    return np.asarray((np.arange(study.columns) + 0.5 - 0.5 * study.columns) * study.pixel_m)


def wall_boundaries(
    curves_sbnc: Reals,
    gap_m: Floats,
    tilt_rad: Floats,
    framing: Framing,
    study: SliceStudy,
    motion: SectionMotion | None = None,
) -> WallBoundaries:
    """Cut walls by their B-scan planes and return the boundaries in the columns of the slices.

    `curves_sbnc` must include all material that the slice shows; `motion` moves the points that the planes meet.
    """
    columns_sc = (column_laterals(study) - framing.lateral_m[:, None]) / framing.scale[:, None]
    depth_sbc = np.empty((*curves_sbnc.shape[:2], study.columns))
    folded = np.empty(len(depth_sbc), dtype=bool)
    for start in range(0, len(depth_sbc), BLOCK):
        block = slice(start, start + BLOCK)
        moved = (gap_m[block], motion.of(block)) if motion else None
        from_m = gap_m[block] - moved[1].across_contact if moved else gap_m[block]
        rings = cut_rings(curves_sbnc[block], from_m[:, None, None], tilt_rad[block, None, None])
        depth_sbc[block], folded[block] = depths_at_columns(*rings, columns_sc[block], framing.turn_rad[block], moved)
    depth_sbc *= framing.scale[:, None, None]
    depth_sbc += framing.depth_m[:, None, None]
    return WallBoundaries(depth_sbc, folded)


def fill_boundaries(depth_sbc: Floats, study: SliceStudy) -> Bytes:
    """Draw walls, (sample, rows, columns): 255 in each pixel whose centre lies between the boundaries, else 0.

    The boundaries (sample, boundary, column) are m below the top edge; NaN: no wall in this column. A centre on a
    boundary belongs to the side below it.
    """
    rows = np.rint(depth_sbc * (SNAP / study.pixel_m)) / SNAP - 0.5
    first = np.ceil(np.clip(rows - 0.5 / SNAP, 0.0, study.rows))
    first[np.isnan(first).any(axis=1, keepdims=True).repeat(2, axis=1)] = study.rows
    ends = np.sort(first, axis=1).astype(np.int16)[:, :, None]
    row = np.arange(study.rows, dtype=np.int16)[:, None]
    inside = (row >= ends[:, 0]) & (row < ends[:, 1])
    return inside.view(np.uint8) * np.uint8(WALL)


def draw_slices(curves_sbnc: Reals, gap_m: Floats, tilt_rad: Floats, framing: Framing, study: SliceStudy) -> Bytes:
    """Return the slices of walls, shape (sample, rows, columns), 255 = wall; arguments of `wall_boundaries`.

    A plane that misses a wall that folds over raises `InputError`.
    """
    boundaries = wall_boundaries(curves_sbnc, gap_m, tilt_rad, framing, study)
    images = fill_boundaries(boundaries.depth_sbc, study)
    window = slice_window(study, study.margin_m)
    for sample in np.flatnonzero(boundaries.folded):
        section = cut_surfaces(curves_sbnc[sample], float(gap_m[sample]), float(tilt_rad[sample]))
        placed = (framing.place(sample, curve) for curve in (section.outer, section.inner))
        images[sample] = fill_section(Section(*placed), window)
    return images
