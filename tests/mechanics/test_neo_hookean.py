"""Materials: the neo-Hookean solid, tissue that stiffens, fibres."""

from dataclasses import replace

import numpy as np
import pytest
from energy import LAMBDA, MU, NU, STEP, energy, stress
from numpy.typing import NDArray
from scipy.optimize import brentq

from reference_walls import stiffness_matrix, symmetric_base
from scleraforce.base.arrays import Floats
from scleraforce.base.errors import SolverError
from scleraforce.mechanics.axisymmetric_wall import (
    AxisymmetricWall,
    EvenWall,
    axisymmetric_path,
)
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_elements import (
    element_stiffness,
    factor_sum,
    volume_points,
)
from scleraforce.mechanics.finite_strain_wall import FiniteWall, TissueLaw
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.hexahedral_mesh import HexMesh, build_mesh
from scleraforce.mechanics.load_path_tracing import PathEnd, pressurise, trace_load_path
from scleraforce.mechanics.loads_and_supports import needle_at, pressure_load
from scleraforce.mechanics.meridian_elements import MeridianSize, meridian_mesh
from scleraforce.mechanics.neo_hookean_solid import FibreLaw, NeoHookeanSolid, fibre_law
from scleraforce.mechanics.tissue_material import (
    burst_tension,
    growth,
    lame_constants,
    strain_measure,
)
from scleraforce.records.globe import CONSTANT_PRESSURE, PressureLaw, sealed_law

R = 12e-3
T = 1e-3
B = 12.0
ORDERS = (1, 2)


def distorted(order: int = 2, **size: int) -> HexMesh:
    """A coarse mesh whose nodes are moved at random, so that no symmetry hides an
    error.
    """
    mesh = build_mesh(R, T, **({"divisions": 4, "level": 0, "order": order} | size))
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


def random_factor(mesh: HexMesh) -> np.ndarray:
    return np.random.default_rng(2).uniform(
        0.6, 1.4, volume_points(mesh).volumes_ep.shape
    )


@pytest.mark.parametrize("order", ORDERS)
def test_patch_test_a_linear_displacement_is_in_equilibrium_and_has_the_exact_energy(
    order: int,
) -> None:
    mesh = distorted(order, layers=2)
    gradient = np.random.default_rng(1).normal(size=(3, 3))
    u = (mesh.points_nc @ gradient.T).ravel()
    points = volume_points(mesh)
    K = stiffness_matrix(mesh, element_stiffness(points, LAMBDA, MU))
    forces = (K @ u).reshape(-1, 3)
    boundary = np.concatenate(
        [mesh.outer_qn.ravel(), mesh.inner_qn.ravel(), mesh.base_nodes]
    )
    inside = np.setdiff1d(np.arange(len(mesh.points_nc)), boundary)
    assert len(inside) > 40
    assert np.abs(forces[inside]).max() < 1e-12 * np.abs(forces).max()
    strain = 0.5 * (gradient + gradient.T)
    hooke = LAMBDA * np.trace(strain) * np.eye(3) + 2 * MU * strain
    assert u @ K @ u == pytest.approx(
        np.sum(hooke * strain) * points.volumes_ep.sum(), rel=1e-12
    )


@pytest.mark.parametrize("order", ORDERS)
def test_only_the_six_rigid_motions_cost_no_energy(order: int) -> None:
    """Full integration: no hourglass modes. Reduced integration of the 27-node element
    would give some.
    """
    mesh = build_mesh(R, T, divisions=4, level=0, order=order)
    element = element_stiffness(volume_points(mesh), LAMBDA, MU)[0]
    energies = np.linalg.eigvalsh(element.reshape(2 * (3 * mesh.cells_en.shape[1],)))
    assert np.abs(energies[:6]).max() < 1e-12 * energies[-1]
    assert energies[6] > 1e-6 * energies[-1]


def test_lame_constants_give_back_the_uniaxial_test() -> None:
    strain = np.diag([1.0, -NU, -NU])
    hooke = LAMBDA * np.trace(strain) * np.eye(3) + 2 * MU * strain
    np.testing.assert_allclose(hooke, np.diag([1.0, 0.0, 0.0]), atol=1e-9)


