"""What a frame shows of a library's wall at given columns, and how that turns with everything that is unknown.

The wall is a surface of revolution about the needle axis. The B-scan plane, parallel to that axis at a distance of one
gap, sees a point of it at the distance r from the axis at the lateral place sqrt(r² - gap²), to both sides. An eye that
is larger by a factor is the same eye at another length unit: thickness and dent count relative to it, and so do F/E, by
its square, and volumes, by its cube.

What a frame shows is the state at the pressure under the needle. In an open globe that is the IOP. In one that may be
sealed it is an unknown of its own, which what is known of the rigidity ties to IOP and dent (`fitting.globe_term`).

The eye's base lies nearer on one side of the needle. What pressure and force move because of that is known where it is
known where the pole lies (`library.base_bulge`); else the pole's place is an unknown.

What an eye that is no even sphere adds comes on top (`fitting.resting_form`): its form at rest, not how that bends.
"""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import loops_are_compiled
from scleraforce.fitting.base_motion import Stations, section_stations
from scleraforce.fitting.placement import Placed, Places, curve_depths, place_curves, pose_derivatives
from scleraforce.fitting.resting_form import form_depths
from scleraforce.fitting.unknowns import (
    DEPTH,
    FORM,
    GAP,
    GAP_STEP_M,
    INNER_OFFSET,
    IOP,
    LATERAL,
    LOG_PRESSURE_STEP,
    MODULUS,
    NAMES,
    POLE,
    POLE_STEP,
    PRESSURE,
    ROTATION,
    SAME_CURVES_AND_MOTION,
    SHINE,
    SHINING_SLOPE,
    SIZE,
    THICKNESS,
    THICKNESS_STEP_M,
    TIP,
    TIP_STEP_M,
)
from scleraforce.known.eye import OPEN, KnownGlobe
from scleraforce.library.responses import Library

Array = NDArray[np.float64]

HIGHEST_POLE = 0.85  # sine of the largest polar angle of a contact that a fit takes


@dataclass(frozen=True, eq=False)
class Walls:
    """The walls that a fit looks among: those of a library, in globes of which so much is known.

    `gap_m` and `thickness_m` are about those of the walls.
    """

    library: Library
    globe: KnownGlobe = OPEN
    _: KW_ONLY
    gap_m: float = 0.6e-3
    thickness_m: float = 0.6e-3

    @cached_property
    def stations(self) -> Stations:
        """Where what the base's nearness moves is found."""
        return section_stations(self.library, self.gap_m, self.thickness_m)

    @property
    def pressure(self) -> int:
        """Which unknown is the pressure under the needle: the IOP where the globe is open."""
        return PRESSURE if self.globe.can_be_sealed else IOP


def force_n(walls: Walls, unknown_su: Array) -> Array:
    """Return the needle's force for each set of unknowns (sample, unknown), (sample,) in N."""
    size, modulus = np.exp(unknown_su[:, SIZE]), np.exp(unknown_su[:, MODULUS])
    forces: Array = modulus * size**2 * walls.library.forces(*_library_place(walls, unknown_su))
    return forces


def displaced_m3(walls: Walls, unknown_su: Array) -> Array:
    """Return the volume that the dent displaces for each set of unknowns, (sample,)."""
    volumes: Array = np.exp(3.0 * unknown_su[:, SIZE]) * walls.library.displaced_m3(*_library_place(walls, unknown_su))
    return volumes


def place_walls(walls: Walls, unknown_su: Array) -> Array:
    """Return the two boundaries of walls in the frame (sample, boundary, point, 2): lateral from its middle, depth, m.

    All lie at the first sample's pose, and none has a form of its own.
    """
    size = np.exp(unknown_su[:, SIZE])
    place = _library_place(walls, unknown_su)
    curves = walls.library.shapes(*place).astype(np.float64)
    return _placed(walls, unknown_su, place, curves * size[:, None, None, None])


def _placed(
    walls: Walls,
    unknown_su: Array,
    place: tuple[Array, Array, Array],
    curves_sbnc: Array,
    alike: Sequence[int] | None = None,
) -> Array:
    """Return surfaces of revolution, moved by what the base's nearness does, cut and placed like `place_walls`.

    `alike`: which sample's motion each takes; None: its own.
    """
    size, gap, pose = np.exp(unknown_su[:, SIZE]), unknown_su[:, GAP], unknown_su[0]
    moved = None
    if unknown_su[:, POLE].any():
        moved = walls.stations.moved(place, unknown_su[:, POLE], alike) * size[:, None, None, None, None]
    return place_curves(cut_by_plane(curves_sbnc, gap, moved), pose[LATERAL], pose[DEPTH], pose[ROTATION])


