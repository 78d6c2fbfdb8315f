"""Calibrations that should not exist are refused, with the likely cause."""

import json
from collections.abc import Callable
from dataclasses import replace
from shutil import copytree

import cv2
import numpy as np
import pytest
from analytic_frames import LIBRARY, SHARED, STUDY, THICKNESS_M
from small_recordings import PUSHES_MN, write_pushes

import scleraforce as sf
from scleraforce.base.errors import CalibrationError
from scleraforce.calibration.calibrate import calibrate_recordings
from scleraforce.calibration.calibration import Calibration
from scleraforce.calibration.calibration_checks import (
    check_recording,
    checked_calibration,
)
from scleraforce.calibration.found_walls import FoundWalls
from scleraforce.front.api.reading_frames import summary_of_calibration
from scleraforce.front.cli.main import run
from scleraforce.reading.load_model import bundled_finder
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.tissue_relaxation import Relaxation


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Recording:
    return read_recording(
        write_pushes(
            tmp_path_factory.mktemp("pushed") / "eye-a", forces_mn=PUSHES_MN[:8]
        )
    )


@pytest.fixture
def turned(recording, tmp_path) -> Callable[..., Recording]:
    """Return the recording with its frames turned."""

    def turn(frames: Callable[[np.ndarray], np.ndarray]) -> Recording:
        folder = copytree(recording.path, tmp_path / "turned")
        for path in (folder / "frames").iterdir():
            cv2.imwrite(str(path), frames(cv2.imread(str(path), -1)))
        return read_recording(folder)

    return turn


def later(recording: Recording, time_s: float) -> Recording:
    moved = [replace(entry, time_s=entry.time_s + time_s) for entry in recording.frames]
    return replace(recording, frames=tuple(moved))


def with_scan(recording: Recording, **values: float) -> Recording:
    scan = replace(recording.info.scan, **values)
    return replace(recording, info=replace(recording.info, scan=scan))


def test_a_recording_that_agrees_with_itself_is_not_refused(recording, turned):
    check_recording(recording, STUDY, FoundWalls())
    # mirrored frames show the same, where the needle does not lean
    check_recording(turned(np.fliplr), STUDY, FoundWalls())


def test_frames_that_are_turned_are_refused_with_their_turn(turned, tmp_path, capsys):
    upside_down = turned(np.flipud)
    with pytest.raises(CalibrationError, match=r"upside down \(import `flip=rows`\)"):
        check_recording(upside_down, STUDY, FoundWalls())
    check_recording(upside_down, STUDY, FoundWalls(), with_forces=False)

    out = tmp_path / "calibration.json"
    assert run(["calibrate", str(upside_down.path), "--out", str(out)]) == 2
    assert not out.exists()
    assert "upside down" in capsys.readouterr().err


def test_transposed_frames_are_named(turned):
    with pytest.raises(CalibrationError, match="transposed; import them with `axes"):
        check_recording(turned(np.transpose), STUDY, FoundWalls(bundled_finder()))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda one: with_scan(one, refractive_index=1.38),
            r"650 µm, but .* is the depth corrected already\?",
        ),
        (
            lambda one: later(one, 5.3),
            r"contradict the dents: .* s earlier than frames",
        ),
        (
            lambda one: later(one, -10.0),
            r"contradict the dents: .* s later than frames",
        ),
    ],
)
def test_what_contradicts_the_dents_is_refused_with_its_size(recording, change, words):
    with pytest.raises(CalibrationError, match=words):
        check_recording(change(recording), STUDY, FoundWalls())


@pytest.fixture(scope="module")
def calibration(recording) -> Calibration:
    eye = replace(recording.info.eye, relaxation=Relaxation.declared(()))
    elastic = replace(recording, info=replace(recording.info, eye=eye))
    return calibrate_recordings([elastic], STUDY, "", LIBRARY, ("e",), 4)


def checked(calibration: Calibration, recording: Recording) -> Calibration:
    summary = summary_of_calibration(calibration)
    return checked_calibration(
        calibration, summary, [recording], STUDY, LIBRARY, FoundWalls()
    )


def test_a_calibration_keeps_what_its_frames_show(calibration, recording):
    found = checked(calibration, recording)
    shown = found.eyes["eye-a"].appearance
    assert shown.thickness_um == pytest.approx(THICKNESS_M * 1e6, rel=0.05)
    assert shown.size == pytest.approx(1.0, abs=0.05)
    assert summary_of_calibration(found).eyes["eye-a"].appearance == shown


@pytest.mark.parametrize("modulus_pa", [0.029e6, 1.23e6])
def test_a_modulus_that_no_reader_takes_is_refused(calibration, recording, modulus_pa):
    eye = calibration.eyes["eye-a"]
    wrong = replace(eye, means=(modulus_pa,), sds=(0.01 * modulus_pa,))
    with pytest.raises(CalibrationError, match="Young's modulus would be"):
        checked(replace(calibration, eyes={"eye-a": wrong}), recording)


@pytest.mark.parametrize("factor", [0.75, 1.35])
def test_frames_that_a_reader_would_refuse_are_refused_with_the_cause(
    calibration, recording, factor
):
    wide = with_scan(recording, width_m=factor * recording.info.scan.width_m)
    words = r"a reader would refuse \d+ of 8 frames .*width_m"
    with pytest.raises(CalibrationError, match=words):
        checked(calibration, wide)


@pytest.mark.parametrize(
    ("shown", "words"),
    [
        ({"thickness_um": 650.0, "size": 1.0}, None),
        ({"thickness_um": 670.0, "size": 1.03}, None),
        ({"thickness_um": 500.0, "size": 1.0}, "µm is seen, not of 500"),
        ({"thickness_um": 650.0, "size": 1.2}, "times as large"),
        (None, None),  # of a file from before
    ],
)
def test_reading_with_the_calibration_of_another_eye_says_so(
    places, tmp_path, shown, words
):
    content = json.loads(places["calibration"].read_text())
    if shown is not None:
        sure = {"thickness_sd_um": 5.0, "size_sd": 0.01, "frames": 8}
        content["eyes"]["mine"]["appearance"] = shown | sure
    file = tmp_path / "calibration.json"
    file.write_text(json.dumps(content))
    model = sf.load_model(places["model"], wall_finder=None)
    notes = sf.evaluate(model, places["mine"], file).notes
    frame = places["mine"] / "frames" / "2.png"
    warnings = sf.read(model, frame, calibration=file).warnings
    for said in (notes, warnings):
        doubts = [each for each in said if "is that of another eye" in each]
        assert len(doubts) == (words is not None)
        assert (words or "") in "".join(doubts)


@pytest.mark.real
@pytest.mark.parametrize(
    "name",
    ["sample-a", *(pytest.param(f"sample-{n}", marks=pytest.mark.slow) for n in "bc")],
)
def test_recordings_by_others_agree_and_their_mistakes_do_not(name):
    folder = SHARED / "recordings" / name
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    recording = read_recording(folder)
    recording = replace(recording, frames=recording.frames[::2])
    check_recording(recording, STUDY, FoundWalls())
    stretched = with_scan(recording, refractive_index=1.38)
    for wrong, words in (
        (later(recording, 10.0), "labels contradict the dents"),
        (stretched, "is the depth corrected already"),
    ):
        with pytest.raises(CalibrationError, match=words):
            check_recording(wrong, STUDY, FoundWalls())
