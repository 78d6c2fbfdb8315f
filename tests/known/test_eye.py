"""What is known of an eye: where it comes from, and what lies outside a model's training."""

from math import nan
from pathlib import Path

import pytest
from calibration_file import calibration_text

from scleraforce.known.calibration_file import read_calibration
from scleraforce.known.eye import Known, Modulus, calibrated_modulus, known_of_recording, outside_training
from scleraforce.recording.info import EyeInfo, NeedleInfo, OctInfo, RecordingInfo
from scleraforce.study import Range, ReaderStudy

TRAINED = ReaderStudy(
    youngs_modulus_pa=Range(min=0.18e6, max=0.55e6),
    iop_pa=Range(min=120.0, max=560.0),
    thickness_m=Range(min=0.45e-3, max=0.85e-3),
    gap_m=Range(min=0.35e-3, max=1e-3),
)
INSIDE = Known(modulus=Modulus(mean_pa=0.3e6, sd_pa=5e3, source="own"), iop_pa=270.0, thickness_m=0.6e-3, gap_m=0.5e-3)


def test_a_recordings_statements_are_taken_and_what_it_omits_is_unknown() -> None:
    info = RecordingInfo(
        EyeInfo("e", thickness_m=0.6e-3),
        OctInfo(columns=512, rows=512, bits=12, width_m=15e-3, depth_m=4e-3),
        NeedleInfo(gauge=22, slice_gap_m=0.5e-3, polar_angle_rad=0.6),
    )
    assert known_of_recording(info) == Known(modulus=None, iop_pa=None, thickness_m=0.6e-3, gap_m=0.5e-3, polar_rad=0.6)


def test_an_eye_has_its_own_modulus_and_another_that_of_its_population_with_its_spread(tmp_path: Path) -> None:
    eyes = {
        "mine": {"mean_mpa": 0.3, "sd_mpa": 0.004},
        "lost": {"mean_mpa": 0.1, "status": "diverged"},
    }
    file = tmp_path / "calibration.json"
    file.write_text(calibration_text(0.25, eyes, population={"mean_mpa": 0.25, "sd_mpa": 0.05}))
    summary = read_calibration(file)
    assert calibrated_modulus(summary, "mine") == Modulus(mean_pa=0.3e6, sd_pa=4e3, source="own")
    for eye in ("lost", "stranger"):
        assert calibrated_modulus(summary, eye) == Modulus(mean_pa=0.25e6, sd_pa=0.05e6, source="population")


def test_the_spread_of_one_eye_is_not_zero(tmp_path: Path) -> None:
    file = tmp_path / "calibration.json"
    file.write_text(calibration_text(0.25, {"mine": {}}, population={"mean_mpa": 0.25, "sd_mpa": 0.0}))
    assert calibrated_modulus(read_calibration(file), "stranger").relative_sd == pytest.approx(0.12)
    file.write_text(calibration_text(0.25, {"mine": {}}, population={"mean_mpa": 0.25, "sd_mpa": None}))
    assert calibrated_modulus(read_calibration(file), "stranger").relative_sd == pytest.approx(0.12 * 2**0.5)


def test_an_eye_inside_the_training_is_inside_also_on_its_bounds() -> None:
    assert outside_training(Known(), TRAINED) is None
    assert outside_training(INSIDE, TRAINED) is None
    for end in (0, 1):
        modulus = Modulus(mean_pa=TRAINED.youngs_modulus_pa.bounds[end], sd_pa=1e3, source="own")
        known = Known(
            modulus=modulus,
            iop_pa=TRAINED.iop_pa.bounds[end],
            thickness_m=TRAINED.thickness_m.bounds[end],
            gap_m=TRAINED.gap_m.bounds[end],
        )
        assert outside_training(known, TRAINED) is None


@pytest.mark.parametrize(
    ("known", "words"),
    [
        (Known(modulus=Modulus(mean_pa=0.6e6, sd_pa=1e3, source="own")), "Young's modulus 0.6 MPa"),
        (Known(iop_pa=1333.0), "IOP 9.998 mmHg"),
        (Known(thickness_m=1e-3), "wall thickness 1000 µm"),
        (Known(gap_m=0.1e-3), "gap between B-scan and needle axis 0.1 mm"),
        (Known(thickness_m=nan), "wall thickness nan"),
    ],
)
def test_what_is_outside_is_named(known: Known, words: str) -> None:
    reason = outside_training(known, TRAINED)
    assert reason is not None
    assert reason.startswith(words)
