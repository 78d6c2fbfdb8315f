from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.sparse.linalg import spsolve

from reference_r2 import FORCES_MN, TIPS_MM, reference_path
from reference_walls import rest_nc, stiffness_matrix, symmetric_base
from scleraforce.errors import InputError, SolverError
from scleraforce.mechanics.contact import Contact
from scleraforce.mechanics.elements import volume_points
from scleraforce.mechanics.finite_strain import FiniteWall, LoadPath, WallEquilibrium
from scleraforce.mechanics.globe import OPEN_GLOBE, Globe, sealed_globe
from scleraforce.mechanics.graded import graded_mesh
from scleraforce.mechanics.linear import LinearWall, tip_displacement
from scleraforce.mechanics.loads import elastic_bed, gravity_load, needle_at, needle_loads, pressure_load, rectus_straps
from scleraforce.mechanics.material import lame_constants
from scleraforce.mechanics.mesh import HexMesh, build_mesh
from scleraforce.units import STANDARD_GRAVITY_M_S2

R, T, NU, E, IOP = 12e-3, 0.8e-3, 0.45, 0.3e6, 266.0
CONTACT = Contact(polar_rad=np.radians(35.0))
LOADS = {"youngs_modulus_pa": E, "iop_pa": IOP, "density_kg_m3": 1100.0}
# A needle wide enough for a mesh of 6 quads.
WIDE = 1.5e-3
GLOBE = sealed_globe(0.15e9)  # as rigid as enucleated human eyes


@cache
def coarse_mesh() -> HexMesh:
    return build_mesh(R, T, divisions=6, level=0)


@cache
def coarse_wall() -> FiniteWall:
    return FiniteWall(coarse_mesh(), NU)


@cache
def coarse_path(globe: Globe = OPEN_GLOBE, largest_step_m: float = 3e-4) -> LoadPath:
    needle = needle_at(coarse_mesh(), CONTACT, WIDE)
    return coarse_wall().load_path(
        needle, **LOADS, max_force_n=40e-3, max_tip_m=2e-3, globe=globe, largest_step_m=largest_step_m
    )


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize(
    ("thickness_m", "modulus_pa", "polar_deg", "loads"),
    [(0.8e-3, 0.27e6, 35.0, 5), (0.8e-3, 0.38e6, 0.0, 4)],  # `bench_finite_strain.py` has the rest
)
def test_reference_problem_r2_on_its_own_mesh_and_loads(
    thickness_m: float, modulus_pa: float, polar_deg: float, loads: int
) -> None:
    """Within a quarter of a percent where 1 % was asked for; read at the node nearest to the load, as R1 was.

    One of the four paths goes to the end: each is a minute to 60 mN.
    """
    mesh, contact = build_mesh(R, thickness_m, divisions=20, level=0), Contact(polar_rad=np.radians(polar_deg))
    expected_mm = np.array(TIPS_MM[thickness_m, modulus_pa, polar_deg][:loads])
    forces_n = 1e-3 * np.array(FORCES_MN[: len(expected_mm)])
    path = reference_path(mesh, modulus_pa, contact, forces_n[-1])
    outer = np.unique(mesh.outer_qn)
    nearest = outer[np.argmin(np.linalg.norm(mesh.points_nc[outer] - R * contact.normal, axis=1))]
    moved_nc = [path.displacement_nc(force)[nearest] - path.displacement_snc[0, nearest] for force in forces_n]
    np.testing.assert_allclose(-1e3 * np.array(moved_nc) @ contact.normal, expected_mm, rtol=2.5e-3, atol=6e-4)


