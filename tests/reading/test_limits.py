"""Setup values of an eye, its scan and its needle outside a model's training."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from analytic_frames import LIBRARY
from small_models import FIVE_MN, FixedNetwork

from scleraforce.base.errors import ModelError
from scleraforce.base.units import to_si
from scleraforce.reading.frame_checks import too_little_wall
from scleraforce.reading.reading_models import ForceReader
from scleraforce.reading.trained_ranges import (
    READER,
    limit_remarks,
    reading_ranges,
    untrained_values,
)
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import SEALED, Globe
from scleraforce.records.model_folder import (
    SHIPPED_READER,
    SHIPPED_WALL_FINDER,
    folder_study,
    read_folder,
)
from scleraforce.records.needle import Needle, gauge_diameter_m
from scleraforce.records.recording_info import RecordingInfo
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import LibraryStudy, Range, ReaderStudy, Study
from virtual_eyes import changed

TRAINED = ReaderStudy(
    youngs_modulus_pa=Range(min=0.18e6, max=0.55e6),
    iop_pa=Range(min=120.0, max=560.0),
    thickness_m=Range(min=0.45e-3, max=0.85e-3),
    gap_m=Range(min=0.35e-3, max=1e-3),
)
HELD = LibraryStudy(stiffening=Range(min=0.0, max=20.0))
STIFF = replace(HELD, stiffening=Range(min=2.0, max=20.0))
ALONE = replace(HELD, stiffenings=1)


def refusal(
    setup: Setup, library: LibraryStudy = HELD, trained: ReaderStudy = TRAINED
) -> str | None:
    study = replace(Study(), reader=trained, library=library)
    model = ForceReader(Path("model"), study, FixedNetwork(FIVE_MN), LIBRARY, "fit")
    return model.refusal(setup)


def known(modulus_pa: float | None = None, **values: float) -> Setup:
    setup = changed(Setup(), **values)
    if modulus_pa is None:
        return setup
    own = Modulus(mean_pa=modulus_pa, sd_pa=1e3, source="own")
    return changed(setup, modulus=own)


@pytest.mark.parametrize(
    ("setup", "library"),
    [
        (known(0.18e6, iop_pa=120.0, thickness_m=0.45e-3, gap_m=0.35e-3), HELD),
        (known(0.55e6, iop_pa=560.0, thickness_m=0.85e-3, gap_m=1e-3), HELD),
        (known(stiffening=0.0), HELD),
        (known(stiffening=20.0), HELD),
        (Setup(), ALONE),
    ],
)
def test_an_eye_inside_the_training_is_inside_also_on_its_bounds(setup, library):
    assert refusal(setup, library) is None


@pytest.mark.parametrize(
    ("setup", "library", "words"),
    [
        (known(0.6e6), HELD, "Young's modulus 0.6 MPa"),
        (known(0.16e6), HELD, "Young's modulus 0.16 MPa"),
        (known(iop_pa=1333.0), HELD, "IOP 9.998 mmHg"),
        (known(thickness_m=1e-3), HELD, "wall thickness 1000 µm"),
        (known(gap_m=0.1e-3), HELD, "gap between B-scan and needle axis 0.1 mm"),
        (
            known(stiffening=20.5),
            HELD,
            "stiffening 20.5 of the tissue, the model was trained on 0 to 20",
        ),
        (Setup(), STIFF, "stiffening 0 of the tissue"),
        (
            known(stiffening=7.0),
            ALONE,
            "stiffening 7 of the tissue, the model was trained on 0 to 0",
        ),
    ],
)
def test_a_value_outside_is_named(setup, library, words):
    assert str(refusal(setup, library)).startswith(words)


@pytest.mark.parametrize(
    ("thickness", "iop", "sd", "reach"),
    [
        (0.03, 0.0, 0.01, 0.0608),
        (0.0, 0.15, 0.01, 0.0510),
        (0.0, 0.0, 0.04, 0.04),
        (0.02, 0.09, 0.12, 0.13),
    ],
)
def test_an_own_modulus_may_be_off_by_its_sd_twice_the_thicknesss_error_and_a_third_of_the_pressures(
    thickness, iop, sd, reach
):
    noise = {"thickness_noise_fraction": thickness, "iop_noise_fraction": iop}
    trained = replace(TRAINED, **noise)
    for bound_pa, outwards in zip(
        TRAINED.youngs_modulus_pa.bounds, (-1.0, 1.0), strict=True
    ):
        for share, is_own in ((0.97, True), (1.03, True), (0.97, False)):
            mean_pa = bound_pa * (1.0 + outwards * share * reach)
            modulus = Modulus(mean_pa=mean_pa, sd_pa=sd * mean_pa, source="own")
            modulus = modulus if is_own else replace(modulus, source="population")
            found = refusal(Setup(eye=Eye(modulus=modulus)), trained=trained)
            assert (found is None) == (is_own and share < 1.0)


EYE = Eye("eye", thickness_m=0.6e-3, iop_pa=270.0, globe=Globe.declared("sealed"))
SCAN = Scan(columns=512, rows=512, bits=12, width_m=15e-3, depth_m=4e-3)
NEEDLE = Needle(diameter_m=gauge_diameter_m(22), gap_m=0.5e-3)
STUDY = Study()


def rigid(mmhg13_per_ul: float) -> Globe:
    return Globe.declared("sealed", to_si(mmhg13_per_ul, "mmhg13_per_ul"))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"width_m": 6e-3}, "of the wall are visible"),
        ({"depth_m": 2e-3}, "frames 2 mm deep: deep dents leave them"),
        ({"globe": rigid(0.5)}, "rigidity of a sealed globe 0.5 mmHg"),
        ({"diameter_m": gauge_diameter_m(30)}, "needle of 30 gauge"),
        ({"tilt_rad": np.radians(10.0)}, "tilt of the B-scan 10 °"),
        ({"rows": 64}, "depth of a pixel 62.5 µm"),
    ],
)
def test_each_quantity_that_is_outside_has_a_sentence_of_its_own(values, words):
    setup = Setup(eye=EYE, scan=SCAN, needle=NEEDLE)
    assert limit_remarks(SHIPPED_READER, RecordingInfo(EYE, SCAN, NEEDLE)) == ()
    setup = changed(setup, **values)
    info = RecordingInfo(setup.eye, setup.scan, setup.needle)
    (found,) = limit_remarks(Path("default"), info)
    assert found.words.startswith("outside the range of default: ")
    assert words in found.words
    assert (found.code, found.severity) == ("outside-training", "caution")
    names = {item.name for kind in (Eye, Needle, Scan) for item in fields(kind)}
    assert found.fields
    assert names.issuperset(found.fields)


@pytest.mark.parametrize(
    ("width_mm", "depth_mm"),
    [
        *((width, 4.0) for width in (3.0, 3.45, 6.0, 9.5, 9.8, 9.9, 10.5, 20.0)),
        *((15.0, depth) for depth in (0.5, 0.9, 1.1, 3.0)),
    ],
)
def test_a_frame_of_the_largest_eye_is_refused_where_its_size_was(width_mm, depth_mm):
    """A circle touches the frame's top edge: how far does it stay in it?"""
    scan = replace(SCAN, width_m=width_mm * 1e-3, depth_m=depth_mm * 1e-3)
    radius_m = STUDY.eye.radius_m * STUDY.reader.size.bounds[1]
    column = np.arange(scan.columns) + 0.5 - scan.columns / 2
    lateral_m = column * scan.width_m / scan.columns
    curve_m = radius_m - np.sqrt(np.maximum(radius_m**2 - lateral_m**2, 0.0))
    outer_m = np.where(curve_m <= scan.depth_m, curve_m, np.nan)
    refused, calibrated = (
        too_little_wall(lateral_m, outer_m, STUDY.slice, is_calibrated=is_own)
        for is_own in (False, True)
    )
    said = untrained_values(READER, STUDY, Setup(), scan)
    visible = [one.words for one in said if "of the wall are visible" in one.words]
    assert bool(visible) == (refused is not None)
    if depth_mm == 4.0:
        assert (calibrated is None) == (width_mm > 3.5)
    if calibrated is not None:
        # which ends without the words on a calibration
        assert visible[0].endswith("are needed")


@pytest.mark.parametrize(
    ("kind", "values", "expected"),
    [
        ("reader", {"refractive_index": 1.38}, []),
        ("raw-reader", {"refractive_index": 1.38}, ["refractive_index"]),
        ("reader", {"globe": SEALED}, []),
        ("reader", {"globe": rigid(0.07)}, ["globe"]),
    ],
)
def test_a_raw_reader_takes_the_refractive_index_of_its_training_and_a_sealed_globe_needs_no_rigidity(
    kind, values, expected
):
    setup = changed(Setup(scan=SCAN), **values)
    said = untrained_values(kind, STUDY, setup, setup.scan)
    assert [field for one in said for field in one.fields] == expected


def test_a_wall_finder_has_no_ranges_and_no_limits_but_the_reader_s_scale():
    assert reading_ranges(SHIPPED_WALL_FINDER) == ()
    with pytest.raises(ModelError, match="kind: found 'wall-finder'"):
        limit_remarks(SHIPPED_WALL_FINDER, RecordingInfo(EYE, SCAN, NEEDLE))

    reader, finder = (
        folder_study(read_folder(model)).scenes.window.pixel_m
        for model in (SHIPPED_READER, SHIPPED_WALL_FINDER)
    )
    assert reader == finder
