"""Linear mechanics of the wall: K u = f_p + f_g + f_n (paper sec. 2.1, eq. 2), factored
once for every load and E.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from scleraforce.base.arrays import Flags, Floats
from scleraforce.base.errors import SolverError
from scleraforce.base.units import STANDARD_GRAVITY_M_S2
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_elements import (
    element_stiffness,
    volume_points,
)
from scleraforce.mechanics.hexahedral_mesh import HexMesh
from scleraforce.mechanics.loads_and_supports import (
    Springs,
    clamped_base,
    gravity_load,
    needle_loads,
    pressure_load,
    tip_at,
)
from scleraforce.mechanics.stiffness_factor import factor_sum
from scleraforce.mechanics.tissue_material import lame_constants

# stiffest over softest motion; a clamped wall has 4e2 to 3e4, a free one 1e16
SINGULAR = 1e12
# right-hand sides in one triangular solve: 10 MB of them at the default mesh
LOADS_AT_ONCE = 32


class LinearWall:
    """A wall of linear elastic material, with its stiffness factored at E = 1 Pa.

    K is proportional to E, so the answer at E is the one at 1 Pa divided by E;
    thickness, Poisson's ratio and supports need a new wall. The model holds for
    displacements that are small compared with the thickness.
    """

    def __init__(
        self,
        mesh: HexMesh,
        poisson_ratio: float,
        held_nc: Flags | None = None,
        *,
        springs: Springs | None = None,
        springs_modulus_pa: float = 1.0,
    ) -> None:
        """Assemble and factor.

        Springs do not scale with E: the wall then represents `springs_modulus_pa` only.
        By default the base is clamped.
        """
        self.mesh = mesh
        self.held_nc = clamped_base(mesh) if held_nc is None else held_nc
        self._points = volume_points(mesh)
        self._free = np.flatnonzero(~self.held_nc.ravel())
        elements = element_stiffness(self._points, *lame_constants(1.0, poisson_ratio))

        if springs is not None:
            springs.add_to(elements, 1.0 / springs_modulus_pa)

        try:
            self._solve = factor_sum(mesh, self.held_nc, elements)
        except SolverError as fault:
            raise SolverError(
                f"stiffness: {fault}; add supports against rigid motion"
            ) from fault

        probe = np.random.default_rng(0).normal(size=len(self._free))
        softest = float(np.linalg.norm(self._solve(probe)) / np.linalg.norm(probe))
        if not softest * float(elements.max()) < SINGULAR:
            raise SolverError(
                "stiffness: the wall may move as a rigid body; add supports against"
                " that"
            )

    @cached_property
    def pressure_nc(self) -> Floats:
        """Displacement under 1 Pa of eye pressure at E = 1 Pa, (node, 3) in m."""
        return self.solve_one(pressure_load(self.mesh))

    @cached_property
    def gravity_nc(self) -> Floats:
        """Displacement under 1 N/m^3 of weight (density times g, along -z) at E = 1 Pa,
        (node, 3) in m.
        """
        return self.solve_one(gravity_load(self.mesh, self._points))

    def needle_cnc(self, contacts: Sequence[Contact], needle_radius_m: float) -> Floats:
        """Displacements under 1 N through the needle at each contact at E = 1 Pa,
        (contact, node, 3) in m.

        A needle that reaches over the base plane is an `InputError`.
        """
        answer = np.empty((len(contacts), *self.mesh.points_nc.shape))
        for start in range(0, len(contacts), LOADS_AT_ONCE):
            part = slice(start, start + LOADS_AT_ONCE)
            answer[part] = self.solve(
                needle_loads(self.mesh, contacts[part], needle_radius_m)
            )

        return answer

    def solve(self, loads_lnc: Floats) -> Floats:
        """Return displacements at E = 1 Pa for nodal forces (load, node, 3) in N; same
        shape, in m.
        """
        answer = np.zeros((len(loads_lnc), 3 * len(self.mesh.points_nc)))
        answer[:, self._free] = self._solve(
            loads_lnc.reshape(answer.shape)[:, self._free].T
        ).T
        return answer.reshape(loads_lnc.shape)

    def solve_one(self, load_nc: Floats) -> Floats:
        """Return the displacement at E = 1 Pa for one set of nodal forces (node, 3) in
        N; same shape, in m.
        """
        return self.solve(load_nc[None])[0]

    def displacement(
        self,
        needle_nc: Floats,
        force_n: float,
        *,
        youngs_modulus_pa: float,
        iop_pa: float,
        density_kg_m3: float,
    ) -> Floats:
        """Return (p u_p + rho g u_g + F u_n) / E, the wall's displacement (node, 3) in
        m, by superposition.
        """
        weight_n_m3 = density_kg_m3 * STANDARD_GRAVITY_M_S2
        loaded = (
            iop_pa * self.pressure_nc
            + weight_n_m3 * self.gravity_nc
            + force_n * needle_nc
        )

        return loaded / youngs_modulus_pa


def tip_displacement(mesh: HexMesh, contact: Contact, needle_nc: Floats) -> float:
    """Return the inward displacement of the outer surface at the contact along the
    needle axis, in m.

    `needle_nc` (node, 3): displacement from the state without the needle; in linear
    mechanics F u_n / E.
    """
    return float(np.sum(tip_at(mesh, contact, -contact.normal) * needle_nc))
