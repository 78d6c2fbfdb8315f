"""A study's eye at finite strain: form, material, needle and pressure follow the study."""

from dataclasses import asdict, replace
from math import pi, radians

import numpy as np
import pytest

from scleraforce import study as st
from scleraforce.errors import SolverError
from scleraforce.mechanics.contact import Contact
from scleraforce.mechanics.finite_strain import BentEye, bend_eye
from scleraforce.mechanics.linear import LinearWall, tip_displacement

COARSE = st.Study(mesh=st.MeshStudy(kind="graded", core=4, rings=6))
COARSEST = st.Study(mesh=st.MeshStudy(kind="graded", core=2, rings=4), eye=st.EyeStudy(density_kg_m3=0.0))
WEIGHTLESS = replace(COARSE, eye=st.EyeStudy(density_kg_m3=0.0))
CONTACT = Contact(polar_rad=radians(35), azimuth_rad=0.4)
FORCE_N = 0.012


def bent(study: st.Study, contact: Contact = CONTACT, **given: object) -> BentEye:
    usual = {"thickness_m": 0.8e-3, "youngs_modulus_pa": 0.3e6, "iop_pa": 266.0, "max_force_n": FORCE_N}
    return bend_eye(study, contact, **{**usual, **given})


def with_form(form: st.FormStudy, study: st.Study = WEIGHTLESS) -> st.Study:
    return replace(study, form=form)


def test_small_forces_on_an_odd_eye_bend_it_as_linear_mechanics_does() -> None:
    form = st.FormStudy((1.06, 1.0, 0.95), (st.WaveStudy(amplitude_fraction=0.1, degree=2, polar_rad=0.5),))
    eye = bent(with_form(form), iop_pa=0.0, max_force_n=1e-4)
    wall = LinearWall(eye.mesh, 0.45)
    needle_nc = wall.needle_cnc([CONTACT], 0.35e-3)[0]
    linear_m = tip_displacement(eye.mesh, CONTACT, needle_nc) * 2e-6 / 0.3e6
    assert eye.path.tip_m(2e-6) == pytest.approx(linear_m, rel=5e-3)  # the needle's disc is laid on the form exactly


@pytest.mark.slow
def test_a_wall_that_bursts_says_at_what_pressure_one_like_it_does() -> None:
    given = {"youngs_modulus_pa": 0.1e6, "iop_pa": 4000.0, "thickness_m": 0.5e-3}
    with pytest.raises(SolverError, match=r"stiffer wall, or less pressure; an even sphere of it bursts at 13 mmHg"):
        bent(COARSE, **given)


@pytest.mark.slow
def test_a_region_that_covers_the_eye_is_another_modulus() -> None:
    whole = st.RegionStudy(modulus_ratio=2.0, half_angle_rad=pi, edge_rad=radians(0.1))
    everywhere = with_form(st.FormStudy(region=(whole,)))
    np.testing.assert_allclose(
        bent(everywhere, youngs_modulus_pa=0.2e6).path.displacement_nc(FORCE_N),
        bent(WEIGHTLESS, youngs_modulus_pa=0.4e6).path.displacement_nc(FORCE_N),
        atol=3e-8,  # other steps, between which the path interpolates
    )


@pytest.mark.slow
def test_a_stiff_cap_under_the_needle_resists_and_a_far_one_hardly_matters() -> None:
    cap, away = st.RegionStudy(modulus_ratio=1.4), Contact(polar_rad=radians(80), azimuth_rad=CONTACT.azimuth_rad + pi)
    plain, near, far = (
        bent(study).path.tip_m(FORCE_N)
        for study in (
            WEIGHTLESS,
            *(with_form(st.FormStudy(region=(replace(cap, **asdict(place)),))) for place in (CONTACT, away)),
        )
    )
    assert near < 0.8 * plain
    assert far == pytest.approx(plain, rel=0.01)