@pytest.mark.parametrize("order", ORDERS)
def test_small_strains_follow_hookes_law_and_a_rigid_rotation_costs_no_force(
    order: int,
) -> None:
    mesh = distorted(order)
    factor = random_factor(mesh)
    points = volume_points(mesh)
    solid = NeoHookeanSolid(mesh, NU, factor)
    large = large_displacement(mesh)
    scaled = replace(points, volumes_ep=points.volumes_ep * factor)
    K = stiffness_matrix(mesh, element_stiffness(scaled, LAMBDA, MU))
    assert (
        abs(stiffness_matrix(mesh, solid.tangents(0.0 * large)) - K).max()
        < 1e-14 * abs(K).max()
    )
    u = 1e-7 * large
    np.testing.assert_allclose(
        solid.forces(u).ravel(), K @ u.ravel(), atol=1e-5 * abs(K @ u.ravel()).max()
    )
    rotation = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    forces = solid.forces(mesh.points_nc @ rotation.T - mesh.points_nc + 0.3 * R)
    assert np.abs(forces).max() < 1e-12 * np.abs(solid.forces(large)).max()


@pytest.mark.parametrize("order", ORDERS)
def test_forces_and_tangent_are_the_derivatives_of_the_energy_at_any_deformation(
    order: int,
) -> None:
    mesh = distorted(order)
    points = volume_points(mesh)
    factor_ep = random_factor(mesh)
    u_nc = large_displacement(mesh)
    moved_nc = np.random.default_rng(3).normal(size=mesh.points_nc.shape)

    def gradient(field_nc: NDArray) -> NDArray:
        return np.einsum(
            "eni,epnj->epij", field_nc[mesh.cells_en], points.gradients_epnc
        )

    F = np.eye(3) + gradient(u_nc) + 1j * STEP * gradient(moved_nc)
    volumes_ep = factor_ep * points.volumes_ep
    solid = NeoHookeanSolid(mesh, NU, factor_ep, stiffening=B)
    forces_nc = solid.forces(u_nc)
    assert np.sum(forces_nc * moved_nc) == pytest.approx(
        np.sum(volumes_ep * energy(F, B).imag) / STEP, rel=1e-11
    )

    local_eni = np.einsum(
        "ep,epij,epnj->eni", volumes_ep, stress(F, B).imag / STEP, points.gradients_epnc
    )
    change_nc = np.zeros_like(forces_nc)
    np.add.at(change_nc, mesh.cells_en, local_eni)
    K = stiffness_matrix(mesh, solid.tangents(u_nc))
    slope_nc = (K @ moved_nc.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(
        slope_nc, change_nc, rtol=0.0, atol=1e-12 * np.abs(change_nc).max()
    )
    assert abs(K - K.T).max() < 1e-13 * abs(K).max()


def test_a_vanishing_stiffening_is_the_neo_hookean_solid_and_the_first_order_is_that_of_the_law():
    mesh = distorted()
    u_nc = large_displacement(mesh)
    soft, tiny, small, double = (
        NeoHookeanSolid(mesh, NU, stiffening=b) for b in (0.0, 1e-300, 1e-6, 2e-6)
    )
    np.testing.assert_allclose(tiny.forces(u_nc), soft.forces(u_nc), rtol=1e-14)
    tangents = soft.tangents(u_nc)
    np.testing.assert_allclose(
        tiny.tangents(u_nc), tangents, atol=1e-14 * np.abs(tangents).max()
    )
    once, twice = (solid.forces(u_nc) - soft.forces(u_nc) for solid in (small, double))
    np.testing.assert_allclose(twice, 2.0 * once, atol=1e-5 * np.abs(once).max())


def test_the_strain_measure_is_twice_the_energy_over_mu() -> None:
    F = np.eye(3) + 0.2 * np.random.default_rng(4).normal(size=(5, 3, 3))
    J = np.linalg.det(F)
    neo = (
        MU / 2.0 * (np.sum(F**2, axis=(1, 2)) - 3.0)
        - MU * np.log(J)
        + LAMBDA / 2.0 * np.log(J) ** 2
    )
    np.testing.assert_allclose(
        strain_measure(np.sum(F**2, axis=(1, 2)) - 3.0, np.log(J), NU), 2.0 * neo / MU
    )


def test_a_wall_turned_inside_out_has_no_forces_and_no_tangent() -> None:
    mesh = distorted()
    solid = NeoHookeanSolid(mesh, NU)
    inverted = -1.5 * mesh.points_nc
    assert np.all(np.isnan(solid.forces(inverted)))

    with pytest.raises(SolverError, match="inside out"):
        solid.tangents(inverted)

    with pytest.raises(SolverError, match="negative volume"):
        volume_points(replace(mesh, points_nc=-mesh.points_nc))

    stiff = NeoHookeanSolid(distorted(1), NU, stiffening=200.0)
    assert np.all(np.isfinite(stiff.forces(0.1 * distorted(1).points_nc)))
    assert np.any(np.isnan(stiff.forces(9.0 * distorted(1).points_nc)))


def test_tangents_in_single_precision_are_exact_to_its_rounding() -> None:
    mesh = distorted()
    solid = NeoHookeanSolid(mesh, NU, random_factor(mesh), stiffening=2.0)
    u = large_displacement(mesh)
    exact = solid.tangents(u)
    single = solid.tangents(u, np.float32)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, exact, atol=3e-6 * np.abs(exact).max())


