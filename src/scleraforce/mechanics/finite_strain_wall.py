"""Finite-strain mechanics of the wall: load paths of an eye under pressure, weight and
the needle.

The material is neo-Hookean, or an exponential of that, which stiffens
(`mechanics.tissue_material`). A dent of a few wall thicknesses softens the wall and
then stiffens it, which linear mechanics does not model. A load path is computed once,
by the tip's displacement (`mechanics.load_path_tracing`), and then read at any force.

The answer depends on F/E, p/E, (weight per volume)/E and (spring stiffness)/E only; E
is 1 Pa inside.
"""

from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import sqrt

import numpy as np
from scipy.interpolate import CubicSpline

from scleraforce.base.arrays import Flags, Floats
from scleraforce.base.errors import InputError, SolverError
from scleraforce.base.units import STANDARD_GRAVITY_M_S2, from_si
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.equilibrium import Solve
from scleraforce.mechanics.graded_mesh import graded_eye
from scleraforce.mechanics.hexahedral_mesh import HexMesh
from scleraforce.mechanics.load_path_tracing import (
    PathEnd,
    Progress,
    pressurise,
    trace_load_path,
)
from scleraforce.mechanics.loads_and_supports import (
    InnerSurface,
    NeedleLoad,
    Springs,
    clamped_base,
    gravity_load,
    needle_at,
    pressure_load,
    study_springs,
)
from scleraforce.mechanics.neo_hookean_solid import FibreLaw, NeoHookeanSolid, fibre_law
from scleraforce.mechanics.stiffness_factor import factor_sum
from scleraforce.mechanics.tissue_material import burst_tension
from scleraforce.mechanics.uneven_form import element_modulus, form_mesh
from scleraforce.records.globe import CONSTANT_PRESSURE, PressureLaw, study_law
from scleraforce.records.study import Study

ROUNDING = 1e-12  # of a force
RIGID = 1e-9  # least over most resisted rigid motion: 0 to rounding where one is free
# cubic interpolation between such states is off by 0.01 %; longer steps save no time
LARGEST_STEP_M = 3e-4


@dataclass(frozen=True, eq=False)
class LoadPath:
    """A wall's states of equilibrium along the needle's path, (state,) each; between
    them all is cubic in the tip.

    `tips_m`: the tip's inward displacement from the undented wall at the state's
    pressure, ascending from 0; the forces need not ascend. `rises_m`: outward
    displacement of the undented wall's tip from rest to the state's pressure.
    `displacement_snc`: displacement from the undeformed wall, (state, node, 3) in m.
    """

    mesh: HexMesh
    tips_m: Floats
    forces_n: Floats
    pressures_pa: Floats
    rises_m: Floats
    displacement_snc: Floats

    @property
    def max_force_n(self) -> float:
        """The largest force of the path's states in N."""
        return float(self.forces_n.max())

    def tip_m(self, force_n: float) -> float:
        """Return the dent in m at a force; the smallest one if several states carry the
        force.
        """
        if not 0.0 <= force_n <= self.max_force_n:
            raise InputError(
                f"force: {from_si(force_n, 'mn'):g} mN; this load path carries 0 to "
                f"{from_si(self.max_force_n, 'mn'):g} mN, up to a dent of "
                f"{from_si(self.tips_m[-1], 'mm'):.3g} mm"
            )

        return self._first_tip(self.forces_n, force_n)

    def tip_of_travel_m(self, travel_m: float) -> float:
        """Return the dent in m where the tip is `travel_m` from rest; the smallest one
        if there are several.
        """
        farthest_m = float((self.tips_m - self.rises_m).max())
        if not 0.0 <= travel_m <= farthest_m * (1.0 + ROUNDING):
            raise InputError(
                f"displacement: {from_si(travel_m, 'mm'):g} mm; this load path goes"
                f" from 0 to {from_si(farthest_m, 'mm'):g} mm"
            )

        return self._first_tip(self.tips_m - self.rises_m, travel_m)

    def at_tip(self, tip_m: float) -> tuple[float, float, float]:
        """Return force in N, eye pressure in Pa and travel in m at a dent; errors as of
        `displacement_at_tip_nc`.
        """
        states_sk = np.stack([self.forces_n, self.pressures_pa, self.rises_m], axis=1)
        force_n, pressure_pa, rise_m = self._weights(tip_m) @ states_sk
        return float(force_n), float(pressure_pa), tip_m - float(rise_m)

    def displacement_nc(self, force_n: float) -> Floats:
        """Return the displacement from the undeformed wall at a force, (node, 3) in m;
        errors as of `tip_m`.
        """
        return self.displacement_at_tip_nc(self.tip_m(force_n))

    def displacement_at_tip_nc(self, tip_m: float) -> Floats:
        """Return the displacement from the undeformed wall at a dent, (node, 3) in m;
        within the path only.
        """
        return np.einsum("s,snc->nc", self._weights(tip_m), self.displacement_snc)

    def pressure_pa(self, force_n: float) -> float:
        """Return the eye pressure at a force in Pa; errors as of `tip_m`."""
        return self.at_tip(self.tip_m(force_n))[1]

    def travel_m(self, force_n: float) -> float:
        """Return the tip's inward displacement from rest at a force, m: the dent, less
        the wall's rise if sealed.
        """
        return self.at_tip(self.tip_m(force_n))[2]

    def _first_tip(self, values_s: Floats, wanted: float) -> float:
        if wanted == 0.0:
            return 0.0
        # Rounding may hide a root that is a state, so the first state that reaches the
        # value bounds the answer.
        reached_m = self.tips_m[np.argmax(values_s >= wanted * (1.0 - ROUNDING))]
        roots_m = CubicSpline(self.tips_m, values_s).solve(wanted, extrapolate=False)
        return float(min(roots_m.min(initial=np.inf), reached_m))

    @cached_property
    def _basis(self) -> CubicSpline:
        """The spline through each state's unit vector: its values are the states'
        weights.
        """
        return CubicSpline(self.tips_m, np.eye(len(self.tips_m)))

    def _weights(self, tip_m: float) -> Floats:
        if not 0.0 <= tip_m <= self.tips_m[-1]:
            raise InputError(
                f"tip: {from_si(tip_m, 'mm'):g} mm; this load path goes from 0 to "
                f"{from_si(self.tips_m[-1], 'mm'):g} mm"
            )
        return self._basis(tip_m)


