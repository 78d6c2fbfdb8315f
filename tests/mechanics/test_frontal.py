import numpy as np
import pytest

from reference_walls import stiffness_matrix
from scleraforce.errors import SolverError
from scleraforce.mechanics.contact import Contact
from scleraforce.mechanics.elements import element_stiffness, volume_points
from scleraforce.mechanics.frontal import FrontalFactor, dissect
from scleraforce.mechanics.graded import graded_mesh
from scleraforce.mechanics.loads import clamped_base
from scleraforce.mechanics.material import lame_constants
from scleraforce.mechanics.mesh import HexMesh, build_mesh

R, T = 12e-3, 0.8e-3
CONTACT = Contact(polar_rad=0.5, azimuth_rad=1.0)
MESHES = {
    "one element a front": build_mesh(R, T, divisions=2, level=0, order=1),
    "8 nodes, two layers": build_mesh(R, T, divisions=6, level=0, layers=2, order=1),
    "27 nodes": build_mesh(R, T, divisions=4, level=0),
    "graded": graded_mesh(R, T, CONTACT, core=2, rings=5),
    "globe": graded_mesh(R, T, CONTACT, core=2, rings=4, whole=True),
}


def held(mesh: HexMesh) -> np.ndarray:
    """The base, or a patch of nodes, and single components here and there."""
    held_nc = clamped_base(mesh)
    held_nc[mesh.points_nc[:, 2] < mesh.points_nc[:, 2].min() + 0.2 * R] |= len(mesh.base_nodes) == 0
    return held_nc | (np.random.default_rng(0).uniform(size=held_nc.shape) < 0.02)


def elements_of(mesh: HexMesh, shift: float = 0.0) -> np.ndarray:
    """Element matrices; shifted by their largest value times `shift`, they are not definite."""
    elements = element_stiffness(volume_points(mesh), *lame_constants(1.0, 0.45))
    size = elements.shape[1] * elements.shape[2]
    return elements - shift * elements.max() * np.eye(size).reshape(elements.shape[1:])


@pytest.mark.parametrize("shift", [0.0, 0.02])
@pytest.mark.parametrize("kind", MESHES)
def test_answers_agree_with_the_full_matrix(kind: str, shift: float) -> None:
    mesh = MESHES[kind]
    held_nc, elements = held(mesh), elements_of(mesh, shift)
    free = np.flatnonzero(~held_nc.ravel())
    K = stiffness_matrix(mesh, elements).toarray()[np.ix_(free, free)]
    assert (np.linalg.eigvalsh(K)[0] < 0.0) == (shift > 0.0)
    loads = np.random.default_rng(1).normal(size=(len(free), 3))
    loads[10:, 2] = 0.0  # fronts without a load are left out
    factor = FrontalFactor(dissect(mesh, held_nc), elements)
    expected = np.linalg.solve(K, loads)
    tolerance = 1e-11 * np.linalg.cond(K, 1) ** 0.5
    np.testing.assert_allclose(factor.solve(loads), expected, atol=tolerance * np.abs(expected).max())
    for column in range(3):
        one, atol = expected[:, column], tolerance * np.abs(expected[:, column]).max()
        np.testing.assert_allclose(factor.solve(loads[:, column]), one, atol=atol)
        np.testing.assert_allclose(factor.solve(loads[:, column, None])[:, 0], one, atol=atol)


def test_single_precision_is_exact_to_its_rounding() -> None:
    mesh = MESHES["27 nodes"]
    held_nc, elements = held(mesh), elements_of(mesh)
    load = np.random.default_rng(1).normal(size=np.count_nonzero(~held_nc))
    exact, single = (FrontalFactor(dissect(mesh, held_nc), values) for values in (elements, elements.astype("f4")))
    expected = exact.solve(load)
    error = np.abs(single.solve(load) - expected).max() / np.abs(expected).max()
    assert 1e-8 < error < 1e-3


@pytest.mark.parametrize("fault", [0.0, np.nan])
def test_a_matrix_without_a_factor_is_refused(fault: float) -> None:
    mesh = MESHES["8 nodes, two layers"]
    with pytest.raises(SolverError, match="singular"):
        FrontalFactor(dissect(mesh, held(mesh)), fault * elements_of(mesh))


@pytest.mark.parametrize("kind", MESHES)
def test_every_free_unknown_is_eliminated_once_and_before_what_it_is_shared_with(kind: str) -> None:
    mesh = MESHES[kind]
    fronts, number_u = dissect(mesh, held(mesh))
    assert sorted(number_u) == list(range(len(number_u)))
    assert [front.own.start for front in fronts[1:]] == [front.own.stop for front in fronts[:-1]]
    assert not len(fronts[-1].shared)
    for front in fronts:
        assert np.all(front.shared >= front.own.stop)
        assert np.all(np.diff(front.shared) > 0)
    elements = np.concatenate([front.elements for front in fronts])
    assert sorted(elements) == list(range(len(mesh.cells_en)))


def test_a_graded_wall_of_13185_unknowns_has_fronts_of_at_most_960() -> None:
    """The cost of a factor grows with the third power of the largest front."""
    mesh = graded_mesh(R, T, CONTACT)
    fronts, _ = dissect(mesh, clamped_base(mesh))
    assert fronts[-1].own.stop == 13_185
    assert max(front.own.stop - front.own.start + len(front.shared) for front in fronts) <= 960
