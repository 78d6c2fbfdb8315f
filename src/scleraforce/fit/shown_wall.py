"""Compiled loops: the depths that a frame shows of a library's wall, their derivatives,
and the law of its globe.

Nodes of a wall far beyond the frame are left out. `tests/oracles/fit_arrays.py` does
the same by arrays.
"""

from typing import NamedTuple

import numpy as np

from scleraforce.base.arrays import Flags, Floats, Places
from scleraforce.base.compiled_loops import compiled, compiled_in_place, compiled_part
from scleraforce.fit import unknowns
from scleraforce.fit.curve_placement import Polyline, read_depths, without_folds
from scleraforce.library.moving_base import (
    UP,
    Vector,
    bulge_at,
    find_meridian,
    push_of,
    turn_about,
)
from scleraforce.library.response_splines import (
    SUPPORT,
    SplineTables,
    curves_at,
    node_before,
    state_weights,
    value_of,
)
from scleraforce.library.ring_cut import meet_rings
from scleraforce.library.sealed_eye import level_growth, level_of

shining = compiled_in_place(unknowns.shining)

LEAST_COSINE = 1e-9
# between the places of a section at which the base's effect is computed
STATION_RAD = 0.04
SPARE_M = 1.0e-3  # of a wall beyond the frame, at rest, and under the needle
SPARE_DENTED_M = 0.1e-3
ALONG = unknowns.POLE.start
ACROSS = unknowns.POLE.start + 1
LEFT = unknowns.FORM.start
RIGHT = unknowns.FORM.start + 3
WEDGE = unknowns.FORM.start + 6


class FitGeometry(NamedTuple):
    """A library, the index of the pressure under the needle, places on a frame, and
    where its plane meets the rings.

    `at_m` (place,), the first `outer` on the outer boundary, and `smoothing_m` are as
    in `curve_placement.PlacesOnFrame`. `stations` (boundary, station, 3): unit vectors
    to places of the section at rest, where the base's effect is found; `about_needle`:
    the same about the needle axis (`turn_about`). A ring (boundary, left nodes and
    right ones), from the axis outwards on either side, lies between the station `left`
    and the next one, by `share` of the way.
    """

    tables: SplineTables
    pressure: int
    at_m: Floats
    outer: int
    smoothing_m: float
    stations: Floats
    about_needle: Floats
    left: Places
    share: Floats


class ShownWall(NamedTuple):
    """A wall of the library: its curves (boundary, node, 2), and the motion of its
    rings (boundary, ring, 3).

    `meridian` (boundary, node, [away, up]) is its motion under the pressure alone,
    `turned` its stations about the eye's axis (`turn_about`), `pushed` (3,) the base's
    push, and by how much the plane is farther from the needle axis for each metre below
    the contact. The rest is workspace: rows and weights of its state, motions of
    stations (station, 3), and the section (2 node,) with its slopes.
    """

    curve: Floats
    motion: Floats
    meridian: Floats
    turned: Floats
    pushed: Floats
    rows: Places
    weights: Floats
    moved: Floats
    lateral: Floats
    down: Floats
    steep: Floats


class WallDepths(NamedTuple):
    """The depths of a wall at places (place,): of an even wall, `even_m` and
    `even_slope`, and with form and shine.
    """

    even_m: Floats
    even_slope: Floats
    depth_m: Floats
    slope: Floats
    seen: Flags
    jacobian: Floats


