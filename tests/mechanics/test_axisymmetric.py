"""Walls of revolution at finite strain against 3-D, closed forms and energies; their
tangents; the base's motion.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from energy import LAMBDA, MU, NU, STEP, energy, stress
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from reference_walls import (
    DeadPressureWall,
    cut_section,
    shift_in_plane,
    spread_needle,
)
from scleraforce.base.arrays import Floats
from scleraforce.base.errors import InputError, SolverError
from scleraforce.base.units import SI_PER_UNIT
from scleraforce.library.moving_base import base_angle
from scleraforce.mechanics import meridian_elements
from scleraforce.mechanics.axisymmetric_wall import (
    AxisymmetricPath,
    AxisymmetricWall,
    EvenWall,
    axisymmetric_path,
    base_shift,
)
from scleraforce.mechanics.contact_and_section import Contact, ScanPlane
from scleraforce.mechanics.graded_mesh import study_mesh
from scleraforce.mechanics.linear_wall import LinearWall, tip_displacement
from scleraforce.mechanics.load_path_tracing import PathEnd, pressurise, trace_load_path
from scleraforce.mechanics.meridian_elements import (
    ElementTables,
    MeridianMesh,
    MeridianSize,
    meridian_mesh,
)
from scleraforce.mechanics.tissue_material import (
    LARGEST_EXPONENT,
    burst_tension,
    lame_constants,
    strain_measure,
)
from scleraforce.records.globe import sealed_law
from scleraforce.records.study import MeshStudy, Study
from scleraforce.records.study_of_eye import RIGIDITY_LAWS

RADIUS = 12e-3
NEEDLE = 0.35e-3
IOP_RATIO = 266.0 / 0.38e6
# of enucleated human eyes (van der Werff 1981)
RIGIDITY = 0.03 * SI_PER_UNIT["mmhg13_per_ul"][1]
RIGHT_ANGLE = 0.5 * np.pi
GRADED = Study(mesh=MeshStudy(kind="graded"))
EYE = EvenWall(RADIUS, 0.5e-3, NU, NEEDLE)


def path_to(
    tips_m: list[float] | Floats,
    wall: EvenWall = EYE,
    iop_ratio: float = IOP_RATIO,
    **more: object,
) -> AxisymmetricPath:
    return axisymmetric_path(
        wall, iop_ratio, PathEnd(tips_m=np.asarray(tips_m)), **more
    )


def test_tangent_is_the_derivative_of_the_residual_to_second_order():
    mesh = meridian_mesh(RADIUS, 0.5e-3, NEEDLE, RIGHT_ANGLE, MeridianSize(16, 2))
    wall = AxisymmetricWall(mesh, NU)
    end = PathEnd(tips_m=np.array([1.5e-3]))
    rest = pressurise(wall, IOP_RATIO)
    u = trace_load_path(wall, rest, IOP_RATIO, end).displacement_su[-1]
    pressure = 20.0 * IOP_RATIO  # high, that its part of the tangent would be missed
    direction = 1e-6 * np.random.default_rng(1).normal(size=u.shape)
    solve = wall.factor(u, pressure)
    balance = wall.residual(u, pressure)
    errors = [
        np.linalg.norm(
            solve(wall.residual(u + step * direction, pressure) - balance)
            - step * direction
        )
        for step in 0.5 ** np.arange(3, 8)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders[1:], 2.0, atol=0.1)


def nominal(stretches: list[float], b: float) -> Floats:
    """Principal nominal stresses over E; b = 0 is as good as 1e-12."""
    return np.diag(stress(np.diag(stretches), b or 1e-12))


def stretched_sheet(stretch: float, b: float) -> float:
    """Nominal stress over E of a sheet that is stretched alike in both directions."""

    def across(own: float) -> float:
        return MU * (own * own - 1.0) + LAMBDA * np.log(stretch**2 * own)

    thinner = brentq(across, 0.01, 1.0, xtol=1e-15)
    return float(nominal([stretch, stretch, thinner], b)[0])


@pytest.mark.parametrize(
    ("b", "tension"),
    [
        (0.0, 0.4),
        (1e-300, 0.4),
        (1.0, 0.3),
        (1.0, 1.5),
        (10.0, 1.0),
        (30.0, 0.2),
        (200.0, 3.0),
    ],
)
def test_a_thin_wall_at_the_pole_meets_the_balance_of_a_membrane(
    b: float, tension: float
):
    """p r = 2 P/L with the radius of curvature r and the stretch L, also where a
    neo-Hookean sphere would burst, and where Newton's first step overflows exp(b Q).
    """
    thickness_m = 60e-6
    middle_m = RADIUS - 0.5 * thickness_m
    wall = EvenWall(
        RADIUS, thickness_m, NU, NEEDLE, stiffening=b, size=MeridianSize(24)
    )
    iop_ratio = tension * thickness_m / middle_m
    at_rest, pressed = (
        path_to([1e-6], wall, ratio).curves_sbnc[0].mean(axis=0)
        for ratio in (0.0, iop_ratio)
    )
    angles = np.arctan2(at_rest[:, 0], RADIUS - at_rest[:, 1])
    near = angles < 0.5
    arcs = middle_m * angles[near, None]
    stretch = np.linalg.lstsq(arcs ** [1, 3, 5], pressed[near, 0], rcond=None)[0][0]
    bend = np.linalg.lstsq(arcs ** [0, 2, 4, 6], pressed[near, 1], rcond=None)[0][1]
    radius_m = stretch**2 / (2.0 * bend)
    assert stretch > 1.03
    assert iop_ratio * radius_m / thickness_m == pytest.approx(
        2.0 * stretched_sheet(stretch, b) / stretch, rel=2e-3
    )


@pytest.mark.parametrize("b", [0.0, 0.03, 5.0])
def test_a_thin_sphere_bursts_at_the_first_maximum_of_its_tension(b: float):
    stretches = np.linspace(1.0, 2.0, 2001)
    tensions = [2.0 * stretched_sheet(each, b) / each**2 for each in stretches]
    falling = np.flatnonzero(np.diff(tensions) < 0.0)
    bursts = tensions[falling[0]] if len(falling) else np.inf
    assert burst_tension(NU, b) == pytest.approx(bursts, rel=1e-4)


def test_a_soft_eye_that_bursts_at_living_pressure_holds_where_it_stiffens():
    iop_ratio = 2400.0 / 0.1e6  # 18 mmHg
    tension = iop_ratio * EYE.radius_m / EYE.thickness_m
    assert burst_tension(NU) < tension < burst_tension(NU, 5.0)

    with pytest.raises(SolverError, match="thicker or stiffer wall"):
        path_to([1e-3], iop_ratio=iop_ratio)

    forces = path_to(
        [0.5e-3, 1e-3], replace(EYE, stiffening=5.0), iop_ratio
    ).force_ratio_m2
    assert (np.diff(forces) > 0.0).all()


def test_small_forces_meet_the_linear_wall_of_three_dimensions():
    contact = Contact(polar_rad=0.0)
    mesh = study_mesh(GRADED, EYE.thickness_m, contact)
    needle_nc = LinearWall(mesh, NU).needle_cnc([contact], NEEDLE)[0]
    path = path_to([1e-6, 2e-6], iop_ratio=0.0)
    first, second = path.tip_m[1:] / path.force_ratio_m2[1:]
    assert 2.0 * first - second == pytest.approx(
        tip_displacement(mesh, contact, needle_nc), rel=0.005
    )


def test_a_wall_without_pressure_softens_and_is_followed_to_deep_dents():
    tips_m = np.linspace(0.25e-3, 7.5e-3, 30)
    path = path_to(tips_m, replace(EYE, thickness_m=0.35e-3), 0.0)
    np.testing.assert_allclose(path.tip_m[1:], tips_m)
    stiffness = np.diff(path.force_ratio_m2)
    assert (stiffness[3:] < 0.3 * stiffness[0]).all()


def r2_tips_mm(thickness_mm: float, modulus_mpa: float, count: int) -> Floats:
    """Tips at the first `count` of R2's forces."""
    forces_mn = np.array([5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0])[:count]
    mesh = meridian_mesh(
        RADIUS, 1e-3 * thickness_mm, NEEDLE, RIGHT_ANGLE, MeridianSize()
    )
    loaded = AxisymmetricWall(mesh, NU)
    spread_needle(loaded, lambda distance_m: np.exp(-0.5 * (distance_m / 0.35e-3) ** 2))
    wall = DeadPressureWall(loaded)
    pressure = 266e-6 / modulus_mpa
    path = trace_load_path(
        wall,
        pressurise(wall, pressure),
        pressure,
        PathEnd(tips_m=np.linspace(0.1e-3, 7e-3, 70), max_force=0.25e-6),
    )
    tips_mm: Floats = 1e3 * CubicSpline(path.force, path.tip_m)(
        1e-9 * forces_mn / modulus_mpa
    )

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
):
    np.testing.assert_allclose(
        r2_tips_mm(thickness_mm, modulus_mpa, len(expected_mm)), expected_mm, rtol=0.03
    )


