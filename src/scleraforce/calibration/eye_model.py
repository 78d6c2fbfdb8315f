"""The eye that a recording shows, as the filter sees it: responses over what is uncertain about it.

Thickness and the contact's polar angle need a solution of their own each; between a few such solutions the
displacements are interpolated by Lagrange's polynomial. Modulus, force, IOP and gap need none (`response`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import prod, sqrt

import numpy as np
from numpy.typing import NDArray

from scleraforce.calibration.response import WallResponse, WallState, lateral_samples, wall_response
from scleraforce.errors import CalibrationError
from scleraforce.eye.contact import Contact
from scleraforce.eye.study_mesh import study_mesh
from scleraforce.mechanics.linear import LinearWall
from scleraforce.study import Study
from scleraforce.units import STANDARD_GRAVITY_M_S2

__all__ = ["EyeConstants", "EyeModel", "build_eye_model"]

Array = NDArray[np.float64]

THICKNESS_NODES = (0.8, 1.0, 1.2)  # of the stated thickness, where the thickness is uncertain


@dataclass(frozen=True)
class EyeConstants:
    """What is stated about an eye and its plane, SI; `polar_sd_rad` is 0 where the recording states the angle."""

    iop_pa: float
    thickness_m: float
    gap_m: float
    polar_rad: float
    polar_sd_rad: float
    direction_rad: float = 0.0
    tilt_rad: float = 0.0


@dataclass(frozen=True, eq=False)
class EyeModel:
    """Responses at nodes of thickness and polar angle.

    `fields` (thickness, polar, field, boundary, line, sample, axis), see `WallResponse`; so is `smoothing_m`.
    """

    constants: EyeConstants
    weight_pa_m: float
    thickness_nodes_m: tuple[float, ...]
    polar_nodes_rad: tuple[float, ...]
    fields: Array
    smoothing_m: float = 0.0

    def at(self, polar_rad: float, thickness_m: float | None = None) -> WallResponse:
        """Return the response for a polar angle and, where it is uncertain, a thickness."""
        thickness = self.constants.thickness_m if thickness_m is None else thickness_m
        if polar_rad in self.polar_nodes_rad and thickness in self.thickness_nodes_m:
            node = self.thickness_nodes_m.index(thickness), self.polar_nodes_rad.index(polar_rad)
            return WallResponse(self.fields[node], self.constants.tilt_rad, self.smoothing_m)
        weights = np.outer(lagrange(self.thickness_nodes_m, thickness), lagrange(self.polar_nodes_rad, polar_rad))
        # A shell bends as 1/t^2 under a point load: t^2 u is smoother in t than u. Positions are linear in t.
        bent = weights * (np.array(self.thickness_nodes_m)[:, None] / thickness) ** 2
        by_field = np.stack([weights, bent, bent, bent])
        fields = np.einsum("ftp,tpfblsc->fblsc", by_field, self.fields)
        return WallResponse(fields, self.constants.tilt_rad, self.smoothing_m)

    def state(self, youngs_modulus_pa: float, force_n: float) -> WallState:
        """Return the state of the eye as stated, at a modulus and a force."""
        stated = self.constants
        return WallState(youngs_modulus_pa, force_n, stated.iop_pa, self.weight_pa_m, stated.gap_m)

    def curves(self, names: Sequence[str], values_rp: Array, force_n: float, polar_rad: float) -> Array:
        """Return the sections for rows of uncertain parameters, shape (row, boundary, sample, 2).

        Args:
            names: of `youngs_modulus_pa`, `iop_pa`, `thickness_m`, `gap_m`, in the order of the columns.
            values_rp: their values, SI.
            force_n: force of the needle.
            polar_rad: polar angle of the contact.
        """
        rows = [dict(zip(names, row, strict=True)) for row in values_rp.tolist()]
        thickness = [row.pop("thickness_m", None) for row in rows]
        states = [replace(self.state(1.0, force_n), **row) for row in rows]
        if all(entry is None for entry in thickness):
            return self.at(polar_rad).curves(states)
        pairs = zip(states, thickness, strict=True)
        return np.concatenate([self.at(polar_rad, entry).curves([state]) for state, entry in pairs])


def lagrange(nodes: Sequence[float], at: float) -> Array:
    """Return the weights (node,) of Lagrange's polynomial through `nodes` at a place.

    >>> lagrange((0.0, 1.0, 2.0), 0.5).tolist()
    [0.375, 0.75, -0.125]
    """
    return np.array([prod((at - other) / (node - other) for other in nodes if other != node) for node in nodes])


def build_eye_model(study: Study, constants: EyeConstants, thickness_uncertain: bool = False) -> EyeModel:
    """Solve the walls that a calibration of one eye needs: one, or three where the thickness is uncertain.

    Raises:
        CalibrationError: the thickness or the contact cannot be meshed.
    """
    if not 0.1e-3 <= constants.thickness_m <= 0.4 * study.eye.radius_m:
        raise CalibrationError(f"thickness: {constants.thickness_m * 1e6:g} um cannot be meshed; state the wall's")
    shares = THICKNESS_NODES if thickness_uncertain else (1.0,)
    thicknesses = tuple(share * constants.thickness_m for share in shares)
    spread = sqrt(3.0) * constants.polar_sd_rad
    polars = tuple(constants.polar_rad + k * spread for k in ((-1.0, 0.0, 1.0) if spread else (0.0,)))
    contacts = [Contact(polar) for polar in polars]
    plane = (constants.gap_m, constants.direction_rad, constants.tilt_rad)
    lateral = lateral_samples(study.eye.radius_m, max(thicknesses), contacts, *plane)
    fields = [_fields(study, constants, thickness, contacts, lateral) for thickness in thicknesses]
    weight = study.eye.density_kg_m3 * STANDARD_GRAVITY_M_S2
    smoothing_m = study.calibration.surface_smoothing_m
    return EyeModel(constants, weight, thicknesses, polars, np.stack(fields), smoothing_m)


def _fields(
    study: Study, constants: EyeConstants, thickness_m: float, contacts: Sequence[Contact], lateral_m: Array
) -> Array:
    mesh = study_mesh(study, thickness_m, contacts[0] if len(contacts) == 1 else None)
    wall = LinearWall(mesh, study.eye.poisson_ratio)
    radius = study.needle.outer_diameter_m / 2
    plane = (constants.gap_m, constants.direction_rad, constants.tilt_rad)
    return np.stack([wall_response(wall, contact, radius, lateral_m, *plane).fields_fblsc for contact in contacts])