@compiled_part
def scene_of(
    tables: SplineTables,
    pressure: int,
    places: tuple[Floats, int, float],
    gap_m: float,
    thickness_m: float,
) -> FitGeometry:
    """Return the scene of walls of about a gap and a thickness, m; `places`: `at_m`,
    `outer` and `smoothing_m`.
    """
    nodes = tables.curves.shape[1] // 4
    count = int(np.ceil(tables.angles[nodes - 1] / STATION_RAD)) + 1
    sines = tables.sines
    along = sines[nodes - 1] * (np.arange(2 * count + 1) / count - 1.0)
    stations = np.empty((2, len(along), 3))
    about_needle = np.empty((2, len(along), 5))
    left = np.empty((2, 2 * nodes), dtype=np.intp)
    share = np.empty((2, 2 * nodes))

    for boundary in range(2):
        across = gap_m / (tables.radius_m - boundary * thickness_m)
        stations[boundary, :, 0] = along
        stations[boundary, :, 1] = across
        stations[boundary, :, 2] = np.sqrt(np.maximum(1.0 - along**2 - across**2, 0.0))

        for ring in range(2 * nodes):
            wanted = np.sqrt(max(sines[ring % nodes] ** 2 - across**2, 0.0)) * (
                -1.0 if ring < nodes else 1.0
            )
            station = node_before(along, wanted)
            left[boundary, ring] = station
            share[boundary, ring] = (wanted - along[station]) / (
                along[station + 1] - along[station]
            )

    turn_about(stations, tables.angles, UP, about_needle)
    at_m, outer, smoothing_m = places
    return FitGeometry(
        tables,
        pressure,
        at_m,
        outer,
        smoothing_m,
        stations,
        about_needle,
        left,
        share,
    )


@compiled_part
def empty_wall(scene: FitGeometry) -> ShownWall:
    """Return a wall without values."""
    nodes = scene.tables.curves.shape[1] // 4
    stations = scene.stations.shape[1]
    return ShownWall(
        np.empty((2, nodes, 2)),
        np.zeros((2, 2 * nodes, 3)),
        np.empty((2, len(scene.tables.angles), 2)),
        np.empty((2, stations, 5)),
        np.zeros(3),
        np.empty(SUPPORT**3, dtype=np.intp),
        np.empty(SUPPORT**3),
        np.empty((stations, 3)),
        np.empty(2 * nodes),
        np.empty(2 * nodes),
        np.empty(2 * nodes),
    )


@compiled_in_place
def library_place(tables: SplineTables, unknown: Floats, pressure: int) -> Vector:
    """Return thickness, pressure over E and tip in the library's own size, kept within
    its ranges.
    """
    size = np.exp(unknown[unknowns.SIZE])
    low, high = tables.thickness_ends_m
    thickness = min(max(unknown[unknowns.THICKNESS] / size, low), high)
    per_tension = thickness / tables.radius_m
    least = tables.tension_ends[0] * per_tension
    most = tables.tension_ends[1] * per_tension
    ratio = min(max(np.exp(unknown[pressure] - unknown[unknowns.MODULUS]), least), most)

    return (
        thickness,
        ratio,
        min(max(unknown[unknowns.TIP] / size, tables.tip_m[0]), tables.tip_m[-1]),
    )


@compiled_in_place
def _find_wall(
    scene: FitGeometry, unknown: Floats, count: int, wall: ShownWall
) -> None:
    """Write the wall of unknowns up to `count` nodes."""
    state = library_place(scene.tables, unknown, scene.pressure)
    axis = _axis(unknown)
    find_curve(scene.tables, state, count, wall, 2)
    _find_push(scene.tables, state, unknown, wall.pushed)
    wall.motion[:] = 0.0

    if axis[2] < 1.0:
        find_meridian(scene.tables, state[0], state[1], wall.meridian)
        _turn_stations(scene, axis, count, wall.turned)
        _move(scene, wall.meridian, wall.turned, axis, count, wall.moved, wall.motion)


@compiled_in_place
def _axis(unknown: Floats) -> Vector:
    """Return the eye's axis."""
    return (
        unknown[ALONG],
        unknown[ACROSS],
        np.sqrt(max(1.0 - unknown[ALONG] ** 2 - unknown[ACROSS] ** 2, 0.0)),
    )


@compiled_in_place
def find_curve(
    tables: SplineTables, state: Vector, count: int, wall: ShownWall, boundaries: int
) -> None:
    """Write the first nodes of the curves of a state, of the outer boundary or of
    both.
    """
    state_weights(tables, state[0], state[1], state[2], wall.rows, wall.weights)
    for boundary in range(boundaries):
        first = 2 * wall.curve.shape[1] * boundary
        curve = wall.curve[boundary, :count].reshape(2 * count)
        curves_at(tables.curves, wall.rows, wall.weights, first, curve)


