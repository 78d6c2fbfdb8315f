"""Recordings in ../shared: two open eyes whose globe is not stated, and a sealed one."""

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
    stated = replace(recording, info=replace(recording.info, eye=replace(recording.info.eye, globe=globe)))
    return calibrate_recordings([stated], Study(), "", cached_library(Study(), workers=1), frames=frames).eyes[name]


@pytest.mark.parametrize(("name", "frames"), [("sample-a", 3), pytest.param("sample-b", None, marks=pytest.mark.long)])
def test_an_open_eye_is_found_open_without_being_declared(name: str, frames: int | None) -> None:
    without, declared = calibrated(name, None, frames), calibrated(name, "open")
    assert (without.status, declared.status) == ("ok", "ok")
    assert abs(without.globe.mean) / PER_UL < 0.001
    assert without.mean_pa == pytest.approx(declared.mean_pa, rel=0.03)


def test_a_sealed_eye_has_a_rigidity_and_does_not_diverge() -> None:
    found = calibrated("sample-c", "sealed", frames=3)
    assert found.status == "ok"
    assert len(found.used) == 3
    assert found.globe.calibrated
    assert 0.005 < found.globe.mean / PER_UL < 0.06
    assert found.globe.sd < 0.1 * found.globe.mean