@pytest.mark.parametrize("law", RIGIDITY_LAWS)
def test_a_sealed_globe_is_the_open_state_whose_pressure_solves_the_law(
    law: str,
):
    globe = sealed_law(RIGIDITY, law).over(0.38e6)
    tips_m = np.linspace(0.4e-3, 2e-3, 5)
    sealed = path_to(tips_m, globe=globe)
    assert np.all(np.diff(sealed.iop_ratio) > 0.0)
    assert sealed.displaced_m3[0] == 0.0
    np.testing.assert_allclose(
        globe.pressure(IOP_RATIO, sealed.displaced_m3), sealed.iop_ratio, rtol=1e-8
    )
    opened = path_to(tips_m[:3], iop_ratio=float(sealed.iop_ratio[3]))
    assert opened.force_ratio_m2[-1] == pytest.approx(
        sealed.force_ratio_m2[3], rel=1e-7
    )
    assert opened.displaced_m3[-1] == pytest.approx(sealed.displaced_m3[3], rel=1e-7)
    np.testing.assert_allclose(
        opened.curves_sbnc[-1], sealed.curves_sbnc[3], atol=1e-11
    )


def test_a_sealed_path_ends_where_the_pressure_runs_away():
    with pytest.raises(
        SolverError, match=r"beyond a dent of 2\.2\d+ mm, .*; the pressure runs away"
    ):
        axisymmetric_path(
            EYE, IOP_RATIO, PathEnd(max_tip_m=3e-3), sealed_law(RIGIDITY).over(0.38e6)
        )