@compiled_in_place
def _find_push(
    tables: SplineTables, state: Vector, unknown: Floats, pushed: Floats
) -> None:
    """Write the push of the base at a state (`moving_base.base_push`)."""
    force_ratio = value_of(tables, tables.forces, state[0], state[1], state[2])
    share = push_of(force_ratio, state[0], tables.poisson_ratio)
    pushed[0] = unknown[ALONG] * share
    pushed[1] = unknown[ACROSS] * share


@compiled_in_place
def _turn_stations(
    scene: FitGeometry, axis: Vector, count: int, turned: Floats
) -> None:
    """Write where the stations about the first rings lie about an axis (boundary,
    station, 5).
    """
    left = scene.left
    nodes = left.shape[1] // 2
    first = min(left[0, count - 1], left[1, count - 1])
    after = max(left[0, nodes + count - 1], left[1, nodes + count - 1]) + 2
    turn_about(
        scene.stations[:, first:after],
        scene.tables.angles,
        axis,
        turned[:, first:after],
    )


@compiled_in_place
def _move(
    scene: FitGeometry,
    meridian: Floats,
    turned: Floats,
    axis: Vector,
    count: int,
    moved: Floats,
    motion: Floats,
) -> None:
    """Write how the pressure moves the first rings of a wall beside the pole (boundary,
    ring, 3) (`moving_base.bulge_at`).
    """
    nodes = motion.shape[1] // 2
    left = scene.left

    for boundary in range(2):
        way = meridian[boundary]
        for place in range(
            left[boundary, count - 1], left[boundary, nodes + count - 1] + 2
        ):
            turn = turned[boundary, place]
            rest = scene.about_needle[boundary, place]
            bulge = bulge_at(way, turn, rest, axis)
            moved[place, 0] = bulge[0]
            moved[place, 1] = bulge[1]
            moved[place, 2] = bulge[2]

        for side in range(2):
            for ring in range(side * nodes, side * nodes + count):
                station = left[boundary, ring]
                share = scene.share[boundary, ring]

                for part in range(3):
                    low = moved[station, part]
                    high = moved[station + 1, part]
                    motion[boundary, ring, part] = low + share * (high - low)


@compiled_in_place
def cut_wall(
    curve: Floats,
    motion: Floats,
    pushed: Floats,
    count: int,
    unknown: Floats,
    wall: ShownWall,
) -> None:
    """Write a boundary's section in the frame: where the plane meets its first nodes,
    left side first, (2 count,).
    """
    nodes = len(curve)
    squares = wall.steep
    lateral = wall.lateral
    down = wall.down
    size = np.exp(unknown[unknowns.SIZE])
    gap_m = unknown[unknowns.GAP] / size - pushed[1]
    c = np.cos(unknown[unknowns.ROTATION])
    s = np.sin(unknown[unknowns.ROTATION])
    longer = size * np.sqrt(1.0 + pushed[2] ** 2)  # depths along the plane

    for side in range(2):
        ring = side * nodes
        sign = 2.0 * side - 1.0
        first, middle = meet_rings(
            curve, motion[ring : ring + count, 1], gap_m, pushed[2], squares
        )

        for node in range(first, count):
            across = sign * np.sqrt(max(squares[node], 0.0))
            across = size * (across + motion[ring + node, 0] + pushed[0])
            deep = longer * (curve[node, 1] + motion[ring + node, 2])
            place = count + node if side else count - 1 - node
            lateral[place] = c * across - s * deep + unknown[unknowns.LATERAL]
            down[place] = s * across + c * deep + unknown[unknowns.DEPTH]

        # rings that the plane misses: its lowest point, which moves with the next ring
        near = ring + first % count
        across = size * (0.0 + motion[near, 0] + pushed[0])
        deep = longer * (middle + motion[near, 2])

        for node in range(first):
            place = count + node if side else count - 1 - node
            lateral[place] = c * across - s * deep + unknown[unknowns.LATERAL]
            down[place] = s * across + c * deep + unknown[unknowns.DEPTH]


