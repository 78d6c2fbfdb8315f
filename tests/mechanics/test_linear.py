"""Linear walls: exact solutions, convergence, CalculiX, and the factor of a matrix."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from reference_r1 import gaussian_load
from reference_walls import stiffness_matrix, symmetric_base, wall_mesh
from scleraforce.base.errors import SolverError
from scleraforce.base.units import STANDARD_GRAVITY_M_S2
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_elements import (
    element_stiffness,
    factor_sum,
    volume_points,
)
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.hexahedral_mesh import HexMesh, build_mesh
from scleraforce.mechanics.linear_wall import LinearWall
from scleraforce.mechanics.loads_and_supports import (
    clamped_base,
    gravity_load,
    needle_loads,
    pressure_load,
)
from scleraforce.mechanics.tissue_material import lame_constants
from speed.solvers.calculix import (
    MM_PER_M,
    calculate,
    force_cards,
    input_deck,
    is_installed,
)

R = 12e-3
NU = 0.45
E = 0.25e6
NEEDLE = 0.35e-3
CONTACT = Contact(polar_rad=np.radians(35.0))


@cache
def coarse_wall() -> LinearWall:
    return LinearWall(build_mesh(R, 0.8e-3, divisions=4), NU)


def r1_displacement(wall: LinearWall) -> np.ndarray:
    """Reference problem R1 of the project's figures: 30 mN at E = 0.25 MPa."""
    return wall.solve_one(gaussian_load(wall.mesh, CONTACT, 0.35e-3)) * 0.03 / E


@pytest.mark.parametrize(
    ("mesh", "expected_m"),
    [
        pytest.param({"divisions": 20, "level": 0}, 2.124e-3, marks=pytest.mark.slow),
        pytest.param(
            {"divisions": 20, "level": 0, "twenty_nodes": True},
            2.117e-3,
            marks=pytest.mark.slow,
        ),
        pytest.param(
            {"divisions": 40, "level": 0, "order": 1, "layers": 2},
            1.743e-3,
            marks=pytest.mark.slow,
        ),
        pytest.param(
            {"divisions": 40, "level": 0, "order": 1, "layers": 3},
            1.867e-3,
            marks=pytest.mark.slow,
        ),
    ],
    ids=["quadratic", "serendipity", "trilinear 9,600", "trilinear 14,400"],
)
def test_reference_problem_r1_is_that_of_other_programs_on_their_meshes(
    mesh: dict, expected_m: float
) -> None:
    """SOFA, CalculiX and scikit-fem, four digits; they were read at the corner nearest
    to the load (36 deg).
    """
    wall = LinearWall(wall_mesh(R, 0.5e-3, **mesh), NU)
    corners = np.unique(wall.mesh.outer_qn[:, :4])
    nearest = corners[
        np.argmin(
            np.linalg.norm(wall.mesh.points_nc[corners] - R * CONTACT.normal, axis=1)
        )
    ]
    assert -r1_displacement(wall)[nearest] @ CONTACT.normal == pytest.approx(
        expected_m, abs=0.0006e-3
    )


def observed_order(divisions: list[int], **kind: object) -> float:
    """Order of the strain energy under refinement along the sphere, from three meshes.

    A smooth problem: two opposite pushes on the poles of a whole sphere. (The edge of a
    clamped base is singular.)
    """
    pole = Contact(polar_rad=0.0)
    energies = []

    for n in divisions:
        mesh = wall_mesh(R, 2e-3, divisions=n, level=0, **kind)
        wall = LinearWall(mesh, NU, symmetric_base(mesh))
        load = gaussian_load(mesh, pole, 3e-3)
        energies.append(0.5 * np.sum(load * wall.solve_one(load)))

    coarse, fine = np.diff(energies)
    assert 0.0 < fine < coarse  # a displacement method approaches the energy from below
    return float(np.log2(coarse / fine))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("divisions", "kind", "order"),
    [
        ([4, 8, 16], {"twenty_nodes": True}, 4.0),
        ([4, 8, 16], {}, 4.0),
        ([8, 16, 32], {"order": 1, "layers": 2}, 2.0),
    ],
)
def test_strain_energy_converges_with_the_order_of_the_elements(
    divisions: list, kind: dict, order: float
) -> None:
    assert observed_order(divisions, **kind) == pytest.approx(order, abs=0.25)


