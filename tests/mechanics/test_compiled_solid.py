"""Compiled loops of a solid of revolution against the arrays that say the same."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from machine_code import by_arrays_and_loops, compiled_again, loops_in_use
from numpy.typing import NDArray

from scleraforce.mechanics.axisymmetric import compiled_solid
from scleraforce.mechanics.axisymmetric.mesh import MeridianMesh, MeridianSize, meridian_mesh
from scleraforce.mechanics.axisymmetric.path import axisymmetric_path
from scleraforce.mechanics.axisymmetric.solid import SolidOfRevolution
from scleraforce.mechanics.stiffening import LARGEST_EXPONENT, strain_measure

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


def by_both(solid: SolidOfRevolution, u: Floats) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Forces and tangents, by arrays and by loops."""
    return by_arrays_and_loops(lambda: (solid.forces(u), solid.tangents(u)))


@pytest.mark.parametrize("stiffening", STIFFENINGS)
def test_forces_and_tangents_are_those_of_the_arrays(mesh: MeridianMesh, stiffening: float) -> None:
    solid = SolidOfRevolution(mesh, NU, stiffening)
    rng = np.random.default_rng(3)
    for size in (0.0, 1e-7, 2e-5):  # strains up to a half or so
        by_arrays, by_loops = by_both(solid, size * rng.normal(size=mesh.points_nc.size))
        for expected, found in zip(by_arrays, by_loops, strict=True):
            assert np.isfinite(expected).all()
            # Entries that nearly cancel are compared on the scale of the largest.
            np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12 * max(np.abs(expected).max(), 1e-6))


def test_the_loops_are_what_answers_where_they_are_in_use(mesh: MeridianMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    solid, u = SolidOfRevolution(mesh, NU), np.zeros(mesh.points_nc.size)
    for name in ("nodal_forces", "element_tangents"):
        monkeypatch.setattr(compiled_solid, name, lambda _tables, _u, found: found.fill(7.0))
    with loops_in_use():
        assert (solid.forces(u) == 7.0).all()
        assert (solid.tangents(u) == 7.0).all()
    with loops_in_use(False):
        assert not (solid.forces(u) == 7.0).any()
        assert not (solid.tangents(u) == 7.0).any()


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
    by_arrays, by_loops = by_both(SolidOfRevolution(mesh, NU), displaced(mesh))
    for expected, found in zip(by_arrays, by_loops, strict=True):
        assert 0 < np.isnan(expected).sum() < expected.size
        np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))


@pytest.mark.parametrize("share", [1.01, 20.0])  # of the largest exponent: exp of the first is still a number
def test_tissue_that_is_stretched_too_far_is_not_finite(mesh: MeridianMesh, share: float) -> None:
    stretched, log_ratio = 0.5 * mesh.points_nc.ravel(), 3.0 * np.log(1.5)  # by a half in every direction
    strain = strain_measure(np.array(3.0 * 1.5**2 - 3.0), np.array(log_ratio), NU)
    assert compiled_solid.MOST_EXPONENT == LARGEST_EXPONENT
    by_arrays, by_loops = by_both(SolidOfRevolution(mesh, NU, share * LARGEST_EXPONENT / float(strain)), stretched)
    assert all(np.isnan(values).all() for values in (*by_arrays, *by_loops))
    by_arrays, by_loops = by_both(SolidOfRevolution(mesh, NU, 0.99 * LARGEST_EXPONENT / float(strain)), stretched)
    assert all(np.isfinite(values).all() for values in (*by_arrays, *by_loops))


@pytest.mark.parametrize("stiffening", STIFFENINGS)
def test_a_path_is_that_of_the_arrays(stiffening: float) -> None:
    eye = (12e-3, 0.6e-3, NU, 0.35e-3, 9e-4)
    tips_m = np.array([0.4e-3, 1.2e-3, 2.5e-3])
    size = MeridianSize(24)
    by_arrays, by_loops = by_arrays_and_loops(
        lambda: axisymmetric_path(*eye, tips_m=tips_m, stiffening=stiffening, size=size)
    )
    np.testing.assert_allclose(by_loops.force_ratio_m2, by_arrays.force_ratio_m2, rtol=1e-8, atol=1e-16)
    np.testing.assert_allclose(by_loops.curves_sbnc, by_arrays.curves_sbnc, rtol=0.0, atol=1e-11)
