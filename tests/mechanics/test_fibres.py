"""Fibres: closed forms of stretched elements and of a sphere under pressure; derivatives of the energy."""

import numpy as np
import pytest
from energy import NU, STEP, energy
from numpy.typing import NDArray

from reference_walls import stiffness_matrix, symmetric_base
from scleraforce.mechanics.elements import element_stiffness, volume_points
from scleraforce.mechanics.fibres import FibreLaw, fibre_law
from scleraforce.mechanics.frontal import FrontalFactor, dissect
from scleraforce.mechanics.loads import pressure_load
from scleraforce.mechanics.material import lame_constants
from scleraforce.mechanics.mesh import HexMesh, build_mesh
from scleraforce.mechanics.neo_hookean import NeoHookeanSolid

R = 12e-3
MIXED = fibre_law(NU, 6.0, 2.0)


def hooke(law: FibreLaw) -> NDArray:
    """Stiffness at small strains, (6, 6): 11, 22, 33 (through the wall), 23, 13, 12."""
    lame_lambda, mu = lame_constants(law.base, NU)
    C = np.diag([2.0 * mu] * 3 + [mu] * 3)
    C[:3, :3] += lame_lambda
    C[np.ix_([0, 1, 5], [0, 1, 5])] += law.plane
    return C


@pytest.mark.parametrize(("softer", "through"), [(1.0, 1.0), (4.0, 1 / 1.79), (10.0, 1 / 3.37), (25.0, 1 / 7.33)])
def test_a_wall_that_is_softer_through_keeps_its_modulus_along(softer: float, through: float) -> None:
    S = np.linalg.inv(hooke(fibre_law(NU, softer, 1.0)))
    np.testing.assert_allclose([1 / S[0, 0], 1 / S[1, 1], -S[0, 1] / S[0, 0]], [1.0, 1.0, NU], rtol=1e-12)
    assert 1.0 / S[2, 2] == pytest.approx(through, rel=3e-3)
    assert S[5, 5] / S[4, 4] == pytest.approx(1.0 / softer, rel=1e-12)  # moduli of shear


@pytest.mark.parametrize("softer", [1.0, 10.0])
def test_a_wall_that_is_stiffer_around_has_e_as_the_mean_of_both_directions(softer: float) -> None:
    S = np.linalg.inv(hooke(fibre_law(NU, softer, 3.0)))
    np.testing.assert_allclose([S[1, 1] / S[0, 0], S[0, 0] * S[1, 1]], [3.0, 1.0], rtol=1e-12)


def directions(mesh: HexMesh) -> NDArray:
    """Around, along the meridian and through the wall at the Gauss points, (element, point, direction, 3)."""
    places = np.einsum("pn,enc->epc", volume_points(mesh).values_pn, mesh.points_nc[mesh.cells_en])
    through = places / np.linalg.norm(places, axis=-1, keepdims=True)
    around = np.cross([0.0, 0.0, 1.0], through)
    around /= np.linalg.norm(around, axis=-1, keepdims=True)
    return np.stack([around, np.cross(through, around), through], axis=2)


def fibre_energy(F: NDArray, mesh: HexMesh, law: FibreLaw) -> NDArray:
    """W of matrices (element, point, 3, 3), real or complex: the definition; b is as good as 0."""
    moved = np.einsum("epij,epkj->epki", F, directions(mesh))
    double = np.einsum("epki,epli->epkl", moved, moved)
    e = np.stack([(double[..., 0, 0] - 1) / 2, (double[..., 1, 1] - 1) / 2, double[..., 0, 1]], axis=-1)
    return law.base * energy(F, 1e-12) + 0.5 * np.einsum("epv,vw,epw->ep", e, law.plane, e)