def formed_wall(walls: Walls, unknown: Array) -> Array:
    """Return the two boundaries of a wall in the frame (boundary, point, 2), with its form at rest."""
    placed: Array = place_walls(walls, unknown[None])[0]
    for is_inner, curve in enumerate(placed):
        is_boundary = np.full(len(curve), float(is_inner))
        curve[:, 1] += form_depths(unknown[FORM], curve[:, 0] - unknown[LATERAL], is_boundary)[0]
    return placed


def predict_wall(walls: Walls, unknown: Array, places: Places) -> Placed:
    """Return what a frame shows at places.

    Args:
        walls: that may be seen.
        unknown: (unknown,), in the order of `NAMES`.
        places: where the frame was looked at.
    """
    return (_predicted_by_loops if loops_are_compiled() else _predicted_by_arrays)(walls, unknown, places)


def _predicted_by_loops(walls: Walls, unknown: Array, places: Places) -> Placed:
    from scleraforce.fitting.compiled_depths import Rings
    from scleraforce.fitting.compiled_prediction import predict

    count = len(places.lateral_m)
    placed = Placed(np.empty(count), np.empty(count), np.empty((count, len(NAMES))), np.empty(count, dtype=np.bool_))
    stations = walls.stations
    rings = Rings(stations.places_bpc, stations.left_bw, stations.share_bw)
    looked_at = places.lateral_m, places.outer, places.smoothing_m
    predict(walls.library.tables, rings, unknown, walls.pressure, *looked_at, *vars(placed).values())
    return placed


def _predicted_by_arrays(walls: Walls, unknown: Array, places: Places) -> Placed:
    steps = np.array([TIP_STEP_M, GAP_STEP_M, THICKNESS_STEP_M, LOG_PRESSURE_STEP, POLE_STEP, POLE_STEP])
    moving = [TIP, GAP, THICKNESS, walls.pressure, *range(POLE.start, POLE.stop)]
    varied = np.repeat(unknown[None], len(moving) + 1, axis=0)
    varied[1:, moving] += np.diag(_inward(walls, unknown, steps))
    moved = varied[1:, moving].diagonal() - unknown[moving]
    found = [curve_depths(curves, places) for curves in _varied_walls(walls, varied)]
    depths, (depth, slope, seen) = np.stack([depth for depth, _, _ in found]), found[0]
    by_tip, by_gap, by_thickness, by_pressure, *by_pole = (depths[1:] - depth) / moved[:, None]
    by_lateral, by_depth, by_rotation = pose_derivatives(places, depth, slope, (unknown[LATERAL], unknown[DEPTH]))
    by_size = depth - unknown[DEPTH] - slope * (places.lateral_m - unknown[LATERAL])
    by_size -= unknown[TIP] * by_tip + unknown[GAP] * by_gap + unknown[THICKNESS] * by_thickness
    jacobian = np.zeros((len(depth), len(NAMES)))
    jacobian[:, [TIP, LATERAL, DEPTH, ROTATION, GAP, THICKNESS]] = np.stack(
        [by_tip, by_lateral, by_depth, by_rotation, by_gap, by_thickness], axis=1
    )
    jacobian[:, [MODULUS, SIZE, INNER_OFFSET]] = np.stack([-by_pressure, by_size, places.is_inner], axis=1)
    jacobian[:, walls.pressure] = by_pressure
    formed, form_slope, by_form = form_depths(unknown[FORM], places.lateral_m - unknown[LATERAL], places.is_inner)
    jacobian[:, FORM] = by_form
    jacobian[:, POLE] = np.stack(by_pole, axis=1)
    jacobian[:, LATERAL] -= form_slope
    jacobian[~seen] = 0.0
    shine = (1.0 - places.is_inner) * shining(slope + form_slope)  # how that turns with the wall is left out: hardly
    jacobian[:, SHINE] = -shine * seen
    offset = unknown[INNER_OFFSET] * places.is_inner + formed - unknown[SHINE] * shine
    return Placed(depth + offset, slope + form_slope, jacobian, seen)


def shining(slope: Array) -> Array:
    """Return how far the mirror reflection moves the edge of a surface of some slope, over where it faces the light.

    >>> shining(np.array([0.0, SHINING_SLOPE])).round(3)
    array([1.   , 0.368])
    """
    share: Array = np.exp(-((slope / SHINING_SLOPE) ** 2))
    return share


def _varied_walls(walls: Walls, varied_su: Array) -> Array:
    """Return `place_walls` of what `predict_wall` compares; the last two differ from the first by the pole alone.

    How the base's motion turns with the dent and the gap is left out: hardly.
    """
    shapes = varied_su[: -(POLE.stop - POLE.start)]
    thickness, ratio, tip = _library_place(walls, shapes)
    curves = walls.library.shapes(thickness, ratio, tip).astype(np.float64)
    curves *= np.exp(shapes[:, SIZE])[:, None, None, None]
    again, alike = SAME_CURVES_AND_MOTION
    place = thickness[again], ratio[again], tip[again]
    return _placed(walls, varied_su, place, curves[again], alike=alike.tolist())


