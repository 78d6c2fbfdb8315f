"""Load paths of 3-D walls: closed forms, symmetry, sealed globes; each key of a study
reaches them.
"""

from dataclasses import asdict, replace
from functools import cache
from math import pi, radians

import numpy as np
import pytest
from energy import radial_displacement
from scipy.sparse.linalg import spsolve

from reference_walls import rest_nc, stiffness_matrix, symmetric_base
from scleraforce.base.errors import InputError, SolverError
from scleraforce.base.units import SI_PER_UNIT, STANDARD_GRAVITY_M_S2, to_si
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_elements import volume_points
from scleraforce.mechanics.finite_strain_wall import (
    FiniteWall,
    LoadPath,
    WallEquilibrium,
    bend_eye,
)
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.hexahedral_mesh import HexMesh, build_mesh
from scleraforce.mechanics.linear_wall import LinearWall, tip_displacement
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.loads_and_supports import (
    elastic_bed,
    gravity_load,
    needle_at,
    needle_loads,
    pressure_load,
    rectus_straps,
)
from scleraforce.records import study as st, study_of_eye
from scleraforce.records.globe import CONSTANT_PRESSURE, PressureLaw, sealed_law
from scleraforce.records.study_of_eye import RIGIDITY_LAWS

R = 12e-3
T = 0.8e-3
NU = 0.45
E = 0.3e6
IOP = 266.0
CONTACT = Contact(polar_rad=np.radians(35.0))
LOADS = {"youngs_modulus_pa": E, "iop_pa": IOP, "density_kg_m3": 1100.0}
# A needle wide enough for a mesh of 6 quads.
WIDE = 1.5e-3
GLOBE = sealed_law(0.15e9)  # as rigid as enucleated human eyes


@cache
def coarse_mesh() -> HexMesh:
    return build_mesh(R, T, divisions=6, level=0)


@cache
def coarse_wall() -> FiniteWall:
    return FiniteWall(coarse_mesh(), NU)


@cache
def coarse_path(
    globe: PressureLaw = CONSTANT_PRESSURE, largest_step_m: float = 3e-4
) -> LoadPath:
    needle = needle_at(coarse_mesh(), CONTACT, WIDE)
    return coarse_wall().load_path(
        needle,
        PathEnd(max_force=40e-3, max_tip_m=2e-3, largest_step_m=largest_step_m),
        **LOADS,
        globe=globe,
    )


@pytest.mark.parametrize("kind", ["plain", "dead", "springs"])
def test_small_forces_without_pressure_give_linear_mechanics(kind: str) -> None:
    mesh = (
        graded_mesh(R, T, CONTACT, core=2, rings=4, whole=True)
        if kind == "springs"
        else coarse_mesh()
    )
    springs = (
        elastic_bed(mesh, 1.4e6, 0.04e6) + rectus_straps(mesh, 20.0)
        if kind == "springs"
        else None
    )
    wall = FiniteWall(
        mesh,
        NU,
        dead_pressure_nc=pressure_load(mesh) if kind == "dead" else None,
        springs=springs,
    )
    loads = {
        "youngs_modulus_pa": E,
        "iop_pa": 0.0,
        "density_kg_m3": 0.0,
    }
    end = PathEnd(max_tip_m=1e-7, largest_step_m=5e-8)
    path = wall.load_path(needle_at(mesh, CONTACT, WIDE), end, **loads)
    force_n = 0.9 * path.max_force_n
    linear = LinearWall(mesh, NU, springs=springs, springs_modulus_pa=E)
    linear_nc = linear.solve_one(needle_loads(mesh, [CONTACT], WIDE)[0]) * force_n / E
    assert path.tip_m(force_n) == pytest.approx(
        tip_displacement(mesh, CONTACT, linear_nc), rel=1e-3
    )
    np.testing.assert_allclose(
        path.displacement_nc(force_n), linear_nc, atol=1e-3 * np.abs(linear_nc).max()
    )


