"""Surfaces of revolution, cut by the plane of the B-scan, in closed form, and the
slices that many walls show at once.

A surface consists of rings at distance r from the needle axis and depth d below the
undeformed contact. In the frame of `mechanics.contact_and_section.ScanPlane` (gap g,
tilt tau) the point of the plane at lateral X and depth Y lies at X along the lateral
axis, g + Y sin(tau) along the offset, and Y cos(tau) deep. So the plane meets the ring
(r, d) at

    Y = d / cos(tau),   X^2 = r^2 - (g + d tan(tau))^2,

if that is not negative: on both sides of the needle axis alike, whatever the direction
of the plane. Between two rings of the library, Y is interpolated linearly in X^2: that
is exact for a parabola, also at X = 0, where X itself grows like a square root along
the surface. `section_motion` adds the effect of the eye's base (`library.moving_base`).

Of many walls, Y is taken first at evenly spaced X, the *stations*, for all sections
together; a place between two stations is then found without a search. A section that is
turned in its plane meets a column where X cos(turn) - Y(X) sin(turn) has the column's
value: Newton's method finds it. A boundary that folds over is done alone. The picture
is that of `mechanics.mesh_section.fill_section` for the same curves: a pixel is wall
where its centre is in the wall. Boundaries come separately, so that a segmentation's
errors can be added before they are filled.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from scleraforce.base.arrays import Bytes, Flags, Floats, Places, Reals
from scleraforce.base.errors import InputError
from scleraforce.library.moving_base import base_push, section_places
from scleraforce.library.wall_responses import INNER, OUTER, Library, Responses
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.mechanics.mesh_section import SNAP, WALL, fill_section, slice_window
from scleraforce.records.study import SliceStudy

PARTS = 4  # points of a section for each ring of the surface
PARTS_MIDDLE = 12  # between X = 0 and the first ring that the plane meets


def cut_rings(
    curves: Reals, gap_m: Floats | float, tilt_rad: Floats | float
) -> tuple[Floats, Floats]:
    """Return X^2 (..., node), m^2, and Y (..., node), m, of the rings; X^2 is negative
    where the plane misses one.

    The curves are distance from the needle axis and depth of the rings (..., node, 2),
    m; gap and tilt broadcast.
    """
    distance = curves[..., 0].astype(np.float64)
    deep = curves[..., 1].astype(np.float64)
    return distance**2 - (gap_m + deep * np.tan(tilt_rad)) ** 2, deep / np.cos(tilt_rad)


def cut_surfaces(curves_bnc: Reals, gap_m: float, tilt_rad: float = 0.0) -> WallSection:
    """Cut a wall, two surfaces of revolution about the needle axis (boundary, node, 2):
    distance and depth, m.

    The section goes from negative to positive lateral side, in the order of the
    material. A plane that misses a surface raises `InputError`, here and below.
    """
    square_bn, depth_bn = cut_rings(curves_bnc, gap_m, tilt_rad)
    return WallSection(
        *(
            section_curve(square_bn[boundary], depth_bn[boundary])
            for boundary in (OUTER, INNER)
        )
    )


def highest_depths(curves_snc: Reals, gap_m: Floats, tilt_rad: Floats) -> Floats:
    """Return the smallest depth of the section of each surface (sample,), m; the
    surfaces are (sample, node, 2).
    """
    square, depth = cut_rings(curves_snc, gap_m[:, None], tilt_rad[:, None])
    first, middle = _middle(square, depth)
    beyond = np.arange(square.shape[1]) > first[:, None]
    return np.minimum(np.where(beyond, depth, np.inf).min(axis=1), middle)


def _middle(square: Floats, depth: Floats) -> tuple[Places, Floats]:
    """Return the last node before X = 0 (...), and the depth there (...)."""
    missed = square < 0.0
    if missed[..., -1].any():
        raise InputError(
            "the B-scan plane misses a surface of the wall; its gap or tilt is too"
            " large"
        )

    nodes = square.shape[-1]
    before = np.where(
        missed.any(axis=-1), nodes - 1 - np.argmax(missed[..., ::-1], axis=-1), 0
    )
    pair = before[..., None] + np.arange(2)
    (low, high), (start, end) = (
        np.moveaxis(np.take_along_axis(values, pair, axis=-1), -1, 0)
        for values in (square, depth)
    )
    part = np.clip(-low / np.where(high > low, high - low, 1.0), 0.0, 1.0)

    return before, start + part * (end - start)


def section_curve(square: Floats, depth: Floats) -> Floats:
    """Return one boundary (points, 2) from X^2 and Y of its rings (node,), from
    negative to positive lateral side.
    """
    before, middle = _middle(square, depth)
    squares = np.concatenate([[0.0], square[before + 1 :]])
    depths = np.concatenate([[middle], depth[before + 1 :]])
    steps = np.full(len(squares) - 1, PARTS)
    steps[0] = PARTS_MIDDLE
    ring = np.repeat(np.arange(len(steps)), steps)
    part = (np.arange(len(ring)) - (np.cumsum(steps) - steps)[ring]) / steps[ring]
    lateral = np.sqrt(squares)
    # equal steps in each interval
    lateral = np.append(lateral[ring] + part * np.diff(lateral)[ring], lateral[-1])
    rise = np.diff(squares)
    part = (lateral[:-1] ** 2 - squares[ring]) / np.where(rise == 0.0, 1.0, rise)[ring]
    deep = np.append(depths[ring] + part * np.diff(depths)[ring], depths[-1])
    half = np.stack([lateral, deep], axis=1)

    return np.concatenate([half[:0:-1] * [-1.0, 1.0], half])


# between places; the motion is smooth, and linear between them to 1 um
PLACE_M = 1.2e-3
# from the axis, where it counts how much wider a wall has become: a dent hardly reaches
# so far
GROWN_RAD = 0.4
BLOCK = 128  # samples together: their arrays stay in the cache
ALONG, ACROSS, DOWN = range(3)


@dataclass(frozen=True, eq=False)
class SectionMotion:
    """The motion of sections, in the library's size.

    `lateral_p` (place,): even places of a section, m, the same to both sides of the
    needle axis. `moved_sbpc` (sample, boundary, place, [along the section, across it,
    down]), m.
    """

    lateral_p: Floats
    moved_sbpc: Floats

    def of(self, samples: slice) -> "SectionMotion":
        """Return the motion of some samples."""
        return SectionMotion(self.lateral_p, self.moved_sbpc[samples])

    def at(self, lateral_t: Floats) -> Floats:
        """Return the motion at other places (sample, boundary, place, 3), m."""
        step = self.lateral_p[1] - self.lateral_p[0]
        from_first = np.clip(
            (lateral_t - self.lateral_p[0]) / step, 0.0, len(self.lateral_p) - 1
        )
        left = np.minimum(from_first.astype(np.intp), len(self.lateral_p) - 2)
        weights = np.zeros((len(lateral_t), len(self.lateral_p)))
        rows = np.arange(len(lateral_t))
        share = from_first - left
        weights[rows, left] = 1.0 - share
        weights[rows, left + 1] = share

        return np.asarray(weights @ self.moved_sbpc)

    @property
    def across_contact(self) -> Floats:
        """Motion of the contact across the section (sample,), m."""
        return self.moved_sbpc[:, 0, len(self.lateral_p) // 2, ACROSS]


def section_motion(
    library: Library,
    walls: Responses,
    place: tuple[Floats, Floats],
    gap_m: Floats,
    pole_s2: Floats,
    reach_m: float,
) -> SectionMotion:
    """Return the motion of the sections of a library's states by pressure and force.

    `place`: thickness, m, and pressure over E of the walls, (sample,) each. `gap_m`
    (sample,) is the sections'; `pole_s2` the direction of the eye's pole
    (`moving_base.pole_directions`); `reach_m` the sections' half width.
    """
    thickness_m, iop_ratio = place
    angles = library.node_angles()
    node = min(int(np.searchsorted(angles, GROWN_RAD)), len(angles) - 1)
    grown_s: Floats = walls.curves_sbnc[:, OUTER, node, 0] / (
        library.radius_m * np.sin(angles[node])
    )
    lateral = reach_m * np.linspace(-1.0, 1.0, 2 * int(np.ceil(reach_m / PLACE_M)) + 1)
    radii_sb = library.radius_m - np.stack(
        [np.zeros_like(thickness_m), thickness_m], axis=1
    )
    # from here to unit vectors at rest
    per_rest = 1.0 / (radii_sb * grown_s[:, None])[..., None]
    moved = np.empty((len(gap_m), 2, len(lateral), 3))

    for start in range(0, len(gap_m), BLOCK):
        some = slice(start, start + BLOCK)
        places = section_places(
            lateral * per_rest[some], gap_m[some, None, None] * per_rest[some]
        )
        moved[some] = library.base_bulge(
            thickness_m[some], iop_ratio[some], places, pole_s2[some]
        )

    pushed = base_push(walls.force_ratio, thickness_m, library.poisson_ratio)
    moved[..., :DOWN] += (pushed[:, None] * pole_s2)[:, None, None, :]
    return SectionMotion(lateral, moved)


# where the wall bends with a radius of 1 mm, what lies between two stations is 0.3 um
# off
STATION_M = 0.05e-3
NEWTON_STEPS = 4
MIN_NODES = 2


def depths_at_columns(
    square_sbn: Floats,
    depth_sbn: Floats,
    columns_sc: Floats,
    turn_s: Floats,
    moved: tuple[Floats, SectionMotion] | None = None,
) -> tuple[Floats, Flags]:
    """Return the depth of boundaries in the columns of their slices, and which samples
    fold over (sample,).

    The depths (sample, boundary, column), m, are after the turn (sample,) of the
    section about its frame's origin: NaN where there is no wall; where a boundary folds
    over, of the part seen from above. `square_sbn` and `depth_sbn` (sample, boundary,
    node) are X^2 and Y of the rings, X^2 negative where the plane misses one. `moved`:
    distance of the planes (sample,), m, and the motion; X^2 includes the motion of the
    contact across the plane.
    """
    reach_m = np.abs(columns_sc).max(axis=1)
    reach_m = reach_m + np.where(
        turn_s != 0.0, np.abs(np.sin(turn_s)) * np.abs(depth_sbn).max(axis=(1, 2)), 0.0
    )

    if moved:
        reach_m = reach_m + np.abs(moved[1].moved_sbpc[..., ALONG]).max(axis=(1, 2))

    low = square_sbn[..., :-1]
    high = square_sbn[..., 1:]
    shown = (np.maximum(low, high) >= 0.0) & (low < reach_m[:, None, None] ** 2)
    # boundaries that run back where they are shown
    folds_sb = (shown & (high <= low)).any(axis=2)
    curves = _Stations.along(square_sbn, depth_sbn, float(reach_m.max()))

    if moved:
        curves = curves.moved(*moved)

    folds_sb |= curves.hang_over(turn_s, reach_m)
    found = np.empty((*folds_sb.shape, columns_sc.shape[1]))
    upright = np.flatnonzero(turn_s == 0.0)
    turned = np.flatnonzero(turn_s)

    if len(upright):
        found[upright] = curves.of(upright).at(
            np.broadcast_to(columns_sc[upright, None], found[upright].shape)
        )

    if len(turned):
        found[turned] = curves.of(turned).at_turned(
            columns_sc[turned, None], turn_s[turned, None, None]
        )

    for sample, boundary in np.argwhere(folds_sb):
        curve = section_curve(square_sbn[sample, boundary], depth_sbn[sample, boundary])
        if moved:
            curve += (
                moved[1]
                .of(slice(sample, sample + 1))
                .at(curve[:, 0])[0, boundary][:, [ALONG, DOWN]]
            )

        c = np.cos(turn_s[sample])
        s = np.sin(turn_s[sample])
        place = c * curve[:, 0] - s * curve[:, 1]
        depth = s * curve[:, 0] + c * curve[:, 1]
        found[sample, boundary] = _seen_from_above(columns_sc[sample], place, depth)

    return found, np.asarray(folds_sb.any(axis=1))


class _Stations:
    """Y (sample, boundary, station) at X = 0, STATION_M, 2 STATION_M ...; NaN beyond
    the last ring.

    Between two stations Y is linear in X^2, as it is between two rings. Sections are
    symmetric until they are `moved`: then stations lie on both sides, and X = 0 is the
    station number `middle`.
    """

    def __init__(self, depth_sbt: Floats, middle: int = 0) -> None:
        self.depth_sbt = depth_sbt
        self.middle = middle
        self.lateral_t = (np.arange(depth_sbt.shape[2]) - middle) * STATION_M
        self.slope_sbt = np.diff(depth_sbt, axis=2) / np.diff(self.lateral_t**2)

    @classmethod
    def along(
        cls, square_sbn: Floats, depth_sbn: Floats, reach_m: float
    ) -> "_Stations":
        stations = int(reach_m / STATION_M) + 2
        nodes = square_sbn.shape[2]
        rows = square_sbn.shape[0] * square_sbn.shape[1]
        # The last ring at or before each station: count the rings up to it.
        first = (
            np.ceil(np.sqrt(np.maximum(square_sbn, 0.0)) / STATION_M)
            .clip(0, stations)
            .astype(np.intp)
        )
        flat = first.reshape(rows, nodes) + np.arange(rows)[:, None] * (stations + 1)
        count = np.bincount(flat.ravel(), minlength=rows * (stations + 1)).reshape(
            rows, -1
        )[:, :stations]
        ring = (np.cumsum(count, axis=1) - 1).clip(0, nodes - 2) + np.arange(rows)[
            :, None
        ] * nodes
        square = square_sbn.ravel()
        depth = depth_sbn.ravel()
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
        """Return sections that have moved: each place shows the point that has moved
        there.
        """
        last = self.depth_sbt.shape[2] - 1
        lateral = np.arange(-last, last + 1) * STATION_M
        moved = motion.at(lateral)
        # r^2 = (X - along)^2 + (gap - across)^2, and the rings were cut where the
        # contact has come from.
        gap = gap_s[:, None, None]
        contact = motion.across_contact[:, None, None]
        across = moved[..., ACROSS]
        square = (lateral - moved[..., ALONG]) ** 2 + (contact - across) * (
            2.0 * gap - contact - across
        )

        return _Stations(
            self.at(np.sqrt(np.maximum(square, 0.0))) + moved[..., DOWN], middle=last
        )

    def hang_over(self, turn_s: Floats, reach_m: Floats) -> Flags:
        """Return True for boundaries that run back, on either side, once they are
        turned (sample, boundary).
        """
        steepest = np.abs(np.diff(self.depth_sbt, axis=2)) / STATION_M
        shown = (
            np.minimum(np.abs(self.lateral_t[:-1]), np.abs(self.lateral_t[1:]))
            < reach_m[:, None, None]
        )

        return np.asarray(
            (shown & (steepest * np.abs(np.tan(turn_s))[:, None, None] >= 1.0)).any(
                axis=2
            )
        )

    def at(self, lateral_sbc: Floats) -> Floats:
        """Return Y at X (sample, boundary, column)."""
        return self._at(lateral_sbc)[0]

    def at_turned(self, columns_sbc: Floats, turn_sbc: Floats) -> Floats:
        """Return the depth at the columns of sections that are turned."""
        c = np.cos(turn_sbc)
        s = np.sin(turn_sbc)
        lateral = np.broadcast_to(
            columns_sbc, (*self.depth_sbt.shape[:2], columns_sbc.shape[2])
        )

        for _ in range(NEWTON_STEPS):
            depth, slope = self._at(lateral)
            lateral = lateral - (c * lateral - s * depth - columns_sbc) / (
                c - s * slope
            )

        depth, _ = self._at(lateral)
        return np.asarray(s * lateral + c * depth)

    def _at(self, lateral_sbc: Floats) -> tuple[Floats, Floats]:
        """Y and dY/dX at X (sample, boundary, column)."""
        samples, boundaries, stations = self.depth_sbt.shape
        from_first = (
            lateral_sbc / STATION_M + self.middle
            if self.middle
            else np.abs(lateral_sbc) / STATION_M
        )
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
    """Smallest depth of a curve at the wanted places; NaN where it has none. `place`
    may run back and forth.
    """
    turns = np.flatnonzero(np.diff(np.sign(np.diff(place)))) + 1
    runs = np.split(np.arange(len(place)), turns)
    smallest = np.full(len(wanted), np.nan)

    for number, run in enumerate(runs):
        ends = np.append(run, run[-1] + 1) if number < len(runs) - 1 else run
        if len(ends) < MIN_NODES:
            continue

        order = ends if place[ends[-1]] > place[ends[0]] else ends[::-1]
        smallest = np.fmin(
            smallest,
            np.interp(wanted, place[order], depth[order], left=np.nan, right=np.nan),
        )

    return smallest


@dataclass(frozen=True)
class Framing:
    """The places of sections in their slices; each array is (sample,).

    A section is turned about its frame's origin (the undeformed contact, moved by the
    gap), from lateral to depth, scaled about it, and then moved: `lateral_m` is the
    origin's place from the middle column, `depth_m` its depth below the slice's top
    edge.
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
        """Return points (point, 2) of a sample's plane, lateral and depth in m, in its
        slice.
        """
        c = np.cos(self.turn_rad[sample])
        s = np.sin(self.turn_rad[sample])
        turned = points @ np.array([[c, s], [-s, c]])
        return np.asarray(
            self.scale[sample] * turned + [self.lateral_m[sample], self.depth_m[sample]]
        )


