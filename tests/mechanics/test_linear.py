"""Linear walls: exact solutions, convergence, CalculiX, scikit-fem, and the factor of a
matrix.
"""

import numpy as np
import pytest
import skfem
from skfem.helpers import dot
from skfem.models.elasticity import lame_parameters, linear_elasticity

from reference_r1 import gaussian_load
from reference_walls import stiffness_matrix, symmetric_base, wall_mesh
from scleraforce.base.errors import SolverError
from scleraforce.base.units import STANDARD_GRAVITY_M_S2
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_elements import (
    element_stiffness,
    volume_points,
)
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.hexahedral_mesh import HexMesh, build_mesh
from scleraforce.mechanics.linear_wall import LinearWall
from scleraforce.mechanics.loads_and_supports import needle_loads
from scleraforce.mechanics.stiffness_factor import factor_sum
from scleraforce.mechanics.tissue_material import lame_constants
from speed.solvers.calculix import (
    MM_PER_M,
    calculate,
    force_cards,
    input_deck,
    is_installed,
)
from speed.solvers.plain_scikit_fem import CORNERS

R = 12e-3
NU = 0.45
E = 0.25e6
NEEDLE = 0.35e-3
CONTACT = Contact(polar_rad=np.radians(35.0))


def r1_displacement(wall: LinearWall) -> np.ndarray:
    """Reference problem R1 of the project's figures: 30 mN at E = 0.25 MPa."""
    return wall.solve_one(gaussian_load(wall.mesh, CONTACT, 0.35e-3)) * 0.03 / E


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mesh", "expected_m"),
    [
        ({"divisions": 20, "level": 0}, 2.124e-3),
        ({"divisions": 20, "level": 0, "twenty_nodes": True}, 2.117e-3),
        ({"divisions": 40, "level": 0, "order": 1, "layers": 2}, 1.743e-3),
        ({"divisions": 40, "level": 0, "order": 1, "layers": 3}, 1.867e-3),
    ],
    ids=["quadratic", "serendipity", "trilinear 9,600", "trilinear 14,400"],
)
def test_reference_problem_r1_is_that_of_other_programs_on_their_meshes(
    mesh: dict, expected_m: float
):
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
):
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


def test_thick_sphere_under_pressure_swells_as_lame_says():
    coarse = lame_error(4)
    fine = lame_error(8)
    assert fine < 2e-3
    assert np.log2(coarse / fine) > 3.0


def test_a_wall_that_may_move_as_a_rigid_body_is_refused():
    mesh = build_mesh(R, 1e-3, divisions=4, level=0)
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
    tmp_path, element: str, kind: dict, load: str
):
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
    loads = {"iop_pa": IOP_PA, "density_kg_m3": DENSITY_KG_M3, "force_n": FORCE_N}
    alone = dict.fromkeys(loads, 0.0) | {LOAD_KEYS[load]: loads[LOAD_KEYS[load]]}
    needle_nc = wall.needle_cnc([TURNED], NEEDLE)[0]
    ours = wall.displacement(needle_nc, youngs_modulus_pa=E, **alone)
    assert np.abs(theirs).max() > 1e-6
    assert np.abs(ours - theirs).max() < 1e-4 * np.abs(theirs).max()


LOAD_KEYS = {"iop": "iop_pa", "gravity": "density_kg_m3", "needle": "force_n"}


@pytest.mark.parametrize("load", ["iop", "gravity"])
def test_displacements_agree_with_scikit_fem(load: str):
    """Trilinear elements; its own forms of the pressure and of the weight."""
    mesh = build_mesh(R, T, divisions=6, level=0, layers=2, order=1)
    wall = LinearWall(mesh, NU)
    hexes = skfem.MeshHex1(mesh.points_nc.T.copy(), mesh.cells_en[:, CORNERS].T.copy())
    element = skfem.ElementVector(skfem.ElementHex1())
    basis = skfem.Basis(hexes, element, intorder=3)
    radii = np.linalg.norm(hexes.p[:, hexes.facets], axis=0)
    inside = np.flatnonzero((radii < R - 0.9 * T).all(axis=0))
    form, domain, ours = {
        "iop": (
            lambda v, w: -dot(w.n, v),
            skfem.FacetBasis(hexes, element, facets=inside, intorder=5),
            wall.pressure_nc,
        ),
        "gravity": (lambda v, w: -v[2] + 0.0 * w.x[0], basis, wall.gravity_nc),
    }[load]
    stiffness = linear_elasticity(*lame_parameters(1.0, NU)).assemble(basis)
    held = basis.get_dofs(hexes.facets_satisfying(lambda x: x[2] < 1e-9))
    force = skfem.LinearForm(form).assemble(domain)
    theirs = skfem.solve(*skfem.condense(stiffness, force, D=held))[basis.nodal_dofs].T
    np.testing.assert_allclose(ours, theirs, atol=1e-8 * np.abs(theirs).max())


FARTHER = Contact(polar_rad=0.5, azimuth_rad=1.0)
MESHES = {
    "8 nodes": build_mesh(R, T, divisions=4, level=0, layers=2, order=1),
    "27 nodes": build_mesh(R, T, divisions=2, level=0),
    "globe": graded_mesh(R, T, FARTHER, core=2, rings=1, whole=True),
}


def elements_and_held(kind: str) -> tuple[HexMesh, np.ndarray, np.ndarray]:
    """A mesh, its element matrices, and what is held: the base or a patch of nodes, and
    single components here and there.
    """
    mesh = MESHES[kind]
    elements = element_stiffness(volume_points(mesh), *lame_constants(1.0, NU))
    lowest = mesh.points_nc[:, 2].min()
    held_nc = np.random.default_rng(0).uniform(size=mesh.points_nc.shape) < 0.02
    held_nc[mesh.points_nc[:, 2] < lowest + 1e-9] = True
    return mesh, elements, held_nc


@pytest.mark.parametrize(
    ("kind", "shift", "precision", "rtol"),
    [
        ("8 nodes", 0.0, "f8", 1e-9),
        ("27 nodes", 0.0, "f8", 1e-9),
        ("27 nodes", 0.02, "f8", 1e-9),  # not definite
        ("27 nodes", 0.0, "f4", 1e-3),
        ("globe", 0.0, "f8", 1e-9),
    ],
)
def test_answers_agree_with_the_full_matrix(
    kind: str, shift: float, precision: str, rtol: float
):
    mesh, elements, held_nc = elements_and_held(kind)
    size = elements.shape[1] * elements.shape[2]
    shifted = np.eye(size).reshape(elements.shape[1:])
    elements = elements - shift * elements.max() * shifted
    free = np.flatnonzero(~held_nc.ravel())
    K = stiffness_matrix(mesh, elements).toarray()[np.ix_(free, free)]
    assert (np.linalg.eigvalsh(K)[0] < 0.0) == (shift > 0.0)
    loads = np.random.default_rng(1).normal(size=(len(free), 3))
    solve = factor_sum(mesh, held_nc, elements.astype(precision))
    expected = np.linalg.solve(K, loads)

    for found, wanted in (
        (solve(loads), expected),
        (solve(loads[:, 0]), expected[:, 0]),
    ):
        np.testing.assert_allclose(found, wanted, atol=rtol * np.abs(expected).max())


@pytest.mark.parametrize(
    ("fault", "message"), [(0.0, "singular"), (np.nan, "not finite")]
)
def test_a_matrix_without_a_factor_is_refused(fault: float, message: str):
    mesh, elements, held_nc = elements_and_held("8 nodes")
    with pytest.raises(SolverError, match=message):
        factor_sum(mesh, held_nc, fault * elements)