@pytest.mark.parametrize("dead", [False, True])
def test_small_forces_without_pressure_give_linear_mechanics(dead: bool) -> None:
    mesh = coarse_mesh()
    wall = FiniteWall(mesh, NU, dead_pressure_nc=pressure_load(mesh) if dead else None)
    loads = {"youngs_modulus_pa": E, "iop_pa": 0.0, "density_kg_m3": 0.0, "max_force_n": np.inf}
    path = wall.load_path(needle_at(mesh, CONTACT, WIDE), **loads, max_tip_m=1e-7, largest_step_m=5e-8)
    force_n = 0.9 * path.max_force_n
    linear_nc = LinearWall(mesh, NU).solve_one(needle_loads(mesh, [CONTACT], WIDE)[0]) * force_n / E
    assert path.tip_m(force_n) == pytest.approx(tip_displacement(mesh, CONTACT, linear_nc), rel=1e-3)
    np.testing.assert_allclose(path.displacement_nc(force_n), linear_nc, atol=1e-3 * np.abs(linear_nc).max())


def test_little_pressure_and_weight_give_linear_mechanics() -> None:
    linear = LinearWall(coarse_mesh(), NU)
    loads = {"youngs_modulus_pa": 1e10, "iop_pa": 266.0, "density_kg_m3": 1100.0}
    expected_nc = linear.displacement(np.zeros_like(linear.pressure_nc), 0.0, **loads)
    moved_nc = rest_nc(coarse_wall(), **loads)
    np.testing.assert_allclose(moved_nc, expected_nc, atol=1e-4 * np.abs(expected_nc).max())


def radial_displacement(inner_m: float, outer_m: float, pressure: float, at_r: np.ndarray) -> np.ndarray:
    """Displacement of a thick neo-Hookean sphere under pressure p/E: P_rr' + 2 (P_rr - P_tt) / r = 0, by shooting."""
    lam, mu = lame_constants(1.0, NU)

    def stress(own: float, along: float, across: float) -> float:
        return mu * (own - 1 / own) + lam * np.log(along * across**2) / own

    def slope(r: float, y: np.ndarray) -> list[float]:
        along, across = y[1], y[0] / r
        by_along = mu * (1 + 1 / along**2) + lam * (1 - np.log(along * across**2)) / along**2
        by_across = 2 * lam / (along * across)
        difference = stress(along, along, across) - stress(across, along, across)
        return [along, -(2 * difference + by_across * (along - across)) / (r * by_along)]

    def shot(stretch: float):
        along = brentq(lambda s: stress(s, s, stretch) + pressure * stretch**2, 0.05, 2.0, xtol=1e-14)
        start = [stretch * inner_m, along]
        return solve_ivp(slope, (inner_m, outer_m), start, rtol=1e-11, atol=1e-14, dense_output=True)

    def traction(stretch: float) -> float:
        r, along = shot(stretch).y[:, -1]
        return stress(along, along, r / outer_m)

    return shot(brentq(traction, 1.0, 1.6, xtol=1e-13)).sol(at_r)[0] - at_r


