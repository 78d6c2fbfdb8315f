"""An eye calibrated frame by frame during a session, and the same frames as a
recording: one result.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_models import fixed_finder

from ideal_boundaries import ideal_boundaries
from scleraforce.base.errors import CalibrationError
from scleraforce.calibration import seen_frames
from scleraforce.calibration.calibrate import calibrate_recordings
from scleraforce.calibration.calibration import Calibration, parse_calibration
from scleraforce.calibration.filter.eye_filter import begin, step
from scleraforce.lab.tissue_light import Pose
from scleraforce.library import Library
from scleraforce.library.plane_cut import cut_surfaces
from scleraforce.reading.load_model import load_wall_finder
from scleraforce.recordings.force_errors import FrameForces, frame_forces
from scleraforce.recordings.forces_under_frames import label_frames
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.calibration_file import parse_calibration_file, summary_of
from scleraforce.records.eye import Eye
from scleraforce.records.globe import OPEN
from scleraforce.records.model_folder import SHIPPED_WALL_FINDER
from scleraforce.records.needle import Needle
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study
from scleraforce.records.tissue_relaxation import Relaxation
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall_in_metres import Boundaries, segmented_boundaries

STUDY = Study()
FRAMES = 6


@pytest.fixture(scope="module")
def recording(made_up_folder: Path) -> Recording:
    found = read_recording(made_up_folder)
    elastic = replace(found.info.eye, relaxation=Relaxation.declared(()))
    return replace(found, info=replace(found.info, eye=elastic))


@pytest.fixture(scope="module")
def calibration(library: Library, recording: Recording) -> Calibration:
    return calibrate_recordings([recording], STUDY, "hash", library)


STATED = Setup(
    eye=Eye(iop_pa=266.0, thickness_m=0.7e-3, globe=OPEN),
    needle=Needle(gap_m=0.5e-3, polar_rad=0.0),
)


def frames(recording: Recording) -> tuple[FrameForces, list[Boundaries]]:
    """Forces and boundaries as a monitor would have them."""
    scale = recording.info.scan.scale
    trials = label_frames(recording, STUDY.classes, STUDY.needle.max_force_n)
    seen = [find_wall(recording.frame(entry), scale) for entry in recording.frames]
    return frame_forces(recording, trials), [
        segmented_boundaries(one, scale) for one in seen
    ]


def test_frames_one_by_one_give_the_result_of_the_recording(
    library, recording, calibration
):
    forces, boundaries = frames(recording)
    eye = begin(STUDY, STATED, library, zero_covariance=forces.zero_covariance)
    prior = eye.modulus
    means = []

    for force_n, since_s, boundary in zip(
        forces.force_n, forces.since_start_s, boundaries, strict=True
    ):
        eye = step(eye, boundary, float(force_n), float(since_s))
        means.append(eye.modulus.mean_pa)

    whole = calibration.eyes["made-up"]
    settings = STUDY.calibration
    assert prior.mean_pa == pytest.approx(settings.prior_mean_pa)
    assert prior.sd_pa == pytest.approx(settings.prior_sd_pa)
    assert means[0] == prior.mean_pa  # 2 mN: a reference of the pose
    assert means[1:] == [frame.mean_pa for frame in whole.used]
    assert eye.modulus.sd_pa == whole.used[-1].sd_pa
    assert eye.updates == whole.updates == 5
    # its frames were read again
    assert whole.mean_pa == pytest.approx(eye.modulus.mean_pa, rel=0.01)


def test_the_force_freed_of_offset_and_drift_decides_which_frames_are_calibrated_on(
    library, recording
):
    trials = label_frames(recording, STUDY.classes, STUDY.needle.max_force_n)
    corrected_n = frame_forces(recording, trials).force_n
    labels_n = np.array([trial.measured_force_n for trial in trials], dtype=np.float64)
    # the label and the force that the filter takes differ
    between_n = float((corrected_n[1] + labels_n[1]) / 2)
    assert (labels_n[1] > between_n) != (corrected_n[1] > between_n)
    study = replace(
        STUDY, calibration=replace(STUDY.calibration, min_force_n=between_n)
    )
    found = calibrate_recordings([recording], study, "", library).eyes["made-up"]
    wanted = [
        trial.file
        for trial, force_n in zip(trials, corrected_n, strict=True)
        if force_n > between_n
    ]
    assert [frame.file for frame in found.used] == wanted


def test_a_calibration_has_the_discrepancy_of_its_forces(
    calibration,
):
    """The made-up eye is one of the library's: its frames, read again, lie about its
    forces. The file keeps it.
    """
    eye = calibration.eyes["made-up"]
    again = [frame.again for frame in eye.used if frame.again is not None]
    assert len(again) == len(eye.used)
    read_n, force_n = (
        np.array([getattr(frame, name) for frame in again])
        for name in ("library_n", "force_n")
    )
    assert read_n == pytest.approx(force_n, rel=0.05)
    # the frames were read, not their labels copied
    assert read_n != pytest.approx(force_n, rel=1e-3)
    found = eye.discrepancy
    assert found is not None
    assert abs(found.level) < 0.01
    assert found.level_sd < 0.02  # what eyes have
    assert 1.0 <= found.scatter < 2.0  # as expected of a wall of the library's
    # an E that is too high goes with forces that are below the library's
    assert found.level_by[0] < 0.0
    content = calibration.to_dict()
    file = parse_calibration_file(json.dumps(content).encode(), "c.json")
    assert summary_of(file).eyes["made-up"].eye.discrepancy == found
    saved = parse_calibration(file)
    assert saved.mechanics == calibration.mechanics == "finite-strain"
    assert saved.eyes["made-up"].updates == eye.updates
    assert saved.eyes["made-up"].discrepancy == found


def parsed(content: dict[str, Any]) -> Calibration:
    return parse_calibration(
        parse_calibration_file(json.dumps(content).encode(), "c.json")
    )


@pytest.mark.parametrize(
    ("key", "value"),
    [("library_n", -1.0), ("modulus_pa", 0.0), ("sd_n", "x"), ("by_modulus", None)],
)
def test_a_frame_read_again_is_refused_by_its_key(calibration, key: str, value: object):
    content = json.loads(json.dumps(calibration.to_dict()))
    steps = content["eyes"]["made-up"]["steps"]
    number, read = next(item for item in enumerate(steps) if item[1]["again"])
    read["again"][key] = value
    place = rf"eyes\.made-up\.steps\[{number}\]\.again\.{key}"
    with pytest.raises(CalibrationError, match=place):
        parsed(content)


def test_older_files_without_frames_read_again_are_read(
    calibration,
):
    content = json.loads(json.dumps(calibration.to_dict()))
    entry = content["eyes"]["made-up"]
    for key in ("level_by", "growth_by", "scatter"):
        del entry["discrepancy"][key]

    for each in entry["steps"]:
        del each["again"]

    found = parsed(content).eyes["made-up"]
    assert found.discrepancy is not None
    assert found.discrepancy.level_by == found.discrepancy.growth_by == (0.0, 0.0)
    assert found.discrepancy.scatter == 1.0
    assert {frame.again for frame in found.frames} == {None}


def test_walls_are_found_with_the_stated_thickness_and_checked_by_the_finder(
    library,
    recording,
    calibration,
    monkeypatch,
):
    """The thickness shows where the wall begins below a conjunctiva."""
    blind = fixed_finder(np.full(88, 100.0), np.full(88, 110.0), sd=0.3)
    with pytest.raises(
        CalibrationError, match=r"not usable: .* to find the wall differ"
    ):
        calibrate_recordings([recording], STUDY, "", library, finder=blind)

    bundled = load_wall_finder(SHIPPED_WALL_FINDER)
    given = list[Any]()
    checked = calibrate_recordings([recording], STUDY, "hash", library, finder=bundled)
    both = [one.eyes["made-up"].means[0] for one in (checked, calibration)]
    # the network may move the wall's end by a few rows
    assert both[0] == pytest.approx(both[1], rel=1e-3)

    def below(frame: Any, scale: Any, *more: Any) -> Any:
        given.append(more)
        return replace(find_wall(frame, scale), usable=False, reason="under a layer")

    monkeypatch.setattr(seen_frames, "find_wall", below)
    with pytest.raises(CalibrationError, match="under a layer"):
        calibrate_recordings([recording], STUDY, "", library, finder=blind)

    assert given == [(0.7e-3, blind)] * FRAMES


def test_forces_far_above_all_calibrated_ones_are_a_doubt(
    library,
    recording,
    calibration,
    monkeypatch,
):
    """Deep dents, of 30 mN or more, are taken for ones that leave the window."""

    # of the highest forces
    deep = [recording.frame(recording.frames[index]) for index in (1, 3, 5)]

    def shallow(pixels: Any, *asked: Any) -> Any:
        is_deep = any(np.array_equal(pixels, frame) for frame in deep)
        return replace(find_wall(pixels, *asked), usable=not is_deep, reason="deep")

    assert calibration.eyes["made-up"].recordings[0].doubts == ()
    monkeypatch.setattr(seen_frames, "find_wall", shallow)
    eye = calibrate_recordings([recording], STUDY, "", library).eyes["made-up"]
    assert [
        round(1e3 * frame.force_n)
        for frame in eye.frames
        if frame.skipped == "not usable: deep"
    ] == [30, 45, 38]
    (doubt,) = eye.recordings[0].doubts
    assert "no frame above 20 mN could be calibrated on, of forces up to 45 mN" in doubt


def test_a_session_starts_with_any_frame_and_its_earlier_values_stay_unchanged(
    library,
):
    walls = library.curves(
        np.array([0.7e-3]), np.array([266.0 / 0.27e6]), np.array([0.03 / 0.27e6])
    ).curves_sbnc
    pose = Pose(lateral_m=0, depth_m=0.5e-3)
    smoothing_m = STUDY.calibration.surface_smoothing_m
    section = cut_surfaces(walls[0], 0.5e-3)
    seen = ideal_boundaries(
        section, pose, STUDY.oct, 5e-6, np.random.default_rng(0), smoothing_m
    )
    before = begin(STUDY, STATED, library)
    after, again = (step(before, seen, 0.03) for _ in range(2))
    assert (before.updates, before.last) == (0, None)
    assert after.modulus == again.modulus
    assert after.modulus.mean_pa == pytest.approx(0.27e6, rel=0.02)
    assert 0 < after.modulus.sd_pa < 0.02e6
    empty = replace(seen, depth_m=np.full_like(seen.depth_m, np.nan))
    assert step(after, empty, 0.001).state is after.state
    assert step(after, empty, 0.03).modulus.mean_pa == after.modulus.mean_pa
