"""Sections of an eye that turns under the needle, against load paths at the frame's own contact."""

import json
from dataclasses import asdict, replace
from math import pi, radians

import numpy as np
import pytest
from effects import contents

from scleraforce.cli.main import run
from scleraforce.errors import RecordingError
from scleraforce.laboratory.phantom import plan_moving_phantom, plan_phantom, plan_sections, write_phantom
from scleraforce.laboratory.virtual_eye import (
    STILL,
    BentSections,
    EyeTurn,
    PhantomEye,
    TurnedSections,
    knot_turns,
    linear_sections,
    pressures_pa,
    study_sections,
    turned_eyes,
    turned_plane,
)
from scleraforce.mechanics.contact import Contact, Section
from scleraforce.mechanics.form import thickness_factor
from scleraforce.recording.folder import read_recording
from scleraforce.study import (
    FormStudy,
    GlobeStudy,
    MechanicsStudy,
    MeshStudy,
    NeedleStudy,
    OctStudy,
    PhantomStudy,
    Range,
    Study,
    WaveStudy,
    fixed,
    format_study,
)

MOVING = PhantomStudy(eye_drift_rad=fixed(radians(3.0)), eye_saccade_rad=Range(min=0.0, max=radians(1.0)))
STUDY = Study(
    oct=OctStudy(columns=64, rows=48),
    mesh=MeshStudy(kind="graded", core=4, rings=6),
    mechanics=MechanicsStudy("finite-strain"),
    form=FormStudy(wave=(WaveStudy(amplitude_fraction=0.12, degree=3),)),
    phantom=MOVING,
)
EYE = PhantomEye(
    id="eye-x",
    thickness_m=600e-6,
    youngs_modulus_pa=0.3e6,
    iop_pa=266.0,
    gap_m=0.5e-3,
    polar_rad=0.6,
    azimuth_rad=0.3,
    direction_rad=0.2,
)
FORCES_N = (0.0, 0.006, 0.012)
FARTHEST = radians(4.0)


def depths_m(section: Section) -> np.ndarray:
    lateral = np.linspace(-5e-3, 5e-3, 101)
    return np.stack([np.interp(lateral, *curve.T) for curve in (section.outer, section.inner)])


def largest_um(found: Section, expected: Section) -> float:
    return float(np.abs(depths_m(found) - depths_m(expected)).max()) * 1e6


@pytest.mark.slow
@pytest.mark.parametrize("side", [2.2, -1.1])  # the wall grows thicker fastest at -1.27, along the meridian
def test_a_section_between_the_paths_is_that_of_a_path_at_its_own_contact(side) -> None:
    turn = EyeTurn(about_x_rad=FARTHEST * np.cos(side), about_y_rad=FARTHEST * np.sin(side))
    plane = turned_plane(EYE.plane, turn)
    own = replace(
        EYE,
        polar_rad=plane.contact.polar_rad,
        azimuth_rad=plane.contact.azimuth_rad,
        direction_rad=plane.direction_rad,
    )
    sections_at = study_sections(EYE, STUDY)
    assert isinstance(sections_at, TurnedSections)
    found = sections_at.turned(FORCES_N, [turn] * 3)
    expected = BentSections(own, STUDY)(FORCES_N)
    still = sections_at(FORCES_N)
    for between, there, start in zip(found, expected, still, strict=True):
        assert largest_um(between, there) < 5.0
        assert largest_um(start, there) > 8.0
    assert largest_um(still[-1], expected[-1]) > 15.0