@dataclass(frozen=True)
class TissueLaw:
    """How tissue differs from a neo-Hookean solid: `stiffening`, b of
    `tissue_material`, and the `fibres` of a wall, if it has any.
    """

    stiffening: float = 0.0
    fibres: FibreLaw | None = None


NEO_HOOKEAN = TissueLaw()


class FiniteWall:
    """A wall at finite strain: its mesh, material, supports and loads, which all paths
    share.
    """

    def __init__(
        self,
        mesh: HexMesh,
        poisson_ratio: float,
        held_nc: Flags | None = None,
        *,
        modulus_factor_ep: Floats | None = None,
        tissue: TissueLaw = NEO_HOOKEAN,
        dead_pressure_nc: Floats | None = None,
        springs: Springs | None = None,
    ) -> None:
        """Prepare everything that does not depend on the displacement; for the material
        see `NeoHookeanSolid`.

        `held_nc` holds displacement components at zero, (node, 3); by default the
        clamped base. `dead_pressure_nc`: nodal forces of 1 Pa that keep their
        direction, (node, 3) in m^2, in place of a pressure that follows the inner
        surface.
        """
        self.mesh = mesh
        self.held_nc = clamped_base(mesh) if held_nc is None else held_nc
        self.solid = NeoHookeanSolid(
            mesh,
            poisson_ratio,
            modulus_factor_ep,
            stiffening=tissue.stiffening,
            fibres=tissue.fibres,
        )
        self.inner = InnerSurface(mesh)
        self.dead_pressure_nc = dead_pressure_nc
        self.springs = springs
        _check_supports(mesh, self.held_nc, springs)
        self.free = np.flatnonzero(~self.held_nc.ravel())

    def load_path(
        self,
        needle: NeedleLoad,
        end: PathEnd,
        *,
        youngs_modulus_pa: float,
        iop_pa: float,
        density_kg_m3: float,
        globe: PressureLaw = CONSTANT_PRESSURE,
        progress: Progress | None = None,
    ) -> LoadPath:
        """Apply pressure and weight, then push the needle up to the end of the path,
        whose force is in N.

        `iop_pa` is the pressure without the needle; a density of 0 leaves the weight
        out. Steps are at most `LARGEST_STEP_M` unless `end` gives others. `progress` is
        called after each step with the finished share of the largest force or travel.
        """
        if globe.is_sealed and self.dead_pressure_nc is not None:
            raise InputError(
                "sealed globe: its pressure has to follow the wall; leave the dead"
                " pressure out"
            )

        problem = WallEquilibrium(self, needle, youngs_modulus_pa, density_kg_m3)
        pressure = iop_pa / youngs_modulus_pa
        states = trace_load_path(
            problem,
            pressurise(problem, pressure),
            pressure,
            replace(end, largest_step_m=_largest_step_m(end)).over(youngs_modulus_pa),
            globe=globe.over(youngs_modulus_pa),
            progress=progress,
        )
        displacement_snc = np.stack([self.full_nc(u) for u in states.displacement_su])
        forces_n = states.force * youngs_modulus_pa
        pressures_pa = states.pressure * youngs_modulus_pa
        rises_m = (states.displacement_su[0] - states.undented_su) @ problem.tip

        return LoadPath(
            self.mesh, states.tip_m, forces_n, pressures_pa, rises_m, displacement_snc
        )

    def full_nc(self, free: Floats) -> Floats:
        """Return the displacement (node, 3) whose free components are given,
        (unknown,); the held ones are zero.
        """
        full = np.zeros(self.mesh.points_nc.size)
        full[self.free] = free
        return full.reshape(-1, 3)


