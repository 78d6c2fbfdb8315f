"""Moments of several planes in a calibration: each counts once, and the gap is
found.
"""

import json
from dataclasses import replace
from shutil import copytree
from typing import Any

import cv2
import numpy as np
import pytest
from analytic_frames import (
    BOTH,
    LATERAL_M,
    LIBRARY,
    MODULUS_PA,
    SMALL_LIBRARY,
    STUDY,
    eye_of_population,
    middling_eye,
)
from scanned_planes import CONTACT_M, CROSS, TILT_RAD, write_moments
from small_models import write_fixed_reader

import scleraforce as sf
from predicted_walls import Walls, force_n as wall_force_n, predict_wall
from scleraforce.base.errors import CalibrationError
from scleraforce.calibration.calibrate import (
    calibrate_recordings,
    setup_to_calibrate,
)
from scleraforce.calibration.calibration import Calibration
from scleraforce.calibration.evaluation import evaluate_recordings
from scleraforce.calibration.found_walls import FoundWalls
from scleraforce.calibration.seen_frames import CalibrationSettings, EyeFrames
from scleraforce.calibration.stiffness_from_shape import EyePosterior
from scleraforce.fit.frames_of_an_eye import ShownFrame
from scleraforce.lab.virtual_eye import scan_plane
from scleraforce.reading.load_model import load_reader
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.calibration_file import parse_calibration_file, summary_of
from scleraforce.records.scan import Plane
from scleraforce.records.study import Study
from virtual_eyes import changed

pytestmark = pytest.mark.usefixtures("made_up_walls")
FORCES_N = 0.002, 0.03, 0.012, 0.02, 0.008
# 1.5 and 0.05 mm from the needle
FAR_FIRST = (
    Plane("far", 1e-3, 0.0),
    Plane("near", -0.45e-3, 0.0),
)


