"""Setup values of an eye, its scan and its needle outside a model's training."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from scleraforce.base.errors import ModelError
from scleraforce.base.units import to_si
from scleraforce.reading.frame_checks import least_wall_m, too_little_wall
from scleraforce.reading.trained_ranges import (
    RAW_READER,
    READER,
    limit_remarks,
    outside_training,
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

TRAINED = ReaderStudy(
    youngs_modulus_pa=Range(min=0.18e6, max=0.55e6),
    iop_pa=Range(min=120.0, max=560.0),
    thickness_m=Range(min=0.45e-3, max=0.85e-3),
    gap_m=Range(min=0.35e-3, max=1e-3),
)
HELD = LibraryStudy(stiffening=Range(min=0.0, max=20.0))
INSIDE = Setup(
    eye=Eye(
        modulus=Modulus(mean_pa=0.3e6, sd_pa=5e3, source="own"),
        iop_pa=270.0,
        thickness_m=0.6e-3,
    ),
    needle=Needle(gap_m=0.5e-3),
)


def test_an_eye_inside_the_training_is_inside_also_on_its_bounds() -> None:
    assert outside_training(Setup(), TRAINED, HELD) is None
    assert outside_training(INSIDE, TRAINED, HELD) is None

    for end in (0, 1):
        modulus = Modulus(
            mean_pa=TRAINED.youngs_modulus_pa.bounds[end], sd_pa=1e3, source="own"
        )
        known = Setup(
            eye=Eye(
                modulus=modulus,
                iop_pa=TRAINED.iop_pa.bounds[end],
                thickness_m=TRAINED.thickness_m.bounds[end],
            ),
            needle=Needle(gap_m=TRAINED.gap_m.bounds[end]),
        )
        assert outside_training(known, TRAINED, HELD) is None


def test_an_eye_is_inside_where_the_library_of_the_training_holds_its_tissue() -> None:
    for stiffening in (None, 0.0, 7.0, 20.0):
        assert (
            outside_training(Setup(eye=Eye(stiffening=stiffening)), TRAINED, HELD)
            is None
        )

    stiff = replace(HELD, stiffening=Range(min=2.0, max=20.0))
    alone = replace(HELD, stiffenings=1)
    assert str(outside_training(Setup(), TRAINED, stiff)).startswith(
        "stiffening 0 of the tissue"
    )
    assert outside_training(Setup(), TRAINED, alone) is None
    assert str(
        outside_training(Setup(eye=Eye(stiffening=7.0)), TRAINED, alone)
    ).endswith("the model was trained on 0 to 0")


def test_a_value_outside_is_named() -> None:
    for known, words in (
        (
            Setup(eye=Eye(modulus=Modulus(mean_pa=0.6e6, sd_pa=1e3, source="own"))),
            "Young's modulus 0.6 MPa",
        ),
        (
            Setup(eye=Eye(modulus=Modulus(mean_pa=0.16e6, sd_pa=1e3, source="own"))),
            "Young's modulus 0.16 MPa",
        ),
        (Setup(eye=Eye(iop_pa=1333.0)), "IOP 9.998 mmHg"),
        (Setup(eye=Eye(thickness_m=1e-3)), "wall thickness 1000 µm"),
        (
            Setup(needle=Needle(gap_m=0.1e-3)),
            "gap between B-scan and needle axis 0.1 mm",
        ),
        (
            Setup(eye=Eye(stiffening=20.5)),
            "stiffening 20.5 of the tissue, the model was trained on 0 to 20",
        ),
    ):
        assert str(outside_training(known, TRAINED, HELD)).startswith(words)


def test_an_own_modulus_may_be_off_by_its_sd_twice_the_thicknesss_error_and_a_third_of_the_pressures():
    low, high = TRAINED.youngs_modulus_pa.bounds
    for thickness, iop, sd, reach in (
        (0.03, 0.0, 0.01, 0.0608),
        (0.0, 0.15, 0.01, 0.0510),
        (0.0, 0.0, 0.04, 0.04),
        (0.02, 0.09, 0.12, 0.13),
    ):
        trained = replace(
            TRAINED, thickness_noise_fraction=thickness, iop_noise_fraction=iop
        )
        for bound, outwards in ((low, -1.0), (high, 1.0)):
            for share, inside in ((0.97, True), (1.03, False)):
                mean_pa = bound * (1.0 + outwards * share * reach)
                own = Modulus(mean_pa=mean_pa, sd_pa=sd * mean_pa, source="own")
                assert (
                    outside_training(Setup(eye=Eye(modulus=own)), trained, HELD) is None
                ) == inside

                for source in ("stated", "population"):
                    assert (
                        outside_training(
                            Setup(eye=Eye(modulus=replace(own, source=source))),
                            trained,
                            HELD,
                        )
                        is not None
                    )


EYE = Eye("eye", thickness_m=0.6e-3, iop_pa=270.0, globe=Globe.declared("sealed"))
SCAN = Scan(columns=512, rows=512, bits=12, width_m=15e-3, depth_m=4e-3)
INFO = RecordingInfo(EYE, SCAN, Needle(diameter_m=gauge_diameter_m(22), gap_m=0.5e-3))
STUDY = Study()
OUTSIDE = {
    "of the wall are visible": replace(INFO, scan=replace(SCAN, width_m=6e-3)),
    "frames 2 mm deep: deep dents leave them": replace(
        INFO, scan=replace(SCAN, depth_m=2e-3)
    ),
    "wall thickness 1000 µm": replace(INFO, eye=replace(EYE, thickness_m=1e-3)),
    "IOP 15 mmHg": replace(INFO, eye=replace(EYE, iop_pa=to_si(15.0, "mmhg"))),
    "rigidity of a sealed globe 0.5 mmHg": replace(
        INFO,
        eye=replace(EYE, globe=Globe.declared("sealed", to_si(0.5, "mmhg13_per_ul"))),
    ),
    "needle of 30 gauge": replace(
        INFO, needle=replace(INFO.needle, diameter_m=gauge_diameter_m(30))
    ),
    "gap between B-scan and needle axis 2 mm": replace(
        INFO, needle=replace(INFO.needle, gap_m=2e-3)
    ),
    "tilt of the B-scan 10 °": replace(
        INFO, scan=replace(SCAN, tilt_rad=np.radians(10.0))
    ),
    "depth of a pixel 62.5 µm": replace(INFO, scan=replace(SCAN, rows=64)),
}


def test_each_quantity_that_is_outside_has_a_sentence_of_its_own() -> None:
    assert limit_remarks(SHIPPED_READER, INFO) == ()
    for words, info in OUTSIDE.items():
        (found,) = limit_remarks(Path("default"), info)
        assert found.words.startswith("outside the range of default: ")
        assert words in found.words
        assert (found.code, found.severity) == ("outside-training", "caution")
        names = {item.name for kind in (Eye, Needle, Scan) for item in fields(kind)}
        assert found.fields
        assert names.issuperset(found.fields)


def test_a_frame_whose_whole_width_shows_the_wall_is_refused_where_its_width_was():
    for width_mm in (3.0, 3.45, 6.0, 9.5, 9.8, 9.9, 10.5, 20.0):
        scan = replace(SCAN, width_m=width_mm * 1e-3)
        lateral_m = (
            (np.arange(scan.columns) + 0.5 - scan.columns / 2)
            * scan.width_m
            / scan.columns
        )
        wall = lateral_m, np.zeros(scan.columns), STUDY.slice
        refused, calibrated = (
            too_little_wall(*wall, is_calibrated=is_own) for is_own in (False, True)
        )
        assert (calibrated is None) == (width_mm > 3.5)
        said = " ".join(map(str, untrained_values(READER, STUDY, Setup(), scan)))
        assert (
            bool(said)
            == bool(untrained_values(RAW_READER, STUDY, Setup(), scan))
            == (refused is not None)
        )
        assert (calibrated or refused or "") in said

    narrow = replace(STUDY, slice=replace(STUDY.slice, columns=60))
    assert least_wall_m(narrow.slice) == pytest.approx(
        60 / STUDY.slice.columns * least_wall_m(STUDY.slice)
    )
    assert untrained_values(READER, narrow, Setup(), replace(SCAN, width_m=6e-3)) == ()


def test_a_frame_is_refused_where_it_is_less_deep_than_the_curve_of_the_largest_eye():
    """The oracle looks how far a circle that touches the frame's top edge stays in
    it.
    """
    radius_m = STUDY.eye.radius_m * STUDY.reader.size.bounds[1]
    lateral_m = np.linspace(-7e-3, 7e-3, 20_001)
    curve_m = radius_m - np.sqrt(radius_m**2 - lateral_m**2)

    for depth_m in (0.5e-3, 0.9e-3, 1.1e-3, 3.0e-3):
        refused = too_little_wall(
            lateral_m, np.where(curve_m <= depth_m, curve_m, np.nan), STUDY.slice
        )
        said = untrained_values(READER, STUDY, Setup(), replace(SCAN, depth_m=depth_m))
        is_named = any("of the wall are visible" in remark.words for remark in said)
        assert is_named == bool(refused)


def test_a_raw_reader_takes_the_refractive_index_of_its_training_and_a_sealed_globe_needs_no_rigidity():
    stretched = replace(SCAN, refractive_index=1.38)
    assert untrained_values(READER, STUDY, Setup(), stretched) == ()
    (said,) = untrained_values(RAW_READER, STUDY, Setup(), stretched)
    assert said.fields == ("refractive_index",)
    assert (
        said.words == "refractive index 1.38 of the frame, the model was trained with 1"
    )
    assert untrained_values(READER, STUDY, Setup(eye=Eye(globe=SEALED)), SCAN) == ()
    stiff = Globe.declared("sealed", to_si(0.07, "mmhg13_per_ul"))
    assert len(untrained_values(READER, STUDY, Setup(eye=Eye(globe=stiff)), SCAN)) == 1


def test_a_wall_finder_has_no_ranges_and_no_limits_but_the_reader_s_scale() -> None:
    assert reading_ranges(SHIPPED_WALL_FINDER) == ()
    with pytest.raises(ModelError, match="kind: found 'wall-finder'"):
        limit_remarks(SHIPPED_WALL_FINDER, INFO)

    studies = [
        folder_study(read_folder(model))
        for model in (SHIPPED_READER, SHIPPED_WALL_FINDER)
    ]
    assert studies[0].scenes.window.pixel_m == studies[1].scenes.window.pixel_m
