"""Compiled loops: the depths that a frame shows of a library's wall, their derivatives, and the law of its globe.

`tests/oracles/fit_arrays.py` does the same by arrays.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.library import unknowns as at
from scleraforce.library.base import SHEARED
from scleraforce.library.sealed import level_of
from scleraforce.library.splines import SUPPORT
from scleraforce.library.states import SplineTables, curves_at, state_weights, undented_at, value_at

Floats = NDArray[np.float64]
Curves = NDArray[np.float32]
Integers = NDArray[np.intp]

LEAST_NORM = 1e-9
GAUSS_HERMITE = np.array([-np.sqrt(3.0), 0.0, np.sqrt(3.0)]), np.array([1.0, 4.0, 1.0]) / 6.0  # places, weights


class States(NamedTuple):
    """States of walls in the library's own size, (wall,) each; the pole's direction (wall, 2); and all walls' pose.

    `curves_of` and `motion_of`: the wall whose curves, and whose motion under the pressure, each has: itself, or one
    before it.
    """

    thickness_m: Floats
    iop_ratio: Floats
    tip_m: Floats
    size: Floats
    gap_m: Floats
    pole: Floats
    curves_of: Integers
    motion_of: Integers
    lateral_m: float
    depth_m: float
    rotation_rad: float


class Rings(NamedTuple):
    """The crossings of sections and the library's rings, and places at which the base's effect is computed.

    `places` (boundary, place, 3): unit vectors to them at rest, as `Library.base_bulge` takes them. A ring (boundary,
    left nodes and right ones), from the axis outwards on either side, lies between the place `left` and the next one,
    by `share` of the way.
    """

    places: Floats
    left: Integers
    share: Floats


@compiled
def depths_of_walls(
    tables: SplineTables,
    rings: Rings,
    states: States,
    at_m: Floats,
    outer: int,
    smoothing_m: float,
    depth_m: Floats,
    slope: Floats,
    reached: NDArray[np.bool_],
) -> None:
    """Write the depths of walls at places, which go from the left on either boundary, (wall, place), m.

    Of the first wall also the slope and whether it is reached (place,).
    """
    walls, nodes = len(states.tip_m), tables.curves.shape[1] // 4
    shapes = _empty_shapes(tables, walls)
    lateral, down = np.empty(2 * nodes), np.empty(2 * nodes)
    slope_at, reached_at = np.empty(len(at_m)), np.empty(len(at_m), dtype=np.bool_)
    for wall in range(walls):
        _find_shape(tables, rings, states, wall, shapes)
        for boundary in range(2):
            _place(states, wall, boundary, shapes, lateral, down)
            length = _without_folds(lateral, down)
            part = slice(0, outer) if boundary == 0 else slice(outer, len(at_m))
            _depths_along(
                lateral[:length], down[:length], at_m[part], smoothing_m if boundary == 0 else 0.0,
                depth_m[wall, part], slope_at[part], reached_at[part],
            )  # fmt: skip
        if wall == 0:
            slope[:], reached[:] = slope_at, reached_at


@compiled
def sections_of_walls(tables: SplineTables, rings: Rings, states: States, placed: Floats) -> None:
    """Write the two boundaries of walls in the frame, (wall, boundary, 2 node, [lateral, depth]), m."""
    lateral, down = np.empty(placed.shape[2]), np.empty(placed.shape[2])
    shapes = _empty_shapes(tables, len(placed))
    for wall in range(len(placed)):
        _find_shape(tables, rings, states, wall, shapes)
        for boundary in range(2):
            _place(states, wall, boundary, shapes, lateral, down)
            placed[wall, boundary, :, 0], placed[wall, boundary, :, 1] = lateral, down


class _Shapes(NamedTuple):
    """Curves of walls (wall, boundary, node, 2), motions of their rings (wall, boundary, ring, 3), and base's push.

    `pushed` (wall, 2); `rows` and `weights` belong to the last wall's state.
    """

    curves: Floats
    motions: Floats
    pushed: Floats
    rows: Integers
    weights: Floats


@compiled
def _empty_shapes(tables: SplineTables, walls: int) -> _Shapes:
    nodes = tables.curves.shape[1] // 4
    return _Shapes(
        np.empty((walls, 2, nodes, 2)), np.empty((walls, 2, 2 * nodes, 3)), np.empty((walls, 2)),
        np.empty(SUPPORT**3, dtype=np.intp), np.empty(SUPPORT**3),
    )  # fmt: skip


@compiled
def _find_shape(tables: SplineTables, rings: Rings, states: States, wall: int, shapes: _Shapes) -> None:
    rows, weights = shapes.rows, shapes.weights
    state_weights(tables, states.thickness_m[wall], states.iop_ratio[wall], states.tip_m[wall], rows, weights)
    if states.curves_of[wall] == wall:
        curves_at(tables.curves, rows, weights, shapes.curves[wall].reshape(tables.curves.shape[1]))
    if states.motion_of[wall] == wall:
        _motion(tables, rings, states, wall, shapes.motions[wall])
    pushed = SHEARED * (1.0 + tables.poisson_ratio) / np.pi * value_at(tables.forces, rows, weights)
    shapes.pushed[wall] = states.pole[wall] * (pushed / states.thickness_m[wall])


@compiled
def _place(states: States, wall: int, boundary: int, shapes: _Shapes, lateral: Floats, down: Floats) -> None:
    """Write a boundary of a wall in the frame, (2 node,)."""
    curve, motion = shapes.curves[states.curves_of[wall], boundary], shapes.motions[states.motion_of[wall], boundary]
    _cut(curve, motion, shapes.pushed[wall], states.size[wall], states.gap_m[wall], lateral, down)
    c, s = np.cos(states.rotation_rad), np.sin(states.rotation_rad)
    for node in range(len(lateral)):
        across, deep = lateral[node], down[node]
        lateral[node] = c * across - s * deep + states.lateral_m
        down[node] = s * across + c * deep + states.depth_m


@compiled
def _motion(tables: SplineTables, rings: Rings, states: States, wall: int, motion: Floats) -> None:
    """Write how the pressure moves the rings of a wall beside the pole (boundary, ring, 3) (`base_bulge`)."""
    nodes, places = len(tables.angles), rings.places.shape[1]
    meridian, at_places = np.empty((2, nodes, 2)), np.empty((places, 3))
    undented_at(tables, states.thickness_m[wall], states.iop_ratio[wall], meridian.reshape(4 * nodes))
    along, across = states.pole[wall]
    upright = np.sqrt(max(1.0 - along**2 - across**2, 0.0))
    for boundary in range(2):
        radius_m = tables.radius_m - boundary * states.thickness_m[wall]
        for node in range(nodes):
            meridian[boundary, node, 0] -= radius_m * np.sin(tables.angles[node])
            up = tables.radius_m - meridian[boundary, node, 1]
            meridian[boundary, node, 1] = up - radius_m * np.cos(tables.angles[node])
        at_places[:] = 0.0
        for place in range(places):
            at = rings.places[boundary, place]
            _add_motion(meridian[boundary], tables.angles, (along, across, upright), 1.0, at, at_places[place])
            _add_motion(meridian[boundary], tables.angles, (0.0, 0.0, 1.0), -1.0, at, at_places[place])
        for ring in range(motion.shape[1]):
            left, share = rings.left[boundary, ring], rings.share[boundary, ring]
            for part in range(3):
                low, high = at_places[left, part], at_places[left + 1, part]
                motion[boundary, ring, part] = low + share * (high - low)
            motion[boundary, ring, 2] *= -1.0


@compiled
def _add_motion(
    meridian: Floats, angles: Floats, axis: tuple[float, float, float], sign: float, at: Floats, total: Floats
) -> None:
    """Add the motion of a place of a wall about an axis, given along its meridian (node, [away, up])."""
    along = at[0] * axis[0] + at[1] * axis[1] + at[2] * axis[2]
    x, y, z = at[0] - along * axis[0], at[1] - along * axis[1], at[2] - along * axis[2]
    norm = max(np.sqrt(x**2 + y**2 + z**2), LEAST_NORM)
    angle = min(max(np.arccos(min(max(along, -1.0), 1.0)), angles[0]), angles[-1])
    # Not np.searchsorted: to load its machine code, Numba imports SciPy's linear algebra, for 0.1 s.
    node, after = 0, len(angles) - 1
    while after - node > 1:
        middle = (node + after) // 2
        if angles[middle] < angle:
            node = middle
        else:
            after = middle
    share = (angle - angles[node]) / (angles[node + 1] - angles[node])
    outwards = sign * (meridian[node, 0] + share * (meridian[node + 1, 0] - meridian[node, 0])) / norm
    up = sign * (meridian[node, 1] + share * (meridian[node + 1, 1] - meridian[node, 1]))
    total[0] += outwards * x + up * axis[0]
    total[1] += outwards * y + up * axis[1]
    total[2] += outwards * z + up * axis[2]


@compiled
def _cut(
    curve: Floats, moved: Floats, pushed: Floats, size: float, gap_m: float, lateral: Floats, down: Floats
) -> None:
    """Write where the plane meets a boundary (node, 2), left side first, (2 node,)."""
    nodes = len(curve)
    squares = np.empty(nodes)
    for side in range(2):
        ring = side * nodes
        first = nodes
        for node in range(nodes):
            gap = gap_m - size * (moved[ring + node, 1] + pushed[1])
            squares[node] = (size * curve[node, 0]) ** 2 - gap**2
            if squares[node] > 0.0 and first == nodes:
                first = node
        beyond, first = first, first % nodes
        before = max(first - 1, 0)
        share = 1.0
        if first > 0:
            share = min(max(-squares[before] / max(squares[first] - squares[before], 1e-30), 0.0), 1.0)
        middle = size * curve[before, 1]
        middle += share * (size * curve[first, 1] - middle)
        for node in range(nodes):
            near = ring + max(node, first)
            across = np.sqrt(max(squares[node], 0.0)) if node >= beyond else 0.0
            deep = size * curve[node, 1] if node >= beyond else middle
            place = nodes + node if side else nodes - 1 - node
            lateral[place] = (across if side else -across) + size * (moved[near, 0] + pushed[0])
            down[place] = deep + size * moved[near, 2]


@compiled
def _without_folds(lateral: Floats, down: Floats) -> int:
    """Move the points that lie ahead of all before to the front; return their number."""
    length = 1
    for node in range(1, len(lateral)):
        if lateral[node] > lateral[length - 1]:
            lateral[length], down[length] = lateral[node], down[node]
            length += 1
    return length


@compiled
def _depths_along(
    lateral: Floats,
    down: Floats,
    at_m: Floats,
    smoothing_m: float,
    depth_m: Floats,
    slope: Floats,
    reached: NDArray[np.bool_],
) -> None:
    """Write depth, slope and whether it is reached, of a polyline under a Gaussian (`placement.curve_depths`)."""
    if len(lateral) == 1:
        depth_m[:], slope[:], reached[:] = down[0], 0.0, False
        return
    depth_m[:], slope[:] = 0.0, 0.0
    for place in range(len(at_m)):
        reached[place] = lateral[0] <= at_m[place] <= lateral[-1]
    for point in range(3) if smoothing_m > 0.0 else range(1, 2):
        weight = GAUSS_HERMITE[1][point] if smoothing_m > 0.0 else 1.0
        segment = 0
        for place in range(len(at_m)):
            at = at_m[place] + GAUSS_HERMITE[0][point] * smoothing_m
            while segment < len(lateral) - 2 and lateral[segment + 1] < at:
                segment += 1
            steep = (down[segment + 1] - down[segment]) / (lateral[segment + 1] - lateral[segment])
            depth_m[place] += weight * (down[segment] + steep * (at - lateral[segment]))
            slope[place] += weight * steep


ALONG, ACROSS = at.POLE.start, at.POLE.start + 1
LEFT, RIGHT, WEDGE = at.FORM.start, at.FORM.start + 3, at.FORM.start + 6
CURVES_OF, MOTION_OF = at.SAME_CURVES_AND_MOTION.astype(np.intp)


class Law(NamedTuple):
    """The law of a globe that may be sealed: the rates of its mean rigidity and of its standard deviation.

    `least_sd` is relative, of the pressure that the law gives.
    """

    is_logarithmic: bool
    mean_rate: float
    spread_rate: float
    least_sd: float


@compiled
def off_the_laws(tables: SplineTables, law: Law, unknown_su: Floats, off: Floats, sd: Floats) -> None:
    """Write how far level(P) is off its mean, and its standard deviation (sample,) (`globe_term`)."""
    rows, weights = np.empty(SUPPORT**3, dtype=np.intp), np.empty(SUPPORT**3)
    for sample in range(len(off)):
        unknown = unknown_su[sample]
        thickness, ratio, tip = _library_place(tables, unknown, at.PRESSURE)
        state_weights(tables, thickness, ratio, tip, rows, weights)
        volume = np.exp(3.0 * unknown[at.SIZE]) * value_at(tables.volumes, rows, weights)
        pressure, resting = np.exp(unknown[at.PRESSURE]), np.exp(unknown[at.IOP])
        risen = level_of(pressure, law.is_logarithmic) - level_of(resting, law.is_logarithmic)
        slope = 1.0 if law.is_logarithmic else np.cbrt(resting) / 3.0  # of the level by the logarithm of the pressure
        off[sample] = risen - law.mean_rate * volume
        sd[sample] = np.hypot(law.spread_rate * volume, law.least_sd * slope)


@compiled
def predict(
    tables: SplineTables,
    rings: Rings,
    unknown: Floats,
    pressure: int,
    at_m: Floats,
    outer: int,
    smoothing_m: float,
    depth_m: Floats,
    slope: Floats,
    jacobian: Floats,
    seen: NDArray[np.bool_],
) -> None:
    """Write the prediction at places (`placement.Placed`); `pressure`: index of the pressure under the needle."""
    moving = np.array([at.TIP, at.GAP, at.THICKNESS, pressure, ALONG, ACROSS])
    moved = np.empty(len(moving))
    varied = np.empty((len(moving) + 1, len(unknown)))
    varied[:] = unknown
    for number in range(len(moving)):
        place = moving[number]
        varied[number + 1, place] += _step(tables, unknown, place, pressure)
        moved[number] = varied[number + 1, place] - unknown[place]
    depths = np.empty((len(varied), len(at_m)))
    depths_of_walls(tables, rings, _states(tables, varied, pressure), at_m, outer, smoothing_m, depths, slope, seen)
    jacobian[:] = 0.0
    for place in range(len(at_m)):
        is_inner = 0.0 if place < outer else 1.0
        across, deep = at_m[place] - unknown[at.LATERAL], depths[0, place]
        formed, form_slope = _form(unknown, across, is_inner, jacobian[place])
        row, steep = jacobian[place], slope[place]
        by_size = deep - unknown[at.DEPTH] - steep * across
        for number in range(len(moving)):
            row[moving[number]] = (depths[number + 1, place] - deep) / moved[number]
        for number in (at.TIP, at.GAP, at.THICKNESS):
            by_size -= unknown[number] * row[number]
        row[at.MODULUS], row[at.SIZE], row[at.INNER_OFFSET] = -row[pressure], by_size, is_inner
        row[at.LATERAL], row[at.DEPTH] = -steep - form_slope, 1.0
        row[at.ROTATION] = across + steep * (deep - unknown[at.DEPTH])
        slope[place] = steep + form_slope
        shine = (1.0 - is_inner) * np.exp(-((slope[place] / at.SHINING_SLOPE) ** 2))
        row[at.SHINE] = -shine
        if not seen[place]:
            row[:] = 0.0
        depth_m[place] = deep + unknown[at.INNER_OFFSET] * is_inner + formed - unknown[at.SHINE] * shine


@compiled
def _library_place(tables: SplineTables, unknown: Floats, pressure: int) -> tuple[float, float, float]:
    """Return thickness, pressure over E and tip in the library's own size (`prediction`)."""
    size = np.exp(unknown[at.SIZE])
    low, high = tables.thickness_ends_m
    thickness = min(max(unknown[at.THICKNESS] / size, low), high)
    per_tension = thickness / tables.radius_m
    least, most = tables.tension_ends[0] * per_tension, tables.tension_ends[1] * per_tension
    ratio = min(max(np.exp(unknown[pressure] - unknown[at.MODULUS]), least), most)
    return thickness, ratio, min(max(unknown[at.TIP] / size, tables.tip_m[0]), tables.tip_m[-1])


