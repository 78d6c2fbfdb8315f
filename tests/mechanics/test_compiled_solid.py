"""Compiled loops of a solid of revolution against the arrays that say the same."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from machine_code import compiled_again
from numpy.typing import NDArray

from scleraforce import compiled
from scleraforce.mechanics.axisymmetric import compiled_solid
from scleraforce.mechanics.axisymmetric.mesh import MeridianMesh, MeridianSize, meridian_mesh
from scleraforce.mechanics.axisymmetric.path import axisymmetric_path
from scleraforce.mechanics.axisymmetric.solid import SolidOfRevolution
from scleraforce.mechanics.stiffening import LARGEST_EXPONENT

Floats = NDArray[np.float64]

NU = 0.45
STIFFENINGS = (0.0, 12.0)


@pytest.fixture(scope="module", autouse=True)
def machine_code() -> Iterator[None]:
    with compiled_again(compiled_solid):
        yield


@pytest.fixture(scope="module")
def mesh() -> MeridianMesh:
    return meridian_mesh(12e-3, 0.6e-3, 0.35e-3, 0.5 * np.pi, MeridianSize(16, 2))


@contextmanager
def loops() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled, "_in_use", True)
        yield


def by_both(solid: SolidOfRevolution, u: Floats) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Forces and tangents, by arrays and by loops."""
    by_arrays = solid.forces(u), solid.tangents(u)
    with loops():
        return by_arrays, (solid.forces(u), solid.tangents(u))


@pytest.mark.parametrize("stiffening", STIFFENINGS)
def test_forces_and_tangents_are_those_of_the_arrays(mesh: MeridianMesh, stiffening: float) -> None:
    solid = SolidOfRevolution(mesh, NU, stiffening)
    rng = np.random.default_rng(3)
    for size in (0.0, 1e-7, 2e-5):  # strains up to a half or so
        by_arrays, by_loops = by_both(solid, size * rng.normal(size=mesh.points_nc.size))
        for expected, found in zip(by_arrays, by_loops, strict=True):
            assert np.isfinite(expected).all()
            # Forces of no strain are what rounding leaves of stresses of 1 Pa on the elements' faces.
            np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12 * max(np.abs(expected).max(), 1e-6))


def test_a_wall_that_is_turned_inside_out_is_not_finite_in_the_same_places(mesh: MeridianMesh) -> None:
    solid = SolidOfRevolution(mesh, NU)
    u = np.zeros((len(mesh.points_nc), 2))
    u[mesh.outer_n[4], 1] = -2e-3  # through the inner boundary
    by_arrays, by_loops = by_both(solid, u.ravel())
    for expected, found in zip(by_arrays, by_loops, strict=True):
        assert 0 < np.isnan(expected).sum() < expected.size
        np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))


def test_tissue_that_is_stretched_too_far_is_not_finite(mesh: MeridianMesh) -> None:
    stretched = 0.5 * mesh.points_nc.ravel()  # by a half in every direction: Q is 1 and more
    solid = SolidOfRevolution(mesh, NU, LARGEST_EXPONENT)
    by_arrays, by_loops = by_both(solid, stretched)
    assert compiled_solid.MOST_EXPONENT == LARGEST_EXPONENT
    assert all(np.isnan(values).all() for values in (*by_arrays, *by_loops))


@pytest.mark.parametrize("stiffening", STIFFENINGS)
def test_a_path_is_that_of_the_arrays(stiffening: float) -> None:
    eye = (12e-3, 0.6e-3, NU, 0.35e-3, 9e-4)
    tips_m = np.array([0.4e-3, 1.2e-3, 2.5e-3])
    size = MeridianSize(24)
    by_arrays = axisymmetric_path(*eye, tips_m=tips_m, stiffening=stiffening, size=size)
    with loops():
        by_loops = axisymmetric_path(*eye, tips_m=tips_m, stiffening=stiffening, size=size)
    np.testing.assert_allclose(by_loops.force_ratio_m2, by_arrays.force_ratio_m2, rtol=1e-8, atol=1e-16)
    np.testing.assert_allclose(by_loops.curves_sbnc, by_arrays.curves_sbnc, rtol=0.0, atol=1e-11)