def lame_error(divisions: int, **kind: object) -> float:
    """Largest relative error of the displacement of a thick sphere under internal
    pressure (Lame).

    u_r = p a^3 / (E (b^3 - a^3)) ((1 - 2 nu) r + (1 + nu) b^3 / (2 r^2)); Timoshenko
    and Goodier, sec. 136.
    """
    b = R
    a = R - 4e-3
    mesh = build_mesh(
        b, b - a, divisions=divisions, level=0, layers=divisions // 4, **kind
    )
    wall = LinearWall(mesh, NU, symmetric_base(mesh))
    r = np.linalg.norm(mesh.points_nc, axis=1, keepdims=True)
    u_r = a**3 / (b**3 - a**3) * ((1 - 2 * NU) * r + (1 + NU) * b**3 / (2 * r**2))

    return float(np.abs(wall.pressure_nc - u_r * mesh.points_nc / r).max() / u_r.max())


def test_thick_sphere_under_pressure_swells_as_lame_says() -> None:
    coarse = lame_error(4)
    fine = lame_error(8)
    assert fine < 2e-3
    assert np.log2(coarse / fine) > 3.0


@pytest.mark.parametrize("load", ["iop", "gravity", "needle"])
def test_reactions_balance_the_loads(load: str) -> None:
    wall = coarse_wall()
    mesh = wall.mesh
    forces, answer = {
        "iop": lambda: (pressure_load(mesh), wall.pressure_nc),
        "gravity": lambda: (gravity_load(mesh, volume_points(mesh)), wall.gravity_nc),
        "needle": lambda: (
            needle_loads(mesh, [CONTACT], NEEDLE)[0],
            wall.needle_cnc([CONTACT], NEEDLE)[0],
        ),
    }[load]()
    K = stiffness_matrix(
        mesh, element_stiffness(volume_points(mesh), *lame_constants(1.0, NU))
    )
    reactions = (K @ answer.ravel()).reshape(-1, 3) - forces
    size = np.abs(forces).sum()
    assert np.abs(reactions[~wall.held_nc]).max() < 1e-8 * np.abs(forces).max()
    np.testing.assert_allclose(
        reactions[wall.held_nc.all(axis=1)].sum(axis=0),
        -forces.sum(axis=0),
        atol=1e-8 * size,
    )
    moments = np.cross(mesh.points_nc, reactions + forces).sum(axis=0)
    np.testing.assert_allclose(moments, 0.0, atol=1e-8 * size * R)


def test_superposition_is_the_solution_for_the_sum_of_the_loads() -> None:
    wall = coarse_wall()
    needle = wall.needle_cnc([CONTACT], NEEDLE)[0]
    sum_of_answers = wall.displacement(
        needle, 0.03, youngs_modulus_pa=E, iop_pa=266.0, density_kg_m3=1100.0
    )
    gravity = 1100.0 * 9.80665 * gravity_load(wall.mesh, volume_points(wall.mesh))
    loads = (
        266.0 * pressure_load(wall.mesh)
        + gravity
        + 0.03 * needle_loads(wall.mesh, [CONTACT], NEEDLE)[0]
    )
    np.testing.assert_allclose(wall.solve_one(loads) / E, sum_of_answers, atol=1e-12)


def test_a_wall_that_may_move_as_a_rigid_body_is_refused() -> None:
    mesh = build_mesh(R, 1e-3, divisions=4)
    held = symmetric_base(mesh)
    held[:, :2] = False  # free to slide in the plane of the base
    with pytest.raises(SolverError, match="supports"):
        LinearWall(mesh, NU, held)


T = 0.8e-3
IOP_PA = 266.0
DENSITY_KG_M3 = 1100.0
FORCE_N = 0.03
TURNED = Contact(polar_rad=np.radians(35.0), azimuth_rad=0.4)


def needle_cards(mesh: HexMesh) -> str:
    """Concentrated loads: what CalculiX solves must be the same; its own disc load does
    not exist.
    """
    return force_cards(FORCE_N * needle_loads(mesh, [TURNED], NEEDLE)[0])


def iop_cards(mesh: HexMesh) -> str:
    """CalculiX's own pressure on face 1 (nodes 1-2-3-4: the inner side of the innermost
    elements).
    """
    inner = set(mesh.inner_qn[:, :4].ravel().tolist())
    elements = [
        e + 1 for e, cell in enumerate(mesh.cells_en) if set(cell[:4].tolist()) <= inner
    ]
    return "*DLOAD\n" + "\n".join(f"{e}, P1, {IOP_PA * 1e-6:.11e}" for e in elements)


def gravity_cards(mesh: HexMesh) -> str:  # noqa: ARG001 - one of three makers of cards
    return f"*DLOAD\nWALL, GRAV, {STANDARD_GRAVITY_M_S2 * MM_PER_M}, 0., 0., -1."


