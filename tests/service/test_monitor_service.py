"""What a monitor's recordings state of the eye that it watches."""

from dataclasses import replace
from pathlib import Path

import pytest

from scleraforce.known.eye import Known, stated_eye, told_globe
from scleraforce.known.globe import OPEN, REFERENCE_RIGIDITY, SEALED, UNKNOWN, KnownGlobe, known_globe
from scleraforce.monitor import MonitorLimits
from scleraforce.recording.pixels import PixelScale
from scleraforce.service.monitor_service import Address, MonitorSettings, _recording_info
from scleraforce.study import Study

CALIBRATED = KnownGlobe(
    kind="sealed", lowest=SEALED.lowest, highest=SEALED.highest, mean=REFERENCE_RIGIDITY, sd=1e6, calibrated=True
)


@pytest.mark.parametrize(
    ("known", "stated"),
    [
        (None, None),
        (UNKNOWN, None),
        (OPEN, OPEN),
        (SEALED, SEALED),
        (known_globe("sealed", REFERENCE_RIGIDITY, "logarithmic"),) * 2,
        (CALIBRATED, SEALED),  # its rigidity stands in the calibration
    ],
)
def test_a_recording_states_what_was_told_of_the_globe(known: KnownGlobe | None, stated: KnownGlobe | None) -> None:
    assert told_globe(stated_eye("mine", Known(globe=known))) == stated


def test_a_recording_states_where_the_monitor_was_told_that_plane_and_needle_are() -> None:
    known = Known(globe=OPEN, gap_m=0.4e-3, polar_rad=0.6, direction_rad=1.1)
    settings = MonitorSettings(
        eye="mine", known=known, limits=MonitorLimits(size=(400, 500)), refractive_index=1.38,
        address=Address("localhost", 0), console=None, black_box=Path("black-box"), record=None, token="",
    )  # fmt: skip
    scale = PixelScale(lateral_m=20e-6, depth_m=5e-6)
    info = _recording_info(settings, Study(), scale)
    assert (info.oct.plane_direction_rad, info.needle.polar_angle_rad, info.needle.slice_gap_m) == (1.1, 0.6, 0.4e-3)
    assert (info.oct.width_m, info.oct.depth_m) == pytest.approx((10e-3, 2e-3))
    assert info.oct.refractive_index == 1.38
    untold = _recording_info(replace(settings, known=Known()), Study(), scale)
    assert (untold.oct.plane_direction_rad, untold.needle.polar_angle_rad) == (None, None)
    assert untold.needle.slice_gap_m == Study().needle.gap_m
