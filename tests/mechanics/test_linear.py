from functools import cache

import numpy as np
import pytest

from reference_r1 import gaussian_load
from reference_walls import stiffness_matrix, symmetric_base, wall_mesh
from scleraforce.errors import SolverError
from scleraforce.mechanics.contact import Contact
from scleraforce.mechanics.elements import element_stiffness, volume_points
from scleraforce.mechanics.linear import LinearWall, tip_displacement
from scleraforce.mechanics.loads import gravity_load, needle_loads, pressure_load
from scleraforce.mechanics.material import lame_constants
from scleraforce.mechanics.mesh import build_mesh

R, NU, E = 12e-3, 0.45, 0.25e6
NEEDLE = 0.35e-3
CONTACT = Contact(polar_rad=np.radians(35.0))


@cache
def default_wall(thickness_m: float) -> LinearWall:
    return LinearWall(build_mesh(R, thickness_m), NU)


@cache
def coarse_wall() -> LinearWall:
    return LinearWall(build_mesh(R, 0.8e-3, divisions=4), NU)


def r1_displacement(wall: LinearWall) -> np.ndarray:
    """Reference problem R1 of the project's figures: 30 mN at E = 0.25 MPa."""
    return wall.solve_one(gaussian_load(wall.mesh, CONTACT, 0.35e-3)) * 0.03 / E


@pytest.mark.slow
@pytest.mark.parametrize(("thickness_m", "expected_m"), [(0.5e-3, 2.135e-3), (0.8e-3, 0.894e-3)])
def test_reference_problem_r1_within_one_percent_on_the_default_mesh(thickness_m: float, expected_m: float) -> None:
    wall = default_wall(thickness_m)
    assert tip_displacement(wall.mesh, CONTACT, r1_displacement(wall)) == pytest.approx(expected_m, rel=0.01)


@pytest.mark.parametrize(
    ("mesh", "expected_m"),
    [
        pytest.param({"divisions": 20, "level": 0}, 2.124e-3, marks=pytest.mark.slow),
        pytest.param({"divisions": 20, "level": 0, "twenty_nodes": True}, 2.117e-3, marks=pytest.mark.slow),
        pytest.param({"divisions": 40, "level": 0, "order": 1, "layers": 2}, 1.743e-3, marks=pytest.mark.slow),
        pytest.param({"divisions": 40, "level": 0, "order": 1, "layers": 3}, 1.867e-3, marks=pytest.mark.slow),
    ],
    ids=["quadratic", "serendipity", "trilinear 9,600", "trilinear 14,400"],
)
def test_reference_problem_r1_is_that_of_other_programs_on_their_meshes(mesh: dict, expected_m: float) -> None:
    """SOFA, CalculiX and scikit-fem, four digits; they were read at the corner nearest to the load (36 deg)."""
    wall = LinearWall(wall_mesh(R, 0.5e-3, **mesh), NU)
    corners = np.unique(wall.mesh.outer_qn[:, :4])
    nearest = corners[np.argmin(np.linalg.norm(wall.mesh.points_nc[corners] - R * CONTACT.normal, axis=1))]
    assert -r1_displacement(wall)[nearest] @ CONTACT.normal == pytest.approx(expected_m, abs=0.0006e-3)


def observed_order(divisions: list[int], **kind: object) -> float:
    """Order of the strain energy under refinement along the sphere, from three meshes.

    A smooth problem: two opposite pushes on the poles of a whole sphere. (The edge of a clamped base is singular.)
    """
    pole, energies = Contact(polar_rad=0.0), []
    for n in divisions:
        mesh = wall_mesh(R, 2e-3, divisions=n, level=0, **kind)
        wall, load = LinearWall(mesh, NU, symmetric_base(mesh)), gaussian_load(mesh, pole, 3e-3)
        energies.append(0.5 * np.sum(load * wall.solve_one(load)))
    coarse, fine = np.diff(energies)
    assert 0.0 < fine < coarse  # a displacement method approaches the energy from below
    return float(np.log2(coarse / fine))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("divisions", "kind", "order"),
    [([4, 8, 16], {"twenty_nodes": True}, 4.0), ([4, 8, 16], {}, 4.0), ([8, 16, 32], {"order": 1, "layers": 2}, 2.0)],
)
def test_strain_energy_converges_with_the_order_of_the_elements(divisions: list, kind: dict, order: float) -> None:
    assert observed_order(divisions, **kind) == pytest.approx(order, abs=0.25)