RADIUS = 12e-3
NEEDLE = 0.35e-3
RIGHT_ANGLE = 0.5 * np.pi


def nominal(stretches: Floats, b: float) -> Floats:
    """Principal nominal stresses over E."""
    return np.diag(stress(np.diag(stretches), b))


def test_the_tangent_modulus_is_what_the_study_and_the_physics_say() -> None:
    for b, said in {0.0: 0.92, 1.0: 0.93, 10.0: 1.12, 30.0: 1.62}.items():

        def drawn(strain: float, b: float = b) -> float:
            free = brentq(
                lambda s: MU * (s * s - 1.0) + LAMBDA * np.log((1.0 + strain) * s * s),
                0.3,
                1.0,
                xtol=1e-15,
            )
            return float(nominal(np.array([1.0 + strain, free, free]), b)[0])

        assert (drawn(0.05 + 1e-5) - drawn(0.05 - 1e-5)) / 2e-5 == pytest.approx(
            said, abs=0.006
        )


def thin_sphere(b: float, thickness_m: float = 60e-6) -> tuple[AxisymmetricWall, float]:
    """A half-sphere on a plane of symmetry, and p/E for a tension p R/(E t) of 1 of its
    middle surface.
    """
    mesh = meridian_mesh(RADIUS, thickness_m, NEEDLE, RIGHT_ANGLE, MeridianSize(24))
    per_tension = thickness_m / (RADIUS - 0.5 * thickness_m)
    return AxisymmetricWall(mesh, NU, symmetric=True, stiffening=b), per_tension


def balloon_tension(stretch: float, b: float) -> float:
    """p R/(E t) of a thin sphere by its stretch: 2 P_along/L^2 with P_across = 0; R and
    t are of the undeformed one.
    """
    across = brentq(
        lambda s: MU * (s * s - 1.0) + LAMBDA * np.log(stretch**2 * s),
        0.1,
        1.0,
        xtol=1e-15,
    )
    return float(2.0 * nominal(np.array([stretch, stretch, across]), b)[0] / stretch**2)


