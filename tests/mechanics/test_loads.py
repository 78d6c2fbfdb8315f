"""Loads and supports: exact resultants and moments; beds and straps whose motions are
known.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from reference_r1 import gaussian_load
from reference_walls import rest_nc, stiffness_matrix, symmetric_base
from scleraforce.base.errors import InputError
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_elements import volume_points
from scleraforce.mechanics.finite_strain_wall import FiniteWall
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.hexahedral_mesh import HexMesh, build_mesh
from scleraforce.mechanics.linear_wall import LinearWall, tip_displacement
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.loads_and_supports import (
    INSERTIONS,
    InnerSurface,
    Springs,
    clamped_base,
    elastic_bed,
    gravity_load,
    needle_at,
    needle_loads,
    pressure_load,
    rectus_straps,
    study_springs,
    tip_at,
)
from scleraforce.records.globe import sealed_law
from scleraforce.records.study import SupportsStudy

R = 12e-3
T = 0.5e-3
NEEDLE = 0.35e-3
KINDS = {"8 nodes": {"order": 1}, "27 nodes": {"order": 2}}
CONTACTS = [
    Contact(polar_rad=0.0),
    Contact(polar_rad=np.radians(35.0), azimuth_rad=0.3),
    Contact(polar_rad=np.radians(54.7), azimuth_rad=np.pi / 4),
    Contact(polar_rad=1.4, azimuth_rad=-2.0),
]
LEANING = Contact(polar_rad=np.radians(35.0), azimuth_rad=0.4)


@pytest.fixture(scope="module", params=KINDS)
def mesh(request: pytest.FixtureRequest) -> HexMesh:
    return build_mesh(R, T, **KINDS[request.param])


def test_the_pressure_lifts_with_its_value_times_the_area_of_the_opening(
    mesh: HexMesh,
) -> None:
    """Exactly so for any mesh, by the divergence theorem: the area is that of the
    polygon or curve of the base.
    """
    load = pressure_load(mesh)
    area = np.pi * (R - T) ** 2
    np.testing.assert_allclose(
        load.sum(axis=0), [0, 0, area], atol=(2e-3 if mesh.order == 1 else 1e-6) * area
    )
    moment = np.cross(mesh.points_nc, load).sum(axis=0)
    np.testing.assert_allclose(moment, 0.0, atol=1e-12 * area * R)


def test_gravity_pulls_down_with_the_weight_of_the_wall(mesh: HexMesh) -> None:
    points = volume_points(mesh)
    load = gravity_load(mesh, points)
    np.testing.assert_allclose(
        load.sum(axis=0), [0, 0, -points.volumes_ep.sum()], rtol=1e-13, atol=1e-20
    )


def test_the_needles_resultant_is_one_newton_along_the_inward_normal(
    mesh: HexMesh,
) -> None:
    loads = needle_loads(mesh, CONTACTS, NEEDLE)
    np.testing.assert_allclose(
        loads.sum(axis=1), [-c.normal for c in CONTACTS], atol=1e-13
    )


def test_the_needles_force_acts_on_its_axis_over_its_disc() -> None:
    mesh = build_mesh(R, T)
    for contact, load in zip(
        CONTACTS, needle_loads(mesh, CONTACTS, NEEDLE), strict=True
    ):
        amount = -load @ contact.normal
        centre = amount @ mesh.points_nc
        np.testing.assert_allclose(
            np.cross(centre, contact.normal), 0.0, atol=2e-4 * NEEDLE
        )

        # Second moment of a uniform disc: radius^2 / 4 about a diameter.
        for axis in (contact.meridian, contact.parallel):
            assert amount @ (mesh.points_nc @ axis) ** 2 == pytest.approx(
                NEEDLE**2 / 4, rel=1e-2
            )

        loaded = np.flatnonzero(amount)
        assert (
            np.linalg.norm(mesh.points_nc[loaded] - R * contact.normal, axis=1).max()
            < 2e-3
        )
        assert set(loaded) <= set(mesh.outer_qn.ravel())


@pytest.mark.parametrize("polar_deg", [89.0, 90.0, 120.0])
def test_a_needle_that_reaches_over_the_base_is_an_input_error(
    polar_deg: float,
) -> None:
    with pytest.raises(InputError, match=r"polar angle.*over the base"):
        needle_loads(
            build_mesh(R, T),
            [Contact(polar_rad=0.5), Contact(polar_rad=np.radians(polar_deg))],
            NEEDLE,
        )


def test_the_gaussian_load_of_r1_is_normalised_and_has_the_mean_of_its_weight(
    mesh: HexMesh,
) -> None:
    contact = CONTACTS[1]
    spread = 2e-3
    load = gaussian_load(mesh, contact, spread)
    np.testing.assert_allclose(load.sum(axis=0), -contact.normal, atol=1e-13)
    # On a sphere |x - R d|^2 = 2 R^2 (1 - c), so the weight is exp(k c) and the mean of
    # c is coth k - 1/k.
    k = (R / spread) ** 2
    mean_cosine = -(load @ contact.normal) @ (mesh.points_nc @ contact.normal) / R
    assert mean_cosine == pytest.approx(
        1.0 / np.tanh(k) - 1.0 / k, abs=2e-3 if mesh.order == 1 else 1e-4
    )


def assert_disc(
    amount: np.ndarray, offset_nc: np.ndarray, directions: tuple[np.ndarray, ...]
) -> None:
    for direction in directions:
        offset = offset_nc @ direction
        assert abs(amount @ offset) < 1e-3 * NEEDLE
        # of a uniform disc
        assert amount @ offset**2 == pytest.approx(NEEDLE**2 / 4, rel=0.02)


def tilted(angle_rad: float) -> np.ndarray:
    return -np.cos(angle_rad) * LEANING.normal + np.sin(angle_rad) * LEANING.meridian


def test_the_needle_along_the_normal_of_a_sphere_is_that_of_linear_mechanics() -> None:
    mesh = build_mesh(R, 0.5e-3)
    theirs = needle_loads(mesh, [LEANING], NEEDLE)[0]
    np.testing.assert_allclose(
        needle_at(mesh, LEANING, NEEDLE).load_nc,
        theirs,
        atol=1e-5 * np.abs(theirs).max(),
    )


@pytest.mark.parametrize("angle_deg", [0.0, 5.0, 20.0])
def test_the_disc_is_round_and_centred_on_the_contact_as_seen_along_the_axis(
    angle_deg: float,
) -> None:
    """Shape functions of second order reproduce first moments of the load exactly and
    second ones nearly.
    """
    mesh = build_mesh(R, 0.5e-3, divisions=20)
    axis = tilted(np.radians(angle_deg))
    load = needle_at(mesh, LEANING, NEEDLE, axis).load_nc
    np.testing.assert_allclose(load.sum(axis=0), axis, atol=1e-12)
    across = np.cross(axis, LEANING.parallel) / np.linalg.norm(
        np.cross(axis, LEANING.parallel)
    )
    assert_disc(
        load @ axis, mesh.points_nc - R * LEANING.normal, (LEANING.parallel, across)
    )


def test_a_form_moves_the_disc_with_its_surface() -> None:
    mesh = build_mesh(R, 0.5e-3, divisions=20)
    stretch = np.array([1.06, 1.0, 0.95])
    shaped = replace(
        mesh, points_nc=mesh.points_nc * stretch, shaped_from_nc=mesh.points_nc
    )
    load = needle_at(shaped, LEANING, NEEDLE).load_nc
    offset_nc = shaped.points_nc - R * LEANING.normal * stretch
    assert_disc(-load @ LEANING.normal, offset_nc, (LEANING.parallel, LEANING.meridian))


def test_the_tip_is_the_displacement_at_the_contact_along_the_axis() -> None:
    mesh = build_mesh(R, 1e-3, divisions=6)
    axis = tilted(0.1)
    inward = np.array([0.2, -0.1, 0.7])
    assert np.sum(tip_at(mesh, LEANING, axis) * inward) == pytest.approx(inward @ axis)
    # A field that grows along the wall shows that the point is the contact.
    assert np.sum(tip_at(mesh, LEANING, axis) * mesh.points_nc) == pytest.approx(
        R * LEANING.normal @ axis, rel=1e-4
    )
    assert tip_displacement(mesh, LEANING, -0.1 * mesh.points_nc) == pytest.approx(
        0.1 * R, rel=1e-4
    )


@pytest.mark.parametrize(
    "axis",
    [np.array([0.0, 0.0, -2.0]), np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])],
)
def test_an_axis_that_does_not_point_into_the_eye_is_an_input_error(
    axis: np.ndarray,
) -> None:
    with pytest.raises(InputError, match="unit vector"):
        needle_at(
            build_mesh(R, 1e-3, divisions=4), Contact(polar_rad=0.0), NEEDLE, axis
        )


def test_a_needle_over_the_base_is_an_input_error_and_fine_on_a_whole_globe() -> None:
    with pytest.raises(InputError, match="over the base"):
        needle_at(build_mesh(R, 1e-3, divisions=4), Contact(polar_rad=1.56), NEEDLE)
    globe = graded_mesh(R, 1e-3, Contact(polar_rad=1.0), rings=4, whole=True)
    assert needle_at(globe, Contact(polar_rad=1.56), NEEDLE).load_nc.sum() != 0.0


def surface(kind: str = "27 nodes") -> tuple[HexMesh, InnerSurface]:
    mesh = build_mesh(R, 1e-3, divisions=4, level=0, **KINDS[kind])
    return mesh, InnerSurface(mesh)


def noise(mesh: HexMesh, seed: int, held: np.ndarray | None = None) -> np.ndarray:
    moves = np.random.default_rng(seed).normal(size=mesh.points_nc.shape) * 0.2e-3
    return moves if held is None else np.where(held, 0.0, moves)


def test_the_pressure_on_the_undeformed_wall_is_the_dead_load() -> None:
    mesh, inner = surface()
    dead = pressure_load(mesh)
    np.testing.assert_allclose(
        inner.forces(np.zeros_like(dead)), dead, atol=1e-14 * np.abs(dead).max()
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("support", [clamped_base, symmetric_base])
def test_the_tangent_is_the_derivative_where_the_edge_is_held_or_stays_in_its_plane(
    kind: str, support
) -> None:
    """The forces are quadratic in the positions, so the central difference is exact."""
    mesh, inner = surface(kind)
    held = support(mesh)
    held[mesh.base_nodes, 2] = True
    u = noise(mesh, 0, held)
    direction = noise(mesh, 1, held)
    nodes = mesh.cells_en.shape[1]
    elements = np.zeros((len(mesh.cells_en), 3, nodes, 3, nodes))
    inner.add_tangent(elements, u, 2.5)
    np.testing.assert_array_equal(elements, elements.transpose(0, 3, 4, 1, 2))
    slope = (stiffness_matrix(mesh, elements) @ direction.ravel()).reshape(-1, 3)
    difference = 2.5 * (inner.forces(u + direction) - inner.forces(u - direction)) / 2
    np.testing.assert_allclose(
        slope[~held], difference[~held], atol=1e-13 * np.abs(slope).max()
    )
    loose = noise(mesh, 2)  # a free edge would break it
    difference = 2.5 * (inner.forces(u + loose) - inner.forces(u - loose)) / 2
    slope = (stiffness_matrix(mesh, elements) @ loose.ravel()).reshape(-1, 3)
    assert np.abs(slope - difference).max() > 1e-3 * np.abs(slope).max()


@pytest.mark.parametrize("support", [clamped_base, symmetric_base])
def test_the_forces_are_the_derivative_of_the_volume(support) -> None:
    mesh, inner = surface()
    held = support(mesh)
    u = noise(mesh, 3, held)
    direction = 1e-3 * noise(mesh, 4, held)
    change = (inner.volume(u + direction) - inner.volume(u - direction)) / 2
    assert change == pytest.approx(np.sum(inner.forces(u) * direction), rel=1e-6)


def test_the_volume_is_that_of_the_half_sphere_and_scales_with_its_cube() -> None:
    mesh, inner = surface()
    volume = inner.volume(np.zeros_like(mesh.points_nc))
    assert volume == pytest.approx(2 * np.pi / 3 * (R - 1e-3) ** 3, rel=2e-4)
    assert inner.volume(0.1 * mesh.points_nc) == pytest.approx(
        1.1**3 * volume, rel=1e-13
    )


THICKER = 0.8e-3
NU = 0.45
E = 0.3e6
CONTACT = Contact(polar_rad=np.radians(35.0))
NORMAL = 1.4e6
SHEAR = 0.04e6


@cache
def globe(core: int = 4, rings: int = 6) -> HexMesh:
    return graded_mesh(R, THICKER, CONTACT, core=core, rings=rings, whole=True)


def moved(mesh: HexMesh, motion) -> np.ndarray:
    return np.broadcast_to(motion, mesh.points_nc.shape)


def energy(springs: Springs, displacement_nc: np.ndarray) -> float:
    return float(np.sum(springs.forces(displacement_nc) * displacement_nc))


def test_the_beds_stiffness_is_that_of_the_integrals_over_the_half_sphere() -> None:
    """Along z: integral of k cos^2 + s sin^2; along x: of k sin^2 cos^2(azimuth) + ...;
    both over 2 pi R^2.
    """
    mesh = globe(rings=10)
    area = 2 * np.pi * R**2
    bed = elastic_bed(mesh, NORMAL, SHEAR)

    for axis in np.eye(3):
        # over the half-sphere the mean of each squared component of the normal is 1/3
        assert energy(bed, moved(mesh, axis)) == pytest.approx(
            area * (NORMAL + 2 * SHEAR) / 3, rel=2e-3
        )
        # a turn slides everywhere: 2/3 R^2 of its square
        turn_nc = np.cross(axis, mesh.points_nc)
        assert energy(bed, turn_nc) == pytest.approx(
            area * SHEAR * R**2 * 2 / 3, rel=2e-3
        )


def test_the_upper_half_lies_on_no_bed() -> None:
    mesh = globe()
    forces = elastic_bed(mesh, NORMAL, SHEAR).forces(
        moved(mesh, np.array([0.0, 0.0, 1.0]))
    )
    above = mesh.points_nc[:, 2] > 1e-9
    assert np.all(forces[above] == 0.0)
    assert np.all(
        forces[np.setdiff1d(np.arange(len(forces)), np.unique(mesh.outer_qn))] == 0.0
    )


def test_a_half_sphere_has_no_bed() -> None:
    with pytest.raises(InputError, match="lower half"):
        elastic_bed(build_mesh(R, THICKER, divisions=4), NORMAL, SHEAR)


def test_four_straps_hold_along_their_meridians() -> None:
    """Naive sum over many points of each insertion's arc."""
    mesh = globe(rings=12)
    straps = rectus_straps(mesh, 20.0, 0.3)
    expected = 0.0
    motion = np.array([0.3, -0.5, 0.8])

    for polar, azimuth, width in INSERTIONS.values():
        azimuths = 0.3 + azimuth + np.linspace(-0.5, 0.5, 2001) * width / np.sin(polar)
        along_pc = np.array(
            [
                Contact(polar_rad=polar, azimuth_rad=azimuth).meridian
                for azimuth in azimuths
            ]
        )
        expected += 20.0 * np.mean((along_pc @ motion) ** 2)

    assert energy(straps, moved(mesh, motion)) == pytest.approx(expected, rel=1e-3)
    # a turn about z slides across
    assert energy(straps, np.cross([0.0, 0.0, 1.0], mesh.points_nc)) < 1e-6 * R**2


