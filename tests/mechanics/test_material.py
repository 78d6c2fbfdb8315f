"""The solid of 3-D walls: its energy, its fibres, and its equilibrium's tangent."""

from dataclasses import replace

import numpy as np
import pytest
from energy import MU, NU, STEP, energy
from numpy.typing import NDArray

from scleraforce.base.errors import SolverError
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_elements import volume_points
from scleraforce.mechanics.finite_strain_wall import (
    FiniteWall,
    TissueLaw,
    WallEquilibrium,
)
from scleraforce.mechanics.graded_mesh import supported_mesh
from scleraforce.mechanics.hexahedral_mesh import HexMesh, build_mesh
from scleraforce.mechanics.loads_and_supports import NeedleLoad, study_springs
from scleraforce.mechanics.neo_hookean_solid import FibreLaw, NeoHookeanSolid, fibre_law
from scleraforce.mechanics.tissue_material import lame_constants
from scleraforce.records.study import MeshStudy, Study, SupportsStudy

R = 12e-3
T = 1e-3
MIXED = fibre_law(NU, 6.0, 2.0)


def distorted(order: int) -> HexMesh:
    """A coarse mesh whose nodes are moved at random, so that no symmetry hides an
    error.
    """
    mesh = build_mesh(R, T, divisions=4, level=0, order=order)
    moves = np.random.default_rng(0).uniform(-0.05, 0.05, mesh.points_nc.shape) * T
    return replace(mesh, points_nc=mesh.points_nc + moves)


def large_displacement(mesh: HexMesh) -> np.ndarray:
    """A smooth field with strains of some 20 % and rotations, and noise on every
    node.
    """
    random = np.random.default_rng(1)
    linear = random.normal(size=(3, 3)) * 0.15
    quadratic = random.normal(size=(3, 3, 3)) * 0.08 / R
    x = mesh.points_nc

    return (
        x @ linear
        + np.einsum("ijk,nj,nk->ni", quadratic, x, x)
        + random.normal(size=x.shape) * 0.01 * T
    )


def fibre_energy(F: NDArray, mesh: HexMesh, law: FibreLaw) -> NDArray:
    """W of matrices (element, point, 3, 3), real or complex: the definition, around the
    eye's axis and along the meridian.
    """
    places = np.einsum(
        "pn,enc->epc", volume_points(mesh).values_pn, mesh.points_nc[mesh.cells_en]
    )
    around = np.cross([0.0, 0.0, 1.0], places)
    directions = np.stack([around, np.cross(places, around)], axis=2)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    moved = np.einsum("epij,epkj->epki", F, directions)
    double = np.einsum("epki,epli->epkl", moved, moved)
    e = np.stack(
        [(double[..., 0, 0] - 1) / 2, (double[..., 1, 1] - 1) / 2, double[..., 0, 1]],
        axis=-1,
    )

    return law.base * energy(F, 1e-12) + 0.5 * np.einsum(
        "epv,vw,epw->ep", e, law.plane, e
    )


@pytest.mark.parametrize(
    ("order", "stiffening", "fibres", "rtol"),
    [
        (1, 0.0, None, 1e-11),
        (2, 0.0, None, 1e-11),
        (2, 12.0, None, 1e-11),
        (2, 0.0, MIXED, 3e-3),  # the directions of curved elements
    ],
    ids=["8 nodes", "27 nodes", "stiffening", "fibres"],
)
def test_forces_and_tangents_are_the_derivatives_of_the_energy_at_any_deformation(
    order: int, stiffening: float, fibres: FibreLaw | None, rtol: float
):
    mesh = build_mesh(R, T, 4, 0) if fibres else distorted(order)
    points = volume_points(mesh)
    random = np.random.default_rng(2)
    factor_ep = random.uniform(0.6, 1.4, points.volumes_ep.shape)
    u_nc = large_displacement(mesh)
    moved_nc = random.normal(size=mesh.points_nc.shape)
    solid = NeoHookeanSolid(mesh, NU, factor_ep, stiffening=stiffening, fibres=fibres)

    def gradient(field_nc: NDArray) -> NDArray:
        return np.einsum(
            "eni,epnj->epij", field_nc[mesh.cells_en], points.gradients_epnc
        )

    F = np.eye(3) + gradient(u_nc) + 1j * STEP * gradient(moved_nc)
    density = (
        fibre_energy(F, mesh, fibres) if fibres else energy(F, stiffening or 1e-12)
    )
    work = np.sum(factor_ep * points.volumes_ep * density.imag) / STEP
    assert np.sum(solid.forces(u_nc) * moved_nc) == pytest.approx(work, rel=rtol)

    step_nc = 1e-9 * moved_nc
    change_nc = (solid.forces(u_nc + step_nc) - solid.forces(u_nc - step_nc)) / 2e-9
    tangents = solid.tangents(u_nc)
    np.testing.assert_allclose(
        tangents, tangents.transpose(0, 3, 4, 1, 2), atol=1e-13 * abs(tangents).max()
    )
    slope_eni = np.einsum("einjm,emj->eni", tangents, moved_nc[mesh.cells_en])
    slope_nc = np.zeros_like(change_nc)
    np.add.at(slope_nc, mesh.cells_en, slope_eni)
    np.testing.assert_allclose(slope_nc, change_nc, atol=1e-6 * abs(change_nc).max())