@compiled_in_place
def _read_depths(
    scene: FitGeometry,
    boundary: int,
    length: int,
    wall: ShownWall,
    depth_m: Floats,
    slope: Floats,
) -> None:
    """Write depth and slope of a boundary's section at its places, the outer one's
    under a Gaussian.
    """
    begin, end = (scene.outer, len(scene.at_m)) if boundary else (0, scene.outer)
    read_depths(
        Polyline(wall.lateral, wall.down, wall.steep),
        length,
        scene.at_m[begin:end],
        0.0 if boundary else scene.smoothing_m,
        depth_m[begin:end],
        slope[begin:end],
    )


@compiled_in_place
def _ends(scene: FitGeometry) -> tuple[float, float]:
    """Return the ends of a frame's places, m."""
    low = scene.at_m[0]
    high = scene.at_m[scene.outer - 1]
    last = len(scene.at_m) - 1
    if scene.outer <= last:
        low = min(low, scene.at_m[scene.outer])
        high = max(high, scene.at_m[last])

    return low - 2.0 * scene.smoothing_m, high + 2.0 * scene.smoothing_m


@compiled_in_place
def show_wall(
    scene: FitGeometry, unknown: Floats, wall: ShownWall, depths: WallDepths
) -> int:
    """Write the depths that a frame shows of the wall of unknowns; return the number of
    its nodes that are found.
    """
    tables = scene.tables
    low, high = _ends(scene)
    nodes = len(scene.share[0]) // 2
    size = np.exp(unknown[unknowns.SIZE])
    s = np.abs(np.sin(unknown[unknowns.ROTATION]))
    reach = (
        max(high - unknown[unknowns.LATERAL], unknown[unknowns.LATERAL] - low)
        + s * size * tables.radius_m
    )
    reach = (
        reach / max(np.cos(unknown[unknowns.ROTATION]), LEAST_COSINE) + SPARE_M
    ) / size
    reach /= tables.radius_m - tables.thickness_ends_m[1]
    count = (
        nodes
        if reach >= 1.0
        else min(node_before(tables.angles, np.arcsin(reach)) + 3, nodes)
    )
    _find_wall(scene, unknown, count, wall)
    boundary = 0

    while boundary < 2:
        cut_wall(
            wall.curve[boundary],
            wall.motion[boundary],
            wall.pushed,
            count,
            unknown,
            wall,
        )
        length = without_folds(wall.lateral, wall.down, 2 * count)
        left = wall.lateral[0]

        right = wall.lateral[length - 1]
        if count < nodes and (
            left > low - SPARE_DENTED_M or right < high + SPARE_DENTED_M
        ):
            count = nodes
            boundary = 0
            _find_wall(scene, unknown, count, wall)
            continue

        _read_depths(scene, boundary, length, wall, depths.even_m, depths.even_slope)
        for place in range(
            scene.outer * boundary, len(scene.at_m) if boundary else scene.outer
        ):
            depths.seen[place] = length > 1 and left <= scene.at_m[place] <= right

        boundary += 1

    for place in range(len(scene.at_m)):
        is_inner = 0.0 if place < scene.outer else 1.0
        formed, form_slope = unknowns.form_at(
            unknown[unknowns.FORM],
            scene.at_m[place] - unknown[unknowns.LATERAL],
            is_inner,
        )
        depths.slope[place] = depths.even_slope[place] + form_slope
        depths.depth_m[place] = (
            depths.even_m[place] + unknown[unknowns.INNER_OFFSET] * is_inner + formed
        )
        depths.depth_m[place] -= (
            unknown[unknowns.SHINE] * (1.0 - is_inner) * shining(depths.slope[place])
        )

    return count