def test_little_pressure_and_weight_give_linear_mechanics() -> None:
    linear = LinearWall(coarse_mesh(), NU)
    loads = {"youngs_modulus_pa": 1e10, "iop_pa": 266.0, "density_kg_m3": 1100.0}
    expected_nc = linear.displacement(np.zeros_like(linear.pressure_nc), 0.0, **loads)
    moved_nc = rest_nc(coarse_wall(), **loads)
    np.testing.assert_allclose(
        moved_nc, expected_nc, atol=1e-4 * np.abs(expected_nc).max()
    )


def thick_sphere_error(divisions: int) -> float:
    """Largest error over the largest displacement, for a sphere that swells by 22 %
    inside.
    """
    mesh = build_mesh(R, 4e-3, divisions=divisions, level=0, layers=divisions // 4)
    wall = FiniteWall(mesh, NU, symmetric_base(mesh))
    moved_nc = rest_nc(wall, youngs_modulus_pa=1.0, iop_pa=0.15, density_kg_m3=0.0)
    r = np.linalg.norm(mesh.points_nc, axis=1)
    exact_nc = (radial_displacement(R - 4e-3, R, 0.15, r) / r)[:, None] * mesh.points_nc
    assert np.abs(exact_nc).max() > 1.5e-3

    return float(np.abs(moved_nc - exact_nc).max() / np.abs(exact_nc).max())


@pytest.mark.slow
def test_a_thick_sphere_under_pressure_swells_as_its_radial_equation_says() -> None:
    coarse = thick_sphere_error(4)
    fine = thick_sphere_error(8)
    assert fine < 2e-3
    assert np.log2(coarse / fine) > 2.5


def test_every_state_balances_its_loads() -> None:
    """Reactions of the base against needle, weight, and the pressure on the opening
    that the deformed wall closes.
    """
    path = coarse_path()
    mesh = coarse_mesh()
    wall = coarse_wall()
    weight_nc = 1100.0 * STANDARD_GRAVITY_M_S2 * gravity_load(mesh, volume_points(mesh))
    needle_nc = needle_at(mesh, CONTACT, WIDE).load_nc

    for force_n, displacement_nc in zip(
        path.forces_n, path.displacement_snc, strict=True
    ):
        loads_nc = (
            force_n * needle_nc + weight_nc + IOP * wall.inner.forces(displacement_nc)
        )
        reactions_nc = E * wall.solid.forces(displacement_nc) - loads_nc
        size = np.abs(loads_nc).sum()
        assert (
            np.abs(np.delete(reactions_nc, mesh.base_nodes, axis=0)).max() < 1e-8 * size
        )
        np.testing.assert_allclose(
            np.sum(reactions_nc + loads_nc, axis=0), 0.0, atol=1e-9 * size
        )
        moments = np.cross(
            mesh.points_nc + displacement_nc, reactions_nc + loads_nc
        ).sum(axis=0)
        np.testing.assert_allclose(moments, 0.0, atol=1e-9 * size * R)


@pytest.mark.parametrize("size", [1e-60, 1.0, 1e60])
def test_a_tangent_factored_in_single_precision_solves_as_one_in_double(
    size: float,
) -> None:
    path = coarse_path()
    wall = coarse_wall()
    problem = WallEquilibrium(wall, needle_at(coarse_mesh(), CONTACT, WIDE), E, 1100.0)
    deep = path.displacement_snc[-1].ravel()[wall.free]
    loads_uk = size * np.random.default_rng(3).normal(size=(len(wall.free), 2))
    answers_uk = problem.factor(deep, IOP / E)(loads_uk)
    elements = wall.solid.tangents(wall.full_nc(deep))
    wall.inner.add_tangent(elements, wall.full_nc(deep), -IOP / E)
    tangent = stiffness_matrix(wall.mesh, elements)[wall.free][:, wall.free]
    exact_uk = spsolve(tangent.tocsc(), loads_uk)
    assert np.linalg.norm(answers_uk - exact_uk) < 2e-3 * np.linalg.norm(exact_uk)


def test_the_path_reads_back_its_own_states() -> None:
    path = coarse_path()
    assert path.tips_m[0] == path.forces_n[0] == path.tip_m(0.0) == 0.0
    needle = needle_at(coarse_mesh(), CONTACT, WIDE)

    for tip_m, force_n, displacement_nc in zip(
        path.tips_m, path.forces_n, path.displacement_snc, strict=True
    ):
        assert path.tip_m(force_n) == pytest.approx(tip_m, abs=1e-12)
        np.testing.assert_allclose(
            path.displacement_nc(force_n), displacement_nc, atol=1e-12
        )
        assert np.sum(
            needle.tip_nc * (displacement_nc - path.displacement_snc[0])
        ) == pytest.approx(tip_m, abs=1e-11)
        assert path.pressure_pa(force_n) == pytest.approx(IOP)


def test_only_ratios_to_the_modulus_matter() -> None:
    needle = needle_at(coarse_mesh(), CONTACT, WIDE)
    stiff = coarse_wall().load_path(
        needle,
        PathEnd(max_force=30e-3),
        youngs_modulus_pa=3 * E,
        iop_pa=3 * IOP,
        density_kg_m3=3 * 1100.0,
    )
    np.testing.assert_allclose(
        stiff.displacement_nc(30e-3),
        coarse_path().displacement_nc(10e-3),
        atol=1e-4 * coarse_path().tip_m(10e-3),
    )


@pytest.mark.slow
def test_the_pressure_of_a_sealed_globe_follows_the_volume_that_the_dent_displaces():
    path = coarse_path(GLOBE)
    inner = coarse_wall().inner
    assert path.pressures_pa[0] == pytest.approx(IOP)
    assert np.all(np.diff(path.pressures_pa) > 0.0)
    opened = coarse_path()
    force_n = 0.9 * min(path.max_force_n, opened.max_force_n)
    assert path.pressure_pa(force_n) > 1.1 * IOP
    assert path.tip_m(force_n) < opened.tip_m(force_n)
    assert opened.travel_m(force_n) == opened.tip_m(force_n)

    # The undented wall at the pressure of the last state, on its own.
    undented_nc = rest_nc(
        coarse_wall(), **{**LOADS, "iop_pa": float(path.pressures_pa[-1])}
    )
    displaced_m3 = inner.volume(undented_nc) - inner.volume(path.displacement_snc[-1])
    assert GLOBE.pressure(IOP, displaced_m3) == pytest.approx(
        path.pressures_pa[-1], rel=1e-7
    )
    tip_nc = needle_at(coarse_mesh(), CONTACT, WIDE).tip_nc
    assert np.sum(tip_nc * (path.displacement_snc[-1] - undented_nc)) == pytest.approx(
        path.tips_m[-1], rel=1e-7
    )
    travel_m = np.sum(tip_nc * (path.displacement_snc[-1] - path.displacement_snc[0]))
    assert path.tips_m[-1] - path.rises_m[-1] == pytest.approx(travel_m, rel=1e-7)
    assert path.travel_m(force_n) < path.tip_m(force_n)


def test_a_sealed_globe_with_a_dead_pressure_is_an_input_error() -> None:
    mesh = coarse_mesh()
    wall = FiniteWall(mesh, NU, dead_pressure_nc=pressure_load(mesh))
    with pytest.raises(InputError, match="follow"):
        wall.load_path(
            needle_at(mesh, CONTACT, WIDE),
            PathEnd(max_force=1e-3),
            **LOADS,
            globe=GLOBE,
        )


def path_through(tips_m: np.ndarray, forces_n: np.ndarray) -> LoadPath:
    """Return a path of two nodes that move as the tip does."""
    count = len(tips_m)
    moved_snc = tips_m[:, None, None] * np.ones((count, 2, 3))
    return LoadPath(
        coarse_mesh(), tips_m, forces_n, np.full(count, IOP), np.zeros(count), moved_snc
    )


def made_up_path() -> LoadPath:
    """A path that turns: 0, 3, 2, 4 mN."""
    tips_m = np.linspace(0.0, 3e-3, 31)
    return path_through(
        tips_m, 1e-3 * np.interp(tips_m, [0.0, 1e-3, 2e-3, 3e-3], [0.0, 3.0, 2.0, 4.0])
    )


def test_of_several_states_with_one_force_the_first_is_taken() -> None:
    path = made_up_path()
    assert path.tip_m(2.5e-3) == pytest.approx(2.5e-3 / 3, rel=0.01)
    assert path.tip_m(3.5e-3) == pytest.approx(2.75e-3, rel=0.01)
    np.testing.assert_allclose(
        path.displacement_nc(2.5e-3), path.tip_m(2.5e-3), rtol=1e-9
    )


def test_the_force_of_a_state_is_read_at_that_state_whatever_the_rounding() -> None:
    random = np.random.default_rng(5)
    for _ in range(200):
        tips_m = np.append(0.0, np.cumsum(random.uniform(0.1e-3, 0.5e-3, size=12)))
        forces_n = 5.0 * tips_m + random.uniform(0.1, 1.0) * 1e3 * tips_m**2
        path = path_through(tips_m, forces_n)

        for side in (0.0, 1.0):
            found_m = [
                path.tip_m(float(force_n))
                for force_n in np.nextafter(forces_n[1:-1], side)
            ]
            np.testing.assert_allclose(found_m, tips_m[1:-1], atol=1e-12)


def test_a_force_or_a_dent_that_the_path_does_not_reach_is_an_input_error() -> None:
    path = made_up_path()
    for value, beyond in ((-1e-6, -1e-6), (4.01e-3, 3.1e-3), (np.nan, np.nan)):
        with pytest.raises(InputError, match="carries 0 to 4 mN"):
            path.displacement_nc(value)
        with pytest.raises(InputError, match="goes from 0 to 3 mm"):
            path.displacement_at_tip_nc(beyond)


def test_a_wall_that_may_move_as_a_rigid_body_is_refused() -> None:
    """Free to slide; a globe on nothing; a globe on straps alone, which may turn about
    its axis.
    """
    held = symmetric_base(coarse_mesh())
    held[:, :2] = False
    with pytest.raises(SolverError, match="rigid body"):
        FiniteWall(coarse_mesh(), NU, held)

    globe = graded_mesh(R, T, CONTACT, core=2, rings=4, whole=True)
    for springs in (None, rectus_straps(globe, 20.0)):
        with pytest.raises(SolverError, match="rigid body"):
            FiniteWall(globe, NU, springs=springs)

    FiniteWall(globe, NU, springs=elastic_bed(globe, 1e6, 1e4))


PER_UL = SI_PER_UNIT["mmhg13_per_ul"][1]
UL = 1e-9


def test_the_cube_root_of_the_pressure_rises_by_003_a_microlitre_in_enucleated_human_eyes():
    globe = sealed_law(0.03 * PER_UL)  # van der Werff 1981
    assert globe.pressure(to_si(2.0, "mmhg"), 32.0 * UL) == pytest.approx(
        to_si((2.0 ** (1 / 3) + 0.96) ** 3, "mmhg")
    )
    # 19 Pa a microlitre at 2 mmHg, 73 at 15.
    assert globe.stiffness(to_si(2.0, "mmhg")) * UL == pytest.approx(19.0, abs=0.1)
    assert globe.stiffness(to_si(15.0, "mmhg")) * UL == pytest.approx(73.0, abs=0.1)


def test_the_logarithmic_law_is_friedenwalds_and_has_the_slope_of_its_rigidity_at_15_mmhg():
    globe = sealed_law(0.0407 * PER_UL, "logarithmic")
    ten_ul = globe.pressure(to_si(15.0, "mmhg"), 10.0 * UL) / to_si(15.0, "mmhg")
    # Friedenwald's mean
    assert np.log10(ten_ul) == pytest.approx(10.0 * 0.0215, rel=2e-3)
    cube_root = sealed_law(0.0407 * PER_UL)
    assert globe.stiffness(to_si(15.0, "mmhg")) == pytest.approx(
        cube_root.stiffness(to_si(15.0, "mmhg"))
    )


@pytest.mark.parametrize("law", RIGIDITY_LAWS)
def test_volume_and_pressure_are_inverse_and_the_stiffness_is_the_slope(
    law: str,
) -> None:
    globe = sealed_law(0.02 * PER_UL, law)
    resting = np.full(5, 300.0)
    volumes = np.linspace(0.0, 40.0, 5) * UL
    pressures = globe.pressure(resting, volumes)
    assert (np.diff(pressures) > 0.0).all()
    assert pressures[0] == pytest.approx(300.0)
    np.testing.assert_allclose(
        globe.displaced_m3(resting, pressures), volumes, atol=1e-20
    )
    step = 1e-4 * UL
    slopes = (
        globe.pressure(resting, volumes + step)
        - globe.pressure(resting, volumes - step)
    ) / (2.0 * step)
    np.testing.assert_allclose(globe.stiffness(pressures), slopes, rtol=1e-6)
    # over a modulus
    over_pa = globe.over(0.45e6).pressure(resting / 0.45e6, volumes) * 0.45e6
    np.testing.assert_allclose(over_pa, pressures)


def test_an_open_globe_keeps_its_pressure_and_a_dent_outwards_takes_no_other_below_0():
    assert not CONSTANT_PRESSURE.is_sealed
    assert sealed_law(0.0) == CONSTANT_PRESSURE
    assert CONSTANT_PRESSURE.pressure(266.0, 1e-7) == pytest.approx(266.0)
    assert CONSTANT_PRESSURE.stiffness(266.0) == 0.0
    assert sealed_law(0.03 * PER_UL).pressure(266.0, -1e-6) == 0.0


@pytest.mark.parametrize("law", RIGIDITY_LAWS)
def test_below_no_rigidity_the_law_continues_smoothly_for_a_search_that_needs_both_sides(
    law: str,
) -> None:
    rigidities = PER_UL * np.array([-2e-4, -1e-4, 0.0, 1e-4, 2e-4])
    pressures = sealed_law(rigidities, law).pressure(np.full(5, 300.0), 20.0 * UL)
    assert pressures[2] == pytest.approx(300.0)
    assert (np.diff(pressures) > 0.0).all()
    np.testing.assert_allclose(np.diff(pressures), np.diff(pressures).mean(), rtol=0.01)
    assert sealed_law(-PER_UL, law).is_sealed


def test_no_such_law_and_no_rigidity_that_is_not_finite() -> None:
    with pytest.raises(
        InputError, match="'linear' is not one of cube-root, logarithmic"
    ):
        PressureLaw("linear", 1.0)
    for rigidity in (np.inf, np.nan):
        with pytest.raises(
            InputError, match=r"rigidity: (inf|nan); must be a finite number"
        ):
            sealed_law(rigidity)


@pytest.mark.parametrize("law", RIGIDITY_LAWS)
def test_a_leaking_globe_loses_the_displaced_volume_with_its_time_constant(
    law: str,
) -> None:
    globe = sealed_law(0.02 * PER_UL, law)
    time_s = 0.5 * np.arange(200)
    pushed = np.where(time_s < 40.0, 1.0, 0.0)

    def pressed(push: float, leaked_m3: float) -> float:
        return float(globe.pressure(300.0, 20.0 * UL * push - leaked_m3))

    leaked = globe.leaked_m3(300.0, 60.0, pushed, pressed)
    full = 1.0 - np.exp(-np.minimum(time_s, 40.0) / 30.0)
    expected = 20.0 * full * np.exp(-np.maximum(time_s - 40.0, 0.0) / 30.0)
    np.testing.assert_allclose(leaked / UL, expected, rtol=1e-9)


COARSE = st.Study(mesh=st.MeshStudy(kind="graded", core=4, rings=6))
COARSEST = st.Study(
    mesh=st.MeshStudy(kind="graded", core=2, rings=4),
    eye=st.EyeStudy(density_kg_m3=0.0),
)
WEIGHTLESS = replace(COARSE, eye=st.EyeStudy(density_kg_m3=0.0))
OBLIQUE = Contact(polar_rad=radians(35), azimuth_rad=0.4)
FORCE_N = 0.012


def bent(
    study: st.Study,
    contact: Contact = OBLIQUE,
    max_force_n: float = FORCE_N,
    **given: object,
) -> LoadPath:
    usual = {
        "thickness_m": 0.8e-3,
        "youngs_modulus_pa": 0.3e6,
        "iop_pa": 266.0,
    }
    end = PathEnd(max_force=max_force_n)
    return bend_eye(study, contact, end, **{**usual, **given})


def with_form(form: st.FormStudy, study: st.Study = WEIGHTLESS) -> st.Study:
    return replace(study, form=form)


def test_small_forces_on_an_odd_eye_bend_it_as_linear_mechanics_does() -> None:
    form = st.FormStudy(
        (1.06, 1.0, 0.95),
        (study_of_eye.WaveStudy(amplitude_fraction=0.1, degree=2, polar_rad=0.5),),
    )
    eye = bent(with_form(form), iop_pa=0.0, max_force_n=1e-4)
    wall = LinearWall(eye.mesh, 0.45)
    needle_nc = wall.needle_cnc([OBLIQUE], 0.35e-3)[0]
    linear_m = tip_displacement(eye.mesh, OBLIQUE, needle_nc) * 2e-6 / 0.3e6
    # the needle's disc is laid on the form exactly
    assert eye.tip_m(2e-6) == pytest.approx(linear_m, rel=5e-3)


@pytest.mark.slow
def test_a_wall_that_bursts_says_at_what_pressure_one_like_it_does() -> None:
    given = {"youngs_modulus_pa": 0.1e6, "iop_pa": 4000.0, "thickness_m": 0.5e-3}
    with pytest.raises(
        SolverError,
        match=r"stiffer wall, or less pressure; an even sphere of it bursts at 13 mmHg",
    ):
        bent(COARSE, **given)


@pytest.mark.slow
def test_a_region_that_covers_the_eye_is_another_modulus() -> None:
    whole = study_of_eye.RegionStudy(
        modulus_ratio=2.0, half_angle_rad=pi, edge_rad=radians(0.1)
    )
    everywhere = with_form(st.FormStudy(region=(whole,)))
    np.testing.assert_allclose(
        bent(everywhere, youngs_modulus_pa=0.2e6).displacement_nc(FORCE_N),
        bent(WEIGHTLESS, youngs_modulus_pa=0.4e6).displacement_nc(FORCE_N),
        atol=3e-8,  # other steps, between which the path interpolates
    )


@pytest.mark.slow
def test_a_stiff_cap_under_the_needle_resists_and_a_far_one_hardly_matters() -> None:
    cap = study_of_eye.RegionStudy(modulus_ratio=1.4)
    away = Contact(polar_rad=radians(80), azimuth_rad=OBLIQUE.azimuth_rad + pi)
    plain, near, far = (
        bent(study).tip_m(FORCE_N)
        for study in (
            WEIGHTLESS,
            *(
                with_form(st.FormStudy(region=(replace(cap, **asdict(place)),)))
                for place in (OBLIQUE, away)
            ),
        )
    )
    assert near < 0.8 * plain
    assert far == pytest.approx(plain, rel=0.01)


@pytest.mark.slow
def test_a_thick_spot_under_the_needle_bends_like_a_thick_wall() -> None:
    """A wave of degree 1 along the needle axis makes the wall 10 % thicker there: about
    (1.1)^2 as stiff.
    """
    wave = study_of_eye.WaveStudy(amplitude_fraction=0.1, degree=1, **asdict(OBLIQUE))
    uneven = with_form(st.FormStudy(wave=(wave,)))
    even = bent(WEIGHTLESS).tip_m(FORCE_N)
    thick = bent(WEIGHTLESS, thickness_m=0.88e-3).tip_m(FORCE_N)
    assert bent(uneven).tip_m(FORCE_N) == pytest.approx(thick, rel=0.02)
    assert thick < 0.9 * even


def test_a_leaning_needle_drags_the_wall_to_its_side_and_its_mirror_image_to_the_other():
    # in the plane y = 0, in which the mesh is its own mirror image
    contact = replace(OBLIQUE, azimuth_rad=0.0)
    needles = [
        st.NeedleStudy(tilt_rad=radians(10), tilt_direction_rad=sign * radians(90))
        for sign in (1, -1)
    ]
    left, right = (
        bent(replace(COARSEST, needle=needle), contact) for needle in needles
    )
    assert left.tip_m(FORCE_N) == pytest.approx(right.tip_m(FORCE_N), rel=1e-6)
    at_contact = np.argmin(
        np.linalg.norm(left.mesh.points_nc - 12e-3 * contact.normal, axis=1)
    )

    for eye, sign in ((left, 1.0), (right, -1.0)):
        moved = (
            eye.displacement_nc(FORCE_N)[at_contact]
            - eye.displacement_nc(0.0)[at_contact]
        )
        assert sign * moved @ contact.parallel > 0.01e-3

    mirrored = left.displacement_nc(FORCE_N) * (1.0, -1.0, 1.0)
    nearest = np.linalg.norm(
        (left.mesh.points_nc * (1.0, -1.0, 1.0))[:, None]
        - right.mesh.points_nc[None, :400],
        axis=2,
    ).argmin(axis=0)
    np.testing.assert_allclose(
        mirrored[nearest], right.displacement_nc(FORCE_N)[:400], atol=1e-8
    )


@pytest.mark.slow
def test_in_a_sealed_globe_the_pressure_rises_and_a_dead_pressure_is_another() -> None:
    kinds = {
        "open": {},
        "sealed": {"globe": st.GlobeStudy("sealed")},
        "dead": {"mechanics": st.MechanicsStudy("finite-strain", follower=False)},
    }
    eyes = {name: bent(replace(WEIGHTLESS, **kind)) for name, kind in kinds.items()}
    assert eyes["open"].pressure_pa(FORCE_N) == pytest.approx(266.0)
    assert eyes["sealed"].pressure_pa(FORCE_N) > 270.0
    tips = {name: eye.tip_m(FORCE_N) for name, eye in eyes.items()}
    assert tips["sealed"] < tips["open"]
    assert 1e-5 < abs(tips["dead"] / tips["open"] - 1.0) < 0.05


def test_progress_ends_at_one() -> None:
    shares: list[float] = []
    bent(COARSEST, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


@pytest.mark.slow
def test_an_eye_on_a_bed_is_a_whole_globe_that_gives_way() -> None:
    held = bent(WEIGHTLESS)
    lying = bent(replace(WEIGHTLESS, supports=st.SupportsStudy(kind="bed")))
    assert lying.mesh.points_nc[:, 2].min() < -0.9 * 12e-3
    below = lying.mesh.points_nc[:, 2] < -6e-3
    pushed_nc = lying.displacement_nc(FORCE_N) - lying.displacement_nc(0.0)
    # 0.44 N/mm for the whole eye along its axis.
    assert 0.01e-3 < np.abs(pushed_nc[below]).max() < 0.1e-3
    assert held.tip_m(FORCE_N) < lying.tip_m(FORCE_N) < 1.2 * held.tip_m(FORCE_N)


def test_straps_hold_a_clamped_eye_a_little_more() -> None:
    firm = st.SupportsStudy(kind="straps", strap_stiffness_n_per_m=2e4)
    held = bent(COARSEST)
    strapped = bent(replace(COARSEST, supports=firm))
    assert 0.9 * held.tip_m(FORCE_N) < strapped.tip_m(FORCE_N) < held.tip_m(FORCE_N)
