from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from reference_walls import rest_nc, stiffness_matrix
from scleraforce.errors import InputError
from scleraforce.mechanics.contact import Contact
from scleraforce.mechanics.elements import FacePlaces
from scleraforce.mechanics.finite_strain import FiniteWall
from scleraforce.mechanics.globe import sealed_globe
from scleraforce.mechanics.graded import graded_mesh
from scleraforce.mechanics.linear import LinearWall
from scleraforce.mechanics.loads import (
    INSERTIONS,
    Springs,
    elastic_bed,
    needle_at,
    needle_loads,
    rectus_straps,
    study_springs,
)
from scleraforce.mechanics.mesh import HexMesh, build_mesh
from scleraforce.study import SupportsStudy

R, T, NU, E = 12e-3, 0.8e-3, 0.45, 0.3e6
CONTACT = Contact(polar_rad=np.radians(35.0))
NORMAL, SHEAR = 1.4e6, 0.04e6
UNLOADED = {"youngs_modulus_pa": E, "iop_pa": 0.0, "density_kg_m3": 0.0, "max_force_n": np.inf}


@cache
def globe(core: int = 4, rings: int = 6) -> HexMesh:
    return graded_mesh(R, T, CONTACT, core=core, rings=rings, whole=True)


def moved(mesh: HexMesh, motion) -> np.ndarray:
    return np.broadcast_to(motion, mesh.points_nc.shape)


def energy(springs: Springs, displacement_nc: np.ndarray) -> float:
    return float(np.sum(springs.forces(displacement_nc) * displacement_nc))


def test_the_beds_stiffness_is_that_of_the_integrals_over_the_half_sphere() -> None:
    """Along z: integral of k cos^2 + s sin^2; along x: of k sin^2 cos^2(azimuth) + ...; both over 2 pi R^2."""
    mesh, area = globe(rings=10), 2 * np.pi * R**2
    bed = elastic_bed(mesh, NORMAL, SHEAR)
    for axis in np.eye(3):  # over the half-sphere the mean of each squared component of the normal is 1/3
        assert energy(bed, moved(mesh, axis)) == pytest.approx(area * (NORMAL + 2 * SHEAR) / 3, rel=2e-3)
        turn_nc = np.cross(axis, mesh.points_nc)  # a turn slides everywhere: 2/3 R^2 of its square
        assert energy(bed, turn_nc) == pytest.approx(area * SHEAR * R**2 * 2 / 3, rel=2e-3)


def test_the_upper_half_lies_on_no_bed() -> None:
    mesh = globe()
    forces = elastic_bed(mesh, NORMAL, SHEAR).forces(moved(mesh, np.array([0.0, 0.0, 1.0])))
    above = mesh.points_nc[:, 2] > 1e-9
    assert np.all(forces[above] == 0.0)
    assert np.all(forces[np.setdiff1d(np.arange(len(forces)), np.unique(mesh.outer_qn))] == 0.0)


def test_a_half_sphere_has_no_bed() -> None:
    with pytest.raises(InputError, match="lower half"):
        elastic_bed(build_mesh(R, T, divisions=4), NORMAL, SHEAR)


def test_four_straps_hold_along_their_meridians() -> None:
    """Naive sum over many points of each insertion's arc."""
    mesh = globe(rings=12)
    straps, expected = rectus_straps(mesh, 20.0, 0.3), 0.0
    motion = np.array([0.3, -0.5, 0.8])
    for polar, azimuth, width in INSERTIONS.values():
        azimuths = 0.3 + azimuth + np.linspace(-0.5, 0.5, 2001) * width / np.sin(polar)
        along_pc = np.array([Contact(polar_rad=polar, azimuth_rad=azimuth).meridian for azimuth in azimuths])
        expected += 20.0 * np.mean((along_pc @ motion) ** 2)
    assert energy(straps, moved(mesh, motion)) == pytest.approx(expected, rel=1e-3)
    assert energy(straps, np.cross([0.0, 0.0, 1.0], mesh.points_nc)) < 1e-6 * R**2  # a turn about z slides across


def test_insertions_lie_on_the_spiral_of_tillaux() -> None:
    behind_mm = {name: 12.0 * polar - 12.0 * np.arcsin(5.75 / 12) for name, (polar, _, _) in INSERTIONS.items()}
    assert behind_mm == pytest.approx({"medial": 5.5, "inferior": 6.5, "lateral": 6.9, "superior": 7.7})
    assert [name for name, _ in sorted(INSERTIONS.items(), key=lambda item: item[1][1])] == [
        "medial", "superior", "lateral", "inferior",
    ]  # fmt: skip


def test_the_blocks_in_the_matrix_are_the_forces() -> None:
    mesh = globe()
    springs = elastic_bed(mesh, NORMAL, SHEAR) + rectus_straps(mesh, 20.0)
    nodes = mesh.cells_en.shape[1]
    elements = np.zeros((len(mesh.cells_en), 3, nodes, 3, nodes))
    springs.add_to(elements, FacePlaces(mesh.cells_en, springs.nodes_qn), 0.5)
    u = np.random.default_rng(0).normal(size=mesh.points_nc.shape)
    K = stiffness_matrix(mesh, elements)
    np.testing.assert_allclose(2 * K @ u.ravel(), springs.forces(u).ravel(), atol=1e-12 * abs(K).max())
    assert abs(K - K.T).max() < 1e-14 * abs(K).max()


