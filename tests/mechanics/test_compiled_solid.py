"""The loops of a solid of revolution against an oracle by arrays."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from solid_arrays import forces_and_tangents

from scleraforce.mechanics.material import LARGEST_EXPONENT, strain_measure
from scleraforce.mechanics.meridian import MOST_EXPONENT, MeridianMesh, MeridianSize, SolidOfRevolution, meridian_mesh

Floats = NDArray[np.float64]

NU = 0.45
STIFFENINGS = (0.0, 12.0)


@pytest.fixture(scope="module")
def mesh() -> MeridianMesh:
    return meridian_mesh(12e-3, 0.6e-3, 0.35e-3, 0.5 * np.pi, MeridianSize(16, 2))


def by_both(mesh: MeridianMesh, solid: SolidOfRevolution, u: Floats) -> tuple[tuple[Floats, ...], tuple[Floats, ...]]:
    """Forces and tangents, by arrays and by loops."""
    return forces_and_tangents(mesh, solid, u), (solid.forces(u), solid.tangents(u))


@pytest.mark.parametrize("stiffening", STIFFENINGS)
def test_forces_and_tangents_are_those_of_the_arrays(mesh: MeridianMesh, stiffening: float) -> None:
    solid = SolidOfRevolution(mesh, NU, stiffening)
    rng = np.random.default_rng(3)
    for size in (0.0, 1e-7, 2e-5):  # strains up to a half or so
        by_arrays, by_loops = by_both(mesh, solid, size * rng.normal(size=mesh.points_nc.size))
        for expected, found in zip(by_arrays, by_loops, strict=True):
            assert np.isfinite(expected).all()
            # Entries that nearly cancel are compared on the scale of the largest.
            np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12 * max(np.abs(expected).max(), 1e-6))


def turned_over(mesh: MeridianMesh) -> Floats:
    """A node pushed through the inner boundary."""
    u_nc = np.zeros((len(mesh.points_nc), 2))
    u_nc[mesh.outer_n[4], 1] = -2e-3
    return u_nc.ravel()


def across_the_axis(mesh: MeridianMesh) -> Floats:
    """All moved sideways: on its meridian the wall is as it was, and near the axis it is on the other side."""
    return np.tile([-1e-3, 0.0], len(mesh.points_nc))


def mirrored(mesh: MeridianMesh) -> Floats:
    """Its middle mirrored in the axis: two signs change there, and the product of the stretches is as it was."""
    away_n = mesh.points_nc[:, 0]
    return np.stack([np.where(away_n < 3e-3, -2.0 * away_n, 0.0), np.zeros_like(away_n)], axis=1).ravel()


@pytest.mark.parametrize("displaced", [turned_over, across_the_axis, mirrored])
def test_a_wall_that_is_turned_inside_out_is_not_finite_in_the_same_places(
    mesh: MeridianMesh, displaced: Callable[[MeridianMesh], Floats]
) -> None:
    by_arrays, by_loops = by_both(mesh, SolidOfRevolution(mesh, NU), displaced(mesh))
    for expected, found in zip(by_arrays, by_loops, strict=True):
        assert 0 < np.isnan(expected).sum() < expected.size
        np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))


@pytest.mark.parametrize("share", [1.01, 20.0])  # of the largest exponent: exp of the first is still a number
def test_tissue_that_is_stretched_too_far_is_not_finite(mesh: MeridianMesh, share: float) -> None:
    stretched, log_ratio = 0.5 * mesh.points_nc.ravel(), 3.0 * np.log(1.5)  # by a half in every direction
    strain = strain_measure(np.array(3.0 * 1.5**2 - 3.0), np.array(log_ratio), NU)
    assert MOST_EXPONENT == LARGEST_EXPONENT
    by_arrays, by_loops = by_both(
        mesh, SolidOfRevolution(mesh, NU, share * LARGEST_EXPONENT / float(strain)), stretched
    )
    assert all(np.isnan(values).all() for values in (*by_arrays, *by_loops))
    stiff = SolidOfRevolution(mesh, NU, 0.99 * LARGEST_EXPONENT / float(strain))
    by_arrays, by_loops = by_both(mesh, stiff, stretched)
    assert all(np.isfinite(values).all() for values in (*by_arrays, *by_loops))