def _inward(walls: Walls, unknown: Array, steps: Array) -> Array:
    """Turn the steps that would leave the library, where derivatives are 0, the other way."""
    library, size = walls.library, np.exp(unknown[SIZE])
    highest = library.iop_ratio_ends(unknown[THICKNESS] / size)[1]
    out = [
        unknown[TIP] / size + TIP_STEP_M > library.tip_m[-1],
        False,
        unknown[THICKNESS] / size + THICKNESS_STEP_M > library.thickness_m[-1],
        np.exp(_log_ratio(walls, unknown[None])[0] + LOG_PRESSURE_STEP) > highest,
        unknown[POLE][0] > 0.0,
        unknown[POLE][1] > 0.0,
    ]
    return np.where(out, -steps, steps)


def _log_ratio(walls: Walls, unknown_su: Array) -> Array:
    """Return the logarithm of the pressure under the needle over E (sample,)."""
    ratio: Array = unknown_su[:, walls.pressure] - unknown_su[:, MODULUS]
    return ratio


def _library_place(walls: Walls, unknown_su: Array) -> tuple[Array, Array, Array]:
    """Return thickness, pressure over E and tip of samples in the library's own size, kept within what it holds."""
    library, size = walls.library, np.exp(unknown_su[:, SIZE])
    thickness = np.clip(unknown_su[:, THICKNESS] / size, library.thickness_m[0], library.thickness_m[-1])
    return (
        thickness,
        np.clip(np.exp(_log_ratio(walls, unknown_su)), *library.iop_ratio_ends(thickness)),
        np.clip(unknown_su[:, TIP] / size, library.tip_m[0], library.tip_m[-1]),
    )


def cut_by_plane(curves_sbnc: Array, gap_s: Array, moved_sbwnc: Array | None = None) -> Array:
    """Return both sides of surfaces of revolution, cut by a plane parallel to their axis.

    Args:
        curves_sbnc: distance from the axis and depth (sample, boundary, node, 2), nodes from the axis outwards.
        gap_s: distance of the plane from the axis, m.
        moved_sbwnc: how far what the plane meets has moved, (sample, boundary, [left, right], node, 3): along the
            section, across it and down, m.

    Returns:
        Lateral place and depth (sample, boundary, 2 node, 2); nodes nearer to the axis than the plane lie in the
        middle, at the depth that the plane's nearest point has.
    """
    gap = gap_s[:, None, None]
    if moved_sbwnc is None:
        right, down, _ = _cut_side(curves_sbnc, gap)
        left, left_down = -right, down
    else:
        left, left_down = _moved_side(curves_sbnc, gap, moved_sbwnc[:, :, 0], -1.0)
        right, down = _moved_side(curves_sbnc, gap, moved_sbwnc[:, :, 1], 1.0)
    lateral = np.concatenate([left[..., ::-1], right], axis=2)
    return np.stack([lateral, np.concatenate([left_down[..., ::-1], down], axis=2)], axis=3)


def _moved_side(curves_sbnc: Array, gap: Array, moved_sbnc: Array, sign: float) -> tuple[Array, Array]:
    """Return one side's lateral places and depths (sample, boundary, node)."""
    lateral, down, first = _cut_side(curves_sbnc, gap - moved_sbnc[..., 1])
    nodes = np.maximum(np.arange(curves_sbnc.shape[2]), first)  # what lies in the middle moves as its neighbour
    along, deeper = (np.take_along_axis(moved_sbnc[..., axis], nodes, axis=2) for axis in (0, 2))
    return sign * lateral + along, down + deeper


def _cut_side(curves_sbnc: Array, gap: Array) -> tuple[Array, Array, NDArray[np.intp]]:
    """Return the right side's lateral places and depths, and the first node beyond the plane (sample, boundary, 1)."""
    distance, depth = curves_sbnc[..., 0], curves_sbnc[..., 1]
    square = distance**2 - gap**2
    beyond = np.maximum.accumulate(square > 0.0, axis=2)
    first = np.argmax(beyond, axis=2, keepdims=True)
    before = np.maximum(first - 1, 0)
    near, far = (np.take_along_axis(square, at, axis=2) for at in (before, first))
    share = np.where(first > 0, -near / np.maximum(far - near, 1e-30), 1.0)
    top, below = (np.take_along_axis(depth, at, axis=2) for at in (before, first))
    middle = top + np.clip(share, 0.0, 1.0) * (below - top)
    lateral = np.where(beyond, np.sqrt(np.maximum(square, 0.0)), 0.0)
    return lateral, np.where(beyond, depth, middle), first
