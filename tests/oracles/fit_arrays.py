"""A library's wall in a frame, and the law of its globe, by arrays."""

import numpy as np
from library_arrays import undented_walls, values_at
from numpy.typing import NDArray

from predicted_walls import Walls
from scleraforce.base.arrays import Floats
from scleraforce.fit import unknowns
from scleraforce.fit.curve_placement import (
    PlacedCurves,
    PlacesOnFrame,
    place_curves,
)
from scleraforce.fit.one_frame import law_of
from scleraforce.fit.shown_wall import LEAST_SD, STATION_RAD
from scleraforce.fit.unknowns import shining
from scleraforce.library.moving_base import base_push, section_places

FORM_STEP = 1e-7  # m


def predict_wall(walls: Walls, unknown: Floats, places: PlacesOnFrame) -> PlacedCurves:
    """Return the boundaries at places, without derivatives."""
    state = library_place(walls, unknown[None])
    size = np.exp(unknown[unknowns.SIZE])
    library = walls.library
    curves = (
        values_at(library, library.tables.curves, *state).reshape(1, 2, -1, 2) * size
    )
    section = cut_by_plane(
        curves,
        unknown[None, unknowns.GAP],
        ring_motion(walls, state, unknown[None, unknowns.POLE]) * size,
    )
    outer, inner = place_curves(
        section,
        unknown[unknowns.LATERAL],
        unknown[unknowns.DEPTH],
        unknown[unknowns.ROTATION],
    )[0]
    parts = (
        smoothed(outer, places),
        depths_along(inner, places.lateral_m[places.outer :]),
    )
    depth, slope, seen = (np.concatenate(pair) for pair in zip(*parts, strict=True))
    form = unknown[unknowns.FORM]
    from_contact_m = places.lateral_m - unknown[unknowns.LATERAL]
    ends = [
        form_depths(form, from_contact_m + step, places.is_inner)
        for step in (0.5 * FORM_STEP, -0.5 * FORM_STEP)
    ]
    form_slope = np.subtract(*ends) / FORM_STEP
    shine = (1.0 - places.is_inner) * shining(slope + form_slope)
    formed = form_depths(form, from_contact_m, places.is_inner)
    offset = (
        unknown[unknowns.INNER_OFFSET] * places.is_inner
        + formed
        - unknown[unknowns.SHINE] * shine
    )

    return PlacedCurves(
        depth + offset, slope + form_slope, np.zeros((len(depth), 0)), seen
    )


def form_depths(form: Floats, from_contact_m: Floats, is_inner: Floats) -> Floats:
    """Return the contribution of a form (7,) to depths (place,), m."""
    depths: Floats = form[6] * from_contact_m * is_inner
    for side, first in ((-1.0, 0), (1.0, 3)):
        limbus_m, angle, curvature = form[first : first + 3]
        beyond = side * from_contact_m - limbus_m
        ramp = 0.5 * (beyond + np.sqrt(beyond**2 + unknowns.SOFT_M**2))
        depths = depths + (angle + 0.5 * curvature * ramp) * ramp

    return depths


def ring_motion(
    walls: Walls, place: tuple[Floats, Floats, Floats], pole_s2: Floats
) -> Floats:
    """Return the motion of the points where the plane meets the rings (sample,
    boundary, [left, right], node, 3), m.

    `place`: of samples in the library's size: thickness, pressure over E and dent,
    (sample,) each. The motion is straight between places of the section.
    """
    library = walls.library
    thickness, ratio, _ = place
    angles = library.node_angles()
    is_inner = np.array([[0], [1]])
    stations = np.sin(angles[-1]) * np.linspace(
        -1.0, 1.0, 2 * int(np.ceil(angles[-1] / STATION_RAD)) + 3
    )
    across = walls.gap_m / (library.radius_m - is_inner * walls.thickness_m)
    rings = np.sqrt(np.maximum(np.sin(angles) ** 2 - across**2, 0.0))
    wanted = np.concatenate([-rings, rings], axis=1)
    left = np.clip(np.searchsorted(stations, wanted) - 1, 0, len(stations) - 2)
    share = (wanted - stations[left]) / (stations[left + 1] - stations[left])
    motion = undented_motion(
        undented_walls(library, thickness, ratio),
        library.tables.angles,
        library.radius_m,
        thickness,
    )
    bulge = base_bulge(
        motion, library.tables.angles, section_places(stations, across), pole_s2
    )
    pushed = base_push(library.forces(*place), thickness, library.poisson_ratio)
    bulge[..., :2] += (pushed[:, None] * pole_s2)[:, None, None, :]
    low = bulge[:, is_inner, left]
    high = bulge[:, is_inner, left + 1]
    at_rings: Floats = low + share[..., None] * (high - low)

    return at_rings.reshape(*at_rings.shape[:2], 2, -1, 3)