@dataclass(frozen=True)
class WallBoundaries:
    """Boundaries of walls in the columns of their slices.

    `depth_sbc` (sample, boundary, column): depth of the outer and the inner boundary
    below the slice's top edge at the centre of the column, m; NaN where there is none.
    Where a boundary folds over, the part seen from above. `folded` (sample,): some
    boundary folds over, so that the two depths are not the whole wall.
    """

    depth_sbc: Floats
    folded: Flags


def column_laterals(study: SliceStudy) -> Floats:
    """Return the centres of a slice's columns (column,), m from its middle."""
    return np.asarray(
        (np.arange(study.columns) + 0.5 - 0.5 * study.columns) * study.pixel_m
    )


def wall_boundaries(
    curves_sbnc: Reals,
    gap_m: Floats,
    tilt_rad: Floats,
    framing: Framing,
    study: SliceStudy,
    motion: SectionMotion | None = None,
) -> WallBoundaries:
    """Cut walls by their B-scan planes and return the boundaries in the columns of the
    slices.

    `curves_sbnc` must include all material that the slice shows; `motion` moves the
    points that the planes meet.
    """
    columns_sc = (column_laterals(study) - framing.lateral_m[:, None]) / framing.scale[
        :, None
    ]
    depth_sbc = np.empty((*curves_sbnc.shape[:2], study.columns))
    folded = np.empty(len(depth_sbc), dtype=bool)

    for start in range(0, len(depth_sbc), BLOCK):
        block = slice(start, start + BLOCK)
        moved = (gap_m[block], motion.of(block)) if motion else None
        from_m = gap_m[block] - moved[1].across_contact if moved else gap_m[block]
        rings = cut_rings(
            curves_sbnc[block], from_m[:, None, None], tilt_rad[block, None, None]
        )
        depth_sbc[block], folded[block] = depths_at_columns(
            *rings, columns_sc[block], framing.turn_rad[block], moved
        )

    depth_sbc *= framing.scale[:, None, None]
    depth_sbc += framing.depth_m[:, None, None]
    return WallBoundaries(depth_sbc, folded)