@compiled_part
def derive(
    scene: FitGeometry,
    unknown: Floats,
    count: int,
    wall: ShownWall,
    other: ShownWall,
    depths: WallDepths,
) -> None:
    """Write the derivatives of the wall that `show_wall` has just shown; `other` is
    workspace.
    """
    tables = scene.tables
    axis = _axis(unknown)
    jacobian = depths.jacobian
    varied = unknown.copy()

    if axis[2] == 1.0:
        state = library_place(tables, unknown, scene.pressure)
        find_meridian(tables, state[0], state[1], wall.meridian)

    depth_m = np.empty(len(scene.at_m))
    slope = np.empty(len(scene.at_m))
    jacobian[:] = 0.0

    for moving in np.array(
        [unknowns.TIP, unknowns.GAP, unknowns.THICKNESS, scene.pressure, ALONG, ACROSS]
    ):
        varied[moving] = unknown[moving] + _step(scene, unknown, moving)
        moved = varied[moving] - unknown[moving]
        state = library_place(tables, varied, scene.pressure)
        curve = wall.curve
        motion = wall.motion

        if moving in (unknowns.TIP, unknowns.THICKNESS, scene.pressure):
            find_curve(tables, state, count, other, 2)
            curve = other.curve

        if moving in (ALONG, ACROSS):
            motion = other.motion
            _turn_stations(scene, _axis(varied), count, other.turned)
            _move(
                scene,
                wall.meridian,
                other.turned,
                _axis(varied),
                count,
                other.moved,
                motion,
            )
        elif axis[2] < 1.0 and moving in (unknowns.THICKNESS, scene.pressure):
            motion = other.motion
            find_meridian(tables, state[0], state[1], other.meridian)
            _move(scene, other.meridian, wall.turned, axis, count, other.moved, motion)

        _find_push(tables, state, varied, other.pushed)
        for boundary in range(2):
            cut_wall(
                curve[boundary], motion[boundary], other.pushed, count, varied, other
            )
            length = without_folds(other.lateral, other.down, 2 * count)
            _read_depths(scene, boundary, length, other, depth_m, slope)

        for place in range(len(depth_m)):
            jacobian[place, moving] = (depth_m[place] - depths.even_m[place]) / moved

        varied[moving] = unknown[moving]

    for place in range(len(depth_m)):
        row = jacobian[place]
        steep = depths.even_slope[place]
        deep = depths.even_m[place]
        if not depths.seen[place]:
            row[:] = 0.0
            continue

        is_inner = 0.0 if place < scene.outer else 1.0
        across = scene.at_m[place] - unknown[unknowns.LATERAL]
        by_size = deep - unknown[unknowns.DEPTH] - steep * across
        by_size -= (
            unknown[unknowns.TIP] * row[unknowns.TIP]
            + unknown[unknowns.GAP] * row[unknowns.GAP]
        )
        row[unknowns.SIZE] = (
            by_size - unknown[unknowns.THICKNESS] * row[unknowns.THICKNESS]
        )
        row[unknowns.MODULUS] = -row[scene.pressure]
        row[unknowns.INNER_OFFSET] = is_inner
        row[unknowns.LATERAL] = -depths.slope[place]
        row[unknowns.DEPTH] = 1.0
        row[unknowns.ROTATION] = across + steep * (deep - unknown[unknowns.DEPTH])
        row[unknowns.SHINE] = (is_inner - 1.0) * shining(depths.slope[place])
        row[WEDGE] = across * is_inner

        for side, first in ((-1.0, LEFT), (1.0, RIGHT)):
            ramp, rise = unknowns.furrow(side * across - unknown[first])
            row[first] = -(unknown[first + 1] + unknown[first + 2] * ramp) * rise
            row[first + 1] = ramp
            row[first + 2] = 0.5 * ramp**2


@compiled_in_place
def _step(scene: FitGeometry, unknown: Floats, place: int) -> float:
    """Return the step of an unknown; one that would leave the library goes the other
    way (`fit.one_frame`).
    """
    tables = scene.tables
    size = np.exp(unknown[unknowns.SIZE])
    thickness = unknown[unknowns.THICKNESS] / size
    step = unknowns.POLE_STEP
    leaves = unknown[place] > 0.0

    if place == unknowns.TIP:
        step = unknowns.TIP_STEP_M
        leaves = unknown[unknowns.TIP] / size + step > tables.tip_m[-1]
    elif place == unknowns.GAP:
        step = unknowns.GAP_STEP_M
        leaves = False
    elif place == unknowns.THICKNESS:
        step = unknowns.THICKNESS_STEP_M
        leaves = thickness + step > tables.thickness_ends_m[1]
    elif place == scene.pressure:
        step = unknowns.LOG_PRESSURE_STEP
        highest = tables.tension_ends[1] * (thickness / tables.radius_m)
        leaves = np.exp(unknown[place] - unknown[unknowns.MODULUS] + step) > highest

    return -step if leaves else step


