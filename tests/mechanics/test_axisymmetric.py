"""The wall of revolution against exact solutions, the three-dimensional linear wall and reference problem R2."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.interpolate import CubicSpline

from reference_walls import DeadPressureWall, spread_needle
from scleraforce.arrays import Floats
from scleraforce.errors import InputError, SolverError
from scleraforce.mechanics.axisymmetric import AxisymmetricWall, axisymmetric_path
from scleraforce.mechanics.contact import Contact
from scleraforce.mechanics.continuation import pressurise, trace
from scleraforce.mechanics.globe import sealed_globe
from scleraforce.mechanics.graded import graded_mesh
from scleraforce.mechanics.linear import LinearWall, tip_displacement
from scleraforce.mechanics.material import lame_constants
from scleraforce.mechanics.meridian import MeridianSize, meridian_mesh
from scleraforce.study.eye import RIGIDITY_LAWS
from scleraforce.units import SI_PER_UNIT

RADIUS, NEEDLE, NU = 12e-3, 0.35e-3, 0.45
IOP_RATIO = 266.0 / 0.38e6
RIGIDITY = 0.03 * SI_PER_UNIT["mmhg13_per_ul"][1]  # of enucleated human eyes (van der Werff 1981)
RIGHT_ANGLE = 0.5 * np.pi


def wall_of(thickness_mm: float, size: MeridianSize | None = None, symmetric: bool = False) -> AxisymmetricWall:
    mesh = meridian_mesh(RADIUS, 1e-3 * thickness_mm, NEEDLE, RIGHT_ANGLE, size or MeridianSize())
    return AxisymmetricWall(mesh, NU, symmetric=symmetric)


@pytest.fixture(scope="module")
def dented() -> tuple[AxisymmetricWall, Floats]:
    """A coarse wall of two layers with a dent of 1.5 mm."""
    wall = wall_of(0.5, MeridianSize(16, 2))
    path = trace(wall, pressurise(wall, IOP_RATIO), IOP_RATIO, tips_m=np.array([1.5e-3]))
    return wall, path.displacement_su[-1]


def test_tangent_is_the_derivative_of_the_residual_to_second_order(dented: tuple[AxisymmetricWall, Floats]) -> None:
    wall, u = dented
    pressure = 20.0 * IOP_RATIO  # high, that its part of the tangent would be missed
    direction = 1e-6 * np.random.default_rng(1).normal(size=u.shape)
    solve, rest = wall.factor(u, pressure), wall.residual(u, pressure)
    errors = [
        np.linalg.norm(solve(wall.residual(u + step * direction, pressure) - rest) - step * direction)
        for step in 0.5 ** np.arange(3, 8)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders[1:], 2.0, atol=0.1)


def test_following_pressure_is_the_derivative_of_the_volume(dented: tuple[AxisymmetricWall, Floats]) -> None:
    wall, u = dented
    direction = np.random.default_rng(3).normal(size=u.shape)
    step = 1e-6
    difference = (wall.volume(u + step * direction)[0] - wall.volume(u - step * direction)[0]) / (2.0 * step)
    assert wall.volume(u)[1] @ direction == pytest.approx(difference, rel=1e-6)
    load = wall.residual(u, 0.0) - wall.residual(u, 1.0)
    np.testing.assert_allclose(load, wall.volume(u)[1], atol=1e-12)
    assert wall.volume(np.zeros_like(u))[0] == pytest.approx(2.0 / 3.0 * np.pi * 11.5e-3**3, rel=1e-5)


def inflated_radius_m(thickness_m: float, pressure: float) -> float:
    """Outer radius of a thick neo-Hookean sphere under p/E, from its radial boundary value problem.

    dP_r/dR + 2 (P_r - P_t) / R = 0 with P_i = mu (l_i - 1/l_i) + lambda ln(J) / l_i, l_r = r', l_t = r / R.
    """
    lame_lambda, lame_mu = lame_constants(1.0, NU)

    def nominal(stretch: Floats, log_J: Floats) -> Floats:
        return lame_mu * (stretch - 1.0 / stretch) + lame_lambda * log_J / stretch

    def both(R: Floats, r: Floats, slope: Floats) -> tuple[Floats, Floats]:
        log_J = np.log(slope * (r / R) ** 2)
        return nominal(slope, log_J), nominal(r / R, log_J)

    def rates(R: Floats, y: Floats) -> Floats:
        r, slope = y
        radial, hoop = both(R, r, slope)
        log_J = np.log(slope * (r / R) ** 2)
        by_slope = lame_mu * (1.0 + slope**-2) + lame_lambda * (1.0 - log_J) / slope**2
        by_radius = 2.0 * lame_lambda * (slope / r - 1.0 / R) / slope  # along R, at fixed slope
        return np.stack([slope, (-2.0 * (radial - hoop) / R - by_radius) / by_slope])

    inner = RADIUS - thickness_m

    def ends(at_inner: Floats, at_outer: Floats) -> Floats:
        inside = both(np.array(inner), at_inner[0], at_inner[1])[0] + pressure * (at_inner[0] / inner) ** 2
        return np.array([inside, both(np.array(RADIUS), at_outer[0], at_outer[1])[0]])

    R = np.linspace(inner, RADIUS, 50)
    answer = solve_bvp(rates, ends, R, np.stack([R, np.ones_like(R)]), tol=1e-10)
    assert answer.success
    return float(answer.y[0, -1])


@pytest.mark.parametrize(("thickness_mm", "pressure"), [(0.5, 0.005), (0.8, 0.02), (3.0, 0.1)])
def test_pressurised_sphere_takes_the_radius_of_its_radial_problem(thickness_mm: float, pressure: float) -> None:
    wall = wall_of(thickness_mm, symmetric=True)
    path = trace(wall, pressurise(wall, pressure), pressure, tips_m=np.array([1e-6]))
    outer = wall.boundaries(path).curves_sbnc[0, 0]
    radii = np.hypot(outer[:, 0], RADIUS - outer[:, 1])
    expected = inflated_radius_m(1e-3 * thickness_mm, pressure)
    assert expected > 1.02 * RADIUS
    np.testing.assert_allclose(radii - RADIUS, expected - RADIUS, rtol=1e-3)


@pytest.mark.parametrize("thickness_mm", [0.5, pytest.param(0.8, marks=pytest.mark.slow)])
def test_small_forces_meet_the_linear_wall_of_three_dimensions(thickness_mm: float) -> None:
    contact = Contact(polar_rad=0.0)
    mesh = graded_mesh(RADIUS, 1e-3 * thickness_mm, contact)
    needle = LinearWall(mesh, NU).needle_cnc([contact], NEEDLE)[0]
    path = axisymmetric_path(RADIUS, 1e-3 * thickness_mm, NU, NEEDLE, 0.0, tips_m=np.array([1e-6, 2e-6]))
    first, second = path.tip_m[1:] / path.force_ratio_m2[1:]
    assert 2.0 * first - second == pytest.approx(tip_displacement(mesh, contact, needle), rel=0.005)


def test_wall_without_pressure_snaps_through() -> None:
    path = axisymmetric_path(RADIUS, 0.35e-3, NU, NEEDLE, 0.0, tips_m=np.linspace(0.25e-3, 7.5e-3, 30))
    assert len(path.tip_m) == 31
    np.testing.assert_allclose(path.tip_m[-1], 7.5e-3)


def r2_tips_mm(thickness_mm: float, modulus_mpa: float, count: int) -> Floats:
    """Tips at the first `count` of R2's forces."""
    forces_mn = np.array([5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0])[:count]
    mesh = meridian_mesh(RADIUS, 1e-3 * thickness_mm, NEEDLE, RIGHT_ANGLE, MeridianSize())
    loaded = AxisymmetricWall(mesh, NU)
    spread_needle(loaded, lambda distance_m: np.exp(-0.5 * (distance_m / 0.35e-3) ** 2))
    wall = DeadPressureWall(loaded)
    pressure = 266e-6 / modulus_mpa
    path = trace(wall, pressurise(wall, pressure), pressure, tips_m=np.linspace(0.1e-3, 7e-3, 70), max_force=0.25e-6)
    tips_mm: Floats = 1e3 * CubicSpline(path.force, path.tip_m)(1e-9 * forces_mn / modulus_mpa)
    return tips_mm