def _largest_step_m(end: PathEnd) -> float:
    return LARGEST_STEP_M if end.largest_step_m is None else end.largest_step_m


def _check_supports(mesh: HexMesh, held_nc: Flags, springs: Springs | None) -> None:
    """Check that held components and springs together resist all six rigid motions of
    the undeformed wall.
    """
    places = mesh.points_nc / mesh.radius_m
    moves = [np.broadcast_to(axis, places.shape) for axis in np.eye(3)] + [
        np.cross(axis, places) for axis in np.eye(3)
    ]
    resisted = np.array([move[held_nc] for move in moves])
    gram = resisted @ resisted.T

    if springs is not None:
        work = np.array(
            [
                [np.sum(springs.forces(move) * other) for other in moves]
                for move in moves
            ]
        )
        gram += work / max(float(np.abs(work).max()), np.finfo(float).tiny)

    eigenvalues = np.linalg.eigvalsh(gram)
    if not eigenvalues[0] > RIGID * eigenvalues[-1]:
        raise SolverError(
            "supports: the wall may move as a rigid body; add supports against that"
        )


class WallEquilibrium:
    """The wall as an `Equilibrium`: its unknowns are the free components, at E = 1
    Pa.
    """

    def __init__(
        self,
        wall: FiniteWall,
        needle: NeedleLoad,
        youngs_modulus_pa: float,
        density_kg_m3: float,
    ) -> None:
        self._wall = wall
        self.needle: Floats = needle.load_nc.ravel()[wall.free]
        self.tip: Floats = needle.tip_nc.ravel()[wall.free]
        weight = density_kg_m3 * STANDARD_GRAVITY_M_S2 / youngs_modulus_pa
        self._weight_nc = weight * gravity_load(wall.mesh, wall.solid.points)
        self._per_modulus = 1.0 / youngs_modulus_pa

    def residual(self, u: Floats, pressure: float) -> Floats:
        """Return the forces out of balance without the needle, (unknown,)."""
        wall = self._wall
        displaced_nc = self._wall.full_nc(u)
        pushed_nc = (
            wall.inner.forces(displaced_nc)
            if wall.dead_pressure_nc is None
            else wall.dead_pressure_nc
        )
        balance_nc = (
            wall.solid.forces(displaced_nc) - pressure * pushed_nc - self._weight_nc
        )

        if wall.springs is not None:
            balance_nc += self._per_modulus * wall.springs.forces(displaced_nc)

        return balance_nc.ravel()[wall.free]

    def factor(self, u: Floats, pressure: float) -> Solve:
        """Factor the tangent in single precision, which costs half; the solve takes
        loads of any size.

        Newton's next step removes its relative error of about 1e-4: the forces alone
        decide the limit.
        """
        wall = self._wall
        displaced_nc = self._wall.full_nc(u)
        elements = wall.solid.tangents(displaced_nc, np.float32)
        if wall.dead_pressure_nc is None and pressure != 0.0:
            wall.inner.add_tangent(elements, displaced_nc, -pressure)
        if wall.springs is not None:
            wall.springs.add_to(elements, self._per_modulus)

        try:
            of_size_one = factor_sum(wall.mesh, wall.held_nc, elements)
        except SolverError as fault:
            raise SolverError(
                f"tangent: {fault}; add supports against rigid motion"
            ) from fault

        def solve(load: Floats) -> Floats:
            size = float(np.abs(load).max()) or 1.0  # single precision ends at 1e-38
            return of_size_one(load / size) * size

        return solve

    def volume(self, u: Floats) -> tuple[float, Floats]:
        """Return the volume inside in m^3 and its derivative, (unknown,)."""
        inner = self._wall.inner
        displaced_nc = self._wall.full_nc(u)
        return (
            inner.volume(displaced_nc),
            inner.forces(displaced_nc).ravel()[self._wall.free],
        )