def lame_error(divisions: int, **kind: object) -> float:
    """Largest relative error of the displacement of a thick sphere under internal pressure (Lame).

    u_r = p a^3 / (E (b^3 - a^3)) ((1 - 2 nu) r + (1 + nu) b^3 / (2 r^2)); Timoshenko and Goodier, sec. 136.
    """
    b, a = R, R - 4e-3
    mesh = build_mesh(b, b - a, divisions=divisions, level=0, layers=divisions // 4, **kind)
    wall = LinearWall(mesh, NU, symmetric_base(mesh))
    r = np.linalg.norm(mesh.points_nc, axis=1, keepdims=True)
    u_r = a**3 / (b**3 - a**3) * ((1 - 2 * NU) * r + (1 + NU) * b**3 / (2 * r**2))
    return float(np.abs(wall.pressure_nc - u_r * mesh.points_nc / r).max() / u_r.max())


def test_thick_sphere_under_pressure_swells_as_lame_says() -> None:
    coarse, fine = lame_error(4), lame_error(8)
    assert fine < 2e-3
    assert np.log2(coarse / fine) > 3.0


@pytest.mark.parametrize("load", ["iop", "gravity", "needle"])
def test_reactions_balance_the_loads(load: str) -> None:
    wall = coarse_wall()
    mesh = wall.mesh
    forces, answer = {
        "iop": lambda: (pressure_load(mesh), wall.pressure_nc),
        "gravity": lambda: (gravity_load(mesh, volume_points(mesh)), wall.gravity_nc),
        "needle": lambda: (needle_loads(mesh, [CONTACT], NEEDLE)[0], wall.needle_cnc([CONTACT], NEEDLE)[0]),
    }[load]()
    K = stiffness_matrix(mesh, element_stiffness(volume_points(mesh), *lame_constants(1.0, NU)))
    reactions = (K @ answer.ravel()).reshape(-1, 3) - forces
    size = np.abs(forces).sum()
    assert np.abs(reactions[~wall.held_nc]).max() < 1e-8 * np.abs(forces).max()
    np.testing.assert_allclose(reactions[wall.held_nc.all(axis=1)].sum(axis=0), -forces.sum(axis=0), atol=1e-8 * size)
    moments = np.cross(mesh.points_nc, reactions + forces).sum(axis=0)
    np.testing.assert_allclose(moments, 0.0, atol=1e-8 * size * R)


@pytest.mark.parametrize("contacts", [1, 3])
def test_wanted_nodes_equal_the_full_solution_to_the_last_bit(contacts: int) -> None:
    wall = coarse_wall()
    pressed = [Contact(polar_rad=0.4, azimuth_rad=azimuth) for azimuth in range(contacts)]
    nodes = np.flatnonzero(np.abs(wall.mesh.points_nc @ CONTACT.parallel) < 2e-3)
    some, every = wall.needle_cnc(pressed, NEEDLE, nodes), wall.needle_cnc(pressed, NEEDLE)
    np.testing.assert_array_equal(some[:, nodes], every[:, nodes])
    assert np.isnan(np.delete(some, nodes, axis=1)).all()


def test_superposition_is_the_solution_for_the_sum_of_the_loads() -> None:
    wall = coarse_wall()
    needle = wall.needle_cnc([CONTACT], NEEDLE)[0]
    sum_of_answers = wall.displacement(needle, 0.03, youngs_modulus_pa=E, iop_pa=266.0, density_kg_m3=1100.0)
    gravity = 1100.0 * 9.80665 * gravity_load(wall.mesh, volume_points(wall.mesh))
    loads = 266.0 * pressure_load(wall.mesh) + gravity + 0.03 * needle_loads(wall.mesh, [CONTACT], NEEDLE)[0]
    np.testing.assert_allclose(wall.solve_one(loads) / E, sum_of_answers, atol=1e-12)


def test_tip_displacement_is_that_of_the_outer_surface_at_the_contact_along_the_axis() -> None:
    mesh = build_mesh(R, 1e-3, divisions=6)
    inward = np.array([0.2, -0.1, 0.7])
    moved_m = tip_displacement(mesh, CONTACT, np.tile(inward, (len(mesh.points_nc), 1)))
    assert moved_m == pytest.approx(-inward @ CONTACT.normal)
    # A field that grows along the wall shows that the point is the contact: u = -0.1 x gives 0.1 R there.
    assert tip_displacement(mesh, CONTACT, -0.1 * mesh.points_nc) == pytest.approx(0.1 * R, rel=1e-4)


def test_a_wall_that_may_move_as_a_rigid_body_is_refused() -> None:
    mesh = build_mesh(R, 1e-3, divisions=4)
    held = symmetric_base(mesh)
    held[:, :2] = False  # free to slide in the plane of the base
    with pytest.raises(SolverError, match="supports"):
        LinearWall(mesh, NU, held)