def test_insertions_lie_on_the_spiral_of_tillaux() -> None:
    behind_mm = {
        name: 12.0 * polar - 12.0 * np.arcsin(5.75 / 12)
        for name, (polar, _, _) in INSERTIONS.items()
    }
    assert behind_mm == pytest.approx(
        {"medial": 5.5, "inferior": 6.5, "lateral": 6.9, "superior": 7.7}
    )
    assert [
        name for name, _ in sorted(INSERTIONS.items(), key=lambda item: item[1][1])
    ] == [
        "medial",
        "superior",
        "lateral",
        "inferior",
    ]


def test_the_blocks_in_the_matrix_are_the_forces() -> None:
    mesh = globe()
    springs = elastic_bed(mesh, NORMAL, SHEAR) + rectus_straps(mesh, 20.0)
    nodes = mesh.cells_en.shape[1]
    elements = np.zeros((len(mesh.cells_en), 3, nodes, 3, nodes))
    springs.add_to(elements, 0.5)
    u = np.random.default_rng(0).normal(size=mesh.points_nc.shape)
    K = stiffness_matrix(mesh, elements)
    np.testing.assert_allclose(
        2 * K @ u.ravel(), springs.forces(u).ravel(), atol=1e-12 * abs(K).max()
    )
    assert abs(K - K.T).max() < 1e-14 * abs(K).max()


