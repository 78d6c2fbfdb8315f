"""Recordings in ../shared: two open eyes of which nothing is told, and a sealed one."""

from dataclasses import replace
from pathlib import Path

import pytest

from scleraforce.calibration.calibrate import calibrate_recordings
from scleraforce.calibration.result import EyeCalibration
from scleraforce.library.build import cached_library
from scleraforce.recording.folder import read_recording
from scleraforce.study import Study
from scleraforce.units import SI_PER_UNIT

RECORDINGS = Path(__file__).parents[3] / "shared" / "recordings"
PER_UL = SI_PER_UNIT["mmhg13_per_ul"][1]
pytestmark = [
    pytest.mark.slow,
    pytest.mark.real,
    pytest.mark.skipif(not RECORDINGS.exists(), reason="no real recordings here"),
]


def calibrated(name: str, globe: str | None, frames: int | None = None) -> EyeCalibration:
    recording = read_recording(RECORDINGS / name)
    told = replace(recording, info=replace(recording.info, eye=replace(recording.info.eye, globe=globe)))
    return calibrate_recordings([told], Study(), "", cached_library(Study(), workers=1), frames=frames).eyes[name]


@pytest.mark.parametrize(("name", "frames"), [("sample-a", 3), pytest.param("sample-b", None, marks=pytest.mark.long)])
def test_an_open_eye_of_which_nothing_is_told_is_found_open(name: str, frames: int | None) -> None:
    untold, told = calibrated(name, None, frames), calibrated(name, "open")
    assert (untold.status, told.status) == ("ok", "ok")
    assert abs(untold.globe.mean) / PER_UL < 0.001
    assert untold.mean_pa == pytest.approx(told.mean_pa, rel=0.03)


def test_a_sealed_eye_has_a_rigidity_and_does_not_diverge() -> None:
    found = calibrated("sample-c", "sealed", frames=3)
    assert found.status == "ok"
    assert len(found.used) == 3
    assert found.globe.calibrated
    assert 0.005 < found.globe.mean / PER_UL < 0.06
    assert found.globe.sd < 0.1 * found.globe.mean


def test_a_sealed_eye_that_is_told_open_diverges_and_a_doubt_says_what_its_frames_tell_of_its_globe() -> None:
    found = calibrated("sample-c", "open", frames=3)
    assert found.status.startswith("diverged")
    *_, doubt = found.recordings[-1].doubts
    assert doubt.startswith("eye.globe is stated as open, and the frames contradict that")
    assert "k 0.0" in doubt