@pytest.mark.parametrize(
    ("thickness_mm", "modulus_mpa", "expected_mm"),
    [
        (0.8, 0.27, (0.144, 0.309, 0.505, 0.750, 1.073, 1.502, 2.541, 3.503, 4.379)),
        (0.8, 0.38, (0.102, 0.215, 0.342, 0.488, 0.660, 0.872, 1.484, 2.319, 3.125)),
        (0.5, 0.22, (0.422, 1.141, 1.941, 2.663, 3.343, 4.001, 5.289, 6.562)),
    ],
)
def test_tip_meets_reference_problem_r2_at_35_degrees(
    thickness_mm: float, modulus_mpa: float, expected_mm: tuple[float, ...]
) -> None:
    np.testing.assert_allclose(r2_tips_mm(thickness_mm, modulus_mpa, len(expected_mm)), expected_mm, rtol=0.03)


@pytest.mark.parametrize("law", RIGIDITY_LAWS)
def test_a_sealed_globe_is_the_open_state_whose_pressure_solves_the_law(law: str) -> None:
    globe = sealed_globe(RIGIDITY, law).over(0.38e6)
    tips_m = np.linspace(0.4e-3, 2e-3, 5)
    wall = (RADIUS, 0.5e-3, NU, NEEDLE)
    sealed = axisymmetric_path(*wall, IOP_RATIO, tips_m=tips_m, globe=globe)
    assert np.all(np.diff(sealed.iop_ratio) > 0.0)
    assert sealed.displaced_m3[0] == 0.0
    np.testing.assert_allclose(globe.pressure(IOP_RATIO, sealed.displaced_m3), sealed.iop_ratio, rtol=1e-8)
    for state in (2, 5):
        opened = axisymmetric_path(*wall, float(sealed.iop_ratio[state]), tips_m=tips_m[:state])
        assert opened.force_ratio_m2[-1] == pytest.approx(sealed.force_ratio_m2[state], rel=1e-7)
        assert opened.displaced_m3[-1] == pytest.approx(sealed.displaced_m3[state], rel=1e-7)
        np.testing.assert_allclose(opened.curves_sbnc[-1], sealed.curves_sbnc[state], atol=1e-11)