# a path goes at least this far; the state without the needle alone is not a path
LEAST_FORCE_N = 1e-4
LEAST_STATES = 4  # of a path: a cubic in the tip has 4 coefficients
# steps of the path over the dent that a linear wall would have; softer walls take more
STEPS_TO_LINEAR_TIP = 3.0


def bend_eye(
    study: Study,
    contact: Contact,
    end: PathEnd,
    *,
    thickness_m: float,
    youngs_modulus_pa: float,
    iop_pa: float,
    progress: Progress | None = None,
) -> LoadPath:
    """Bend an eye at finite strain, up to the end of a path, with a graded mesh and all
    sections of the study.

    The force of `end` is in N; a lower one than 0.1 mN is raised to that. Steps are
    shortened until the path has at least four states. The thickness is nominal, the
    modulus that outside all regions, the pressure that without the needle. For
    `progress` see `FiniteWall.load_path`.
    """
    mesh = form_mesh(graded_eye(study, thickness_m, contact), study.form, contact)
    ratios = study.tissue.softer_through, study.tissue.stiffer_around
    even = ratios == (1.0, 1.0)
    fibres = None if even else fibre_law(study.eye.poisson_ratio, *ratios)
    wall = FiniteWall(
        mesh,
        study.eye.poisson_ratio,
        modulus_factor_ep=element_modulus(mesh, study.form),
        dead_pressure_nc=None if study.mechanics.follower else pressure_load(mesh),
        springs=study_springs(study.supports, mesh),
        tissue=TissueLaw(study.tissue.stiffening, fibres),
    )
    axis_c = contact.leaning_axis(
        study.needle.tilt_rad, study.needle.tilt_direction_rad
    )
    goal_n = max(end.max_force, LEAST_FORCE_N)
    # The dent of a shallow linear shell without pressure under a point force (Reissner,
    # J. Math. Phys. 25, 1946).
    stiffness = youngs_modulus_pa * thickness_m**2 / study.eye.radius_m
    linear = sqrt(3.0 * (1.0 - study.eye.poisson_ratio**2)) / 4.0
    travel_m = max(end.max_travel_m, linear * LEAST_FORCE_N / stiffness)
    linear_tip_m = min(linear * goal_n / stiffness, travel_m)
    goal = replace(
        end,
        max_force=goal_n,
        max_travel_m=travel_m,
        largest_step_m=min(_largest_step_m(end), linear_tip_m / STEPS_TO_LINEAR_TIP),
    )
    walk = partial(
        wall.load_path,
        needle_at(mesh, contact, 0.5 * study.needle.outer_diameter_m, axis_c),
        youngs_modulus_pa=youngs_modulus_pa,
        iop_pa=iop_pa,
        density_kg_m3=study.eye.density_kg_m3,
        globe=study_law(study.globe),
        progress=progress,
    )

    try:
        path = walk(goal)
    except SolverError as fault:
        tension = burst_tension(study.eye.poisson_ratio, study.tissue.stiffening)
        burst_pa = tension * youngs_modulus_pa * thickness_m / study.eye.radius_m
        hint = (
            f"; an even sphere of it bursts at {from_si(burst_pa, 'mmhg'):.3g} mmHg"
            if iop_pa > burst_pa
            else ""
        )
        raise SolverError(f"{fault}{hint}") from fault

    if len(path.tips_m) < LEAST_STATES:
        # high pressure: the dent is far shallower than a linear wall's
        reached_m = min(path.tip_m(min(goal_n, path.max_force_n)), travel_m)
        path = walk(replace(goal, largest_step_m=reached_m / LEAST_STATES))

    return path