def test_a_wall_turned_inside_out_has_no_forces_and_no_tangent():
    mesh = distorted(2)
    solid = NeoHookeanSolid(mesh, NU)
    assert np.all(np.isnan(solid.forces(-1.5 * mesh.points_nc)))

    with pytest.raises(SolverError, match="inside out"):
        solid.tangents(-1.5 * mesh.points_nc)


def globe(supports: SupportsStudy) -> HexMesh:
    study = Study(
        mesh=MeshStudy(kind="graded", core=2, rings=4),
        supports=replace(supports, kind="bed"),
    )
    return supported_mesh(study, T, Contact(polar_rad=0.6))


@pytest.mark.parametrize("kind", ["clamped", "straps"])
def test_a_globe_that_may_move_as_a_rigid_body_is_refused(kind: str):
    """On nothing, or on straps alone, it may turn about its axis."""
    supports = SupportsStudy(kind=kind)
    mesh = globe(supports)
    with pytest.raises(SolverError, match="rigid body"):
        FiniteWall(mesh, NU, springs=study_springs(supports, mesh))


@pytest.mark.parametrize("size", [1e-60, 1.0, 1e60])
def test_the_tangent_in_single_precision_is_the_derivative_of_the_balance(
    size: float,
):
    """Of wall, following pressure, bed and straps, for loads of any size."""
    supports = SupportsStudy(kind="bed-and-straps", bed_stiffness_pa_per_m=1e9)
    mesh = globe(supports)
    wall = FiniteWall(
        mesh,
        NU,
        springs=study_springs(supports, mesh),
        tissue=TissueLaw(2.0, MIXED),
    )
    nothing = np.zeros_like(mesh.points_nc)
    balance = WallEquilibrium(wall, NeedleLoad(nothing, nothing), 0.3e6, 1100.0)
    u = 0.3 * large_displacement(mesh).ravel()
    step = 1e-9 * np.random.default_rng(3).normal(size=u.shape)
    pressure = 0.1
    change = balance.residual(u + step, pressure) - balance.residual(u - step, pressure)
    found = balance.factor(u, pressure)(size * change) / size
    assert np.linalg.norm(found - 2.0 * step) < 5e-3 * np.linalg.norm(2.0 * step)


@pytest.mark.parametrize(
    ("softer", "around", "through"),
    [
        (1.0, 1.0, 1.0),
        (4.0, 1.0, 1 / 1.79),
        (25.0, 1.0, 1 / 7.33),
        (1.0, 3.0, None),
        (10.0, 3.0, None),
    ],
)
def test_fibres_give_the_moduli_that_a_study_states(
    softer: float, around: float, through: float | None
):
    """Compliance of small strains: 1 around the axis, 2 along the meridian, 3
    through.
    """
    law = fibre_law(NU, softer, around)
    lame_lambda, mu = lame_constants(law.base, NU)
    C = np.diag([2.0 * mu] * 3 + [mu] * 3)
    C[:3, :3] += lame_lambda
    C[np.ix_([0, 1, 5], [0, 1, 5])] += law.plane
    S = np.linalg.inv(C)
    np.testing.assert_allclose(
        [S[1, 1] / S[0, 0], S[0, 0] * S[1, 1]], [around, 1.0], rtol=1e-12
    )

    if through is not None:
        assert -S[0, 1] / S[0, 0] == pytest.approx(NU, rel=1e-12)
        assert 1.0 / S[2, 2] == pytest.approx(through, rel=3e-3)
        assert mu == pytest.approx(MU / softer, rel=1e-12)
