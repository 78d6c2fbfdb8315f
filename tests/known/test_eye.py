"""What is known of an eye: where it comes from."""

from dataclasses import replace
from pathlib import Path

import pytest
from small_recordings import calibration_text

from scleraforce.known import OPEN, SEALED, UNKNOWN, Known, KnownGlobe, Modulus, known_of_recording, stated_globe
from scleraforce.known.calibration_file import (
    CalibrationSummary,
    calibrated_modulus,
    foreign_modulus,
    globe_entry,
    known_of_eye,
    read_calibration,
)
from scleraforce.recording.folder import EyeInfo, NeedleInfo, OctInfo, RecordingInfo

CALIBRATED = replace(SEALED, mean=1.3e8, sd=4e6, correlation=-0.4, calibrated=True)


def test_a_recordings_statements_are_taken_and_what_it_omits_is_unknown() -> None:
    info = RecordingInfo(
        EyeInfo("e", thickness_m=0.6e-3),
        OctInfo(columns=512, rows=512, bits=12, width_m=15e-3, depth_m=4e-3),
        NeedleInfo(gauge=22, slice_gap_m=0.5e-3, polar_angle_rad=0.6),
    )
    assert known_of_recording(info) == Known(modulus=None, iop_pa=None, thickness_m=0.6e-3, gap_m=0.5e-3, polar_rad=0.6)
    turned = replace(info, oct=replace(info.oct, plane_direction_rad=0.8))
    assert known_of_recording(turned) == replace(known_of_recording(info), direction_rad=0.8)


EYES = {
    "mine": {"mean_mpa": 0.3, "sd_mpa": 0.004, "globe": globe_entry(CALIBRATED)},
    "lost": {"mean_mpa": 0.1, "status": "diverged: by 4 sd"},
    "contradicted": {"mean_mpa": 0.1, "status": "diverged: by 4 sd", "globe": globe_entry(UNKNOWN)},
}


@pytest.fixture
def summary(tmp_path: Path) -> CalibrationSummary:
    file = tmp_path / "calibration.json"
    file.write_text(calibration_text(0.25, EYES, population={"mean_mpa": 0.25, "sd_mpa": 0.05}))
    return read_calibration(file)


def test_an_eye_has_its_own_modulus_and_another_that_of_its_population_with_its_spread(
    summary: CalibrationSummary,
) -> None:
    assert calibrated_modulus(summary, "mine") == Modulus(mean_pa=0.3e6, sd_pa=4e3, source="own")
    assert calibrated_modulus(summary, "stranger") == Modulus(mean_pa=0.25e6, sd_pa=0.05e6, source="population")
    assert foreign_modulus(summary, "mine") is None
    assert str(foreign_modulus(summary, "stranger")).endswith("read with the population's modulus, 0.25 MPa +- 20 %")


def test_an_eye_whose_calibration_diverged_is_read_as_one_of_unknown_modulus_or_globe_and_a_sentence_says_so(
    summary: CalibrationSummary,
) -> None:
    told = Known(iop_pa=270.0, thickness_m=0.6e-3, globe=OPEN)
    assert calibrated_modulus(summary, "lost") is None
    assert known_of_eye(told, summary, "lost") == told
    assert known_of_eye(told, summary, "contradicted") == replace(told, globe=None)
    assert str(foreign_modulus(summary, "contradicted")).endswith("unknown modulus in an unknown globe")
    assert foreign_modulus(summary, "lost") == (
        f"lost is not usable (diverged: by 4 sd) in {summary.path}, which has 3 eyes (mine, lost, contradicted): "
        "read as one of unknown modulus"
    )


def test_where_all_diverged_no_eye_has_a_modulus(tmp_path: Path) -> None:
    file = tmp_path / "calibration.json"
    file.write_text(calibration_text(0.25, {"lost": EYES["lost"]}))
    assert calibrated_modulus(read_calibration(file), "stranger") is None


@pytest.mark.parametrize("told", [None, SEALED], ids=["nothing told", "the same kind told"])
def test_an_eye_takes_the_globe_that_its_calibration_found(
    summary: CalibrationSummary, told: KnownGlobe | None
) -> None:
    found = known_of_eye(Known(thickness_m=0.6e-3, globe=told), summary, "mine").globe
    assert found is not None
    assert (found.kind, found.calibrated, found.correlation) == ("sealed", True, CALIBRATED.correlation)
    assert (found.mean, found.sd) == pytest.approx((CALIBRATED.mean, CALIBRATED.sd))


def test_another_kind_of_globe_that_is_told_stands(summary: CalibrationSummary) -> None:
    assert known_of_eye(Known(globe=OPEN), summary, "mine").globe is OPEN


def test_what_frames_found_of_a_globe_of_which_nothing_was_told_stands(tmp_path: Path) -> None:
    """E was found with it, and goes with no other."""
    found = replace(UNKNOWN, mean=0.4 * UNKNOWN.mean, sd=0.1 * UNKNOWN.sd, correlation=-0.8, calibrated=True)
    file = tmp_path / "calibration.json"
    file.write_text(calibration_text(0.25, {"mine": {"globe": globe_entry(found)}}))
    for told in (None, OPEN, SEALED):
        globe = known_of_eye(Known(globe=told), read_calibration(file), "mine").globe
        assert globe is not None
        assert (globe.kind, globe.correlation, globe.mean) == ("unknown", -0.8, pytest.approx(found.mean))


def test_an_eye_of_the_population_says_nothing_of_another_globe(summary: CalibrationSummary) -> None:
    assert known_of_eye(Known(globe=SEALED), summary, "stranger").globe is SEALED
    assert known_of_eye(Known(), summary, "stranger").globe is None


@pytest.mark.parametrize(
    ("eye", "kind", "rigidity"),
    [
        (EyeInfo("e"), None, None),
        (EyeInfo("e", globe="open"), "open", 0.0),
        (EyeInfo("e", globe="sealed"), "sealed", SEALED.mean),
        (EyeInfo("e", globe="sealed", rigidity_pa13_per_m3=1e8), "sealed", 1e8),
    ],
)
def test_a_recordings_globe_is_what_it_says_and_nothing_where_it_says_nothing(
    eye: EyeInfo, kind: str | None, rigidity: float | None
) -> None:
    told = stated_globe(eye)
    assert (kind, rigidity) == (None, None) if told is None else (told.kind, told.mean) == (kind, rigidity)


def test_the_spread_of_one_eye_is_not_zero(tmp_path: Path) -> None:
    file = tmp_path / "calibration.json"
    file.write_text(calibration_text(0.25, {"mine": {}}, population={"mean_mpa": 0.25, "sd_mpa": 0.0}))
    assert calibrated_modulus(read_calibration(file), "stranger").relative_sd == pytest.approx(0.12)
    file.write_text(calibration_text(0.25, {"mine": {}}, population={"mean_mpa": 0.25, "sd_mpa": None}))
    assert calibrated_modulus(read_calibration(file), "stranger").relative_sd == pytest.approx(0.12 * 2**0.5)
