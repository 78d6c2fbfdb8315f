"""Virtual eyes: sections at finite strain, and of a globe that turns."""

import json
from dataclasses import asdict, replace
from math import radians

import numpy as np
import pytest

from reference_walls import cut_section
from scleraforce.base.errors import InputError, RecordingError
from scleraforce.base.units import to_si
from scleraforce.front.cli.main import run
from scleraforce.lab import virtual_eye as ve
from scleraforce.lab.virtual_eye import (
    BentSections,
    EyeTurn,
    LinearSections,
    scan_plane,
    study_sections,
)
from scleraforce.lab.virtual_recording import (
    plan_moving_phantom,
    plan_phantom,
    write_phantom,
)
from scleraforce.mechanics.contact_and_section import Contact, ScanPlane, WallSection
from scleraforce.mechanics.finite_strain_wall import bend_eye
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records import study as st, study_of_eye
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import SEALED
from scleraforce.records.motion import Motion
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from virtual_eyes import changed, wall_of

STUDY = st.Study(
    oct=st.OctStudy(columns=128, rows=96),
    mesh=st.MeshStudy(kind="graded", core=2, rings=4),
    mechanics=st.MechanicsStudy("finite-strain"),
    form=st.FormStudy(
        semi_axes=(1.04, 1.0, 0.96),
        wave=(study_of_eye.WaveStudy(amplitude_fraction=0.1, degree=2),),
    ),
)
EYE = Setup(
    eye=Eye("eye-x", thickness_m=800e-6, modulus=Modulus.stated(0.3e6), iop_pa=266.0),
    needle=Needle(gap_m=0.5e-3, polar_rad=0.6, azimuth_rad=0.3),
    scan=Scan(direction_rad=0.2),
)
FORCES_N = (0.012, 0.0, 0.004)


def test_each_section_is_that_of_its_state_alone():
    together = study_sections(EYE, STUDY)(FORCES_N)
    wall = {"thickness_m": 800e-6, "youngs_modulus_pa": 0.3e6, "iop_pa": 266.0}
    bent = bend_eye(STUDY, scan_plane(EYE).contact, PathEnd(max_force=0.012), **wall)

    for force_n, section in zip(FORCES_N, together, strict=True):
        alone = cut_section(bent.mesh, scan_plane(EYE), bent.displacement_nc(force_n))
        assert np.abs(section.outer - alone.outer).max() < 1e-8
        assert np.abs(section.inner - alone.inner).max() < 1e-8

    top = [section.outer[:, 1].min() for section in together]
    assert (
        top[1]
        < 1e-5
        < 0.2e-3
        < together[0].outer[np.abs(together[0].outer[:, 0]) < 0.2e-3, 1].min()
    )


def test_a_larger_force_later_is_answered_and_smaller_ones_stay():
    sections_at = BentSections(EYE, STUDY)
    small = sections_at([0.003])[0]
    large, again = sections_at([0.012, 0.003])
    assert np.abs(again.outer - small.outer).max() < 1e-7  # steps differ
    near = np.abs(small.outer[:, 0]) < 1e-3
    assert np.all(large.outer[near, 1] > small.outer[near, 1] + 0.1e-3)
    assert sections_at([]) == []


def test_small_forces_without_pressure_bend_as_in_linear_mechanics():
    plain = replace(STUDY, form=st.FormStudy(), eye=st.EyeStudy(density_kg_m3=0.0))
    eye = changed(EYE, iop_pa=0.0)
    forces_n = (0.0, 1e-4)
    rest, bent = BentSections(eye, plain)(forces_n)
    linear_rest, linear = LinearSections(eye, plain)(forces_n)
    moved = bent.outer - rest.outer
    linear_moved = linear.outer - linear_rest.outer
    assert np.abs(moved - linear_moved).max() < 0.005 * np.abs(linear_moved).max()


def test_linear_mechanics_refuses_an_eye_that_it_does_not_support():
    linear = {"mechanics": st.MechanicsStudy("linear"), "form": st.FormStudy()}
    leaning = replace(STUDY, needle=st.NeedleStudy(tilt_rad=0.1), **linear)
    with pytest.raises(InputError, match="tilt_deg"):
        study_sections(EYE, leaning)