def test_curves_start_on_the_axis_end_at_the_support_and_enclose_the_displaced_volume():
    path = path_to([1.5e-3], replace(EYE, size=MeridianSize(96)))
    curves_sbnc = path.curves_sbnc
    np.testing.assert_allclose(curves_sbnc[:, :, 0, 0], 0.0, atol=1e-15)
    np.testing.assert_allclose(curves_sbnc[:, 0, -1], [[RADIUS, RADIUS]] * 2)
    dent_m = curves_sbnc[1, 0, 0, 1] - curves_sbnc[0, 0, 0, 1]
    assert dent_m == pytest.approx(1.5e-3, rel=1e-9)
    distance, depth = np.moveaxis(curves_sbnc[:, 1], -1, 0)
    # of the space above; both end on the same ring
    volumes_m3 = -np.pi * np.trapezoid(distance**2, depth)
    assert path.displaced_m3[1] == pytest.approx(
        volumes_m3[1] - volumes_m3[0], rel=2e-3
    )


@pytest.mark.parametrize(
    "fault",
    [
        {"thickness_m": 0.0},
        {"thickness_m": 12e-3},
        {"needle_radius_m": 0.0},
        {"needle_radius_m": 12e-3},
    ],
    ids=str,
)
def test_sizes_that_make_no_eye_are_refused(fault: dict[str, float]):
    with pytest.raises(InputError, match="must be"):
        path_to([1e-3], replace(EYE, **fault))


B = 12.0
ENTRIES = [0, 0, 1, 1, 2], [0, 1, 0, 1, 2]  # of F that are not zero


