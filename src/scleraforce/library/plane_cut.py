"""Surfaces of revolution, cut by the plane of the B-scan, in closed form, and the
slices that many walls show at once.

`library.ring_cut` has where the plane meets the rings that a surface consists of.
Between two rings Y is linear in X^2 here: that is exact for a parabola, also at X = 0,
where X itself grows like a square root along the surface. A section is a polyline with
some points for each ring, 0.01 um in the mean from Y linear in X^2. The fit joins the
rings by straight lines in X, without points between. Its depths differ from these by
0.2 um in the mean and by 60 um on the steepest flanks (1,000 walls of the bundled
library). Forces and their intervals were measured with the fit's form, so it stays as
it is until they are measured anew.

The picture is that of `mechanics.mesh_section.fill_section` for the same curves: a
pixel is wall where its centre is in the wall. Boundaries come separately, so that a
segmentation's errors can be added before they are filled.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from scleraforce.base.arrays import Bytes, Flags, Floats, Reals
from scleraforce.base.compiled_loops import compiled, compiled_in_place
from scleraforce.base.errors import InputError
from scleraforce.library.moving_base import base_push, section_places
from scleraforce.library.ring_cut import meet_rings
from scleraforce.library.wall_responses import INNER, OUTER, Library, Responses
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.mechanics.mesh_section import SNAP, WALL, fill_section, slice_window
from scleraforce.records.study import SliceStudy

PARTS = 4  # points of a section for each ring of the surface
PARTS_MIDDLE = 12  # between X = 0 and the first ring that the plane meets


@compiled_in_place
def _find_section(
    curve: Floats,
    motion: Floats,
    gap_m: float,
    slope: float,
    squares: Floats,
    points: Floats,
) -> tuple[int, int]:
    """Write a section, from negative to positive lateral side, into the middle of
    points (point, 2); return its first and last point.

    `motion` (ring, 3): of the rings on the left, then on the right. Both points are the
    same where the plane misses the surface.
    """
    nodes = len(curve)
    longer = np.sqrt(1.0 + slope**2)
    middle = len(points) // 2
    ends = (middle, middle)

    for side in range(2):
        way = motion[side * nodes : (side + 1) * nodes]
        step = 2 * side - 1
        first, deep = meet_rings(curve, way[:, 1], gap_m, slope, squares)
        before = max(first - 1, 0)
        square = 0.0
        lateral = 0.0
        place = middle
        points[place, 0] = way[before, 0]
        points[place, 1] = longer * (deep + way[before, 2])

        for ring in range(before + 1, nodes):
            wider = np.sqrt(max(squares[ring], 0.0))
            rise = squares[ring] - square
            rise = 1.0 if rise == 0.0 else rise
            parts = PARTS_MIDDLE if ring == before + 1 else PARTS

            for part in range(1, parts + 1):
                share = part / parts
                across = lateral + share * (wider - lateral)
                along = way[ring - 1, 0] + share * (way[ring, 0] - way[ring - 1, 0])
                down = way[ring - 1, 2] + share * (way[ring, 2] - way[ring - 1, 2])
                down += deep + (across**2 - square) / rise * (curve[ring, 1] - deep)
                place += step
                points[place, 0] = step * across + along
                points[place, 1] = longer * down

            square = squares[ring]
            lateral = wider
            deep = curve[ring, 1]

        ends = (ends[0], place) if side else (place, middle)

    return ends


@compiled_in_place
def _points(nodes: int) -> int:
    """Return the number of points of a section at most."""
    return 2 * (PARTS * nodes + PARTS_MIDDLE) + 1


@compiled
def _section_of(curve: Floats, gap_m: float, slope: float) -> Floats:
    """Return a section (point, 2); of a surface that the plane misses, one point."""
    nodes = len(curve)
    points = np.empty((_points(nodes), 2))
    begin, end = _find_section(
        curve, np.zeros((2 * nodes, 3)), gap_m, slope, np.empty(nodes), points
    )
    return points[begin : end + 1]


def cut_surfaces(curves_bnc: Reals, gap_m: float, tilt_rad: float = 0.0) -> WallSection:
    """Cut a wall, two surfaces of revolution about the needle axis (boundary, node, 2):
    distance and depth, m.

    The section goes from negative to positive lateral side, in the order of the
    material. A plane that misses a surface raises `InputError`, here and in
    `highest_depths`.
    """
    curves = np.ascontiguousarray(curves_bnc, dtype=np.float64)
    slope = float(np.tan(tilt_rad))
    outer, inner = (
        _section_of(curves[boundary], float(gap_m), slope)
        for boundary in (OUTER, INNER)
    )
    _check_met(min(len(outer), len(inner)) > 1)

    return WallSection(outer, inner)


def _check_met(is_met: bool) -> None:
    """Raise `InputError` where a plane misses a surface."""
    if not is_met:
        raise InputError(
            "the B-scan plane misses a surface of the wall; its gap or tilt is too"
            " large"
        )


def highest_depths(curves_snc: Reals, gap_m: Floats, tilt_rad: Floats) -> Floats:
    """Return the smallest depth of the section of each surface (sample,), m; the
    surfaces are (sample, node, 2).
    """
    curves = np.ascontiguousarray(curves_snc, dtype=np.float64)
    found = _highest_depths(curves, gap_m, np.tan(tilt_rad))
    _check_met(bool(np.isfinite(found).all()))
    return found


@compiled
def _highest_depths(curves_snc: Floats, gap_m: Floats, slope: Floats) -> Floats:
    """Return the smallest depths (sample,); NaN where the plane misses a surface."""
    samples, nodes, _ = curves_snc.shape
    squares = np.empty(nodes)
    still = np.zeros(nodes)
    found = np.empty(samples)

    for sample in range(samples):
        curve = curves_snc[sample]
        first, highest = meet_rings(curve, still, gap_m[sample], slope[sample], squares)
        for ring in range(first, nodes):
            highest = min(highest, curve[ring, 1])

        highest *= np.sqrt(1.0 + slope[sample] ** 2)
        found[sample] = highest if first < nodes else np.nan

    return found


# between places; the motion is smooth, and linear between them to 1 um
PLACE_M = 1.2e-3
# from the axis, where it counts how much wider a wall has become: a dent hardly reaches
# so far
GROWN_RAD = 0.4
# of the search for the place to which a ring has moved; each leaves a hundredth of the
# error, of 0.1 mm at first
ROUNDS = 3


class SectionMotion(NamedTuple):
    """The motion of sections, in the library's size.

    `moved_sbpc` (sample, boundary, place, [along the section, across it, down]), m, at
    even places from -`reach_m` to `reach_m` beside the needle axis.
    """

    reach_m: float
    moved_sbpc: Floats


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
    places = section_places(lateral * per_rest, gap_m[:, None, None] * per_rest)
    moved = library.base_bulge(thickness_m, iop_ratio, places, pole_s2)
    pushed = base_push(walls.force_ratio, thickness_m, library.poisson_ratio)
    moved[..., :2] += (pushed[:, None] * pole_s2)[:, None, None, :]

    return SectionMotion(reach_m, moved)


@compiled_in_place
def _find_ring_motion(
    curve: Floats,
    moved: Floats,
    reach_m: float,
    gap_m: float,
    slope: float,
    motion: Floats,
) -> None:
    """Write the motion of rings on the left and on the right (ring, 3), from that of
    the places to which they have moved (place, 3).
    """
    nodes = len(curve)
    last = len(moved) - 1
    per_m = 0.5 * last / reach_m

    for side in range(2):
        for node in range(nodes):
            ring = motion[side * nodes + node]
            for part in range(3):
                ring[part] = moved[last // 2, part]

            for _ in range(ROUNDS):
                gap = gap_m - ring[1] + slope * curve[node, 1]
                lateral = np.sqrt(max(curve[node, 0] ** 2 - gap**2, 0.0))
                from_first = ((2 * side - 1) * lateral + ring[0] + reach_m) * per_m
                from_first = min(max(from_first, 0.0), float(last))
                left = min(int(from_first), last - 1)
                share = from_first - left

                for part in range(3):
                    low = moved[left, part]
                    ring[part] = low + share * (moved[left + 1, part] - low)


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
    curves = np.ascontiguousarray(curves_sbnc, dtype=np.float64)
    depth_sbc = np.empty((*curves.shape[:2], study.columns))
    folded = np.empty(len(curves), dtype=np.bool_)
    pose = (framing.lateral_m, framing.depth_m, framing.scale, framing.turn_rad)
    _find_boundaries(
        curves,
        np.stack(np.broadcast_arrays(gap_m, np.tan(tilt_rad), *pose)),
        motion or SectionMotion(1.0, np.empty((len(curves), 2, 0, 3))),
        column_laterals(study),
        study.pixel_m,
        depth_sbc,
        folded,
    )

    return WallBoundaries(depth_sbc, folded)


@compiled
def _find_boundaries(
    curves_sbnc: Floats,
    planes_ks: Floats,
    motion: SectionMotion,
    columns_m: Floats,
    pixel_m: float,
    depth_sbc: Floats,
    folded: Flags,
) -> None:
    """Write the depths of boundaries, and which walls fold over.

    `planes_ks`: gap, m, and tan(tau), then the `Framing`.
    """
    nodes = curves_sbnc.shape[2]
    squares = np.empty(nodes)
    rings = np.zeros((2 * nodes, 3))
    points = np.empty((_points(nodes), 2))

    for sample in range(len(folded)):
        gap_m, slope, lateral_m, depth_m, scale, turn_rad = planes_ks[:, sample]
        c = scale * np.cos(turn_rad)
        s = scale * np.sin(turn_rad)
        folded[sample] = False

        for boundary in range(2):
            curve = curves_sbnc[sample, boundary]
            moved = motion.moved_sbpc[sample, boundary]
            if len(moved):
                _find_ring_motion(curve, moved, motion.reach_m, gap_m, slope, rings)

            begin, end = _find_section(curve, rings, gap_m, slope, squares, points)
            section = points[begin : end + 1]

            for point in section:
                lateral = point[0]
                point[0] = c * lateral - s * point[1] + lateral_m
                point[1] = s * lateral + c * point[1] + depth_m

            folds = _see_from_above(
                section, columns_m, pixel_m, depth_sbc[sample, boundary]
            )
            folded[sample] = folded[sample] or folds


@compiled_in_place
def _see_from_above(
    section: Floats, columns_m: Floats, pixel_m: float, depth_m: Floats
) -> bool:
    """Write the smallest depth of a section in each column, NaN where it has none;
    return whether it runs back within the columns.
    """
    columns = len(columns_m)
    folds = False
    depth_m[:] = np.inf

    for point in range(1, len(section)):
        lateral, down = section[point - 1]
        step = section[point, 0] - lateral
        rise = section[point, 1] - down
        low = (min(lateral, section[point, 0]) - columns_m[0]) / pixel_m
        high = (max(lateral, section[point, 0]) - columns_m[0]) / pixel_m
        low = max(np.ceil(low), 0.0)
        high = min(np.floor(high), columns - 1.0)
        folds = folds or (step < 0.0 and low <= columns - 1.0 and high >= 0.0)

        for column in range(int(low), int(high) + 1 if step != 0.0 else 0):
            deep = down + (columns_m[column] - lateral) / step * rise
            depth_m[column] = min(depth_m[column], deep)

    for column in range(columns):
        if depth_m[column] == np.inf:
            depth_m[column] = np.nan

    return folds


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
