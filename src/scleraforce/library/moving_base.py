"""The effect of the eye's base on a needle beside the pole: bulge, push, rise of the
contact, and stiffness.

The library's wall is clamped about the needle axis, the eye's about its own;
docs/physics.md, "The base beside the needle", has the derivations and what was
measured. Maxwell's reciprocity: Timoshenko and Goodier, Theory of Elasticity, sec. 97.
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Floats
from scleraforce.library.library_plan import (
    LARGEST_POLAR_DEG,
    SUPPORTS_DEG,
    evenly_picked,
)
from scleraforce.library.response_splines import SUPPORT, CubicSpline

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


def base_push(
    force_ratio_s: Floats, thickness_s: Floats, poisson_ratio: float
) -> Floats:
    """Return the motion of the dent (sample,), m, by the needle's force F/E, m^2, per
    part of `pole_directions`.
    """
    return SHEARED * (1.0 + poisson_ratio) / np.pi * force_ratio_s / thickness_s


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
    motion_sbnc: Floats, angles_n: Floats, places_sbpc: Floats, pole_s2: Floats
) -> Floats:
    """Return the motion from the wall about the needle axis to that about the eye's
    (sample, boundary, place, 3), m.

    Its parts are along the section, across it, and down. `motion_sbnc`: of walls under
    the pressure alone (`undented_motion`), whose nodes are at `angles_n`.
    `places_sbpc`: unit vectors to the places at rest, along the section, across it, up
    along the needle axis; one sample for all, or one for each.
    """
    upright = np.sqrt(np.maximum(1.0 - (pole_s2**2).sum(axis=1, keepdims=True), 0.0))
    eye_axis_sc = np.concatenate([pole_s2, upright], axis=1)
    places_sbpc = places_sbpc.reshape(-1, *places_sbpc.shape[-3:])
    bulged = _about(eye_axis_sc, motion_sbnc, angles_n, places_sbpc)
    bulged -= _about(np.array([[0.0, 0.0, 1.0]]), motion_sbnc, angles_n, places_sbpc)
    bulged[..., 2] *= -1.0

    return bulged


def _about(
    axis_sc: Floats, motion_sbnc: Floats, angles_n: Floats, places_sbpc: Floats
) -> Floats:
    """Return the motion at places of walls about an axis; beyond the base, the base's:
    zero.
    """
    axis = axis_sc[:, None, None, :]
    along = (places_sbpc * axis).sum(axis=-1, keepdims=True)
    away = places_sbpc - along * axis
    away /= np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-9)
    angle = np.clip(
        np.arccos(np.clip(along[..., 0], -1.0, 1.0)), angles_n[0], angles_n[-1]
    )
    node = np.clip(np.searchsorted(angles_n, angle) - 1, 0, len(angles_n) - 2)
    share = ((angle - angles_n[node]) / (angles_n[node + 1] - angles_n[node]))[
        ..., None
    ]
    motion_sbnc = np.broadcast_to(
        motion_sbnc, (max(len(motion_sbnc), len(node)), *motion_sbnc.shape[1:])
    )
    node = np.broadcast_to(node, (len(motion_sbnc), *node.shape[1:]))[..., None]
    low, high = (np.take_along_axis(motion_sbnc, at, axis=2) for at in (node, node + 1))
    moved = low + share * (high - low)

    return moved[..., :1] * away + moved[..., 1:] * axis


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
