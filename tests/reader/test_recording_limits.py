"""What a model would refuse in a recording is known from its study and the recording's settings alone."""

from dataclasses import replace
from math import hypot
from pathlib import Path

import numpy as np
import pytest

from scleraforce.errors import ModelError
from scleraforce.known import SEALED, Known, known_globe
from scleraforce.models import SHIPPED_READER, SHIPPED_WALL_FINDER, folder_study, read_folder
from scleraforce.reader.limits import RAW_READER, READER, limit_notes, limits, reading_ranges
from scleraforce.reader.verdicts import least_wall_m, too_little_wall
from scleraforce.recording.folder import EyeInfo, NeedleInfo, OctInfo, RecordingInfo
from scleraforce.study import Study
from scleraforce.units import to_si

EYE = EyeInfo("eye", thickness_m=0.6e-3, iop_pa=270.0, globe="sealed")
SCAN = OctInfo(columns=512, rows=512, bits=12, width_m=15e-3, depth_m=4e-3)
INFO = RecordingInfo(EYE, SCAN, NeedleInfo(gauge=22, slice_gap_m=0.5e-3))
STUDY = Study()
OUTSIDE = {
    "of the wall are seen": replace(INFO, oct=replace(SCAN, width_m=6e-3)),
    "frames 2 mm deep: deep dents leave them": replace(INFO, oct=replace(SCAN, depth_m=2e-3)),
    "wall thickness 1000 µm": replace(INFO, eye=replace(EYE, thickness_m=1e-3)),
    "IOP 15 mmHg": replace(INFO, eye=replace(EYE, iop_pa=to_si(15.0, "mmhg"))),
    "rigidity of a sealed globe 0.5 mmHg": replace(
        INFO, eye=replace(EYE, rigidity_pa13_per_m3=to_si(0.5, "mmhg13_per_ul"))
    ),
    "needle of 30 gauge": replace(INFO, needle=replace(INFO.needle, gauge=30)),
    "gap between B-scan and needle axis 2 mm": replace(INFO, needle=replace(INFO.needle, slice_gap_m=2e-3)),
    "tilt of the B-scan 10 °": replace(INFO, oct=replace(SCAN, plane_tilt_rad=np.radians(10.0))),
    "depth of a pixel 62.5 µm": replace(INFO, oct=replace(SCAN, rows=64)),
}


def test_a_recording_inside_of_all_ranges_has_no_limits() -> None:
    assert limit_notes(SHIPPED_READER, INFO) == ()


def test_each_quantity_that_is_outside_has_a_sentence_of_its_own() -> None:
    for words, info in OUTSIDE.items():
        (found,) = limit_notes(Path("default"), info)
        assert found.startswith("outside of what default reads: ")
        assert words in found


@pytest.mark.parametrize("width_mm", [6.0, 9.5, 9.8, 9.9, 10.5, 20.0])
def test_a_frame_whose_whole_width_shows_the_wall_is_refused_where_its_width_was(width_mm: float) -> None:
    scan = replace(SCAN, width_m=width_mm * 1e-3)
    lateral_m = (np.arange(scan.columns) + 0.5 - scan.columns / 2) * scan.width_m / scan.columns
    refused = too_little_wall(lateral_m, np.zeros(scan.columns), STUDY.slice)
    (said,) = limits(READER, STUDY, Known(), scan) or (None,)
    assert (said is None) == (refused is None)
    assert refused is None or (said is not None and said.endswith(refused))


@pytest.mark.parametrize("depth_mm", [0.5, 0.9, 1.1, 3.0])
def test_a_frame_is_refused_where_it_is_less_deep_than_the_curve_of_the_largest_eye(depth_mm: float) -> None:
    """The oracle looks how far a circle that touches the frame's top edge stays in it."""
    radius_m = STUDY.eye.radius_m * STUDY.reader.size.bounds[1]
    lateral_m = np.linspace(-7e-3, 7e-3, 20_001)
    depth_m = radius_m - np.sqrt(radius_m**2 - lateral_m**2)
    seen = np.where(depth_m <= depth_mm * 1e-3, depth_m, np.nan)
    scan = replace(SCAN, depth_m=depth_mm * 1e-3)
    said = limits(READER, STUDY, Known(), scan)
    assert any("of the wall are seen" in sentence for sentence in said) == bool(
        too_little_wall(lateral_m, seen, STUDY.slice)
    )


def test_the_least_width_goes_with_the_slice_of_the_study() -> None:
    narrow = replace(STUDY, slice=replace(STUDY.slice, columns=60))
    assert least_wall_m(narrow.slice) == pytest.approx(60 / STUDY.slice.columns * least_wall_m(STUDY.slice))
    assert limits(READER, narrow, Known(), replace(SCAN, width_m=6e-3)) == ()


def test_a_raw_reader_takes_the_refractive_index_of_its_training_alone() -> None:
    stretched = replace(SCAN, refractive_index=1.38)
    assert limits(READER, STUDY, Known(), stretched) == ()
    assert limits(RAW_READER, STUDY, Known(), stretched) == (
        "refractive index 1.38 of the frame, the model was trained with 1",
    )


def test_a_sealed_globe_without_a_rigidity_is_inside() -> None:
    assert limits(READER, STUDY, Known(globe=SEALED), SCAN) == ()
    stiff = known_globe("sealed", to_si(0.07, "mmhg13_per_ul"))
    assert len(limits(READER, STUDY, Known(globe=stiff), SCAN)) == 1


def test_a_model_that_reads_no_forces_has_no_ranges_and_no_limits() -> None:
    assert reading_ranges(SHIPPED_WALL_FINDER) == ()
    with pytest.raises(ModelError, match="kind: found 'wall-finder'"):
        limit_notes(SHIPPED_WALL_FINDER, INFO)


def test_the_scale_is_that_of_the_scenes_of_the_shipped_wall_finder() -> None:
    studies = [folder_study(read_folder(model)) for model in (SHIPPED_READER, SHIPPED_WALL_FINDER)]
    assert studies[0].scenes.window.pixel_m == studies[1].scenes.window.pixel_m


def test_every_range_is_in_words() -> None:
    ranges = dict(reading_ranges(SHIPPED_READER))
    assert ranges["wall thickness"] == "380 to 900 µm"
    assert ranges["width of the frames"] == "9.8 mm or more"
    half = least_wall_m(STUDY.slice) / 2
    radius_m = STUDY.eye.radius_m * STUDY.reader.size.bounds[1]
    depth_mm = float(ranges["depth of the frames"].split()[0])
    assert hypot(half, radius_m - depth_mm * 1e-3) == pytest.approx(radius_m, rel=0.01)