@compiled_in_place
def formed_section(
    scene: FitGeometry, unknown: Floats, wall: ShownWall, section: Floats
) -> None:
    """Write the boundaries of a wall in the frame, with its form at rest (boundary, 2
    node, [lateral, depth]), m.
    """
    count = section.shape[1] // 2
    _find_wall(scene, unknown, count, wall)

    for boundary in range(2):
        cut_wall(
            wall.curve[boundary],
            wall.motion[boundary],
            wall.pushed,
            count,
            unknown,
            wall,
        )

        for place in range(2 * count):
            formed, _ = unknowns.form_at(
                unknown[unknowns.FORM],
                wall.lateral[place] - unknown[unknowns.LATERAL],
                float(boundary),
            )
            section[boundary, place, 0] = wall.lateral[place]
            section[boundary, place, 1] = wall.down[place] + formed


# relative, of the pressure that a globe's law gives: volumes of the library
LEAST_SD = 3e-3


class GlobeLaw(NamedTuple):
    """The law of a globe: the rates of the bounds, the mean and the standard deviation
    of its rigidity; 0 if open.

    `pressure` is the index of the unknown that is the pressure under the needle.
    """

    pressure: int
    is_open: bool
    is_logarithmic: bool
    lowest: float
    mean: float
    highest: float
    spread: float


@compiled_in_place
def off_the_law(
    tables: SplineTables, law: GlobeLaw, unknown: Floats
) -> tuple[float, float]:
    """Return how far level(P) is off its mean, and its standard deviation
    (`fit.one_frame`).
    """
    volume = displaced_volume(tables, law, unknown)
    pressure = np.exp(unknown[unknowns.PRESSURE])
    resting = np.exp(unknown[unknowns.IOP])
    level = level_of(resting, law.is_logarithmic)
    risen = level_of(pressure, law.is_logarithmic) - level
    slope = level_growth(level, law.is_logarithmic)
    spread = np.hypot(law.spread * volume, LEAST_SD * slope)

    return risen - law.mean * volume, float(spread)


@compiled_in_place
def displaced_volume(tables: SplineTables, law: GlobeLaw, unknown: Floats) -> float:
    """Return the volume that the dent displaces, m^3."""
    thickness, ratio, tip = library_place(tables, unknown, law.pressure)
    return float(
        np.exp(3.0 * unknown[unknowns.SIZE])
        * value_of(tables, tables.volumes, thickness, ratio, tip)
    )


@compiled_in_place
def force_at(tables: SplineTables, law: GlobeLaw, unknown: Floats) -> float:
    """Return the needle's force, N."""
    thickness, ratio, tip = library_place(tables, unknown, law.pressure)
    force_ratio = value_of(tables, tables.forces, thickness, ratio, tip)
    return float(
        np.exp(unknown[unknowns.MODULUS] + 2.0 * unknown[unknowns.SIZE]) * force_ratio
    )


@compiled
def predict_depths(
    tables: SplineTables,
    law: GlobeLaw,
    places: tuple[Floats, int, float],
    gap_m: float,
    thickness_m: float,
    unknown: Floats,
    depths: WallDepths,
    section: Floats,
) -> float:
    """Write depths and derivatives of walls of about a gap and a thickness, and their
    section; return the force, N.
    """
    scene = scene_of(tables, law.pressure, places, gap_m, thickness_m)
    wall = empty_wall(scene)
    other = empty_wall(scene)
    derive(scene, unknown, show_wall(scene, unknown, wall, depths), wall, other, depths)
    formed_section(scene, unknown, wall, section)
    return force_at(tables, law, unknown)