def test_paths_at_turned_contacts_are_blended_by_how_far_the_eye_turns_about_each_axis() -> None:
    """Three walls, flat, at 1, 1.2 and 0.9 mm: a turn by half the reach about one axis goes half the way."""
    lateral = np.linspace(-8e-3, 8e-3, 81)

    def flat_at(depth_m, first=0, last=80):
        outer = np.stack([lateral, np.full(81, depth_m)], axis=1)[first : last + 1]
        wall = Section(outer, outer + np.array([0.0, 6e-4]))
        return lambda forces_n: [wall.shifted(0.0, force_n) for force_n in forces_n]

    sections = TurnedSections([flat_at(1e-3), flat_at(1.2e-3, 10), flat_at(0.9e-3, 0, 70)], 0.1)
    turns = [
        STILL,
        EyeTurn(about_x_rad=0.05, about_y_rad=0.0),
        EyeTurn(about_x_rad=0.0, about_y_rad=-0.1),
        EyeTurn(about_x_rad=0.1, about_y_rad=0.1),
    ]
    found = sections.turned([0.0, 1e-4, 0.0, 0.0], turns)
    assert [section.outer[:, 1].mean() for section in found] == pytest.approx([1e-3, 1.2e-3, 1.1e-3, 1.1e-3])
    assert [section.inner[:, 1].mean() for section in found] == pytest.approx([1.6e-3, 1.8e-3, 1.7e-3, 1.7e-3])
    assert found[0].outer[[0, -1], 0] == pytest.approx(lateral[[10, 70]])  # as far as all of them go
    assert np.abs(sections([0.0])[0].outer - found[0].outer).max() == 0.0


def test_eyes_at_the_knots_are_pushed_by_a_needle_that_leans_as_before() -> None:
    study = replace(STUDY, needle=NeedleStudy(tilt_rad=0.1, tilt_direction_rad=1.0))
    eyes = turned_eyes(EYE, study)
    assert len(eyes) == 3
    for (eye, own), turn in zip(eyes, knot_turns(FARTHEST), strict=True):
        needle, plane = own.needle, eye.plane
        assert plane.contact.normal == pytest.approx(turned_plane(EYE.plane, turn).contact.normal)
        axis = plane.contact.leaning_axis(needle.tilt_rad, needle.tilt_direction_rad)
        first = EYE.plane.contact.leaning_axis(0.1, 1.0)
        for name in ("lateral", "depth", "normal"):
            assert axis @ getattr(plane, name) == pytest.approx(first @ getattr(EYE.plane, name))
    wrapped = replace(EYE, azimuth_rad=pi, direction_rad=3.1)
    assert all(abs(own.needle.tilt_direction_rad) <= pi for _, own in turned_eyes(wrapped, study))
    assert turned_eyes(EYE, replace(study, phantom=PhantomStudy())) == [(EYE, replace(study, phantom=PhantomStudy()))]


@pytest.mark.slow
def test_pressures_of_a_sealed_eye_follow_the_turn() -> None:
    study = replace(STUDY, globe=GlobeStudy("sealed"), mesh=MeshStudy(kind="graded", core=2, rings=4))
    sections_at = study_sections(EYE, study)
    turns = [
        STILL,
        EyeTurn(about_x_rad=FARTHEST, about_y_rad=0.0),
        EyeTurn(about_x_rad=0.5 * FARTHEST, about_y_rad=0.0),
    ]
    start, far, between = pressures_pa(EYE, sections_at, [0.012] * 3, turns)
    knots = [knot.pressures_pa([0.012])[0] for knot in sections_at.knots]
    assert (start, far, between) == pytest.approx((knots[0], knots[1], 0.5 * (knots[0] + knots[1])))
    assert start > 1.02 * EYE.iop_pa
    assert start != pytest.approx(far, rel=1e-4)


def test_the_truth_of_a_phantom_has_each_frames_turn_and_contact_and_the_recording_those_of_the_start(tmp_path) -> None:
    study = replace(STUDY, mesh=MeshStudy(divisions=4), mechanics=MechanicsStudy(), form=FormStudy())
    plan = plan_phantom(EYE, FORCES_N, study, 3)
    write_phantom(tmp_path / "rec", plan, study_sections(EYE, study), study)
    truth = json.loads((tmp_path / "rec" / "truth.json").read_text())
    for said, turn in zip(truth["frames"], plan.turns, strict=True):
        contact = Contact(polar_rad=said["turn"]["polar_rad"], azimuth_rad=said["turn"]["azimuth_rad"])
        assert contact == turned_plane(EYE.plane, turn).contact
        assert {key: said["turn"][key] for key in asdict(turn)} == asdict(turn)
        assert said["turn"]["thickness_at_contact_m"] == pytest.approx(600e-6)
    uneven = plan_phantom(EYE, FORCES_N, STUDY, 3)
    assert uneven.turns == plan.turns
    info = read_recording(tmp_path / "rec").info
    assert (info.needle.polar_angle_rad, info.oct.plane_direction_rad) == (EYE.polar_rad, EYE.direction_rad)


