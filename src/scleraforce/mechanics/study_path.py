"""The load path of a study's eye: its form, its material, the needle's axis, how the pressure acts."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import sqrt

from scleraforce.errors import SolverError
from scleraforce.eye.contact import Contact
from scleraforce.eye.form import form_mesh
from scleraforce.eye.globe import study_globe
from scleraforce.eye.graded import graded_globe, graded_mesh
from scleraforce.eye.mesh import HexMesh
from scleraforce.mechanics.burst import burst_tension
from scleraforce.mechanics.finite_strain import LARGEST_STEP_M, FiniteWall, LoadPath
from scleraforce.mechanics.loads import pressure_load
from scleraforce.mechanics.needle import needle_at
from scleraforce.mechanics.quadrature import gauss_points
from scleraforce.mechanics.springs import study_springs
from scleraforce.study import Study
from scleraforce.units import from_si

LEAST_FORCE_N = 1e-4  # a path goes at least this far; the state without the needle alone is not a path
LEAST_STATES = 4  # of a path: a cubic in the tip needs so many
STEPS_TO_LINEAR_TIP = 3.0  # steps of the path over the dent that a linear wall would have; softer walls take more


@dataclass(frozen=True, eq=False)
class BentEye:
    """A formed wall under the needle, and its states under growing force."""

    mesh: HexMesh
    path: LoadPath


def bend_eye(
    study: Study,
    contact: Contact,
    *,
    thickness_m: float,
    youngs_modulus_pa: float,
    iop_pa: float,
    max_force_n: float,
    max_tip_m: float | None = None,
    as_far_as_found: bool = False,
    progress: Callable[[float], object] | None = None,
) -> BentEye:
    """Bend an eye at finite strain, up to a force; radius, material, form and needle are the study's.

    Args:
        study: all of its sections on the eye count, with a mesh of the graded kind.
        contact: where the needle pushes.
        thickness_m: nominal thickness of the wall.
        youngs_modulus_pa: E outside all regions.
        iop_pa: eye pressure without the needle.
        max_force_n: where the path may end.
        max_tip_m: the deepest dent; the path may then end below the force.
        as_far_as_found: the path may also end where no equilibrium is found any more.
        progress: called after every state with the share of the force that is reached.

    Raises:
        InputError: the contact is too close to the base.
        SolverError: no equilibrium was found; the message says what was reached.
    """
    eye, cells = study.eye, study.mesh
    graded = graded_globe if study.supports.has_bed else graded_mesh
    sphere = graded(eye.radius_m, thickness_m, contact, cells.core, cells.rings, cells.layers, cells.order)
    formed = form_mesh(sphere, study.form, contact)
    wall = FiniteWall(
        formed.mesh,
        eye.poisson_ratio,
        modulus_factor_ep=formed.modulus_factor(gauss_points(3, formed.mesh.order + 1)[0]),
        dead_pressure_nc=None if study.mechanics.follower else pressure_load(formed.mesh),
        springs=study_springs(study.supports, formed.mesh),
        stiffening=study.tissue.stiffening,
    )
    axis_c = contact.leaning_axis(study.needle.tilt_rad, study.needle.tilt_direction_rad)
    goal_n = max(max_force_n, LEAST_FORCE_N)
    linear_tip_m = _linear_tip_m(study, goal_n, youngs_modulus_pa, thickness_m)
    walk = partial(
        wall.load_path,
        needle_at(formed.mesh, contact, 0.5 * study.needle.outer_diameter_m, axis_c),
        youngs_modulus_pa=youngs_modulus_pa,
        iop_pa=iop_pa,
        density_kg_m3=eye.density_kg_m3,
        max_force_n=goal_n,
        max_tip_m=max_tip_m,
        globe=study_globe(study.globe),
        largest_step_m=min(LARGEST_STEP_M, linear_tip_m / STEPS_TO_LINEAR_TIP),
        as_far_as_found=as_far_as_found,
        progress=None if progress is None else lambda force_n: progress(min(force_n / goal_n, 1.0)),
    )
    try:
        path = walk()
    except SolverError as fault:
        raise SolverError(f"{fault}{_burst(study, thickness_m, youngs_modulus_pa, iop_pa)}") from fault
    if len(path.tips_m) < LEAST_STATES:  # high pressure: the dent is far shallower than a linear wall's
        path = walk(largest_step_m=path.tip_m(min(goal_n, path.max_force_n)) / LEAST_STATES)
    return BentEye(formed.mesh, path)


def _burst(study: Study, thickness_m: float, youngs_modulus_pa: float, iop_pa: float) -> str:
    """Return at what pressure a thin even sphere of a wall bursts, as the end of a sentence; empty where it stands."""
    limit = burst_tension(study.eye.poisson_ratio, study.tissue.stiffening)
    burst_pa = limit * youngs_modulus_pa * thickness_m / study.eye.radius_m
    return f"; an even sphere of it bursts at {from_si(burst_pa, 'mmhg'):.3g} mmHg" if iop_pa > burst_pa else ""


def _linear_tip_m(study: Study, force_n: float, youngs_modulus_pa: float, thickness_m: float) -> float:
    """Dent of a shallow linear shell without pressure under a point force (Reissner, J. Math. Phys. 25, 1946)."""
    stiffness = youngs_modulus_pa * thickness_m**2 / study.eye.radius_m
    return sqrt(3.0 * (1.0 - study.eye.poisson_ratio**2)) / 4.0 * force_n / stiffness
