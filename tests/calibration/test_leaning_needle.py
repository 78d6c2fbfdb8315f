"""A needle that leans, from the phantom through the calibration to the reading."""

import json
from dataclasses import replace

import numpy as np
import pytest

import scleraforce as sf
from scleraforce.base.errors import InputError
from scleraforce.records.fields import fixed
from scleraforce.records.needle import Needle, gauge_diameter_m

LEAN_RAD = np.radians(35.0)
MODULUS_PA = 0.3e6


@pytest.mark.slow
def test_a_leaning_needle_is_calibrated_and_read_by_the_force_along_it(
    tmp_path,
):
    study = sf.Study()
    drawn = {
        "needle_count": fixed(1),
        "needle_angle_rad": fixed(LEAN_RAD),
        "needle_lean_rad": fixed(0.0),
    }
    study = replace(study, phantom=replace(study.phantom, **drawn))
    recording = sf.phantom(
        tmp_path / "eye",
        study,
        forces_n=[0.01, 0.02, 0.03, 0.04],
        thickness_m=0.6e-3,
        globe="open",
        gap_m=0.3e-3,
        youngs_modulus_pa=MODULUS_PA,
        mechanics="finite-strain",
    )
    assert recording.info.needle.lean_rad == pytest.approx((LEAN_RAD, LEAN_RAD))
    calibration = sf.calibrate(recording, frames=2, out=tmp_path / "eye.json")
    eye = calibration.eyes["eye-1"]
    assert eye.lean_rad == pytest.approx(LEAN_RAD)
    # of forces along the needle it would be 22 % more
    assert eye.mean_pa == pytest.approx(MODULUS_PA, rel=0.06)
    assert json.loads((tmp_path / "eye.json").read_text())["eyes"]["eye-1"][
        "lean_deg"
    ] == pytest.approx(35.0)
    reader = sf.load_model("default")
    read = sf.evaluate(reader, recording, calibration)
    assert read.mae_n < 0.8e-3
    frame = recording.frame_path(recording.frames[2])
    number = 2
    one = sf.read(reader, frame, calibration=tmp_path / "eye.json")
    assert one.to_dict() == read.frames[number].answer.to_dict()
    straight = sf.Needle(lean_rad=(0.0, 0.0))
    upright = sf.read(reader, frame, needle=straight, calibration=tmp_path / "eye.json")
    assert upright.force_n == pytest.approx(np.cos(LEAN_RAD) * one.force_n)
    assert any("in the picture" in warning for warning in upright.warnings)
    without = replace(
        recording,
        info=replace(
            recording.info, needle=Needle(diameter_m=gauge_diameter_m(22), gap_m=0.3e-3)
        ),
    )

    with pytest.raises(InputError, match=r"needle\.lean_rad"):
        sf.calibrate([recording, without])
