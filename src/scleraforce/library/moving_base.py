"""The effect of the eye's base on a needle beside the pole: bulge, push, rise of the
contact, and stiffness.

The library's wall is clamped about the needle axis, the eye's about its own;
docs/physics.md, "The base beside the needle", has the derivations and what was
measured. Maxwell's reciprocity: Timoshenko and Goodier, Theory of Elasticity, sec. 97.
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Floats, Number
from scleraforce.base.compiled_loops import compiled, compiled_in_place
from scleraforce.library.library_plan import (
    LARGEST_POLAR_DEG,
    SUPPORTS_DEG,
    evenly_picked,
)
from scleraforce.library.response_splines import (
    SUPPORT,
    CubicSpline,
    SplineTables,
    node_before,
    undented_at,
)

Vector = tuple[float, float, float]

UP = (0.0, 0.0, 1.0)  # along the needle axis
LEAST_NORM = 1e-9

# Times (1 + nu)/pi F/(E t): how far a force across its axis moves the top of a
# half-sphere, a membrane, that is held at its base. 1.08 for 0.6 mm; 1.05 to 1.2 for
# 0.35 to 0.9 mm, polar angles of 10 to 55 deg and nu of 0.3 and 0.45 (linear, three
# dimensions).
SHEARED = 1.08


def pole_directions(polar_s: Floats | float, direction_s: Floats | float) -> Floats:
    """Return the direction of the eye's pole: the parts of its axis along the section
    and across it (..., 2).

    `direction_s`: of the section, from the meridian
    (`mechanics.contact_and_section.ScanPlane`).
    """
    reach = np.sin(polar_s)
    return np.stack(
        [-reach * np.cos(direction_s), reach * np.sin(direction_s)], axis=-1
    )


def base_push(force_ratio: Number, thickness_m: Number, poisson_ratio: float) -> Number:
    """Return the motion of the dent, m, by the needle's force F/E, m^2, per part of
    `pole_directions`.
    """
    return SHEARED * (1.0 + poisson_ratio) / np.pi * force_ratio / thickness_m


push_of = compiled_in_place(base_push)


def section_places(along: Floats, across: Floats) -> Floats:
    """Return unit vectors to places of a section at rest (..., [along it, across it,
    up]); the parts broadcast.
    """
    up = np.sqrt(np.maximum(1.0 - along**2 - across**2, 0.0))
    return np.stack(np.broadcast_arrays(along, across, up), axis=-1)


def meridian_angles(undented_bnc: Floats, radius_m: float) -> Floats:
    """Return the angles from the axis of the nodes of a wall that has hardly moved
    (node,).
    """
    return np.arctan2(undented_bnc[0, :, 0], radius_m - undented_bnc[0, :, 1])


@compiled_in_place
def find_meridian(
    tables: SplineTables, thickness_m: float, iop_ratio: float, meridian: Floats
) -> None:
    """Write how the pressure alone moves a wall (boundary, node, [away from the axis,
    up]).
    """
    undented_at(tables, thickness_m, iop_ratio, meridian.reshape(meridian.size))
    for boundary in range(2):
        radius_m = tables.radius_m - boundary * thickness_m
        way = meridian[boundary]

        for node in range(len(way)):
            way[node, 0] -= radius_m * tables.sines[node]
            way[node, 1] = (
                tables.radius_m - way[node, 1] - radius_m * tables.cosines[node]
            )


@compiled_in_place
def turn_about(places: Floats, angles: Floats, axis: Vector, turned: Floats) -> None:
    """Write where places at rest, unit vectors (boundary, place, 3), lie about an axis
    (boundary, place, 5).

    Each lies on the meridian between a node, at an angle, and the next one by a share;
    then follows its unit vector from the axis. Beyond the base it is at the base.
    """
    for boundary in range(2):
        for place in range(places.shape[1]):
            x, y, z = places[boundary, place]
            along = x * axis[0] + y * axis[1] + z * axis[2]
            x = x - along * axis[0]
            y = y - along * axis[1]
            z = z - along * axis[2]
            norm = max(np.sqrt(x**2 + y**2 + z**2), LEAST_NORM)
            angle = min(
                max(np.arccos(min(max(along, -1.0), 1.0)), angles[0]), angles[-1]
            )
            node = node_before(angles, angle)
            turn = turned[boundary, place]
            turn[0] = node
            turn[1] = (angle - angles[node]) / (angles[node + 1] - angles[node])
            turn[2] = x / norm
            turn[3] = y / norm
            turn[4] = z / norm


@compiled_in_place
def bulge_at(way: Floats, turn: Floats, rest: Floats, axis: Vector) -> Vector:
    """Return the motion of a place from the wall about the needle axis to that about
    the eye's: along the section, across it and down, m.

    `way` (node, [away, up]) is the motion along the meridian; `turn` and `rest` (5,)
    are where the place lies about the eye's axis and about the needle's (`turn_about`).
    """
    away, up = _moved_along(way, turn)
    resting, above = _moved_along(way, rest)
    return (
        away * turn[2] + up * axis[0] - resting * rest[2],
        away * turn[3] + up * axis[1] - resting * rest[3],
        above - away * turn[4] - up * axis[2],
    )


@compiled_in_place
def _moved_along(way: Floats, turn: Floats) -> tuple[float, float]:
    """Return the motion along the meridian, away from its axis and up, at a place."""
    node = int(turn[0])
    share = turn[1]
    away = way[node, 0] + share * (way[node + 1, 0] - way[node, 0])
    return away, way[node, 1] + share * (way[node + 1, 1] - way[node, 1])


@compiled
def bulges_of(
    tables: SplineTables,
    thickness_m: Floats,
    iop_ratio: Floats,
    places_sbpc: Floats,
    pole_s2: Floats,
    moved_sbpc: Floats,
) -> None:
    """Write the motion of places by the base (`Library.base_bulge`)."""
    meridian = np.empty((2, len(tables.angles), 2))
    turned = np.empty((2, places_sbpc.shape[2], 5))
    about_needle = np.empty_like(turned)

    for sample in range(len(pole_s2)):
        along = pole_s2[sample, 0]
        across = pole_s2[sample, 1]
        axis = (along, across, np.sqrt(max(1.0 - along**2 - across**2, 0.0)))
        find_meridian(tables, thickness_m[sample], iop_ratio[sample], meridian)
        turn_about(places_sbpc[sample], tables.angles, axis, turned)
        turn_about(places_sbpc[sample], tables.angles, UP, about_needle)

        for boundary in range(2):
            for place in range(places_sbpc.shape[2]):
                motion = bulge_at(
                    meridian[boundary],
                    turned[boundary, place],
                    about_needle[boundary, place],
                    axis,
                )
                moved = moved_sbpc[sample, boundary, place]
                moved[0] = motion[0]
                moved[1] = motion[1]
                moved[2] = motion[2]


def contact_rises(
    undented_tpbnc: NDArray[np.float32], polar_rad: Floats, radius_m: float
) -> Floats:
    """Return how far contacts at polar angles (a,) rise along their normal under the
    pressure alone (a, t, p), m.
    """
    outer_tpnc = undented_tpbnc[:, :, 0].astype(np.float64)
    # The first has hardly moved; and an angle that is a little off turns the rise by
    # its square only.
    spline = CubicSpline(
        meridian_angles(undented_tpbnc[0, 0].astype(np.float64), radius_m)
    )
    contact_tpac = spline.shares(polar_rad) @ outer_tpnc
    away = contact_tpac[..., 0]
    above = radius_m - contact_tpac[..., 1]

    return np.moveaxis(
        away * np.sin(polar_rad) + above * np.cos(polar_rad) - radius_m, -1, 0
    )


def rise_slope(rise_tp: Floats, thinness_t: Floats, tension: Floats) -> Floats:
    """Return the derivative of a contact's rise (t, p) by the pressure over E (t, p),
    m.

    `thinness_t`: thickness over radius; `tension`: p R/(E t) (p,).
    """
    ratio_tp = tension * thinness_t[:, None]
    per_ratio = rise_tp / ratio_tp  # hardly turns where the wall is linear
    spline = CubicSpline(np.log(tension))
    return per_ratio + spline.slopes(spline.coefficients(per_ratio, axis=1))


POLAR_ANGLES = 11
# share of the stiffening that remains where neighbouring directions share the load
SHARE = 0.5
# around half of the needle axis; the force is 0.02 % off at 35 deg, 0.5 % at 50 deg
DIRECTIONS = 4
RIGHT_ANGLE = int(np.searchsorted(SUPPORTS_DEG, 90.0))  # its place among the supports


def base_angle(polar_rad: float, azimuth_rad: Floats) -> Floats:
    """Return the angle from the needle axis at which the base lies, by the direction
    around that axis.
    """
    return np.asarray(
        np.arctan2(np.cos(polar_rad), np.cos(azimuth_rad) * np.sin(polar_rad))
    )


def base_stiffness(
    thickness_m: Floats,
    tension: Floats,
    tip_m: Floats,
    force_tpd: Floats,
    support_force_bklt: Floats,
) -> tuple[Floats, Floats]:
    """Return polar angles of the contact (a,), rad, and the factor of the force there
    (a, t, p, d).

    `force_tpd`: F/E with the clamp at 90 degrees, over the library's axes.
    `support_force_bklt`: F/E with the clamps of the plan, at its thicknesses and
    tensions, at the first tips.
    """
    tips = support_force_bklt.shape[3]
    counts = support_force_bklt.shape[1:3]
    nodes = [
        evenly_picked(len(axis), count)
        for axis, count in zip((thickness_m, tension), counts, strict=True)
    ]
    even_klt = force_tpd[np.ix_(*nodes, np.arange(1, tips))]
    ratio_bklt = np.insert(
        support_force_bklt[..., 1:] / even_klt, RIGHT_ANGLE, 1.0, axis=0
    )
    angles = np.radians(np.insert(SUPPORTS_DEG, RIGHT_ANGLE, 90.0))
    polar_rad = np.radians(np.linspace(0.0, LARGEST_POLAR_DEG, POLAR_ANGLES))
    around = np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    factor_aklt = np.stack(
        [
            _factor(angles, ratio_bklt, base_angle(float(polar), around))
            for polar in polar_rad
        ]
    )

    for axis, (values, known) in enumerate(
        zip((thickness_m, tension), nodes, strict=True), start=1
    ):
        moved = np.moveaxis(factor_aklt, axis, 0)
        factor_aklt = np.moveaxis(
            _along(np.log(values[known]), moved, np.log(values)), 0, axis
        )

    # The ratio has a limit at no dent, and stays as it is beyond the last tip.
    column = np.clip(np.arange(len(tip_m)) - 1, 0, tips - 2)
    return polar_rad, np.ascontiguousarray(factor_aklt[..., column])


def _factor(angles: Floats, ratio_bklt: Floats, base_rad: Floats) -> Floats:
    """Return the factor (k, l, t) of a contact whose base lies at these angles around
    it.

    The outermost supports, which deep dents run into, would make the spline between the
    others oscillate: they are used only where they are needed.
    """
    inner = angles[1] <= base_rad.min() and base_rad.max() <= angles[-2]
    near = slice(1, -1) if inner else slice(None)
    return 1.0 + SHARE * (
        _along(angles[near], ratio_bklt[near], base_rad).mean(axis=0) - 1.0
    )


def _along(nodes: Floats, values: Floats, places: Floats) -> Floats:
    """Interpolate along the first axis."""
    spline = CubicSpline(nodes)
    first, weights = spline.weights(np.clip(places, nodes[0], nodes[-1]))
    near = spline.coefficients(values)[first[:, None] + np.arange(SUPPORT)]
    return np.einsum("sk,sk...->s...", weights, near)
