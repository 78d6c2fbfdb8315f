"""Load paths of 3-D eyes: closed forms, linear mechanics, sealed globes; each key of a
study reaches them.
"""

from collections.abc import Callable
from dataclasses import asdict, replace
from math import pi, radians

import numpy as np
import pytest
from cavity import cavity_m3
from energy import NU, radial_displacement

from scleraforce.base.errors import InputError, SolverError
from scleraforce.base.units import SI_PER_UNIT, to_si
from scleraforce.mechanics.axisymmetric_wall import EvenWall, axisymmetric_path
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_strain_wall import LoadPath, bend_eye
from scleraforce.mechanics.hexahedral_mesh import build_mesh
from scleraforce.mechanics.linear_wall import LinearWall
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.loads_and_supports import study_springs
from scleraforce.records import study as st, study_of_eye
from scleraforce.records.globe import (
    CONSTANT_PRESSURE,
    PressureLaw,
    sealed_law,
    study_law,
)
from scleraforce.records.study_of_eye import RIGIDITY_LAWS

R = 12e-3
T = 0.8e-3
E = 0.3e6
IOP = 266.0
FORCE_N = 0.012
OBLIQUE = Contact(polar_rad=radians(35), azimuth_rad=0.4)
POLE = Contact(polar_rad=0.0)
COARSE = st.Study(
    mesh=st.MeshStudy(kind="graded", core=2, rings=4),
    eye=st.EyeStudy(density_kg_m3=0.0),
)
SEALED = st.GlobeStudy("sealed")
BED = st.SupportsStudy(kind="bed")
DEAD = st.MechanicsStudy("finite-strain", follower=False)


def bent(
    study: st.Study = COARSE,
    contact: Contact = OBLIQUE,
    end: PathEnd | None = None,
    **given: object,
) -> LoadPath:
    usual = {"thickness_m": T, "youngs_modulus_pa": E, "iop_pa": IOP}
    return bend_eye(
        study, contact, end or PathEnd(max_force=FORCE_N), **{**usual, **given}
    )


@pytest.fixture(scope="module")
def path() -> LoadPath:
    return bent()


ODD = st.FormStudy(
    (1.06, 1.0, 0.95),
    (study_of_eye.WaveStudy(amplitude_fraction=0.1, degree=2, polar_rad=0.5),),
)
# as firm beside the modulus as the default beside that of an eye
FIRM = st.SupportsStudy(
    kind="bed-and-straps",
    bed_stiffness_pa_per_m=4e9,
    bed_shear_stiffness_pa_per_m=1e8,
    strap_stiffness_n_per_m=6e4,
)


@pytest.mark.parametrize(
    ("more", "rtol"),
    [
        ({}, 2e-3),
        ({"mechanics": DEAD}, 2e-3),
        ({"supports": FIRM}, 2e-3),
        ({"form": ODD}, 8e-3),  # the needle's disc is laid on the form exactly
    ],
    ids=["plain", "dead", "springs", "form"],
)
def test_small_loads_bend_an_eye_as_linear_mechanics_does(
    more: dict[str, object], rtol: float
) -> None:
    modulus_pa = 1e9
    force_n = 0.05
    study = replace(COARSE, eye=st.EyeStudy(density_kg_m3=5000.0), **more)
    loads = {"youngs_modulus_pa": modulus_pa, "iop_pa": 2000.0}
    found = bent(study, end=PathEnd(max_force=force_n), **loads)
    wall = LinearWall(
        found.mesh,
        NU,
        springs=study_springs(study.supports, found.mesh),
        springs_modulus_pa=modulus_pa,
    )
    needle_nc = wall.needle_cnc([OBLIQUE], 0.35e-3)[0]

    for pushed_n in (0.0, force_n):
        linear_nc = wall.displacement(
            needle_nc, pushed_n, **loads, density_kg_m3=5000.0
        )
        np.testing.assert_allclose(
            found.displacement_nc(pushed_n),
            linear_nc,
            atol=rtol * np.abs(linear_nc).max(),
        )


