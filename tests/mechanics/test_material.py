"""Tissue that stiffens: closed forms, and eyes in three dimensions and of revolution."""

import numpy as np
import pytest
from energy import LAMBDA, MU, NU, stress
from scipy.optimize import brentq

from reference_walls import stiffness_matrix
from scleraforce.arrays import Floats
from scleraforce.errors import SolverError
from scleraforce.mechanics.axisymmetric import AxisymmetricWall, axisymmetric_path
from scleraforce.mechanics.contact import Contact
from scleraforce.mechanics.continuation import pressurise, trace
from scleraforce.mechanics.equilibrium import Solve
from scleraforce.mechanics.finite_strain import FiniteWall
from scleraforce.mechanics.globe import OPEN_GLOBE, Globe, sealed_globe
from scleraforce.mechanics.graded import graded_mesh
from scleraforce.mechanics.loads import needle_at
from scleraforce.mechanics.material import burst_tension, growth
from scleraforce.mechanics.meridian import MeridianSize, meridian_mesh
from scleraforce.mechanics.mesh import HexMesh
from scleraforce.mechanics.neo_hookean import NeoHookeanSolid

RADIUS, NEEDLE = 12e-3, 0.35e-3
RIGHT_ANGLE = 0.5 * np.pi


class Block:
    """A unit cube of one element between three planes of symmetry, drawn by a nominal stress on other faces."""

    def __init__(self, stiffening: float, drawn: tuple[int, ...]) -> None:
        self.points_nc = np.array(
            [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], dtype=np.float64
        )
        quads = np.array([[4, 5, 6, 7]])
        self.mesh = HexMesh(
            points_nc=self.points_nc, cells_en=np.arange(8)[None], outer_qn=quads, inner_qn=quads,
            base_nodes=np.array([], dtype=np.int64), radius_m=1.0, thickness_m=1.0, order=1,
        )  # fmt: skip
        self.solid = NeoHookeanSolid(self.mesh, NU, stiffening=stiffening)
        self.free = np.flatnonzero(self.points_nc.ravel() > 0.0)
        load_nc = np.zeros((8, 3))
        for axis in drawn:
            load_nc[self.points_nc[:, axis] > 0.0, axis] = 0.25
        self.needle = self.tip = load_nc.ravel()[self.free]

    def all(self, u: Floats) -> Floats:
        full = np.zeros(24)
        full[self.free] = u
        return full.reshape(8, 3)

    def residual(self, u: Floats, pressure: float) -> Floats:
        return self.solid.forces(self.all(u)).ravel()[self.free] - pressure * self.needle

    def factor(self, u: Floats, pressure: float) -> Solve:  # noqa: ARG002 (a dead load)
        whole = stiffness_matrix(self.mesh, self.solid.tangents(self.all(u))).toarray()
        K = whole[np.ix_(self.free, self.free)]
        return lambda rhs: np.linalg.solve(K, rhs)

    def stretches(self, nominal_stress: float) -> Floats:
        """Stretches of the edges under a stress over E; every face stays plane."""
        places_nc = self.points_nc + self.all(pressurise(self, nominal_stress))
        for axis in range(3):
            np.testing.assert_allclose(np.ptp(places_nc[self.points_nc[:, axis] > 0.0, axis]), 0.0, atol=1e-9)
        return places_nc[6]


def nominal(stretches: Floats, b: float) -> Floats:
    """Principal nominal stresses over E."""
    return np.diag(stress(np.diag(stretches), b))


@pytest.mark.parametrize("b", [0.0, 3.0, 30.0, 200.0])
def test_one_element_drawn_along_two_axes_takes_the_stretch_of_the_closed_form(b: float) -> None:
    along, second, across = Block(b, drawn=(0, 1)).stretches(0.25)
    assert along == pytest.approx(second, rel=1e-9)
    free = brentq(lambda s: MU * (s * s - 1.0) + LAMBDA * np.log(along**2 * s), 0.3, 1.0, xtol=1e-15)
    assert across == pytest.approx(free, rel=1e-7)
    np.testing.assert_allclose(nominal(np.array([along, along, free]), b), [0.25, 0.25, 0.0], atol=1e-7)


def test_the_tangent_modulus_is_what_the_study_and_the_physics_say() -> None:
    for b, said in {0.0: 0.92, 1.0: 0.93, 10.0: 1.12, 30.0: 1.62}.items():

        def drawn(strain: float, b: float = b) -> float:
            free = brentq(lambda s: MU * (s * s - 1.0) + LAMBDA * np.log((1.0 + strain) * s * s), 0.3, 1.0, xtol=1e-15)
            return float(nominal(np.array([1.0 + strain, free, free]), b)[0])

        assert (drawn(0.05 + 1e-5) - drawn(0.05 - 1e-5)) / 2e-5 == pytest.approx(said, abs=0.006)


def thin_sphere(b: float, thickness_m: float = 60e-6) -> tuple[AxisymmetricWall, float]:
    """A half-sphere on a plane of symmetry, and p/E for a tension p R/(E t) of 1 of its middle surface."""
    mesh = meridian_mesh(RADIUS, thickness_m, NEEDLE, RIGHT_ANGLE, MeridianSize(24))
    per_tension = thickness_m / (RADIUS - 0.5 * thickness_m)
    return AxisymmetricWall(mesh, NU, symmetric=True, stiffening=b), per_tension