@compiled
def _states(tables: SplineTables, varied: Floats, pressure: int) -> States:
    """Return walls as `depths_of_walls` takes them, all at the first one's pose."""
    walls = len(varied)
    thickness, ratio, tip, size = np.empty(walls), np.empty(walls), np.empty(walls), np.empty(walls)
    for wall in range(walls):
        thickness[wall], ratio[wall], tip[wall] = _library_place(tables, varied[wall], pressure)
        size[wall] = np.exp(varied[wall, at.SIZE])
    return States(
        thickness, ratio, tip, size, varied[:, at.GAP].copy(), varied[:, ALONG : ACROSS + 1].copy(),
        CURVES_OF, MOTION_OF, varied[0, at.LATERAL], varied[0, at.DEPTH], varied[0, at.ROTATION],
    )  # fmt: skip


@compiled
def _step(tables: SplineTables, unknown: Floats, place: int, pressure: int) -> float:
    """Return the step of an unknown; one that would leave the library goes the other way (`prediction`)."""
    size = np.exp(unknown[at.SIZE])
    thickness = unknown[at.THICKNESS] / size
    step, leaves = at.POLE_STEP, unknown[place] > 0.0
    if place == at.TIP:
        step = at.TIP_STEP_M
        leaves = unknown[at.TIP] / size + step > tables.tip_m[-1]
    elif place == at.GAP:
        step, leaves = at.GAP_STEP_M, False
    elif place == at.THICKNESS:
        step = at.THICKNESS_STEP_M
        leaves = thickness + step > tables.thickness_ends_m[1]
    elif place == pressure:
        step, highest = at.LOG_PRESSURE_STEP, tables.tension_ends[1] * (thickness / tables.radius_m)
        leaves = np.exp(unknown[pressure] - unknown[at.MODULUS] + step) > highest
    return -step if leaves else step


@compiled
def _form(unknown: Floats, from_contact_m: float, is_inner: float, row: Floats) -> tuple[float, float]:
    """Return the contribution of a form to depth and slope, and write its derivatives (`unknowns`)."""
    depth, slope = unknown[WEDGE] * from_contact_m * is_inner, unknown[WEDGE] * is_inner
    row[WEDGE] = from_contact_m * is_inner
    for side, first in ((-1.0, LEFT), (1.0, RIGHT)):
        angle, curvature = unknown[first + 1], unknown[first + 2]
        beyond = side * from_contact_m - unknown[first]
        root = np.sqrt(beyond**2 + at.SOFT_M**2)
        ramp, rise = 0.5 * (beyond + root), 0.5 * (1.0 + beyond / root)
        by_beyond = (angle + curvature * ramp) * rise
        depth += (angle + 0.5 * curvature * ramp) * ramp
        slope += side * by_beyond
        row[first], row[first + 1], row[first + 2] = -by_beyond, ramp, 0.5 * ramp**2
    return depth, slope