def test_a_globe_on_a_bed_balances_the_needle_with_the_beds_force() -> None:
    mesh = globe()
    bed = elastic_bed(mesh, NORMAL, SHEAR)
    wall = LinearWall(mesh, NU, springs=bed, springs_modulus_pa=E)
    load_nc = needle_loads(mesh, [CONTACT], 0.35e-3)[0]
    bed_nc = bed.forces(wall.solve_one(load_nc) / E)
    np.testing.assert_allclose(bed_nc.sum(axis=0), load_nc.sum(axis=0), atol=1e-8)
    np.testing.assert_allclose(np.cross(mesh.points_nc, bed_nc - load_nc).sum(axis=0), 0.0, atol=1e-8 * R)


def test_a_very_stiff_bed_clamps_and_a_wall_of_one_modulus_is_that_of_another_with_scaled_springs() -> None:
    mesh = globe(core=2, rings=4)
    bed = elastic_bed(mesh, NORMAL, SHEAR)
    load_nc = needle_loads(mesh, [CONTACT], 0.35e-3)[0]
    doubled = replace(bed, blocks_qnnii=2 * bed.blocks_qnnii)
    one = LinearWall(mesh, NU, springs=bed, springs_modulus_pa=E).solve_one(load_nc)
    other = LinearWall(mesh, NU, springs=doubled, springs_modulus_pa=2 * E).solve_one(load_nc)
    np.testing.assert_allclose(one, other, atol=1e-9 * np.abs(one).max())
    hard = replace(bed, blocks_qnnii=1e6 * bed.blocks_qnnii)
    held = LinearWall(mesh, NU, springs=hard, springs_modulus_pa=E).solve_one(load_nc)
    lower = mesh.points_nc[:, 2] < -0.2 * R
    assert np.abs(held[lower]).max() < 1e-3 * np.abs(held).max() < 1e-2 * np.abs(one[lower]).max()


@pytest.mark.parametrize("kind", ["bed", "bed and straps"])
def test_small_forces_at_finite_strain_are_linear_with_springs_too(kind: str) -> None:
    mesh = globe(core=2, rings=4)
    springs = elastic_bed(mesh, NORMAL, SHEAR)
    if kind == "bed and straps":
        springs = springs + rectus_straps(mesh, 20.0)
    path = FiniteWall(mesh, NU, springs=springs).load_path(
        needle_at(mesh, CONTACT, 0.35e-3), **UNLOADED, max_tip_m=2e-7, largest_step_m=1e-7
    )
    force_n = 0.9 * path.max_force_n
    linear = LinearWall(mesh, NU, springs=springs, springs_modulus_pa=E)
    linear_nc = linear.solve_one(needle_loads(mesh, [CONTACT], 0.35e-3)[0]) * force_n / E
    np.testing.assert_allclose(path.displacement_nc(force_n), linear_nc, atol=1e-3 * np.abs(linear_nc).max())


@pytest.mark.slow
def test_the_pressure_of_a_sealed_globe_on_a_bed_follows_the_law() -> None:
    mesh = globe(core=2, rings=4)
    wall = FiniteWall(mesh, NU, springs=elastic_bed(mesh, NORMAL, SHEAR))
    loads = {"youngs_modulus_pa": E, "density_kg_m3": 1100.0}
    law = sealed_globe(0.15e9)
    needle = needle_at(mesh, CONTACT, 1e-3)
    path = wall.load_path(needle, **loads, iop_pa=266.0, max_force_n=1.0, max_tip_m=0.6e-3, globe=law)
    undented_nc = rest_nc(wall, **loads, iop_pa=float(path.pressures_pa[-1]))
    displaced_m3 = wall.inner.volume(undented_nc) - wall.inner.volume(path.displacement_snc[-1])
    assert path.pressures_pa[-1] > 300.0
    assert path.pressures_pa[-1] == pytest.approx(law.pressure(266.0, displaced_m3), rel=1e-6)


def test_a_studys_springs_follow_its_kind() -> None:
    mesh, u = globe(), np.random.default_rng(1).normal(size=globe().points_nc.shape)
    bed, straps = elastic_bed(mesh, 2e6, 0.1e6).forces(u), rectus_straps(mesh, 30.0, 0.5).forces(u)
    expected = {"bed": bed, "straps": straps, "bed-and-straps": bed + straps}
    study = SupportsStudy(
        bed_stiffness_pa_per_m=2e6, bed_shear_stiffness_pa_per_m=0.1e6, strap_stiffness_n_per_m=30.0,
        medial_azimuth_rad=0.5,
    )  # fmt: skip
    for kind, forces_nc in expected.items():
        springs = study_springs(replace(study, kind=kind), mesh)
        assert springs is not None
        np.testing.assert_allclose(springs.forces(u), forces_nc, atol=1e-12 * np.abs(forces_nc).max())
    assert study_springs(SupportsStudy(), mesh) is None