def test_forces_and_tangents_are_the_derivatives_of_the_energy() -> None:
    mesh = build_mesh(R, 1e-3, divisions=4, level=0, layers=2)
    points, random = volume_points(mesh), np.random.default_rng(1)
    factor_ep = random.uniform(0.6, 1.4, points.volumes_ep.shape)
    u_nc = mesh.points_nc @ (random.normal(size=(3, 3)) * 0.12) + random.normal(size=mesh.points_nc.shape) * 1e-5
    moved_nc = random.normal(size=mesh.points_nc.shape)
    solid = NeoHookeanSolid(mesh, NU, factor_ep, fibres=MIXED)

    def gradient(field_nc: NDArray) -> NDArray:
        return np.einsum("eni,epnj->epij", field_nc[mesh.cells_en], points.gradients_epnc)

    F = np.eye(3) + gradient(u_nc) + 1j * STEP * gradient(moved_nc)
    work = np.sum(factor_ep * points.volumes_ep * fibre_energy(F, mesh, MIXED).imag) / STEP
    assert np.sum(solid.forces(u_nc) * moved_nc) == pytest.approx(work, rel=2e-3)  # directions of curved elements
    step = 1e-6 * 1e-3
    change = (solid.forces(u_nc + step * moved_nc) - solid.forces(u_nc - step * moved_nc)).ravel() / (2.0 * step)
    K = stiffness_matrix(mesh, solid.tangents(u_nc))
    np.testing.assert_allclose(K @ moved_nc.ravel(), change, atol=1e-6 * np.abs(change).max())


def test_a_rotation_costs_no_force_and_no_fibres_are_the_isotropic_solid() -> None:
    mesh = build_mesh(R, 1e-3, divisions=4, level=0)
    rotation = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    turned_nc = mesh.points_nc @ (rotation * np.linalg.det(rotation)).T - mesh.points_nc
    stretched_nc = 0.1 * mesh.points_nc
    fibred = NeoHookeanSolid(mesh, NU, fibres=MIXED)
    assert np.abs(fibred.forces(turned_nc)).max() < 1e-10 * np.abs(fibred.forces(stretched_nc)).max()
    even = NeoHookeanSolid(mesh, NU, fibres=fibre_law(NU, 1.0, 1.0)).tangents(0.0 * turned_nc)
    np.testing.assert_allclose(even, element_stiffness(volume_points(mesh), *lame_constants(1.0, NU)), atol=1e-9)


def test_a_thick_fibred_sphere_swells_under_pressure_as_the_closed_form_says() -> None:
    """u = A r^m + B r^n with m, n = -1/2 +- sqrt(1/4 + 2 (C11 + C12 - C13)/C33) (Lekhnitskii, sec. 62)."""
    outer, inner = R, R - 4e-3
    law = fibre_law(NU, 8.0, 1.0)
    mesh = build_mesh(outer, outer - inner, divisions=8, level=0, layers=2)
    held_nc = symmetric_base(mesh)
    tangents = NeoHookeanSolid(mesh, NU, fibres=law).tangents(np.zeros_like(mesh.points_nc))
    u_nc = np.zeros(mesh.points_nc.size)
    free = ~held_nc.ravel()
    u_nc[free] = FrontalFactor(dissect(mesh, held_nc), tangents).solve(pressure_load(mesh).ravel()[free])
    C = hooke(law)
    root = np.sqrt(0.25 + 2.0 * (C[0, 0] + C[0, 1] - C[0, 2]) / C[2, 2])
    powers = np.array([-0.5 + root, -0.5 - root])
    ends = np.array([inner, outer])[:, None]
    stress = (C[2, 2] * powers + 2.0 * C[0, 2]) * ends ** (powers - 1.0)
    A = np.linalg.solve(stress, [-1.0, 0.0])
    r = np.linalg.norm(mesh.points_nc, axis=1, keepdims=True)
    exact_nc = (r**powers @ A)[:, None] * mesh.points_nc / r
    assert np.abs(u_nc.reshape(-1, 3) - exact_nc).max() < 5e-3 * np.abs(exact_nc).max()
