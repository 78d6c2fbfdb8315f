"""A recording's calibration: E after each frame, what it is written with, and doubts."""

import json
from dataclasses import replace
from math import log
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_models import fixed_finder

from scleraforce.base.errors import CalibrationError
from scleraforce.calibration import found_walls
from scleraforce.calibration.calibrate import calibrate_recordings
from scleraforce.calibration.calibration import (
    Calibration,
    found_remarks,
    parse_calibration,
)
from scleraforce.calibration.found_walls import FoundWalls
from scleraforce.library import Library
from scleraforce.reading.load_model import load_wall_finder
from scleraforce.recordings.force_errors import frame_forces
from scleraforce.recordings.forces_under_frames import label_frames
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.calibration_file import (
    Appearance,
    parse_calibration_file,
    summary_of,
)
from scleraforce.records.model_folder import SHIPPED_WALL_FINDER
from scleraforce.records.study import Study
from scleraforce.records.tissue_relaxation import Relaxation
from scleraforce.wall.find_wall import find_wall

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


def test_the_modulus_after_each_frame_comes_from_the_prior_to_the_eye_s(
    calibration,
):
    eye = calibration.eyes["made-up"]
    settings = STUDY.calibration
    assert eye.prior is not None
    assert eye.prior.mean_pa == settings.prior_mean_pa
    assert eye.prior.sd_pa == settings.prior_sd_pa
    # the first of the six frames bears 2 mN: too little to tell E
    assert eye.updates == 5
    last = eye.used[-1]
    assert (last.mean_pa, last.sd_pa) == (eye.mean_pa, eye.effective_sd_pa)
    # forces do not feel the errors of thickness and pressure, for which E makes up
    assert eye.sd_pa > 1.2 * eye.effective_sd_pa
    sds = [frame.sd_pa for frame in eye.used]
    assert sds[0] < 0.3 * eye.prior.sd_pa
    assert sds[-1] < 0.9 * sds[0]
    for frame in eye.used:
        assert frame.mean_pa == pytest.approx(eye.mean_pa, rel=0.03)
        assert frame.own_modulus_pa == pytest.approx(eye.mean_pa, rel=0.06)


@pytest.mark.parametrize("shown_um", [500.0, 600.0, 660.0])
def test_the_thickness_that_frames_show_tells_how_far_the_modulus_is_off(
    calibration, shown_um
):
    """At a given dent a force goes as the thickness squared: of a wall that is thinner
    by a share, E would be larger by twice as much.
    """
    eye = calibration.eyes["made-up"]
    stated_um = 1e6 * eye.stated_thickness_m
    appearance = Appearance(
        thickness_um=shown_um, thickness_sd_um=1.0, size=1.0, size_sd=0.0, frames=6
    )
    seen = eye.with_appearance(appearance)
    # forces are read as before
    assert (seen.mean_pa, seen.effective_sd_pa) == (eye.mean_pa, eye.effective_sd_pa)
    ratio = stated_um / shown_um
    off = abs(2.0 * log(ratio))
    assert seen.sd_pa / seen.mean_pa > 0.8 * off
    assert seen.sd_pa / seen.mean_pa < 1.3 * off + 0.08
    of_thickness = [
        remark for remark in found_remarks(seen) if "thickness_m" in remark.fields
    ]
    if abs(ratio - 1.0) < 0.05:
        assert not of_thickness
        return

    (remark,) = of_thickness
    mean_mpa = 1e-6 * seen.mean_pa * ratio**2
    assert str(remark) == (
        f"frames show a wall of {shown_um:.0f} µm, not {stated_um:.0f}: its E would be"
        f" {mean_mpa:.2g} MPa"
    )


def test_a_recording_without_a_new_frame_leaves_an_eye_as_it_is(
    calibration, library, recording
):
    before = calibration.eyes["made-up"]
    twice = calibrate_recordings([recording, recording], STUDY, "hash", library)
    after = twice.eyes["made-up"]
    assert (after.means, after.sds, after.frames) == (
        before.means,
        before.sds,
        before.frames,
    )
    assert len(after.recordings) == 2


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
        calibrate_recordings([recording], STUDY, "", library, walls=FoundWalls(blind))

    bundled = load_wall_finder(SHIPPED_WALL_FINDER)
    given = list[Any]()
    checked = calibrate_recordings(
        [recording], STUDY, "hash", library, walls=FoundWalls(bundled)
    )
    both = [one.eyes["made-up"].means[0] for one in (checked, calibration)]
    # the network may move the wall's end by a few rows
    assert both[0] == pytest.approx(both[1], rel=1e-3)

    def below(frame: Any, scale: Any, *more: Any) -> Any:
        given.append(more)
        return replace(find_wall(frame, scale), usable=False, reason="under a layer")

    monkeypatch.setattr(found_walls, "find_wall", below)
    with pytest.raises(CalibrationError, match="under a layer"):
        calibrate_recordings([recording], STUDY, "", library, walls=FoundWalls(blind))

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
    monkeypatch.setattr(found_walls, "find_wall", shallow)
    eye = calibrate_recordings([recording], STUDY, "", library).eyes["made-up"]
    assert [
        round(1e3 * frame.force_n)
        for frame in eye.frames
        if frame.skipped == "not usable: deep"
    ] == [30, 45, 38]
    (doubt,) = eye.recordings[0].doubts
    assert "no frame above 20 mN could be calibrated on, of forces up to 45 mN" in doubt