@pytest.mark.parametrize(
    ("b", "tension"),
    [
        (0.0, 0.4),
        (1.0, 0.3),
        (1.0, 1.5),
        (10.0, 1.0),
        (30.0, 0.2),
        (30.0, 1.0),
        (200.0, 3.0),
    ],
)
def test_a_balloon_has_the_radius_of_its_closed_form_also_beyond_the_neo_hookean_burst(
    b: float, tension: float
) -> None:
    wall, per_tension = thin_sphere(b)
    u = pressurise(wall, tension * per_tension)
    end = PathEnd(tips_m=np.array([1e-6]))
    path = trace_load_path(wall, u, tension * per_tension, end)
    places = wall.boundaries(path).curves_sbnc[0].mean(axis=0)  # of the middle surface
    middle_m = RADIUS - 30e-6
    radii = np.hypot(places[:, 0], RADIUS - places[:, 1])
    np.testing.assert_allclose(
        [balloon_tension(radius_m / middle_m, b) for radius_m in radii],
        tension,
        rtol=2e-3,
    )


def test_a_step_that_overflows_the_exponential_is_too_long_and_a_shorter_one_is_taken():
    """Silently: pytest makes an error of a warning."""
    wall, per_tension = thin_sphere(200.0)
    pressure = 3.0 * per_tension
    none = np.zeros_like(wall.needle)
    # Newton's first step
    too_far = -wall.factor(none, 0.0)(wall.residual(none, pressure))
    assert not np.all(np.isfinite(wall.residual(too_far, pressure)))
    assert np.all(np.isfinite(pressurise(wall, pressure)))
    np.testing.assert_array_equal(
        np.isnan(growth(1.0, np.array([0.0, 299.0, 1e4, np.inf, np.nan]))),
        [0, 0, 1, 1, 1],
    )


# A soft eye at living pressure: 0.1 MPa, 0.5 mm, 18 mmHg.
SOFT = EvenWall(RADIUS, 0.5e-3, NU, NEEDLE)
SOFT_IOP_RATIO = 2400.0 / 0.1e6


def test_a_soft_eye_that_bursts_at_living_pressure_holds_where_it_stiffens() -> None:
    tension = SOFT_IOP_RATIO * SOFT.radius_m / SOFT.thickness_m
    assert burst_tension(NU) < tension < burst_tension(NU, 5.0)

    with pytest.raises(
        SolverError,
        match=r"pressure: equilibrium found up to .*; use a thicker or stiffer wall",
    ):
        axisymmetric_path(SOFT, SOFT_IOP_RATIO, PathEnd(max_tip_m=1e-3))

    stiffer = replace(SOFT, stiffening=5.0)
    end = PathEnd(tips_m=np.array([0.5e-3, 1e-3]))
    path = axisymmetric_path(stiffer, SOFT_IOP_RATIO, end)
    assert 0.0 < path.force_ratio_m2[1] < path.force_ratio_m2[2]


@pytest.mark.slow
@pytest.mark.parametrize(
    "globe", [CONSTANT_PRESSURE, sealed_law(0.15e9)], ids=["open", "sealed"]
)
def test_an_eye_that_stiffens_is_the_same_in_three_dimensions_and_of_revolution(
    globe: PressureLaw,
) -> None:
    b = 20.0
    modulus_pa = 0.4e6
    iop_pa = 266.0
    thickness_m = 0.6e-3
    contact = Contact(polar_rad=0.0)
    mesh = graded_mesh(RADIUS, thickness_m, contact, core=4, rings=10)
    solid = FiniteWall(mesh, NU, tissue=TissueLaw(b)).load_path(
        needle_at(mesh, contact, NEEDLE),
        PathEnd(max_force=1.0, max_tip_m=1.2e-3),
        youngs_modulus_pa=modulus_pa,
        iop_pa=iop_pa,
        density_kg_m3=0.0,
        globe=globe,
    )
    tips_m = np.array([0.4e-3, 0.8e-3, 1.2e-3])
    flat, plain = (
        axisymmetric_path(
            EvenWall(RADIUS, thickness_m, NU, NEEDLE, stiffening=each),
            iop_pa / modulus_pa,
            PathEnd(tips_m=tips_m),
            globe.over(modulus_pa),
        )
        for each in (b, 0.0)
    )
    forces_n = np.interp(tips_m, solid.tips_m, solid.forces_n)
    np.testing.assert_allclose(
        forces_n, modulus_pa * flat.force_ratio_m2[1:], rtol=0.02
    )
    assert np.all(flat.force_ratio_m2[2:] > 1.15 * plain.force_ratio_m2[2:])