def test_a_sealed_path_ends_where_the_pressure_runs_away() -> None:
    with pytest.raises(SolverError, match=r"beyond a dent of 2\.2\d+ mm, .*; the pressure runs away there"):
        axisymmetric_path(
            *(RADIUS, 0.5e-3, NU, NEEDLE, IOP_RATIO), max_tip_m=3e-3, globe=sealed_globe(RIGIDITY).over(0.38e6)
        )


def test_the_displaced_volume_lies_between_the_inner_curves() -> None:
    path = axisymmetric_path(RADIUS, 0.5e-3, NU, NEEDLE, IOP_RATIO, tips_m=np.array([1.5e-3]), size=MeridianSize(96))
    distance, depth = np.moveaxis(path.curves_sbnc[:, 1], -1, 0)
    volumes_m3 = -np.pi * np.trapezoid(distance**2, depth)  # of the space above; both end on the same ring
    assert path.displaced_m3[1] == pytest.approx(volumes_m3[1] - volumes_m3[0], rel=2e-3)
    assert 15e-9 < path.displaced_m3[1] < 30e-9


def test_curves_start_on_the_axis_and_end_at_the_support() -> None:
    path = axisymmetric_path(RADIUS, 0.5e-3, NU, NEEDLE, IOP_RATIO, tips_m=np.array([1e-3]))
    np.testing.assert_allclose(path.curves_sbnc[:, :, 0, 0], 0.0, atol=1e-15)
    np.testing.assert_allclose(path.curves_sbnc[:, 0, -1], [[RADIUS, RADIUS]] * 2, rtol=1e-12)
    moved = path.curves_sbnc[1, 0, 0, 1] - path.curves_sbnc[0, 0, 0, 1]
    assert moved == pytest.approx(1e-3, rel=1e-9)


@pytest.mark.parametrize(("thickness_mm", "needle_mm"), [(0.0, 0.35), (12.0, 0.35), (0.5, 0.0), (0.5, 12.0)])
def test_sizes_that_make_no_eye_are_refused(thickness_mm: float, needle_mm: float) -> None:
    with pytest.raises(InputError, match="must be"):
        axisymmetric_path(RADIUS, 1e-3 * thickness_mm, NU, 1e-3 * needle_mm, 0.0, max_tip_m=1e-3)
