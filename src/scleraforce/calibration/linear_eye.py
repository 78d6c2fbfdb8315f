"""An eye of linear mechanics: responses over what is uncertain about it.

Thickness and the contact's polar angle need a solution of their own each; between a few such solutions the
displacements are interpolated by Lagrange's polynomial. Modulus, force, IOP and gap need none (`response`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.calibration.eye_model import EyeConstants, WallState, lagrange, polar_nodes
from scleraforce.calibration.response import WallResponse, lateral_samples, response_fields
from scleraforce.errors import CalibrationError
from scleraforce.eye.contact import Contact
from scleraforce.eye.study_mesh import study_mesh
from scleraforce.mechanics.linear import LinearWall
from scleraforce.study import Study
from scleraforce.units import STANDARD_GRAVITY_M_S2, from_si

Array = NDArray[np.float64]

THICKNESS_NODES = (0.8, 1.0, 1.2)  # of the stated thickness, where the thickness is uncertain


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearEye:
    """Responses at nodes of thickness and polar angle.

    `fields` (thickness, polar, field, boundary, line, sample, axis), see `WallResponse`; so are `weight_pa_m` and
    `smoothing_m`.
    """

    constants: EyeConstants
    weight_pa_m: float
    thickness_nodes_m: tuple[float, ...]
    polar_nodes_rad: tuple[float, ...]
    fields: Array
    smoothing_m: float = 0.0

    @property
    def polar_ends_rad(self) -> tuple[float, float]:
        """Polar angles between which the section's turning with the angle is taken."""
        return min(self.polar_nodes_rad), max(self.polar_nodes_rad)

    def curves(self, states: Sequence[WallState]) -> Array:
        """Return the sections as a segmentation sees them, (state, boundary, sample, 2) in m: lateral and depth."""
        walls = {(state.polar_rad, state.thickness_m) for state in states}
        if len(walls) == 1:
            return self.at(*walls.pop()).curves(states)
        return np.concatenate([self.at(state.polar_rad, state.thickness_m).curves([state]) for state in states])

    def outside(self, state: WallState) -> str | None:  # noqa: ARG002
        """Return None: linear mechanics has an answer to every load."""
        return None

    def at(self, polar_rad: float, thickness_m: float) -> WallResponse:
        """Return the response for a polar angle and a thickness."""
        if polar_rad in self.polar_nodes_rad and thickness_m in self.thickness_nodes_m:
            node = self.thickness_nodes_m.index(thickness_m), self.polar_nodes_rad.index(polar_rad)
            return self._response(self.fields[node])
        weights = np.outer(lagrange(self.thickness_nodes_m, thickness_m), lagrange(self.polar_nodes_rad, polar_rad))
        # A shell bends as 1/t^2 under a point load: t^2 u is smoother in t than u. Positions are linear in t.
        bent = weights * (np.array(self.thickness_nodes_m)[:, None] / thickness_m) ** 2
        by_field = np.stack([weights, bent, bent, bent])
        return self._response(np.einsum("ftp,tpfblsc->fblsc", by_field, self.fields))

    def _response(self, fields_fblsc: Array) -> WallResponse:
        return WallResponse(
            fields_fblsc=fields_fblsc,
            weight_pa_m=self.weight_pa_m,
            tilt_rad=self.constants.tilt_rad,
            smoothing_m=self.smoothing_m,
        )


def linear_eye(study: Study, constants: EyeConstants, thickness_uncertain: bool = False) -> LinearEye:
    """Solve the walls that a calibration of one eye needs: one, or three where the thickness is uncertain.

    Raises:
        CalibrationError: the thickness or the contact cannot be meshed.
    """
    if not 0.1e-3 <= constants.thickness_m <= 0.4 * study.eye.radius_m:
        raise CalibrationError(
            f"thickness: {from_si(constants.thickness_m, 'um'):g} um cannot be meshed; state the wall's"
        )
    shares = THICKNESS_NODES if thickness_uncertain else (1.0,)
    thicknesses = tuple(share * constants.thickness_m for share in shares)
    polars = polar_nodes(constants)
    contacts = [Contact(polar_rad=polar) for polar in polars]
    plane = (constants.gap_m, constants.section_direction_rad, constants.tilt_rad)
    lateral = lateral_samples(study.eye.radius_m, max(thicknesses), contacts, *plane)
    fields = [_fields(study, constants, thickness, contacts, lateral) for thickness in thicknesses]
    weight = study.eye.density_kg_m3 * STANDARD_GRAVITY_M_S2
    smoothing_m = study.calibration.surface_smoothing_m
    return LinearEye(
        constants=constants,
        weight_pa_m=weight,
        thickness_nodes_m=thicknesses,
        polar_nodes_rad=polars,
        fields=np.stack(fields),
        smoothing_m=smoothing_m,
    )


def _fields(
    study: Study, constants: EyeConstants, thickness_m: float, contacts: Sequence[Contact], lateral_m: Array
) -> Array:
    mesh = study_mesh(study, thickness_m, contacts[0] if len(contacts) == 1 else None)
    wall = LinearWall(mesh, study.eye.poisson_ratio)
    radius = study.needle.outer_diameter_m / 2
    plane = (constants.gap_m, constants.section_direction_rad, constants.tilt_rad)
    return np.stack([response_fields(wall, contact, radius, lateral_m, *plane) for contact in contacts])