def test_a_thin_sphere_holds_a_little_less_than_its_burst_and_no_more() -> None:
    wall, per_tension = thin_sphere(0.0)
    pressurise(wall, 0.98 * burst_tension(NU) * per_tension)
    with pytest.raises(SolverError, match="equilibrium found up to"):
        pressurise(wall, 1.02 * burst_tension(NU) * per_tension)


def test_an_almost_incompressible_sphere_bursts_where_the_closed_form_says() -> None:
    # J = 1: p R/(mu t) = 2 (1/L - 1/L^7), largest at L^6 = 7; E = 3 mu.
    stretch = 7.0 ** (1.0 / 6.0)
    assert burst_tension(0.499999) == pytest.approx(
        2.0 / 3.0 * (1.0 / stretch - stretch**-7), rel=1e-4
    )


MIXED = fibre_law(NU, 6.0, 2.0)


def hooke(law: FibreLaw) -> NDArray:
    """Stiffness at small strains, (6, 6): 11, 22, 33 (through the wall), 23, 13, 12."""
    lame_lambda, mu = lame_constants(law.base, NU)
    C = np.diag([2.0 * mu] * 3 + [mu] * 3)
    C[:3, :3] += lame_lambda
    C[np.ix_([0, 1, 5], [0, 1, 5])] += law.plane
    return C


@pytest.mark.parametrize(
    ("softer", "through"),
    [(1.0, 1.0), (4.0, 1 / 1.79), (10.0, 1 / 3.37), (25.0, 1 / 7.33)],
)
def test_a_wall_that_is_softer_through_keeps_its_modulus_along(
    softer: float, through: float
) -> None:
    S = np.linalg.inv(hooke(fibre_law(NU, softer, 1.0)))
    np.testing.assert_allclose(
        [1 / S[0, 0], 1 / S[1, 1], -S[0, 1] / S[0, 0]], [1.0, 1.0, NU], rtol=1e-12
    )
    assert 1.0 / S[2, 2] == pytest.approx(through, rel=3e-3)
    # moduli of shear
    assert S[5, 5] / S[4, 4] == pytest.approx(1.0 / softer, rel=1e-12)


@pytest.mark.parametrize("softer", [1.0, 10.0])
def test_a_wall_that_is_stiffer_around_has_e_as_the_mean_of_both_directions(
    softer: float,
) -> None:
    S = np.linalg.inv(hooke(fibre_law(NU, softer, 3.0)))
    np.testing.assert_allclose(
        [S[1, 1] / S[0, 0], S[0, 0] * S[1, 1]], [3.0, 1.0], rtol=1e-12
    )


def directions(mesh: HexMesh) -> NDArray:
    """Around, along the meridian and through the wall at the Gauss points, (element,
    point, direction, 3).
    """
    places = np.einsum(
        "pn,enc->epc", volume_points(mesh).values_pn, mesh.points_nc[mesh.cells_en]
    )
    through = places / np.linalg.norm(places, axis=-1, keepdims=True)
    around = np.cross([0.0, 0.0, 1.0], through)
    around /= np.linalg.norm(around, axis=-1, keepdims=True)

    return np.stack([around, np.cross(through, around), through], axis=2)


def fibre_energy(F: NDArray, mesh: HexMesh, law: FibreLaw) -> NDArray:
    """W of matrices (element, point, 3, 3), real or complex: the definition; b is as
    good as 0.
    """
    moved = np.einsum("epij,epkj->epki", F, directions(mesh))
    double = np.einsum("epki,epli->epkl", moved, moved)
    e = np.stack(
        [(double[..., 0, 0] - 1) / 2, (double[..., 1, 1] - 1) / 2, double[..., 0, 1]],
        axis=-1,
    )

    return law.base * energy(F, 1e-12) + 0.5 * np.einsum(
        "epv,vw,epw->ep", e, law.plane, e
    )