def test_the_truth_has_the_thickness_where_the_needle_pushes(tmp_path) -> None:
    flat = [lambda forces_n: [Section(*np.zeros((2, 9, 2)) + np.linspace(-9e-3, 9e-3, 9)[:, None])] * len(forces_n)]
    plan = plan_phantom(EYE, FORCES_N, STUDY, 3)
    write_phantom(tmp_path / "rec", plan, TurnedSections(flat * 3, FARTHEST), STUDY)
    for said in json.loads((tmp_path / "rec" / "truth.json").read_text())["frames"]:
        contact = Contact(polar_rad=said["turn"]["polar_rad"], azimuth_rad=said["turn"]["azimuth_rad"])
        thickness_m = 600e-6 * float(thickness_factor(STUDY.form, contact.normal))
        assert said["turn"]["thickness_at_contact_m"] == pytest.approx(thickness_m)
        assert thickness_m != pytest.approx(600e-6, rel=1e-3)


def test_the_movement_of_the_eye_leaves_all_else_as_it_was_drawn() -> None:
    for plan_of in (
        lambda study: plan_phantom(EYE, FORCES_N, study, 3),
        lambda study: plan_moving_phantom(EYE, (0.01,), study, 3, rate_hz=5.0, ramp_n_per_s=0.02, hold_s=0.5),
    ):
        moving, still = plan_of(STUDY), plan_of(replace(STUDY, phantom=PhantomStudy()))
        assert len(moving.turns) == len(moving.frames)
        assert len(set(moving.turns)) > 1
        assert still.turns == []
        frames = tuple(replace(frame, turn=None) for frame in moving.frames)
        assert replace(moving, frames=frames) == still


def test_an_eye_that_stands_still_has_the_recording_that_it_had(tmp_path) -> None:
    study = replace(STUDY, mesh=MeshStudy(divisions=4), mechanics=MechanicsStudy(), form=FormStudy())
    still = replace(study, phantom=PhantomStudy())
    for name, own in (("moving", study), ("still", still)):
        write_phantom(tmp_path / name, plan_phantom(EYE, FORCES_N, own, 3), study_sections(EYE, own), own)
    write_phantom(tmp_path / "alone", plan_phantom(EYE, FORCES_N, still, 3), linear_sections(EYE, still), still)
    assert contents(tmp_path / "alone") == contents(tmp_path / "still")
    assert "turn" not in json.loads((tmp_path / "still" / "truth.json").read_text())["frames"][0]
    moving, still_bytes = contents(tmp_path / "moving"), contents(tmp_path / "still")
    changed = {str(name) for name in moving if moving[name] != still_bytes[name]}
    assert {name for name in changed if not name.endswith(".png")} == {"truth.json"}
    assert any(name.endswith(".png") for name in changed)


def test_sections_of_one_contact_are_refused_for_an_eye_that_turns() -> None:
    plan = plan_phantom(EYE, FORCES_N, STUDY, 3)
    with pytest.raises(RecordingError, match="eye eye-x: it turns, and its sections are those of one contact"):
        plan_sections(plan, lambda _: [])


@pytest.mark.slow
def test_the_command_computes_all_paths_and_says_how_far_it_is(tmp_path) -> None:
    study = tmp_path / "study.toml"
    study.write_text(format_study(replace(STUDY, mesh=MeshStudy(kind="graded", core=2, rings=4), form=FormStudy())))
    arguments = ["phantom", "--study", str(study), "--forces-mn", "6,2", "--thickness-um", "800", "--json"]
    assert run([*arguments, "--out", str(tmp_path / "a")]) == 0
    assert run([*arguments, "--out", str(tmp_path / "b")]) == 0
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    shares: list[float] = []
    sections_at = study_sections(EYE, replace(STUDY, mesh=MeshStudy(kind="graded", core=2, rings=4)), shares.append)
    sections_at([0.006])
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    assert min(shares) < 1 / 3