def balloon_tension(stretch: float, b: float) -> float:
    """p R/(E t) of a thin sphere by its stretch: 2 P_along/L^2 with P_across = 0; R and t are of the undeformed one."""
    across = brentq(lambda s: MU * (s * s - 1.0) + LAMBDA * np.log(stretch**2 * s), 0.1, 1.0, xtol=1e-15)
    return float(2.0 * nominal(np.array([stretch, stretch, across]), b)[0] / stretch**2)


@pytest.mark.parametrize(
    ("b", "tension"), [(0.0, 0.4), (1.0, 0.3), (1.0, 1.5), (10.0, 1.0), (30.0, 0.2), (30.0, 1.0), (200.0, 3.0)]
)
def test_a_balloon_has_the_radius_of_its_closed_form_also_beyond_the_neo_hookean_burst(
    b: float, tension: float
) -> None:
    wall, per_tension = thin_sphere(b)
    u = pressurise(wall, tension * per_tension)
    path = trace(wall, u, tension * per_tension, tips_m=np.array([1e-6]))
    places = wall.boundaries(path).curves_sbnc[0].mean(axis=0)  # of the middle surface
    middle_m = RADIUS - 30e-6
    radii = np.hypot(places[:, 0], RADIUS - places[:, 1])
    np.testing.assert_allclose([balloon_tension(radius_m / middle_m, b) for radius_m in radii], tension, rtol=2e-3)


def test_a_step_that_overflows_the_exponential_is_too_long_and_a_shorter_one_is_taken() -> None:
    """Silently: pytest makes an error of a warning."""
    wall, per_tension = thin_sphere(200.0)
    pressure = 3.0 * per_tension
    none = np.zeros_like(wall.needle)
    too_far = -wall.factor(none, 0.0)(wall.residual(none, pressure))  # Newton's first step
    assert not np.all(np.isfinite(wall.residual(too_far, pressure)))
    assert np.all(np.isfinite(pressurise(wall, pressure)))
    np.testing.assert_array_equal(np.isnan(growth(1.0, np.array([0.0, 299.0, 1e4, np.inf, np.nan]))), [0, 0, 1, 1, 1])


# A soft eye at living pressure: 0.1 MPa, 0.5 mm, 18 mmHg.
SOFT = (RADIUS, 0.5e-3, NU, NEEDLE, 2400.0 / 0.1e6)


def test_a_soft_eye_that_bursts_at_living_pressure_holds_where_it_stiffens() -> None:
    tension = SOFT[4] * RADIUS / SOFT[1]
    assert burst_tension(NU) < tension < burst_tension(NU, 5.0)
    with pytest.raises(SolverError, match=r"pressure: equilibrium found up to .*; use a thicker or stiffer wall"):
        axisymmetric_path(*SOFT, max_tip_m=1e-3)
    path = axisymmetric_path(*SOFT, tips_m=np.array([0.5e-3, 1e-3]), stiffening=5.0)
    assert 0.0 < path.force_ratio_m2[1] < path.force_ratio_m2[2]


@pytest.mark.slow
@pytest.mark.parametrize("globe", [OPEN_GLOBE, sealed_globe(0.15e9)], ids=["open", "sealed"])
def test_an_eye_that_stiffens_is_the_same_in_three_dimensions_and_of_revolution(globe: Globe) -> None:
    b, modulus_pa, iop_pa, thickness_m = 20.0, 0.4e6, 266.0, 0.6e-3
    contact = Contact(polar_rad=0.0)
    mesh = graded_mesh(RADIUS, thickness_m, contact, core=4, rings=10)
    solid = FiniteWall(mesh, NU, stiffening=b).load_path(
        needle_at(mesh, contact, NEEDLE), youngs_modulus_pa=modulus_pa, iop_pa=iop_pa, density_kg_m3=0.0,
        max_force_n=1.0, max_tip_m=1.2e-3, globe=globe,
    )  # fmt: skip
    tips_m = np.array([0.4e-3, 0.8e-3, 1.2e-3])
    sizes = (RADIUS, thickness_m, NU, NEEDLE, iop_pa / modulus_pa)
    flat, plain = (
        axisymmetric_path(*sizes, tips_m=tips_m, globe=globe.over(modulus_pa), stiffening=each) for each in (b, 0.0)
    )
    forces_n = np.interp(tips_m, solid.tips_m, solid.forces_n)
    np.testing.assert_allclose(forces_n, modulus_pa * flat.force_ratio_m2[1:], rtol=0.02)
    assert np.all(flat.force_ratio_m2[2:] > 1.15 * plain.force_ratio_m2[2:])


def test_a_thin_sphere_holds_a_little_less_than_its_burst_and_no_more() -> None:
    wall, per_tension = thin_sphere(0.0)
    pressurise(wall, 0.98 * burst_tension(NU) * per_tension)
    with pytest.raises(SolverError, match="equilibrium found up to"):
        pressurise(wall, 1.02 * burst_tension(NU) * per_tension)


def test_an_almost_incompressible_sphere_bursts_where_the_closed_form_says() -> None:
    # J = 1: p R/(mu t) = 2 (1/L - 1/L^7), largest at L^6 = 7; E = 3 mu.
    stretch = 7.0 ** (1.0 / 6.0)
    assert burst_tension(0.499999) == pytest.approx(2.0 / 3.0 * (1.0 / stretch - stretch**-7), rel=1e-4)