def fill_boundaries(depth_sbc: Floats, study: SliceStudy) -> Bytes:
    """Draw walls, (sample, rows, columns): 255 in each pixel whose centre lies between
    the boundaries, else 0.

    The boundaries (sample, boundary, column) are m below the top edge; NaN: no wall in
    this column. A centre on a boundary belongs to the side below it.
    """
    rows = np.rint(depth_sbc * (SNAP / study.pixel_m)) / SNAP - 0.5
    first = np.ceil(np.clip(rows - 0.5 / SNAP, 0.0, study.rows))
    first[np.isnan(first).any(axis=1, keepdims=True).repeat(2, axis=1)] = study.rows
    ends = np.sort(first, axis=1).astype(np.int16)[:, :, None]
    row = np.arange(study.rows, dtype=np.int16)[:, None]
    inside = (row >= ends[:, 0]) & (row < ends[:, 1])

    return inside.view(np.uint8) * np.uint8(WALL)


def draw_slices(
    curves_sbnc: Reals,
    gap_m: Floats,
    tilt_rad: Floats,
    framing: Framing,
    study: SliceStudy,
) -> Bytes:
    """Return the slices of walls, shape (sample, rows, columns), 255 = wall; arguments
    of `wall_boundaries`.

    A plane that misses a wall that folds over raises `InputError`.
    """
    boundaries = wall_boundaries(curves_sbnc, gap_m, tilt_rad, framing, study)
    images = fill_boundaries(boundaries.depth_sbc, study)
    window = slice_window(study, study.margin_m)

    for sample in np.flatnonzero(boundaries.folded):
        section = cut_surfaces(
            curves_sbnc[sample], float(gap_m[sample]), float(tilt_rad[sample])
        )
        placed = (
            framing.place(sample, curve) for curve in (section.outer, section.inner)
        )
        images[sample] = fill_section(WallSection(*placed), window)

    return images