def test_a_globe_on_a_bed_balances_the_needle_with_the_beds_force() -> None:
    mesh = globe()
    bed = elastic_bed(mesh, NORMAL, SHEAR)
    wall = LinearWall(mesh, NU, springs=bed, springs_modulus_pa=E)
    load_nc = needle_loads(mesh, [CONTACT], 0.35e-3)[0]
    bed_nc = bed.forces(wall.solve_one(load_nc) / E)
    np.testing.assert_allclose(bed_nc.sum(axis=0), load_nc.sum(axis=0), atol=1e-8)
    np.testing.assert_allclose(
        np.cross(mesh.points_nc, bed_nc - load_nc).sum(axis=0), 0.0, atol=1e-8 * R
    )


def test_a_very_stiff_bed_clamps_and_a_wall_of_one_modulus_is_that_of_another_with_scaled_springs():
    mesh = globe(core=2, rings=4)
    bed = elastic_bed(mesh, NORMAL, SHEAR)
    load_nc = needle_loads(mesh, [CONTACT], 0.35e-3)[0]
    doubled = replace(bed, blocks_qnnii=2 * bed.blocks_qnnii)
    one = LinearWall(mesh, NU, springs=bed, springs_modulus_pa=E).solve_one(load_nc)
    other = LinearWall(mesh, NU, springs=doubled, springs_modulus_pa=2 * E).solve_one(
        load_nc
    )
    np.testing.assert_allclose(one, other, atol=1e-9 * np.abs(one).max())
    hard = replace(bed, blocks_qnnii=1e6 * bed.blocks_qnnii)
    held = LinearWall(mesh, NU, springs=hard, springs_modulus_pa=E).solve_one(load_nc)
    lower = mesh.points_nc[:, 2] < -0.2 * R
    assert (
        np.abs(held[lower]).max()
        < 1e-3 * np.abs(held).max()
        < 1e-2 * np.abs(one[lower]).max()
    )