@pytest.fixture(scope="module")
def cross(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return read_recording(
        write_moments(tmp_path_factory.mktemp("cross") / "rec", FORCES_N, log=True)
    )


@pytest.fixture(scope="module")
def single(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """The first plane alone, at its true gap."""
    return read_recording(
        write_moments(
            tmp_path_factory.mktemp("single") / "rec", FORCES_N, CROSS[:1], log=True
        )
    )


def calibrated(recording: Recording, **given: Any) -> Calibration:
    return calibrate_recordings([recording], STUDY, "hash", LIBRARY, ("e",), **given)


@pytest.fixture(scope="module")
def calibration(cross: Recording) -> Calibration:
    return calibrated(cross, frames=3)


def test_moments_of_a_cross_tell_the_modulus_as_frames_of_a_known_gap_do(
    calibration, single
):
    found = calibration.eyes["eye"]
    given = calibrated(single, frames=3).eyes["eye"]
    assert found.status == "ok"
    assert found.mean_pa == pytest.approx(given.mean_pa, rel=0.02)
    # of this made-up wall, from pictures
    assert found.mean_pa == pytest.approx(MODULUS_PA, rel=0.08)
    # a second plane is not another observation
    assert found.sd_pa == pytest.approx(given.sd_pa, rel=0.15)


def test_frames_counts_moments_and_a_moment_is_one_record(calibration):
    found = calibration.eyes["eye"]
    assert [frame.file[0] for frame in found.used] == ["2", "3", "1"]
    assert [frame.force_n for frame in found.used] == pytest.approx(
        [0.012, 0.02, 0.03], abs=4e-4
    )
    assert (found.updates, len({frame.file[0] for frame in found.frames})) == (
        3,
        len(found.frames),
    )


def test_the_filter_follows_the_plane_nearest_to_the_needle(tmp_path):
    recording = read_recording(
        write_moments(tmp_path / "rec", FORCES_N[:3], FAR_FIRST, log=True)
    )
    whole = calibrated(recording).eyes["eye"]
    assert [frame.file for frame in whole.used] == ["1-1.png", "2-1.png"]
    assert whole.mean_pa == pytest.approx(MODULUS_PA, rel=0.08)
    some = recording.frames[:3] + recording.frames[4:]
    missing = replace(recording, frames=some)
    frames = calibrated(missing).eyes["eye"].frames
    assert "not usable: no frame of plane near" in {frame.skipped for frame in frames}


def test_a_frame_is_of_the_eye_at_the_place_of_its_plane(cross):
    """Gap, direction and tilt of the plane across, by the contact and tilt of the
    recording.
    """
    settings = CalibrationSettings(STUDY, LIBRARY, ("e",), False, None, FoundWalls())
    seen = EyeFrames(cross, settings, frozenset(), None).seen(1)
    stated = changed(setup_to_calibrate(cross, STUDY), direction_rad=0.3)
    plane = scan_plane(seen.beside(stated))
    assert plane.gap_m == pytest.approx(CONTACT_M[0], abs=30e-6)
    assert plane.direction_rad == 0.3 + CROSS[1].direction_rad
    assert plane.tilt_rad == pytest.approx(-TILT_RAD[0], abs=5e-3)


@pytest.mark.slow
def test_frames_of_other_gaps_tell_what_frames_of_one_gap_do():
    setup = eye_of_population(0.4e6, 0.1e6)
    walls = Walls(LIBRARY)

    def found_pa(gaps_m: np.ndarray, are_given: bool) -> float:
        frames = []
        for tip_m, gap_m in zip((1e-3, 2e-3, 3e-3), gaps_m, strict=True):
            unknown = middling_eye(tip_m, gap_m=gap_m)
            frame = ShownFrame(
                lateral_m=LATERAL_M,
                depth_bc=predict_wall(walls, unknown, BOTH).depth_m.reshape(2, -1),
                force_n=float(wall_force_n(walls, unknown[None])[0]),
                force_sd_n=1e-4,
                gap_m=gap_m if are_given else None,
            )
            frames.append(frame)

        eye = EyePosterior(setup=setup, study=STUDY, library=LIBRARY)
        return eye.with_frames(frames).modulus.mean_pa

    of_one = found_pa(np.full(3, 0.6e-3), False)
    assert of_one == pytest.approx(0.3e6, rel=0.03)
    gaps_m = np.array([0.45e-3, 0.75e-3, 0.6e-3])
    for given_m in (gaps_m, -gaps_m):
        assert found_pa(given_m, True) == pytest.approx(of_one, rel=2e-3)

    assert found_pa(gaps_m, False) != pytest.approx(of_one, rel=0.01)


def test_a_moment_that_one_plane_shows_is_left_out_with_the_reason(cross, tmp_path):
    folder = copytree(cross.path, tmp_path / "rec")
    file = str(folder / "frames" / "1-0.png")
    cv2.imwrite(file, np.full_like(cv2.imread(file, cv2.IMREAD_UNCHANGED), 300))
    found = calibrated(read_recording(folder), frames=3).eyes["eye"]
    assert [frame.file[0] for frame in found.used] == ["2", "3", "4"]
    (skipped,) = (frame.skipped for frame in found.frames if frame.file[0] == "1")
    assert "not usable" in skipped


def test_a_moment_is_not_taken_again_from_a_plane_that_was_not_followed(cross, single):
    again = (
        calibrate_recordings([cross, single], STUDY, "hash", LIBRARY, ("e",), frames=3)
        .eyes["eye"]
        .frames
    )
    assert [frame.file for frame in again] == [
        "2-1.png",
        "3-1.png",
        "1-1.png",
        "4-0.png",
    ]

    some = replace(cross, frames=cross.frames[:4])
    seen = replace(single, frames=single.frames[:2])
    with pytest.raises(CalibrationError, match="none of its 0 frames"):
        sf.calibrate([some, seen], without_force=True)


def test_what_planes_cannot_be_calibrated_with_is_refused(cross):
    for library, parameters, words in (
        (None, ("e",), "linear mechanics"),
        (LIBRARY, ("e", "gap"), "leave gap out"),
    ):
        with pytest.raises(
            CalibrationError, match=rf"recording.toml: oct.plane: .*{words}"
        ):
            calibrate_recordings([cross], Study(), "hash", library, parameters)


def test_without_force_a_cross_is_seen_as_one_plane_of_a_known_gap(cross, single):
    found, given = (
        sf.calibrate(one, without_force=True, frames=1).eyes["eye"]
        for one in (cross, single)
    )
    assert found.mean_pa == pytest.approx(given.mean_pa, rel=0.03)
    assert found.sd_pa == pytest.approx(given.sd_pa, rel=0.1)
    assert [frame.file[0] for frame in found.used] == list("01234")
    assert [frame.force_n > 0.0 for frame in found.frames] == [
        False,
        True,
        False,
        False,
        False,
    ]


def test_an_evaluation_leaves_out_the_whole_moment(calibration, cross, tmp_path):
    write_fixed_reader(tmp_path / "reader", SMALL_LIBRARY, [1.0] * 32)
    summary = summary_of(
        parse_calibration_file(json.dumps(calibration.to_dict()).encode(), "c.json")
    )
    found = evaluate_recordings(load_reader(tmp_path / "reader"), [cross.path], summary)
    assert [frame.calibration for frame in found.frames] == [
        name in "123" for name in "0011223344"
    ]
    # A frame of the plane that was not followed is known, too: alone it is not scored
    # either.
    assert {"1-0.png", "1-1.png"} <= {
        frame.file for frame in summary.eyes["eye"].frames
    }