def test_the_phantom_command_bends_a_sealed_eye_that_stiffens_and_tells_form_tissue_and_pressures(
    tmp_path, capsys
):
    study = tmp_path / "study.toml"
    out = tmp_path / "eye"
    tissue = st.TissueStudy(stiffening=8.0)
    own = replace(STUDY, mechanics=st.MechanicsStudy(), tissue=tissue)
    study.write_text(st.format_study(own))
    options = "--forces-mn 12,0,18 --thickness-um 800 --globe sealed --rigidity 0.02"
    arguments = ["phantom", "--study", str(study), "--out", str(out), *options.split()]
    assert run(arguments) == 2
    assert (
        f"{study}: form.semi_axes, form.wave, tissue.stiffening, globe.kind"
        in capsys.readouterr().err
    )
    assert run([*arguments, "--mechanics", "finite-strain", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    truth = json.loads((out / "truth.json").read_text())
    assert answer["mechanics"] == truth["mechanics"]["kind"] == "finite-strain"
    assert truth["form"]["semi_axes"] == [1.04, 1.0, 0.96]
    polar = np.radians(35.0)
    assert truth["thickness_at_contact_m"] == pytest.approx(
        800e-6 * (1 + 0.1 * (1.5 * np.cos(polar) ** 2 - 0.5))
    )
    pressed_pa, rest_pa, most_pa = (frame["pressure_pa"] for frame in truth["frames"])
    assert rest_pa == pytest.approx(truth["eye"]["iop_pa"])
    assert rest_pa < pressed_pa < most_pa
    assert truth["globe"]["kind"] == answer["globe"] == "sealed"
    assert truth["tissue"]["stiffening"] == answer["stiffening"] == 8.0
    assert truth["globe"]["rigidity_pa13_per_m3"] == pytest.approx(
        0.02 * to_si(1.0, "mmhg") ** (1 / 3) * 1e9
    )
    # as a laboratory knows it
    assert read_recording(out).info.eye.globe == SEALED


def test_a_leaking_eye_is_one_that_does_not_leak_of_the_pressure_that_is_left():
    globe = st.GlobeStudy(
        "sealed", 2.0 * STUDY.globe.rigidity_pa13_per_m3, leak_time_s=20.0
    )
    own = replace(STUDY, globe=globe)
    sections_at = study_sections(EYE, own)
    sections, pressures_pa = sections_at.along(
        lambda time_s: np.where(time_s < 30.0, 0.012, 0.0), [0.0, 20.0, 40.0]
    )
    rest = BentSections(
        changed(EYE, iop_pa=pressures_pa[2]),
        replace(own, globe=replace(globe, leak_time_s=0.0)),
    )
    again_pa = rest.pressures_pa([0.012])[0]
    assert pressures_pa[0] == pytest.approx(
        BentSections(EYE, own).pressures_pa([0.012])[0]
    )
    assert (
        pressures_pa[2]
        < wall_of(EYE).iop_pa
        < pressures_pa[1]
        < again_pa
        < pressures_pa[0]
    )
    here, there = (
        np.interp(1e-3, *section.outer.T) for section in (sections[2], rest([0.0])[0])
    )
    assert here == pytest.approx(there, abs=1e-7)


MOVING = st.PhantomStudy(
    eye_drift_rad=st.fixed(radians(3.0)),
    eye_saccade_rad=st.Range(min=0.0, max=radians(1.0)),
)
UNEVEN = st.FormStudy(wave=(study_of_eye.WaveStudy(amplitude_fraction=0.12, degree=3),))
SMALL = st.OctStudy(columns=64, rows=48)
GRADED = st.MeshStudy(kind="graded", core=4, rings=6)
TURNED_STUDY = st.Study(
    oct=SMALL, mesh=GRADED, mechanics=STUDY.mechanics, form=UNEVEN, phantom=MOVING
)
TURNED_EYE = changed(EYE, thickness_m=600e-6)
TURNED_FORCES_N = (0.0, 0.006, 0.012)
FARTHEST = radians(4.0)


def depths_m(section: WallSection) -> np.ndarray:
    lateral = np.linspace(-5e-3, 5e-3, 101)
    return np.stack(
        [np.interp(lateral, *curve.T) for curve in (section.outer, section.inner)]
    )


def largest_um(found: WallSection, expected: WallSection) -> float:
    return float(np.abs(depths_m(found) - depths_m(expected)).max()) * 1e6


@pytest.mark.slow
# the wall grows thicker fastest at -1.27, along the meridian
@pytest.mark.parametrize("side", [2.2, -1.1])
def test_a_section_between_the_paths_is_that_of_a_path_at_its_own_contact(side):
    turn = EyeTurn(
        about_x_rad=FARTHEST * np.cos(side), about_y_rad=FARTHEST * np.sin(side)
    )
    plane = ve.turned_plane(scan_plane(TURNED_EYE), turn)
    own = changed(
        TURNED_EYE, **asdict(plane.contact), direction_rad=plane.direction_rad
    )
    sections_at = study_sections(TURNED_EYE, TURNED_STUDY)
    assert isinstance(sections_at, ve.TurnedSections)
    found = sections_at.turned(TURNED_FORCES_N, [turn] * 3)
    expected = BentSections(own, TURNED_STUDY)(TURNED_FORCES_N)
    still = sections_at(TURNED_FORCES_N)

    for between, there, start in zip(found, expected, still, strict=True):
        assert largest_um(between, there) < 5.0
        assert largest_um(start, there) > 8.0

    assert largest_um(still[-1], expected[-1]) > 15.0


LINEAR = replace(
    TURNED_STUDY,
    mesh=st.MeshStudy(divisions=4),
    mechanics=st.MechanicsStudy(),
    form=st.FormStudy(),
)


def test_the_truth_of_a_phantom_has_each_frames_turn_and_contact_and_the_recording_the_first(
    tmp_path,
):
    plan = plan_phantom(TURNED_EYE, TURNED_FORCES_N, LINEAR, 3)
    of_one_contact = "eye eye-x: it turns, and its sections have one contact"
    with pytest.raises(RecordingError, match=of_one_contact):
        write_phantom(tmp_path / "rec", plan, lambda _: [], LINEAR)

    write_phantom(tmp_path / "rec", plan, study_sections(TURNED_EYE, LINEAR), LINEAR)
    truth = json.loads((tmp_path / "rec" / "truth.json").read_text())

    for said, turn in zip(truth["frames"], plan.turns, strict=True):
        told = said["turn"]
        assert asdict(turn).items() <= told.items()
        contact = Contact(polar_rad=told["polar_rad"], azimuth_rad=told["azimuth_rad"])
        # the needle stays in space
        assert rotated(contact.normal, turn) == pytest.approx(
            scan_plane(TURNED_EYE).contact.normal, abs=1e-12
        )
        assert told["thickness_at_contact_m"] == pytest.approx(600e-6)

    info = read_recording(tmp_path / "rec").info
    assert info.needle.polar_rad == wall_of(TURNED_EYE).polar_rad
    assert info.scan.direction_rad == scan_plane(TURNED_EYE).direction_rad


PLANE = ScanPlane(
    Contact(polar_rad=0.7, azimuth_rad=2.9),
    gap_m=0.5e-3,
    direction_rad=-1.1,
    tilt_rad=0.05,
)


def rotated(vector, turn):
    """The rotation of space that takes the globe there, by Rodrigues' formula."""
    axis = np.array([turn.about_x_rad, turn.about_y_rad, 0.0])
    angle = np.linalg.norm(axis)
    axis /= angle
    along = (1 - np.cos(angle)) * (axis @ vector) * axis
    return np.cos(angle) * vector + np.sin(angle) * np.cross(axis, vector) + along


@pytest.mark.parametrize(("x", "y"), [(0.05, -0.02), (-0.4, 0.3), (0.0, 0.01)])
def test_the_plane_stays_in_space_while_the_globe_turns(x: float, y: float):
    turn = EyeTurn(about_x_rad=x, about_y_rad=y)
    seen = ve.turned_plane(PLANE, turn)

    for name in ("lateral", "depth", "normal"):
        assert rotated(getattr(seen, name), turn) == pytest.approx(
            getattr(PLANE, name), abs=1e-12
        )

    assert rotated(seen.origin(12e-3), turn) == pytest.approx(
        PLANE.origin(12e-3), abs=1e-15
    )


def turns_of(phantom: st.PhantomStudy, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Times and turns of an eye that a needle holds for a minute."""
    motion = Motion(rate_hz=10.0, ramp_n_per_s=0.02, hold_s=60.0)
    study = replace(STUDY, phantom=phantom)
    plan = plan_moving_phantom(EYE, (0.02,), study, seed, motion)
    times_s = np.array([frame.time_s for frame in plan.frames])
    return times_s, np.array([list(asdict(turn).values()) for turn in plan.turns])


@pytest.mark.parametrize("seed", range(3))
def test_a_drift_grows_evenly_to_one_side(seed: int):
    times_s, turns = turns_of(st.PhantomStudy(eye_drift_rad=st.fixed(0.04)), seed)
    assert np.linalg.norm(turns[-1]) == pytest.approx(0.04)
    assert turns == pytest.approx(np.outer(times_s / times_s[-1], turns[-1]))


def test_saccades_leave_the_drift_every_second_to_every_side():
    saccades = st.PhantomStudy(eye_saccade_rad=st.Range(min=0.005, max=0.015))
    times_s, turns = turns_of(saccades, 1)
    sizes = np.linalg.norm(turns, axis=1)
    assert 0.005 <= sizes.min() < 0.006 < 0.014 < sizes.max() <= 0.015
    jumps = np.linalg.norm(np.diff(turns, axis=0), axis=1) > 1e-9
    assert np.diff(times_s[1:][jumps]) == pytest.approx(1.0)
    sides = np.arctan2(*turns[::10].T)
    assert np.histogram(sides, 4, (-np.pi, np.pi))[0].min() > 5