def undented_motion(
    undented_sbnc: Floats, angles_n: Floats, radius_m: float, thickness_s: Floats
) -> Floats:
    """Return the motion under the pressure (sample, boundary, node, [away from the
    axis, up]), m.

    `undented_sbnc`: walls under the pressure alone (distance from the axis, depth);
    `angles_n`: of their nodes.
    """
    radii_sb = radius_m - np.stack([np.zeros_like(thickness_s), thickness_s], axis=1)
    at_rest = radii_sb[..., None, None] * np.stack(
        [np.sin(angles_n), np.cos(angles_n)], axis=-1
    )
    now = np.stack([undented_sbnc[..., 0], radius_m - undented_sbnc[..., 1]], axis=-1)
    return np.asarray(now - at_rest)


def base_bulge(
    motion_sbnc: Floats, angles_n: Floats, places_bpc: Floats, pole_s2: Floats
) -> Floats:
    """Return the motion from walls about the needle axis to those about the eye's
    (sample, boundary, place, 3), m: along the section, across it, and down.

    `motion_sbnc`: of walls under the pressure alone (`undented_motion`), whose nodes
    are at `angles_n`. `places_bpc`: unit vectors to the places at rest, along the
    section, across it, up along the needle axis.
    """
    upright = np.sqrt(np.maximum(1.0 - (pole_s2**2).sum(axis=1, keepdims=True), 0.0))
    eye_axis_sc = np.concatenate([pole_s2, upright], axis=1)
    bulged = np.array(
        [
            _about(axis, motion, angles_n, places_bpc)
            - _about(np.array([0.0, 0.0, 1.0]), motion, angles_n, places_bpc)
            for axis, motion in zip(eye_axis_sc, motion_sbnc, strict=True)
        ]
    )
    bulged[..., 2] *= -1.0

    return bulged


def _about(
    axis_c: Floats, motion_bnc: Floats, angles_n: Floats, places_bpc: Floats
) -> Floats:
    """Return the motion at places (boundary, place, 3) of a wall about an axis."""
    along = places_bpc @ axis_c
    away = places_bpc - along[..., None] * axis_c
    away /= np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-9)
    angle = np.arccos(np.clip(along, -1.0, 1.0))
    moved = np.stack(
        [
            [np.interp(angle[boundary], angles_n, part) for part in motion.T]
            for boundary, motion in enumerate(motion_bnc)
        ]
    )

    return moved[:, 0, :, None] * away + moved[:, 1, :, None] * axis_c


def cut_by_plane(curves_sbnc: Floats, gap_s: Floats, moved_sbwnc: Floats) -> Floats:
    """Return both sides of surfaces of revolution, cut by a plane parallel to their
    axis: lateral place and depth.

    The surfaces are (sample, boundary, node, 2), distance from the axis and depth,
    nodes from the axis outwards; the result is (sample, boundary, 2 node, 2). Nodes
    nearer to the axis than the plane are put in the middle, at the depth of the plane's
    nearest point. `moved_sbwnc` (sample, boundary, [left, right], node, 3) is the
    motion of the points that the plane meets: along the section, across it and down, m.
    """
    gap = gap_s[:, None, None]
    left, left_down = _moved_side(curves_sbnc, gap, moved_sbwnc[:, :, 0], -1.0)
    right, down = _moved_side(curves_sbnc, gap, moved_sbwnc[:, :, 1], 1.0)
    lateral = np.concatenate([left[..., ::-1], right], axis=2)

    return np.stack(
        [lateral, np.concatenate([left_down[..., ::-1], down], axis=2)], axis=3
    )


def _moved_side(
    curves_sbnc: Floats, gap: Floats, moved_sbnc: Floats, sign: float
) -> tuple[Floats, Floats]:
    """Return one side's lateral places and depths (sample, boundary, node)."""
    lateral, down, first = _cut_side(curves_sbnc, gap - moved_sbnc[..., 1])
    # what lies in the middle moves as its neighbour
    nodes = np.maximum(np.arange(curves_sbnc.shape[2]), first)
    along, deeper = (
        np.take_along_axis(moved_sbnc[..., axis], nodes, axis=2) for axis in (0, 2)
    )

    return sign * lateral + along, down + deeper