@pytest.fixture(scope="module")
def mesh() -> MeridianMesh:
    return meridian_mesh(RADIUS, 1e-3, NEEDLE, RIGHT_ANGLE, MeridianSize(8, 2))


def gradient_operator(solid: ElementTables) -> Floats:
    """G (element, point, 5, 18) with dF = G du, F in the order rr, rz, zr, zz, tt."""
    r, z, around = np.moveaxis(solid.shapes_epgn, 2, 0)
    G = np.zeros((*r.shape[:2], 5, 9, 2))
    G[:, :, 0, :, 0] = r
    G[:, :, 1, :, 0] = z
    G[:, :, 2, :, 1] = r
    G[:, :, 3, :, 1] = z
    G[:, :, 4, :, 0] = around

    return G.reshape(*r.shape[:2], 5, 18)


def deformation(solid: ElementTables, u: NDArray) -> NDArray:
    """F (element, point, 3, 3)."""
    F = np.zeros((*solid.mu_ep.shape, 3, 3), dtype=u.dtype)
    F[(..., *ENTRIES)] = np.einsum(
        "epkN,eN->epk", gradient_operator(solid), u[solid.unknowns_en]
    )
    return F + np.eye(3)


def test_forces_and_tangent_are_the_derivatives_of_the_energy(
    mesh,
):
    """At strains of some 15 % with rotation and noise, none of them across the axis."""
    r, z = mesh.points_nc.T
    noise = np.random.default_rng(1).normal(size=mesh.points_nc.shape) * 5e-6
    outward = 0.12 * r + 0.1 * r * z / RADIUS + noise[:, 0] * (r > 0.0)
    up = 0.2 * r - 0.08 * z + noise[:, 1]
    u = np.stack([outward, up], axis=1).ravel()
    solid = meridian_elements.solid_of_revolution(mesh, NU, B)
    volumes_ep = solid.mu_ep / lame_constants(1.0, NU)[1]
    moved = np.random.default_rng(3).normal(size=u.shape)
    F = deformation(solid, u + 1j * STEP * moved)
    work = np.sum(volumes_ep * energy(F, B).imag) / STEP
    assert meridian_elements.nodal_forces(solid, u) @ moved == pytest.approx(
        work, rel=1e-11
    )
    P = stress(F, B).imag[(..., *ENTRIES)] / STEP
    change_eN = np.einsum("ep,epk,epkN->eN", volumes_ep, P, gradient_operator(solid))
    tangents = meridian_elements.element_tangents(solid, u)
    slope_eN = np.einsum("eMN,eN->eM", tangents, moved[solid.unknowns_en])
    np.testing.assert_allclose(
        slope_eN, change_eN, rtol=0.0, atol=1e-12 * np.abs(change_eN).max()
    )
    np.testing.assert_array_equal(tangents, tangents.transpose(0, 2, 1))


def turned_over(mesh: MeridianMesh) -> Floats:
    """A node pushed through the inner boundary."""
    u_nc = np.zeros((len(mesh.points_nc), 2))
    u_nc[mesh.outer_n[4], 1] = -2e-3
    return u_nc.ravel()


def mirrored(mesh: MeridianMesh) -> Floats:
    """Its middle mirrored in the axis: two signs change there, and the product of the
    stretches is unchanged.
    """
    away_n = mesh.points_nc[:, 0]
    return np.stack(
        [np.where(away_n < 3e-3, -2.0 * away_n, 0.0), np.zeros_like(away_n)], axis=1
    ).ravel()


@pytest.mark.parametrize("displaced", [turned_over, mirrored])
def test_elements_that_are_turned_inside_out_and_no_others_are_not_finite(
    mesh, displaced: Callable[[MeridianMesh], Floats]
):
    solid = meridian_elements.solid_of_revolution(mesh, NU)
    u = displaced(mesh)
    F = deformation(solid, u)
    inverted_e = np.any(
        (np.linalg.det(F[..., :2, :2]) <= 0.0) | (F[..., 2, 2] <= 0.0), axis=1
    )
    assert 0 < np.count_nonzero(inverted_e) < len(inverted_e)
    np.testing.assert_array_equal(
        np.isnan(meridian_elements.element_tangents(solid, u)).all(axis=(1, 2)),
        inverted_e,
    )
    np.testing.assert_array_equal(
        np.isnan(meridian_elements.nodal_forces(solid, u)),
        np.isin(np.arange(len(u)), solid.unknowns_en[inverted_e]),
    )