def assert_swollen(
    ratio: float, tissue: st.TissueStudy, exact: Callable, rtol: float
) -> None:
    """Check the displacement of a thick globe under p/E along its radii; its bed is
    soft, and only shifts it.
    """
    soft = replace(BED, bed_stiffness_pa_per_m=1e5, bed_shear_stiffness_pa_per_m=1e5)
    mesh = replace(COARSE.mesh, layers=2)
    globe = bent(
        replace(COARSE, mesh=mesh, supports=soft, tissue=tissue),
        POLE,
        PathEnd(max_tip_m=1e-4),
        thickness_m=THICK,
        youngs_modulus_pa=3e6,
        iop_pa=3e6 * ratio,
    )
    radii = np.linalg.norm(globe.mesh.points_nc, axis=1)
    expected = exact(radii)
    along = globe.mesh.points_nc * (expected / radii)[:, None]
    off = globe.displacement_snc[0] - along
    np.testing.assert_allclose(
        off, np.broadcast_to(off.mean(axis=0), off.shape), atol=rtol * expected.max()
    )


THICK = 4e-3


def test_a_thick_globe_under_pressure_swells_as_its_radial_equation_says() -> None:
    """By 22 % inside."""
    assert_swollen(
        0.15,
        st.TissueStudy(),
        lambda r: radial_displacement(R - THICK, R, 0.15, r),
        5e-3,
    )


def test_a_thick_fibred_globe_swells_under_pressure_as_the_closed_form_says() -> None:
    """u = A r^m + B r^n with m, n = -1/2 +- sqrt(1/4 + 2 (C11 + C12 - C13)/C33)
    (Lekhnitskii, sec. 62).
    """
    softer = 8.0
    ratio = 1e-4
    # between the fibres Hooke's law of E/8; along the wall E and nu without stress
    # through it
    per_volume = 1.0 / softer / ((1.0 + NU) * (1.0 - 2.0 * NU))
    C33 = per_volume * (1.0 - NU)
    C13 = per_volume * NU
    both = 1.0 / (1.0 - NU) + 2.0 * C13**2 / C33  # C11 + C12
    root = np.sqrt(0.25 + 2.0 * (both - C13) / C33)
    powers = np.array([-0.5 + root, -0.5 - root])
    ends = np.array([R - THICK, R])[:, None]
    stress = (C33 * powers + 2.0 * C13) * ends ** (powers - 1.0)
    A = np.linalg.solve(stress, [-ratio, 0.0])
    assert_swollen(
        ratio,
        st.TissueStudy(softer_through=softer),
        lambda r: r[:, None] ** powers @ A,
        2e-2,
    )


@pytest.mark.slow
@pytest.mark.parametrize("globe", [st.GlobeStudy(), SEALED], ids=["open", "sealed"])
def test_an_eye_that_stiffens_is_the_same_in_three_dimensions_and_of_revolution(
    globe: st.GlobeStudy,
) -> None:
    b = 20.0
    thickness_m = 0.6e-3
    study = replace(
        COARSE,
        mesh=st.MeshStudy(kind="graded", core=4, rings=10),
        tissue=st.TissueStudy(stiffening=b),
        globe=globe,
    )
    end = PathEnd(max_force=1.0, max_tip_m=1.2e-3)
    solid = bent(study, POLE, end, thickness_m=thickness_m)
    tips_m = np.array([0.4e-3, 0.8e-3, 1.2e-3])
    even = EvenWall(R, thickness_m, NU, 0.35e-3, stiffening=b)
    flat, plain = (
        axisymmetric_path(
            wall, IOP / E, PathEnd(tips_m=tips_m), study_law(globe).over(E)
        )
        for wall in (even, replace(even, stiffening=0.0))
    )
    forces_n = np.interp(tips_m, solid.tips_m, solid.forces_n)
    np.testing.assert_allclose(forces_n, E * flat.force_ratio_m2[1:], rtol=0.02)
    assert np.all(flat.force_ratio_m2[2:] > 1.15 * plain.force_ratio_m2[2:])


def test_the_path_reads_back_its_own_states(path: LoadPath) -> None:
    assert path.tips_m[0] == path.forces_n[0] == path.tip_m(0.0) == 0.0
    for tip_m, force_n, displacement_nc in zip(
        path.tips_m, path.forces_n, path.displacement_snc, strict=True
    ):
        assert path.tip_m(force_n) == pytest.approx(tip_m, abs=1e-12)
        np.testing.assert_allclose(
            path.displacement_nc(force_n), displacement_nc, atol=1e-12
        )
        assert path.pressure_pa(force_n) == pytest.approx(IOP)
        assert path.travel_m(force_n) == path.tip_m(force_n)