def test_forces_and_tangents_are_the_derivatives_of_the_energy() -> None:
    mesh = build_mesh(R, 1e-3, divisions=4, level=0, layers=2)
    points = volume_points(mesh)
    random = np.random.default_rng(1)
    factor_ep = random.uniform(0.6, 1.4, points.volumes_ep.shape)
    u_nc = (
        mesh.points_nc @ (random.normal(size=(3, 3)) * 0.12)
        + random.normal(size=mesh.points_nc.shape) * 1e-5
    )
    moved_nc = random.normal(size=mesh.points_nc.shape)
    solid = NeoHookeanSolid(mesh, NU, factor_ep, fibres=MIXED)

    def gradient(field_nc: NDArray) -> NDArray:
        return np.einsum(
            "eni,epnj->epij", field_nc[mesh.cells_en], points.gradients_epnc
        )

    F = np.eye(3) + gradient(u_nc) + 1j * STEP * gradient(moved_nc)
    work = (
        np.sum(factor_ep * points.volumes_ep * fibre_energy(F, mesh, MIXED).imag) / STEP
    )
    # directions of curved elements
    assert np.sum(solid.forces(u_nc) * moved_nc) == pytest.approx(work, rel=2e-3)
    step = 1e-6 * 1e-3
    change = (
        solid.forces(u_nc + step * moved_nc) - solid.forces(u_nc - step * moved_nc)
    ).ravel() / (2.0 * step)
    K = stiffness_matrix(mesh, solid.tangents(u_nc))
    np.testing.assert_allclose(
        K @ moved_nc.ravel(), change, atol=1e-6 * np.abs(change).max()
    )


def test_a_rotation_costs_no_force_and_no_fibres_are_the_isotropic_solid() -> None:
    mesh = build_mesh(R, 1e-3, divisions=4, level=0)
    rotation = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    turned_nc = mesh.points_nc @ (rotation * np.linalg.det(rotation)).T - mesh.points_nc
    stretched_nc = 0.1 * mesh.points_nc
    fibred = NeoHookeanSolid(mesh, NU, fibres=MIXED)
    assert (
        np.abs(fibred.forces(turned_nc)).max()
        < 1e-10 * np.abs(fibred.forces(stretched_nc)).max()
    )
    even = NeoHookeanSolid(mesh, NU, fibres=fibre_law(NU, 1.0, 1.0)).tangents(
        0.0 * turned_nc
    )
    np.testing.assert_allclose(
        even,
        element_stiffness(volume_points(mesh), *lame_constants(1.0, NU)),
        atol=1e-9,
    )


def test_a_thick_fibred_sphere_swells_under_pressure_as_the_closed_form_says() -> None:
    """u = A r^m + B r^n with m, n = -1/2 +- sqrt(1/4 + 2 (C11 + C12 - C13)/C33)
    (Lekhnitskii, sec. 62).
    """
    outer = R
    inner = R - 4e-3
    law = fibre_law(NU, 8.0, 1.0)
    mesh = build_mesh(outer, outer - inner, divisions=8, level=0, layers=2)
    held_nc = symmetric_base(mesh)
    tangents = NeoHookeanSolid(mesh, NU, fibres=law).tangents(
        np.zeros_like(mesh.points_nc)
    )
    u_nc = np.zeros(mesh.points_nc.size)
    free = ~held_nc.ravel()
    u_nc[free] = factor_sum(mesh, held_nc, tangents)(pressure_load(mesh).ravel()[free])
    C = hooke(law)
    root = np.sqrt(0.25 + 2.0 * (C[0, 0] + C[0, 1] - C[0, 2]) / C[2, 2])
    powers = np.array([-0.5 + root, -0.5 - root])
    ends = np.array([inner, outer])[:, None]
    stress = (C[2, 2] * powers + 2.0 * C[0, 2]) * ends ** (powers - 1.0)
    A = np.linalg.solve(stress, [-1.0, 0.0])
    r = np.linalg.norm(mesh.points_nc, axis=1, keepdims=True)
    exact_nc = (r**powers @ A)[:, None] * mesh.points_nc / r
    assert np.abs(u_nc.reshape(-1, 3) - exact_nc).max() < 5e-3 * np.abs(exact_nc).max()