@pytest.mark.skipif(not is_installed(), reason="CalculiX (ccx) is not installed")
@pytest.mark.parametrize(
    ("element", "kind"),
    [
        ("C3D20", {"twenty_nodes": True, "divisions": 6}),
        ("C3D8", {"order": 1, "divisions": 10}),
    ],
)
@pytest.mark.parametrize("load", ["iop", "gravity", "needle"])
def test_displacements_agree_with_calculix(
    tmp_path: Path, element: str, kind: dict, load: str
) -> None:
    mesh = wall_mesh(R, T, level=0, layers=2, **kind)
    wall = LinearWall(mesh, NU)
    cards = {"iop": iop_cards, "gravity": gravity_cards, "needle": needle_cards}[load](
        mesh
    )
    deck = input_deck(
        mesh,
        element,
        cards,
        youngs_modulus_pa=E,
        poisson_ratio=NU,
        density_kg_m3=DENSITY_KG_M3,
    )
    theirs = calculate(tmp_path, deck, len(mesh.points_nc)).displacement_nc
    ours = {
        "iop": lambda: IOP_PA * wall.pressure_nc,
        "gravity": lambda: DENSITY_KG_M3 * STANDARD_GRAVITY_M_S2 * wall.gravity_nc,
        "needle": lambda: FORCE_N * wall.needle_cnc([TURNED], NEEDLE)[0],
    }[load]() / E
    assert np.abs(theirs).max() > 1e-6
    assert np.abs(ours - theirs).max() < 1e-4 * np.abs(theirs).max()


FARTHER = Contact(polar_rad=0.5, azimuth_rad=1.0)
MESHES = {
    "8 nodes, one layer": build_mesh(R, T, divisions=2, level=0, order=1),
    "8 nodes, two layers": build_mesh(R, T, divisions=6, level=0, layers=2, order=1),
    "27 nodes": build_mesh(R, T, divisions=4, level=0),
    "graded": graded_mesh(R, T, FARTHER, core=2, rings=5),
    "globe": graded_mesh(R, T, FARTHER, core=2, rings=4, whole=True),
}


def held(mesh: HexMesh) -> np.ndarray:
    """The base, or a patch of nodes, and single components here and there."""
    held_nc = clamped_base(mesh)
    held_nc[mesh.points_nc[:, 2] < mesh.points_nc[:, 2].min() + 0.2 * R] |= (
        len(mesh.base_nodes) == 0
    )
    return held_nc | (np.random.default_rng(0).uniform(size=held_nc.shape) < 0.02)


def elements_of(mesh: HexMesh, shift: float = 0.0) -> np.ndarray:
    """Element matrices; shifted by their largest value times `shift`, they are not
    definite.
    """
    elements = element_stiffness(volume_points(mesh), *lame_constants(1.0, 0.45))
    size = elements.shape[1] * elements.shape[2]
    return elements - shift * elements.max() * np.eye(size).reshape(elements.shape[1:])


@pytest.mark.parametrize("shift", [0.0, 0.02])
@pytest.mark.parametrize("kind", MESHES)
def test_answers_agree_with_the_full_matrix(kind: str, shift: float) -> None:
    mesh = MESHES[kind]
    held_nc = held(mesh)
    elements = elements_of(mesh, shift)
    free = np.flatnonzero(~held_nc.ravel())
    K = stiffness_matrix(mesh, elements).toarray()[np.ix_(free, free)]
    assert (np.linalg.eigvalsh(K)[0] < 0.0) == (shift > 0.0)
    loads = np.random.default_rng(1).normal(size=(len(free), 3))
    solve = factor_sum(mesh, held_nc, elements)
    expected = np.linalg.solve(K, loads)
    tolerance = 1e-11 * np.linalg.cond(K, 1) ** 0.5
    np.testing.assert_allclose(
        solve(loads), expected, atol=tolerance * np.abs(expected).max()
    )
    np.testing.assert_allclose(
        solve(loads[:, 0]),
        expected[:, 0],
        atol=tolerance * np.abs(expected[:, 0]).max(),
    )


def test_single_precision_is_exact_to_its_rounding() -> None:
    mesh = MESHES["27 nodes"]
    held_nc = held(mesh)
    elements = elements_of(mesh)
    load = np.random.default_rng(1).normal(size=np.count_nonzero(~held_nc))
    exact, single = (
        factor_sum(mesh, held_nc, values)
        for values in (elements, elements.astype("f4"))
    )
    expected = exact(load)
    error = np.abs(single(load) - expected).max() / np.abs(expected).max()
    assert 1e-8 < error < 1e-3


@pytest.mark.parametrize(
    ("fault", "message"), [(0.0, "singular"), (np.nan, "not finite")]
)
def test_a_matrix_without_a_factor_is_refused(fault: float, message: str) -> None:
    mesh = MESHES["8 nodes, two layers"]
    with pytest.raises(SolverError, match=message):
        factor_sum(mesh, held(mesh), fault * elements_of(mesh))