def test_only_ratios_to_the_modulus_matter() -> None:
    light, heavy = (
        replace(COARSE, eye=st.EyeStudy(density_kg_m3=density))
        for density in (1500.0, 4500.0)
    )
    tripled = {"youngs_modulus_pa": 3.0 * E, "iop_pa": 3.0 * IOP}
    stiff = bent(heavy, end=PathEnd(max_force=3.0 * FORCE_N), **tripled)
    np.testing.assert_allclose(
        stiff.displacement_nc(3.0 * FORCE_N),
        bent(light).displacement_nc(FORCE_N),
        atol=1e-8,
    )


@pytest.mark.parametrize("supports", [st.SupportsStudy(), BED], ids=["base", "bed"])
def test_the_pressure_of_a_sealed_globe_follows_the_volume_that_the_dent_displaces(
    supports: st.SupportsStudy,
) -> None:
    study = replace(COARSE, globe=SEALED, supports=supports)
    sealed = bent(study)
    pressure_pa = float(sealed.pressures_pa[-1])
    assert sealed.pressures_pa[0] == pytest.approx(IOP)
    assert np.all(np.diff(sealed.pressures_pa) > 0.0)
    assert pressure_pa > 1.02 * IOP

    # an open globe at the pressure of the last state
    opened = bent(replace(study, globe=st.GlobeStudy()), iop_pa=pressure_pa)
    undented_nc = opened.displacement_snc[0]
    dented_nc = sealed.displacement_snc[-1]
    volumes_m3 = [cavity_m3(sealed.mesh, each) for each in (undented_nc, dented_nc)]
    law = study_law(SEALED)
    assert law.pressure(IOP, volumes_m3[0] - volumes_m3[1]) == pytest.approx(
        pressure_pa, rel=1e-7
    )
    np.testing.assert_allclose(
        opened.displacement_at_tip_nc(sealed.tips_m[-1]), dented_nc, atol=1e-8
    )
    contact = np.argmin(
        np.linalg.norm(sealed.mesh.points_nc - R * OBLIQUE.normal, axis=1)
    )
    risen_m = (undented_nc - sealed.displacement_snc[0])[contact] @ OBLIQUE.normal
    assert sealed.rises_m[-1] == pytest.approx(risen_m, rel=1e-3)
    travel_m = sealed.travel_m(sealed.forces_n[-1])
    assert travel_m == pytest.approx(sealed.tips_m[-1] - sealed.rises_m[-1], rel=1e-9)


def test_a_dead_pressure_bends_an_eye_otherwise(path: LoadPath) -> None:
    dead = bent(replace(COARSE, mechanics=DEAD))
    assert 1e-5 < abs(dead.tip_m(FORCE_N) / path.tip_m(FORCE_N) - 1.0) < 0.05