@pytest.mark.slow
def test_a_thick_spot_under_the_needle_bends_like_a_thick_wall() -> None:
    """A wave of degree 1 along the needle axis makes the wall 10 % thicker there: about (1.1)^2 as stiff."""
    wave = st.WaveStudy(amplitude_fraction=0.1, degree=1, **asdict(CONTACT))
    uneven = with_form(st.FormStudy(wave=(wave,)))
    even, thick = bent(WEIGHTLESS).path.tip_m(FORCE_N), bent(WEIGHTLESS, thickness_m=0.88e-3).path.tip_m(FORCE_N)
    assert bent(uneven).path.tip_m(FORCE_N) == pytest.approx(thick, rel=0.02)
    assert thick < 0.9 * even


def test_a_leaning_needle_drags_the_wall_to_its_side_and_its_mirror_image_to_the_other() -> None:
    contact = replace(CONTACT, azimuth_rad=0.0)  # in the plane y = 0, in which the mesh is its own mirror image
    needles = [st.NeedleStudy(tilt_rad=radians(10), tilt_direction_rad=sign * radians(90)) for sign in (1, -1)]
    left, right = (bent(replace(COARSEST, needle=needle), contact) for needle in needles)
    assert left.path.tip_m(FORCE_N) == pytest.approx(right.path.tip_m(FORCE_N), rel=1e-6)
    at_contact = np.argmin(np.linalg.norm(left.mesh.points_nc - 12e-3 * contact.normal, axis=1))
    for eye, sign in ((left, 1.0), (right, -1.0)):
        moved = eye.path.displacement_nc(FORCE_N)[at_contact] - eye.path.displacement_nc(0.0)[at_contact]
        assert sign * moved @ contact.parallel > 0.01e-3
    mirrored = left.path.displacement_nc(FORCE_N) * (1.0, -1.0, 1.0)
    nearest = np.linalg.norm(
        (left.mesh.points_nc * (1.0, -1.0, 1.0))[:, None] - right.mesh.points_nc[None, :400], axis=2
    ).argmin(axis=0)
    np.testing.assert_allclose(mirrored[nearest], right.path.displacement_nc(FORCE_N)[:400], atol=1e-8)


@pytest.mark.slow
def test_in_a_sealed_globe_the_pressure_rises_and_a_dead_pressure_is_another() -> None:
    kinds = {
        "open": {},
        "sealed": {"globe": st.GlobeStudy("sealed")},
        "dead": {"mechanics": st.MechanicsStudy("finite-strain", follower=False)},
    }
    eyes = {name: bent(replace(WEIGHTLESS, **kind)) for name, kind in kinds.items()}
    assert eyes["open"].path.pressure_pa(FORCE_N) == pytest.approx(266.0)
    assert eyes["sealed"].path.pressure_pa(FORCE_N) > 270.0
    tips = {name: eye.path.tip_m(FORCE_N) for name, eye in eyes.items()}
    assert tips["sealed"] < tips["open"]
    assert 1e-5 < abs(tips["dead"] / tips["open"] - 1.0) < 0.05


def test_progress_ends_at_one() -> None:
    shares: list[float] = []
    bent(COARSEST, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


@pytest.mark.slow
def test_an_eye_on_a_bed_is_a_whole_globe_that_gives_way() -> None:
    held, lying = bent(WEIGHTLESS), bent(replace(WEIGHTLESS, supports=st.SupportsStudy(kind="bed")))
    assert lying.mesh.points_nc[:, 2].min() < -0.9 * 12e-3
    below = lying.mesh.points_nc[:, 2] < -6e-3
    pushed_nc = lying.path.displacement_nc(FORCE_N) - lying.path.displacement_nc(0.0)
    # 0.44 N/mm for the whole eye along its axis.
    assert 0.01e-3 < np.abs(pushed_nc[below]).max() < 0.1e-3
    assert held.path.tip_m(FORCE_N) < lying.path.tip_m(FORCE_N) < 1.2 * held.path.tip_m(FORCE_N)


def test_straps_hold_a_clamped_eye_a_little_more() -> None:
    firm = st.SupportsStudy(kind="straps", strap_stiffness_n_per_m=2e4)
    held, strapped = bent(COARSEST), bent(replace(COARSEST, supports=firm))
    assert 0.9 * held.path.tip_m(FORCE_N) < strapped.path.tip_m(FORCE_N) < held.path.tip_m(FORCE_N)