@pytest.mark.slow
def test_the_pressure_of_a_sealed_globe_on_a_bed_follows_the_law() -> None:
    mesh = globe(core=2, rings=4)
    wall = FiniteWall(mesh, NU, springs=elastic_bed(mesh, NORMAL, SHEAR))
    loads = {"youngs_modulus_pa": E, "density_kg_m3": 1100.0}
    law = sealed_law(0.15e9)
    needle = needle_at(mesh, CONTACT, 1e-3)
    path = wall.load_path(
        needle,
        PathEnd(max_force=1.0, max_tip_m=0.6e-3),
        **loads,
        iop_pa=266.0,
        globe=law,
    )
    undented_nc = rest_nc(wall, **loads, iop_pa=float(path.pressures_pa[-1]))
    displaced_m3 = wall.inner.volume(undented_nc) - wall.inner.volume(
        path.displacement_snc[-1]
    )
    assert path.pressures_pa[-1] > 300.0
    assert path.pressures_pa[-1] == pytest.approx(
        law.pressure(266.0, displaced_m3), rel=1e-6
    )


def test_a_studys_springs_follow_its_kind() -> None:
    mesh = globe()
    u = np.random.default_rng(1).normal(size=globe().points_nc.shape)
    bed = elastic_bed(mesh, 2e6, 0.1e6).forces(u)
    straps = rectus_straps(mesh, 30.0, 0.5).forces(u)
    expected = {"bed": bed, "straps": straps, "bed-and-straps": bed + straps}
    study = SupportsStudy(
        bed_stiffness_pa_per_m=2e6,
        bed_shear_stiffness_pa_per_m=0.1e6,
        strap_stiffness_n_per_m=30.0,
        medial_azimuth_rad=0.5,
    )

    for kind, forces_nc in expected.items():
        springs = study_springs(replace(study, kind=kind), mesh)
        assert springs is not None
        np.testing.assert_allclose(
            springs.forces(u), forces_nc, atol=1e-12 * np.abs(forces_nc).max()
        )

    assert study_springs(SupportsStudy(), mesh) is None