# of the largest exponent
@pytest.mark.parametrize(("share", "finite"), [(0.99, True), (1.01, False)])
def test_tissue_that_is_stretched_too_far_is_not_finite(
    mesh, share: float, finite: bool
):
    # by a half in every direction
    stretched = 0.5 * mesh.points_nc.ravel()
    log_ratio = np.array(3.0 * np.log(1.5))
    strain = strain_measure(np.array(3.0 * 1.5**2 - 3.0), log_ratio, NU)
    solid = meridian_elements.solid_of_revolution(
        mesh, NU, share * LARGEST_EXPONENT / float(strain)
    )
    forces = meridian_elements.nodal_forces(solid, stretched)
    assert np.isfinite(forces).all() if finite else np.isnan(forces).all()


@pytest.mark.parametrize("polar_deg", [10.0, 50.0])
def test_base_lies_where_the_direction_meets_its_plane(polar_deg: float):
    contact = Contact(polar_rad=np.radians(polar_deg))
    azimuths = np.linspace(0.0, 2.0 * np.pi, 9)
    angles = base_angle(contact.polar_rad, azimuths)
    sideways = np.outer(np.cos(azimuths), contact.meridian) + np.outer(
        np.sin(azimuths), contact.parallel
    )
    points = (
        np.cos(angles)[:, None] * contact.normal + np.sin(angles)[:, None] * sideways
    )
    np.testing.assert_allclose(points[:, 2], 0.0, atol=1e-12)


THICK = replace(EYE, thickness_m=0.8e-3)


def test_on_the_pole_the_base_shifts_nothing():
    shift = base_shift(THICK, 0.0)
    dent = 8.3e3  # m per F/E, the linear wall's tip
    # the 3-D mesh under the needle
    assert np.abs(shift.needle_mbnc).max() < 0.005 * dent


@pytest.mark.slow
def test_shift_takes_the_linear_curves_to_three_dimensions():
    gap_m = 0.5e-3
    contact = Contact(polar_rad=np.radians(45.0))
    force_ratio = 2e-9
    wall = LinearWall(study_mesh(GRADED, 0.8e-3, contact), NU)
    displacement_nc = (
        IOP_RATIO * wall.pressure_nc
        + force_ratio * wall.needle_cnc([contact], NEEDLE)[0]
    )
    shift = base_shift(THICK, contact.polar_rad)
    path = path_to([1e-6, 2e-5], THICK)
    share = force_ratio / path.force_ratio_m2[-1]
    curves = path.curves_sbnc[0] + share * (path.curves_sbnc[-1] - path.curves_sbnc[0])

    for direction_rad in (0.0, 1.0, 2.5):
        section = cut_section(
            wall.mesh,
            ScanPlane(contact, gap_m=gap_m, direction_rad=direction_rad),
            displacement_nc,
        )
        for side in (-1.0, 1.0):
            lateral_bn = side * np.sqrt(np.maximum(curves[..., 0] ** 2 - gap_m**2, 0.0))
            shifts = shift_in_plane(
                shift, IOP_RATIO, force_ratio, lateral_bn, gap_m, direction_rad
            )[0]
            lateral, depth = np.moveaxis(shifts, -1, 0)
            shown = (curves[0, :, 0] > 0.7e-3) & (curves[0, :, 0] < 6.5e-3)
            expected = np.interp((lateral_bn[0] + lateral)[shown], *section.outer.T)
            np.testing.assert_allclose(
                (curves[0, :, 1] + depth)[shown], expected, atol=4e-6
            )


@pytest.mark.parametrize("polar_deg", [-1.0, 60.0])
def test_polar_angles_out_of_range_are_refused(polar_deg: float):
    with pytest.raises(InputError, match="polar angle"):
        base_shift(replace(EYE, size=MeridianSize(16)), np.radians(polar_deg))