def _cut_side(
    curves_sbnc: Floats, gap: Floats
) -> tuple[Floats, Floats, NDArray[np.intp]]:
    """Return the right side's lateral places and depths, and the first node beyond the
    plane (sample, boundary, 1).
    """
    distance = curves_sbnc[..., 0]
    depth = curves_sbnc[..., 1]
    square = distance**2 - gap**2
    beyond = np.maximum.accumulate(square > 0.0, axis=2)
    first = np.argmax(beyond, axis=2, keepdims=True)
    before = np.maximum(first - 1, 0)
    near, far = (np.take_along_axis(square, node, axis=2) for node in (before, first))
    share = np.where(first > 0, -near / np.maximum(far - near, 1e-30), 1.0)
    top, below = (np.take_along_axis(depth, node, axis=2) for node in (before, first))
    middle = top + np.clip(share, 0.0, 1.0) * (below - top)
    lateral = np.where(beyond, np.sqrt(np.maximum(square, 0.0)), 0.0)

    return lateral, np.where(beyond, depth, middle), first


def depths_along(
    curve_sc: Floats, at: Floats
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Interpolate a polyline without the parts that fold back; nothing is seen of one
    that only folds back.
    """
    lateral, down = curve_sc.T
    ahead = np.append(True, lateral[1:] > np.maximum.accumulate(lateral)[:-1])
    lateral = lateral[ahead]
    down = down[ahead]
    if len(lateral) == 1:
        still = np.zeros(at.shape)
        return still + down[0], still, np.zeros(at.shape, dtype=np.bool_)

    segment = np.clip(lateral.searchsorted(at) - 1, 0, len(lateral) - 2)
    slope = np.diff(down)[segment] / np.diff(lateral)[segment]
    depth = down[segment] + slope * (at - lateral[segment])
    return depth, slope, (at >= lateral[0]) & (at <= lateral[-1])


def smoothed(
    outer: Floats, places: PlacesOnFrame
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Depth, slope and whether it is seen, of an outer boundary under a Gaussian: Gauss
    and Hermite's three points.
    """
    lateral = places.lateral_m[: places.outer]
    apart = np.sqrt(3.0) * places.smoothing_m
    found = depths_along(
        outer, (lateral + np.array([[-apart], [0.0], [apart]])).ravel()
    )
    depth, slope = (
        np.array([1.0, 4.0, 1.0]) @ part.reshape(3, -1) / 6.0 for part in found[:2]
    )

    return depth, slope, found[2].reshape(3, -1)[1]


def off_the_law(walls: Walls, unknown_su: Floats) -> tuple[Floats, Floats]:
    """Return the error of pressures against their globe's law, and its standard
    deviation, (sample,) each.
    """
    known = walls.globe
    volume = displaced_m3(walls, unknown_su)
    mean = known.pressure_law(known.mean)
    spread = known.pressure_law(known.sd)
    pressure = np.exp(unknown_su[:, unknowns.PRESSURE])
    resting = np.exp(unknown_su[:, unknowns.IOP])
    off = mean.level(pressure) - mean.level(resting) - mean.rate * volume

    return off, np.hypot(
        spread.rate * volume, LEAST_SD * mean.level_slope(resting) * resting
    )


def displaced_m3(walls: Walls, unknown_su: Floats) -> Floats:
    """Return the volume that the dent displaces, (sample,), m^3."""
    library = walls.library
    state = library_place(walls, unknown_su)
    return np.exp(3.0 * unknown_su[:, unknowns.SIZE]) * values_at(
        library, library.tables.volumes, *state
    )


def library_place(walls: Walls, unknown_su: Floats) -> tuple[Floats, Floats, Floats]:
    """Return thickness, pressure over E and tip of samples in the library's size, kept
    within its ranges.
    """
    library = walls.library
    size = np.exp(unknown_su[:, unknowns.SIZE])
    thickness = np.clip(
        unknown_su[:, unknowns.THICKNESS] / size,
        library.thickness_m[0],
        library.thickness_m[-1],
    )
    ratio = np.exp(
        unknown_su[:, law_of(walls.globe).pressure] - unknown_su[:, unknowns.MODULUS]
    )
    tip_m = np.clip(
        unknown_su[:, unknowns.TIP] / size, library.tip_m[0], library.tip_m[-1]
    )

    return thickness, np.clip(ratio, *library.iop_ratio_ends(thickness)), tip_m


def force_n(walls: Walls, unknown_su: Floats) -> Floats:
    """Return the needle's force (sample,), N."""
    state = library_place(walls, unknown_su)
    return np.exp(
        unknown_su[:, unknowns.MODULUS] + 2.0 * unknown_su[:, unknowns.SIZE]
    ) * walls.library.forces(*state)