@pytest.mark.parametrize(
    ("study", "given", "error", "message"),
    [
        (
            replace(COARSE, mechanics=DEAD, globe=SEALED),
            {},
            InputError,
            "pressure has to follow",
        ),
        pytest.param(
            COARSE,
            {"youngs_modulus_pa": 0.1e6, "iop_pa": 4000.0, "thickness_m": 0.5e-3},
            SolverError,
            "less pressure; an even sphere of it bursts at 13 mmHg",
            marks=pytest.mark.slow,
        ),
    ],
    ids=["sealed and dead", "bursts"],
)
def test_an_eye_that_cannot_be_bent_is_refused(
    study: st.Study, given: dict[str, float], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        bent(study, **given)


def path_through(tips_m: np.ndarray, forces_n: np.ndarray) -> LoadPath:
    """Return a path of two nodes that move as the tip does."""
    count = len(tips_m)
    moved_snc = tips_m[:, None, None] * np.ones((count, 2, 3))
    mesh = build_mesh(R, T, divisions=2, level=0, order=1)
    return LoadPath(
        mesh, tips_m, forces_n, np.full(count, IOP), np.zeros(count), moved_snc
    )


def made_up_path() -> LoadPath:
    """A path that turns: 0, 3, 2, 4 mN."""
    tips_m = np.linspace(0.0, 3e-3, 31)
    return path_through(
        tips_m, 1e-3 * np.interp(tips_m, [0.0, 1e-3, 2e-3, 3e-3], [0.0, 3.0, 2.0, 4.0])
    )


def test_of_several_states_with_one_force_the_first_is_taken() -> None:
    turning = made_up_path()
    assert turning.tip_m(2.5e-3) == pytest.approx(2.5e-3 / 3, rel=0.01)
    assert turning.tip_m(3.5e-3) == pytest.approx(2.75e-3, rel=0.01)
    np.testing.assert_allclose(
        turning.displacement_nc(2.5e-3), turning.tip_m(2.5e-3), rtol=1e-9
    )


def test_the_force_of_a_state_is_read_at_that_state_whatever_the_rounding() -> None:
    random = np.random.default_rng(5)
    for _ in range(40):
        tips_m = np.append(0.0, np.cumsum(random.uniform(0.1e-3, 0.5e-3, size=12)))
        forces_n = 5.0 * tips_m + random.uniform(0.1, 1.0) * 1e3 * tips_m**2
        curved = path_through(tips_m, forces_n)

        for side in (0.0, 1.0):
            found_m = [
                curved.tip_m(float(force_n))
                for force_n in np.nextafter(forces_n[1:-1], side)
            ]
            np.testing.assert_allclose(found_m, tips_m[1:-1], atol=1e-12)


@pytest.mark.parametrize(
    ("force_n", "tip_m"), [(-1e-6, -1e-6), (4.01e-3, 3.1e-3), (np.nan, np.nan)]
)
def test_a_force_or_a_dent_that_the_path_does_not_reach_is_an_input_error(
    force_n: float, tip_m: float
) -> None:
    with pytest.raises(InputError, match="carries 0 to 4 mN"):
        made_up_path().displacement_nc(force_n)
    with pytest.raises(InputError, match="goes from 0 to 3 mm"):
        made_up_path().displacement_at_tip_nc(tip_m)


PER_UL = SI_PER_UNIT["mmhg13_per_ul"][1]
UL = 1e-9


@pytest.mark.parametrize("law", RIGIDITY_LAWS)
def test_volume_and_pressure_are_inverse_and_the_stiffness_is_the_slope(
    law: str,
) -> None:
    globe = sealed_law(0.02 * PER_UL, law)
    resting = np.full(5, 300.0)
    volumes = np.linspace(0.0, 40.0, 5) * UL
    pressures = globe.pressure(resting, volumes)
    np.testing.assert_allclose(
        globe.displaced_m3(resting, pressures), volumes, atol=1e-20
    )
    slopes = [globe.pressure(resting, volumes + step) for step in (1e-13, -1e-13)]
    np.testing.assert_allclose(
        globe.stiffness(pressures), np.subtract(*slopes) / 2e-13, rtol=1e-5
    )
    over_pa = globe.over(0.45e6).pressure(resting / 0.45e6, volumes) * 0.45e6
    np.testing.assert_allclose(over_pa, pressures)
    # for a search that needs both sides of an open globe
    around = sealed_law(PER_UL * np.array([-1e-4, 0.0, 1e-4]), law)
    steps = np.diff(around.pressure(np.full(3, 300.0), 20.0 * UL))
    assert steps[0] == pytest.approx(steps[1], rel=0.01)
    assert steps[0] > 0.0


def test_the_laws_are_those_that_were_measured() -> None:
    # van der Werff 1981: the cube root rises by 0.03 a microlitre
    assert sealed_law(0.03 * PER_UL).pressure(
        to_si(2.0, "mmhg"), 32.0 * UL
    ) == pytest.approx(to_si((2.0 ** (1 / 3) + 0.96) ** 3, "mmhg"))
    # Friedenwald's mean
    ten_ul = sealed_law(0.0407 * PER_UL, "logarithmic").pressure(1.0, 10.0 * UL)
    assert np.log10(ten_ul) == pytest.approx(10.0 * 0.0215, rel=2e-3)
    assert sealed_law(0.0) == CONSTANT_PRESSURE
    assert CONSTANT_PRESSURE.pressure(266.0, 1e-7) == pytest.approx(266.0)
    assert sealed_law(0.03 * PER_UL).pressure(266.0, -1e-6) == 0.0


@pytest.mark.parametrize(("law", "rate"), [("linear", 1.0), ("cube-root", np.nan)])
def test_another_law_and_a_rigidity_that_is_not_finite_are_refused(
    law: str, rate: float
) -> None:
    with pytest.raises(InputError, match="rigidity"):
        PressureLaw(law, rate)


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


def region(ratio: float, place: Contact = OBLIQUE, **size: float) -> st.Study:
    found = study_of_eye.RegionStudy(modulus_ratio=ratio, **asdict(place), **size)
    return replace(COARSE, form=st.FormStudy(region=(found,)))


def test_a_region_that_covers_the_eye_is_another_modulus() -> None:
    everywhere = region(2.0, half_angle_rad=pi, edge_rad=radians(0.1))
    np.testing.assert_allclose(
        bent(everywhere, youngs_modulus_pa=0.2e6).displacement_nc(FORCE_N),
        bent(youngs_modulus_pa=0.4e6).displacement_nc(FORCE_N),
        atol=3e-8,  # other steps, between which the path interpolates
    )


def test_a_stiff_cap_under_the_needle_resists_and_a_far_one_hardly_matters(
    path: LoadPath,
) -> None:
    away = Contact(polar_rad=radians(80), azimuth_rad=OBLIQUE.azimuth_rad + pi)
    plain, near, far = (
        each.tip_m(FORCE_N)
        for each in (path, bent(region(1.4)), bent(region(1.4, away)))
    )
    assert near < 0.8 * plain
    assert far == pytest.approx(plain, rel=0.02)


def test_a_thick_spot_under_the_needle_bends_like_a_thick_wall(path: LoadPath) -> None:
    """A wave of degree 1 along the needle axis makes the wall 10 % thicker there: about
    (1.1)^2 as stiff.
    """
    wave = study_of_eye.WaveStudy(amplitude_fraction=0.1, degree=1, **asdict(OBLIQUE))
    uneven = replace(COARSE, form=st.FormStudy(wave=(wave,)))
    thick = bent(thickness_m=1.1 * T).tip_m(FORCE_N)
    assert bent(uneven).tip_m(FORCE_N) == pytest.approx(thick, rel=0.02)
    assert thick < 0.9 * path.tip_m(FORCE_N)


def test_a_leaning_needle_drags_the_wall_to_its_side_and_its_mirror_image_to_the_other():
    # in the plane y = 0, in which the mesh is its own mirror image
    contact = replace(OBLIQUE, azimuth_rad=0.0)
    left, right = (
        bent(
            replace(
                COARSE,
                needle=st.NeedleStudy(
                    tilt_rad=radians(10), tilt_direction_rad=radians(degrees)
                ),
            ),
            contact,
        )
        for degrees in (90, -90)
    )
    assert left.tip_m(FORCE_N) == pytest.approx(right.tip_m(FORCE_N), rel=1e-6)
    points_nc = left.mesh.points_nc
    mirror = points_nc * (1.0, -1.0, 1.0)
    nearest = np.linalg.norm(mirror[:, None] - points_nc, axis=2).argmin(axis=0)
    moved_nc = left.displacement_nc(FORCE_N)
    np.testing.assert_allclose(
        moved_nc[nearest] * (1.0, -1.0, 1.0), right.displacement_nc(FORCE_N), atol=1e-8
    )
    at_contact = np.argmin(np.linalg.norm(points_nc - R * contact.normal, axis=1))
    pushed = (moved_nc - left.displacement_nc(0.0))[at_contact]
    assert pushed @ contact.parallel > 0.01e-3


def test_progress_ends_at_one() -> None:
    shares: list[float] = []
    bent(progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_an_eye_on_a_bed_is_a_whole_globe_that_gives_way(path: LoadPath) -> None:
    lying = bent(replace(COARSE, supports=BED))
    below = lying.mesh.points_nc[:, 2] < -6e-3
    pushed_nc = lying.displacement_nc(FORCE_N) - lying.displacement_nc(0.0)
    # 0.44 N/mm for the whole eye along its axis.
    assert 0.01e-3 < np.abs(pushed_nc[below]).max() < 0.1e-3
    assert path.tip_m(FORCE_N) < lying.tip_m(FORCE_N) < 1.2 * path.tip_m(FORCE_N)


def test_straps_hold_a_clamped_eye_a_little_more(path: LoadPath) -> None:
    firm = st.SupportsStudy(kind="straps", strap_stiffness_n_per_m=2e4)
    strapped = bent(replace(COARSE, supports=firm))
    assert 0.9 * path.tip_m(FORCE_N) < strapped.tip_m(FORCE_N) < path.tip_m(FORCE_N)
