"""An eye of linear mechanics: its displaced section for any modulus, force, pressure
and gap (paper eq. 1, 2).

K scales with E, so u = (IOP u_p + rho g u_g + F u_n) / E with three solutions at E = 1
Pa. They are kept only where the B-scan plane may cut: on short lines of material points
across the plane. A line's point of zero distance to the plane is a point of the
section. Thickness and the contact's polar angle need a solution of their own each;
between a few such solutions the displacements are interpolated by Lagrange's
polynomial.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin, tan

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import CalibrationError
from scleraforce.base.units import STANDARD_GRAVITY_M_S2, from_si
from scleraforce.calibration.filter.eye_parameters import (
    SAMPLE_STEP_M,
    WallState,
    lagrange,
    polar_nodes,
    smoothed_curves,
    stated_polar_rad,
)
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.graded_mesh import study_mesh
from scleraforce.mechanics.hexahedral_mesh import locate
from scleraforce.mechanics.linear_wall import LinearWall
from scleraforce.records.fields import declared
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study

# how far the section reaches to either side of the contact, as a share of the radius
SAMPLE_REACH = 0.72
LINE_STEP_M = 0.2e-3  # between material points across the plane
LINE_REACH_M = 0.6e-3  # how far material may move across the plane
BASE_MARGIN = 0.01  # of the radius: the section ends above the clamped base


def _cut_lines(points_rblsc: Floats, gap_m: Floats, tilt_rad: float) -> Floats:
    """Cut lines of points (..., line, sample, 3) with the plane; return (..., sample,
    2), linear between the points.
    """
    lateral, across, depth = (points_rblsc[..., axis] for axis in range(3))
    across = across - gap_m
    c = cos(tilt_rad)
    s = sin(tilt_rad)
    distance = c * across - s * depth
    down = s * across + c * depth
    before = np.clip(
        (distance < 0).sum(axis=-2, keepdims=True) - 1, 0, distance.shape[-2] - 2
    )
    points = np.stack([distance, lateral, down], axis=-1)
    start, end = (
        np.take_along_axis(points, before[..., None] + k, axis=-3)[..., 0, :, :]
        for k in (0, 1)
    )
    share = start[..., :1] / (start[..., :1] - end[..., :1])

    return start[..., 1:] + share * (end[..., 1:] - start[..., 1:])


def _response(
    wall: LinearWall,
    contact: Contact,
    study: Study,
    setup: Setup,
    lateral_m: Floats,
) -> Floats:
    """Return the fields of a factored wall about the plane of one contact, (field,
    boundary, line, sample, axis).
    """
    mesh = wall.mesh
    axes = _plane_axes(contact, setup)
    gap_m = declared(setup.needle.gap_m, "needle: gap_m")
    plane = (mesh.radius_m, lateral_m, gap_m, setup.scan.tilt_rad or 0.0)
    points_blsc = np.stack(
        [
            _line_points(mesh.radius_m - inward, *plane)
            for inward in (0.0, mesh.thickness_m)
        ]
    )
    world = points_blsc @ axes - mesh.radius_m * axes[2]
    quads, weights = locate(mesh, world.reshape(-1, 3))
    outer, inner = np.split(quads, 2)
    nodes = np.concatenate([mesh.outer_qn[outer], mesh.inner_qn[inner]])
    needle = wall.needle_cnc([contact], study.needle.outer_diameter_m / 2)[0]
    solutions = np.stack([wall.pressure_nc, wall.gravity_nc, needle])
    moved = np.einsum("pn,fpnc->fpc", weights, solutions[:, nodes])
    stood = (
        np.einsum("pn,pnc->pc", weights, mesh.points_nc[nodes])
        + mesh.radius_m * axes[2]
    )
    fields: Floats = np.concatenate([stood[None], moved]) @ axes.T

    return fields.reshape(4, *points_blsc.shape)


def _lateral_samples(
    radius_m: float,
    thickness_m: float,
    contacts: Sequence[Contact],
    setup: Setup,
) -> Floats:
    """Return evenly spaced lateral positions (sample,) at which, for all contacts, the
    whole wall is above the base.
    """
    gap_m = declared(setup.needle.gap_m, "needle: gap_m")
    reach = SAMPLE_REACH * radius_m
    lateral = np.arange(-reach, reach + SAMPLE_STEP_M / 2, SAMPLE_STEP_M)
    above = np.ones(len(lateral), dtype=bool)

    for contact in contacts:
        axes = _plane_axes(contact, setup)
        points = _line_points(
            radius_m - thickness_m,
            radius_m,
            lateral,
            gap_m,
            setup.scan.tilt_rad or 0.0,
        )
        height = (points @ axes)[..., 2] - radius_m * axes[2, 2]
        above &= (height > BASE_MARGIN * radius_m).all(axis=0)

    return lateral[above]


def _plane_axes(contact: Contact, setup: Setup) -> Floats:
    """Return lateral, across and depth axis of the untilted plane (by default the
    meridian's), (3, 3), one a row.
    """
    direction_rad = setup.scan.direction_rad or 0.0
    lateral = (
        cos(direction_rad) * contact.meridian + sin(direction_rad) * contact.parallel
    )
    return np.stack([lateral, np.cross(contact.normal, lateral), -contact.normal])


def _line_points(
    radius_m: float,
    outer_radius_m: float,
    lateral_m: Floats,
    gap_m: float,
    tilt_rad: float,
) -> Floats:
    """Return points on a sphere of given radius in the plane's axes, from the contact:
    shape (line, sample, 3).
    """
    steps = np.arange(-LINE_REACH_M, LINE_REACH_M + LINE_STEP_M / 2, LINE_STEP_M)[
        :, None
    ]
    depth = outer_radius_m - np.sqrt(radius_m**2 - lateral_m**2 - gap_m**2)
    across = gap_m + tan(tilt_rad) * depth + steps
    depth = outer_radius_m - np.sqrt(radius_m**2 - lateral_m**2 - across**2)

    return np.stack([np.broadcast_to(lateral_m, across.shape), across, depth], axis=-1)


THICKNESS_NODES = (0.8, 1.0, 1.2)  # of the stated thickness, if that is uncertain


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearEye:
    """Material points about the plane, and how they move, at nodes of thickness and
    polar angle.

    `fields` (thickness, polar, field, boundary, line, sample, axis): the undeformed
    position, then the displacements at E = 1 Pa per Pa of IOP, per Pa/m of weight and
    per N of force. Boundaries: outer, inner. Axes: lateral, across the plane (untilted,
    from the needle axis), depth below the undeformed contact. `weight_pa_m` is density
    times gravity; `smoothing_m`: standard deviation of the Gaussian by which a
    segmentation smooths the outer curve; `polar_sd_rad`: of the polar angle, 0 if it is
    stated.
    """

    setup: Setup
    weight_pa_m: float
    thickness_nodes_m: tuple[float, ...]
    polar_nodes_rad: tuple[float, ...]
    fields: Floats
    smoothing_m: float = 0.0
    polar_sd_rad: float = 0.0

    def curves(self, states: Sequence[WallState]) -> Floats:
        """Return the sections as a segmentation sees them, (state, boundary, sample, 2)
        in m: lateral and depth.
        """
        walls = {(state.polar_rad, state.thickness_m) for state in states}
        if len(walls) == 1:
            return self._sections(self._fields_at(*walls.pop()), states)

        each = (
            self._sections(self._fields_at(state.polar_rad, state.thickness_m), [state])
            for state in states
        )
        return np.concatenate(list(each))

    def _fields_at(self, polar_rad: float, thickness_m: float) -> Floats:
        """Return the fields (field, boundary, line, sample, axis) for a polar angle and
        a thickness.
        """
        if polar_rad in self.polar_nodes_rad and thickness_m in self.thickness_nodes_m:
            return self.fields[
                self.thickness_nodes_m.index(thickness_m),
                self.polar_nodes_rad.index(polar_rad),
            ]

        weights = np.outer(
            lagrange(self.thickness_nodes_m, thickness_m),
            lagrange(self.polar_nodes_rad, polar_rad),
        )
        # A shell bends as 1/t^2 under a point load: t^2 u is smoother in t than u.
        # Positions are linear in t.
        bent = weights * (np.array(self.thickness_nodes_m)[:, None] / thickness_m) ** 2
        by_field = np.stack([weights, bent, bent, bent])

        return np.asarray(
            np.einsum("ftp,tpfblsc->fblsc", by_field, self.fields), dtype=np.float64
        )

    def _sections(self, fields_fblsc: Floats, states: Sequence[WallState]) -> Floats:
        compliance = np.array([1.0 / state.youngs_modulus_pa for state in states])
        loads = [[state.iop_pa, self.weight_pa_m, state.force_n] for state in states]
        loads_sf = np.column_stack(
            [np.ones(len(states)), np.array(loads) * compliance[:, None]]
        )
        points = (loads_sf @ fields_fblsc.reshape(4, -1)).reshape(
            len(states), *fields_fblsc.shape[1:]
        )
        gap = np.array([state.gap_m for state in states])[:, None, None, None]
        curves = _cut_lines(points, gap, self.setup.scan.tilt_rad or 0.0)
        curves[:, 0] = smoothed_curves(curves[:, 0], self.smoothing_m)

        return curves


def linear_eye(
    study: Study,
    setup: Setup,
    thickness_uncertain: bool = False,
    polar_sd_rad: float = 0.0,
) -> LinearEye:
    """Solve the walls for an eye, three if the thickness is uncertain; raises
    `CalibrationError`.
    """
    thickness_m = declared(setup.eye.thickness_m, "eye: thickness_m")
    if not 0.1e-3 <= thickness_m <= 0.4 * study.eye.radius_m:
        raise CalibrationError(
            f"thickness: {from_si(thickness_m, 'um'):g} µm cannot be "
            "meshed; state the wall's"
        )

    shares = THICKNESS_NODES if thickness_uncertain else (1.0,)
    thicknesses = tuple(share * thickness_m for share in shares)
    polars = polar_nodes(stated_polar_rad(setup), polar_sd_rad)
    contacts = [Contact(polar_rad=polar) for polar in polars]
    lateral = _lateral_samples(study.eye.radius_m, max(thicknesses), contacts, setup)
    fields = []

    for thickness in thicknesses:
        mesh = study_mesh(study, thickness, contacts[0] if len(contacts) == 1 else None)
        wall = LinearWall(mesh, study.eye.poisson_ratio)
        fields.append(
            np.stack(
                [
                    _response(wall, contact, study, setup, lateral)
                    for contact in contacts
                ]
            )
        )

    return LinearEye(
        setup=setup,
        weight_pa_m=study.eye.density_kg_m3 * STANDARD_GRAVITY_M_S2,
        thickness_nodes_m=thicknesses,
        polar_nodes_rad=polars,
        fields=np.stack(fields),
        smoothing_m=study.calibration.surface_smoothing_m,
        polar_sd_rad=polar_sd_rad,
    )
