"""Compiled loops: the depths that a frame shows of some walls of a library, beside each other.

They do what `fit_prediction` does by arrays (`base_motion.Stations.moved`, `cut_by_plane`, `placement.curve_depths`),
one wall at a time; those are their oracle.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.library.base_bulge import SHEARED
from scleraforce.library.compiled_states import curves_at, state_weights, undented_at, value_at
from scleraforce.library.splines import SUPPORT
from scleraforce.library.tables import SplineTables

Floats = NDArray[np.float64]
Curves = NDArray[np.float32]
Integers = NDArray[np.intp]

LEAST_NORM = 1e-9
GAUSS_HERMITE = np.array([-np.sqrt(3.0), 0.0, np.sqrt(3.0)]), np.array([1.0, 4.0, 1.0]) / 6.0  # places, weights


class States(NamedTuple):
    """States of walls in the library's own size, (wall,) each; where the pole lies (wall, 2); and all walls' pose.

    `curves_of` and `motion_of`: the wall whose curves each has, and whose motion under the pressure: itself, or one
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
    """What `base_motion.Stations` says of places and rings."""

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
    """Write what a frame shows of walls at places, which go from the left on either boundary.

    Depths (wall, place), m; of the first wall the slope and whether it is reached (place,).
    """
    walls, nodes = len(states.tip_m), tables.curves.shape[1] // 4
    rows, weights = np.empty(SUPPORT**3, dtype=np.intp), np.empty(SUPPORT**3)
    curves = np.empty((walls, tables.curves.shape[1]))
    motions = np.empty((walls, 2, 2 * nodes, 3))
    lateral, down = np.empty(2 * nodes), np.empty(2 * nodes)
    slope_at, reached_at = np.empty(len(at_m)), np.empty(len(at_m), dtype=np.bool_)
    c, s = np.cos(states.rotation_rad), np.sin(states.rotation_rad)
    for wall in range(walls):
        state_weights(tables, states.thickness_m[wall], states.iop_ratio[wall], states.tip_m[wall], rows, weights)
        if states.curves_of[wall] == wall:
            curves_at(tables.curves, rows, weights, curves[wall])
        if states.motion_of[wall] == wall:
            _motion(tables, rings, states, wall, motions[wall])
        pushed = SHEARED * (1.0 + tables.poisson_ratio) / np.pi * value_at(tables.forces, rows, weights)
        pushed /= states.thickness_m[wall]
        for boundary in range(2):
            _cut(
                curves[states.curves_of[wall]].reshape(2, nodes, 2)[boundary],
                motions[states.motion_of[wall], boundary],
                states.pole[wall] * pushed,
                states.size[wall],
                states.gap_m[wall],
                lateral,
                down,
            )
            for node in range(2 * nodes):
                across, deep = lateral[node], down[node]
                lateral[node] = c * across - s * deep + states.lateral_m
                down[node] = s * across + c * deep + states.depth_m
            length = _without_folds(lateral, down)
            part = slice(0, outer) if boundary == 0 else slice(outer, len(at_m))
            _depths_along(
                lateral[:length], down[:length], at_m[part], smoothing_m if boundary == 0 else 0.0,
                depth_m[wall, part], slope_at[part], reached_at[part],
            )  # fmt: skip
        if wall == 0:
            slope[:], reached[:] = slope_at, reached_at


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
    """Add the motion of a place of a wall about an axis, of whose meridian it is known (node, [away, up])."""
    along = at[0] * axis[0] + at[1] * axis[1] + at[2] * axis[2]
    x, y, z = at[0] - along * axis[0], at[1] - along * axis[1], at[2] - along * axis[2]
    norm = max(np.sqrt(x**2 + y**2 + z**2), LEAST_NORM)
    angle = min(max(np.arccos(min(max(along, -1.0), 1.0)), angles[0]), angles[-1])
    node = min(max(np.searchsorted(angles, angle) - 1, 0), len(angles) - 2)
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
    """Write what the plane meets of a boundary (node, 2), left side first (2 node,) (`fit_prediction.cut_by_plane`)."""
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
    """Move what lies ahead of all before to the front; return how much that is."""
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