def thick_sphere_error(divisions: int) -> float:
    """Largest error over the largest displacement, for a sphere that swells by 22 % inside."""
    mesh = build_mesh(R, 4e-3, divisions=divisions, level=0, layers=divisions // 4)
    moved_nc = rest_nc(
        FiniteWall(mesh, NU, symmetric_base(mesh)), youngs_modulus_pa=1.0, iop_pa=0.15, density_kg_m3=0.0
    )
    r = np.linalg.norm(mesh.points_nc, axis=1)
    exact_nc = (radial_displacement(R - 4e-3, R, 0.15, r) / r)[:, None] * mesh.points_nc
    assert np.abs(exact_nc).max() > 1.5e-3
    return float(np.abs(moved_nc - exact_nc).max() / np.abs(exact_nc).max())


@pytest.mark.slow
def test_a_thick_sphere_under_pressure_swells_as_its_radial_equation_says() -> None:
    coarse, fine = thick_sphere_error(4), thick_sphere_error(8)
    assert fine < 2e-3
    assert np.log2(coarse / fine) > 2.5


def test_every_state_balances_its_loads() -> None:
    """Reactions of the base against needle, weight, and the pressure on the opening that the deformed wall closes."""
    path, mesh, wall = coarse_path(), coarse_mesh(), coarse_wall()
    weight_nc = 1100.0 * STANDARD_GRAVITY_M_S2 * gravity_load(mesh, volume_points(mesh))
    needle_nc = needle_at(mesh, CONTACT, WIDE).load_nc
    for force_n, displacement_nc in zip(path.forces_n, path.displacement_snc, strict=True):
        loads_nc = force_n * needle_nc + weight_nc + IOP * wall.inner.forces(displacement_nc)
        reactions_nc = E * wall.solid.forces(displacement_nc) - loads_nc
        size = np.abs(loads_nc).sum()
        assert np.abs(np.delete(reactions_nc, mesh.base_nodes, axis=0)).max() < 1e-8 * size
        np.testing.assert_allclose(np.sum(reactions_nc + loads_nc, axis=0), 0.0, atol=1e-9 * size)
        moments = np.cross(mesh.points_nc + displacement_nc, reactions_nc + loads_nc).sum(axis=0)
        np.testing.assert_allclose(moments, 0.0, atol=1e-9 * size * R)


@pytest.mark.parametrize("size", [1e-60, 1.0, 1e60])
def test_a_tangent_factored_in_single_precision_solves_as_one_in_double(size: float) -> None:
    path, wall = coarse_path(), coarse_wall()
    problem = WallEquilibrium(wall, needle_at(coarse_mesh(), CONTACT, WIDE), E, 1100.0)
    deep = path.displacement_snc[-1].ravel()[wall.free]
    loads_uk = size * np.random.default_rng(3).normal(size=(len(wall.free), 2))
    answers_uk = problem.factor(deep, IOP / E)(loads_uk)
    elements = wall.solid.tangents(wall.full_nc(deep))
    wall.inner.add_tangent(elements, wall.full_nc(deep), -IOP / E)
    tangent = stiffness_matrix(wall.mesh, elements)[wall.free][:, wall.free]
    exact_uk = spsolve(tangent.tocsc(), loads_uk)
    assert np.linalg.norm(answers_uk - exact_uk) < 2e-3 * np.linalg.norm(exact_uk)


def test_the_path_reads_back_its_own_states() -> None:
    path = coarse_path()
    assert path.tips_m[0] == path.forces_n[0] == path.tip_m(0.0) == 0.0
    needle = needle_at(coarse_mesh(), CONTACT, WIDE)
    for tip_m, force_n, displacement_nc in zip(path.tips_m, path.forces_n, path.displacement_snc, strict=True):
        assert path.tip_m(force_n) == pytest.approx(tip_m, abs=1e-12)
        np.testing.assert_allclose(path.displacement_nc(force_n), displacement_nc, atol=1e-12)
        assert np.sum(needle.tip_nc * (displacement_nc - path.displacement_snc[0])) == pytest.approx(tip_m, abs=1e-11)
        assert path.pressure_pa(force_n) == pytest.approx(IOP)


def test_only_ratios_to_the_modulus_matter() -> None:
    needle = needle_at(coarse_mesh(), CONTACT, WIDE)
    stiff = coarse_wall().load_path(
        needle, youngs_modulus_pa=3 * E, iop_pa=3 * IOP, density_kg_m3=3 * 1100.0, max_force_n=30e-3
    )
    np.testing.assert_allclose(
        stiff.displacement_nc(30e-3), coarse_path().displacement_nc(10e-3), atol=1e-4 * coarse_path().tip_m(10e-3)
    )


@pytest.mark.slow
def test_the_pressure_of_a_sealed_globe_follows_the_volume_that_the_dent_displaces() -> None:
    path, inner = coarse_path(GLOBE), coarse_wall().inner
    assert path.pressures_pa[0] == pytest.approx(IOP)
    assert np.all(np.diff(path.pressures_pa) > 0.0)
    opened = coarse_path()
    force_n = 0.9 * min(path.max_force_n, opened.max_force_n)
    assert path.pressure_pa(force_n) > 1.1 * IOP
    assert path.tip_m(force_n) < opened.tip_m(force_n)
    assert opened.travel_m(force_n) == opened.tip_m(force_n)

    # The undented wall at the pressure of the last state, on its own.
    undented_nc = rest_nc(coarse_wall(), **{**LOADS, "iop_pa": float(path.pressures_pa[-1])})
    displaced_m3 = inner.volume(undented_nc) - inner.volume(path.displacement_snc[-1])
    assert GLOBE.pressure(IOP, displaced_m3) == pytest.approx(path.pressures_pa[-1], rel=1e-7)
    tip_nc = needle_at(coarse_mesh(), CONTACT, WIDE).tip_nc
    assert np.sum(tip_nc * (path.displacement_snc[-1] - undented_nc)) == pytest.approx(path.tips_m[-1], rel=1e-7)
    travel_m = np.sum(tip_nc * (path.displacement_snc[-1] - path.displacement_snc[0]))
    assert path.tips_m[-1] - path.rises_m[-1] == pytest.approx(travel_m, rel=1e-7)
    assert path.travel_m(force_n) < path.tip_m(force_n)


def test_a_sealed_globe_with_a_dead_pressure_is_an_input_error() -> None:
    mesh = coarse_mesh()
    wall = FiniteWall(mesh, NU, dead_pressure_nc=pressure_load(mesh))
    with pytest.raises(InputError, match="follow"):
        wall.load_path(needle_at(mesh, CONTACT, WIDE), **LOADS, max_force_n=1e-3, globe=GLOBE)


def made_up_path() -> LoadPath:
    """A path that turns: 0, 3, 2, 4 mN."""
    tips_m = np.linspace(0.0, 3e-3, 31)
    forces_n = 1e-3 * np.interp(tips_m, [0.0, 1e-3, 2e-3, 3e-3], [0.0, 3.0, 2.0, 4.0])
    return LoadPath(tips_m, forces_n, np.full(31, IOP), np.zeros(31), tips_m[:, None, None] * np.ones((31, 2, 3)))


def test_of_several_states_with_one_force_the_first_is_taken() -> None:
    path = made_up_path()
    assert path.tip_m(2.5e-3) == pytest.approx(2.5e-3 / 3, rel=0.01)
    assert path.tip_m(3.5e-3) == pytest.approx(2.75e-3, rel=0.01)
    np.testing.assert_allclose(path.displacement_nc(2.5e-3), path.tip_m(2.5e-3), rtol=1e-9)


def test_the_force_of_a_state_is_read_at_that_state_whatever_the_rounding() -> None:
    random = np.random.default_rng(5)
    for _ in range(200):
        tips_m = np.append(0.0, np.cumsum(random.uniform(0.1e-3, 0.5e-3, size=12)))
        forces_n = 5.0 * tips_m + random.uniform(0.1, 1.0) * 1e3 * tips_m**2
        path = LoadPath(tips_m, forces_n, np.full(13, IOP), np.zeros(13), tips_m[:, None, None] * np.ones((13, 2, 3)))
        for side in (0.0, 1.0):
            found_m = [path.tip_m(float(force_n)) for force_n in np.nextafter(forces_n[1:-1], side)]
            np.testing.assert_allclose(found_m, tips_m[1:-1], atol=1e-12)


def test_a_force_or_a_dent_that_the_path_does_not_reach_is_an_input_error() -> None:
    path = made_up_path()
    for value, beyond in ((-1e-6, -1e-6), (4.01e-3, 3.1e-3), (np.nan, np.nan)):
        with pytest.raises(InputError, match="carries 0 to 4 mN"):
            path.displacement_nc(value)
        with pytest.raises(InputError, match="goes from 0 to 3 mm"):
            path.displacement_at_tip_nc(beyond)


def test_a_wall_that_may_move_as_a_rigid_body_is_refused() -> None:
    """Free to slide; a globe on nothing; a globe on straps alone, which may turn about its axis."""
    held = symmetric_base(coarse_mesh())
    held[:, :2] = False
    with pytest.raises(SolverError, match="rigid body"):
        FiniteWall(coarse_mesh(), NU, held)
    globe = graded_mesh(R, T, CONTACT, core=2, rings=4, whole=True)
    for springs in (None, rectus_straps(globe, 20.0)):
        with pytest.raises(SolverError, match="rigid body"):
            FiniteWall(globe, NU, springs=springs)
    FiniteWall(globe, NU, springs=elastic_bed(globe, 1e6, 1e4))
