"""Records and their short forms: what is known of an experiment, told to the public
functions.
"""

from collections.abc import Callable
from dataclasses import replace
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from analytic_frames import (
    GAP_M,
    IOP_PA,
    KNOWN_EYE,
    MODULUS_PA,
    SIZE,
    THICKNESS_M,
    frame_under,
)
from foreign_files import FRAMES
from small_models import force_reader
from small_recordings import calibration_of_a_sealed_eye, write_small_recording

import scleraforce as sf
from scleraforce.base.errors import InputError
from scleraforce.front.api.monitor_settings import prepare_monitor
from scleraforce.front.api.reading_frames import summary_of_calibration
from scleraforce.live.monitor_request import MonitorRequest
from scleraforce.reading.answer import Answer, Reading
from scleraforce.records.calibration_file import known_of_eye, write_calibration
from scleraforce.records.eye import NO_DISCREPANCY
from scleraforce.records.model_folder import SHIPPED_READER
from scleraforce.records.setup import Setup

FRAME = frame_under(0.020)
NEEDLE: dict[str, Any] = {"gap_m": GAP_M}
SCAN = SIZE | {"refractive_index": 1.02}
SHORT = KNOWN_EYE | NEEDLE | SCAN
OPEN_EYE = sf.Eye(
    modulus=sf.Modulus.stated(MODULUS_PA),
    iop_pa=IOP_PA,
    thickness_m=THICKNESS_M,
    globe=sf.Globe.declared("open"),
)
RELAXING = sf.Relaxation.declared([(0.12, 1.2), (0.15, 12.0)])
UNSURE = Reading(
    probabilities=(0.2, 0.5, 0.3),
    force_n=0.02,
    interval_n=(0.0, 0.06),
    contact_m=0.3e-3,
)
MASK = np.zeros(FRAME.shape, np.uint8)


def read(frame: Any = FRAME, **given: Any) -> Answer:
    return sf.read(force_reader(), frame, **given)  # type: ignore[no-any-return]


def fit_width_n(**changes: Any) -> float:
    """Width of the fit's interval with other values of the eye."""
    answer = read(eye=replace(OPEN_EYE, **changes), **NEEDLE, **SCAN)
    return dict(answer.readings)["fit"].width_n


@pytest.fixture(scope="module")
def short_answer() -> dict[str, Any]:
    """The answer where all values are keywords."""
    answer = read(**SHORT)
    assert answer.usable
    return answer.to_dict()


@pytest.mark.parametrize(
    "records",
    [
        {"eye": OPEN_EYE, **NEEDLE, **SCAN},
        {"needle": sf.Needle(**NEEDLE), **KNOWN_EYE, **SCAN},
        {"scan": sf.Scan(**SCAN), **KNOWN_EYE, **NEEDLE},
        {"frame": sf.Frame(FRAME), **SHORT},
        {"frame": [sf.Frame(FRAME)], **SHORT},
        {"frame": sf.Moment((sf.Frame(FRAME),)), **SHORT},
        {"frame": sf.Moment((sf.Frame(FRAME),), iop_pa=IOP_PA), **SHORT, "iop_pa": 1e3},
    ],
    ids=["eye", "needle", "scan", "frame", "frames", "moment", "iop"],
)
def test_a_record_is_read_as_its_short_form(
    records: dict[str, Any], short_answer: dict[str, Any]
) -> None:
    assert read(**records).to_dict() == short_answer


FULL: dict[str, Any] = {
    "eye": OPEN_EYE,
    "needle": sf.Needle(**NEEDLE),
    "scan": sf.Scan(**SCAN),
}


@pytest.mark.parametrize("name", SHORT)
def test_a_value_that_is_stated_twice_is_refused_with_its_name(name: str) -> None:
    with pytest.raises(InputError, match=f"^{name}: stated twice, by the keyword and"):
        read(**FULL, **{name: SHORT[name]})


@pytest.mark.parametrize(
    ("method", "mechanics"),
    [
        ({}, "finite-strain"),
        ({"estimator": "ours"}, "finite-strain"),
        ({"mechanics": "finite-strain"}, "finite-strain"),
        ({"estimator": "ours", "mechanics": "finite-strain"}, "finite-strain"),
        ({"estimator": "roukf"}, "linear"),
        ({"mechanics": "linear"}, "linear"),
        ({"estimator": "roukf", "mechanics": "linear"}, "linear"),
    ],
)
def test_an_estimator_and_its_mechanics_imply_each_other(
    method: dict[str, Any], mechanics: str
) -> None:
    assert sf.CalibrationMethod(**method).wall_mechanics == mechanics


@pytest.mark.parametrize(
    ("ask", "name"),
    [
        (lambda: sf.calibrate("a", eye=OPEN_EYE, thickness_m=6e-4), "thickness_m"),
        (
            lambda: sf.calibrate("a", method=sf.CalibrationMethod(), mechanics="x"),
            "mechanics",
        ),
        (lambda: imported(needle=sf.Needle(diameter_m=7e-4), gauge=22), "diameter_m"),
        (lambda: imported(scan=sf.Scan(bits=12), bits=12), "bits"),
        (
            lambda: imported(settings=sf.ImportSettings(rate_hz=2.0), rate_hz=2.0),
            "rate_hz",
        ),
        (lambda: read(sf.Frame(FRAME, mask=MASK), mask=MASK, **SHORT), "mask"),
    ],
)
def test_a_value_of_another_record_is_stated_once(
    ask: Callable[[], object], name: str
) -> None:
    with pytest.raises(InputError, match=f"^{name}: stated "):
        ask()


def imported(**given: Any) -> Any:
    return sf.import_recording("a.tif", "no/such/folder", **given)


@pytest.mark.parametrize(
    ("function", "arguments"),
    [
        (sf.read, ("default", FRAME)),
        (sf.segment, (FRAME,)),
        (sf.calibrate, ("eye-a",)),
        (sf.import_recording, ("a.tif", "no/such/folder")),
        (sf.simulate, ()),
    ],
)
def test_a_keyword_that_does_not_exist_is_a_type_error(
    function: Any, arguments: tuple[Any, ...]
) -> None:
    with pytest.raises(TypeError, match="unexpected keyword 'iop_mmhg'"):
        function(*arguments, iop_mmhg=15.0)


def test_a_frame_has_its_own_mask_and_a_moment_of_masks_takes_no_other() -> None:
    mask = sf.segment(FRAME, **SCAN).mask
    framed = sf.Frame(FRAME, mask=mask)
    assert read(framed, **SHORT).to_dict() == read(mask=mask, **SHORT).to_dict()

    with pytest.raises(InputError, match=r"^mask: of a moment, each frame has its own"):
        read(sf.Moment((framed,)), mask=mask, **SHORT)


@pytest.mark.parametrize(
    ("record", "words"),
    [
        (lambda: sf.Frame(FRAME, mask_sd_rows=0.0), "mask_sd_rows: 0.0; give"),
        (lambda: sf.Frame(FRAME, mask_sd_rows=None), "mask_sd_rows: None; give"),
        (lambda: sf.Frame(FRAME, plane=5), "plane: found int 5; give a str"),
        (lambda: sf.Moment(()), "frame: none"),
        (lambda: sf.Moment((FRAME,)), "frames: give a tuple of Frame"),
        (lambda: replace(OF_FRAME, held_s=-1.0), "held_s: -1; give"),
        (lambda: replace(OF_FRAME, iop_pa=-1.0), "iop_pa: -1 is below"),
        (lambda: replace(OF_FRAME, time_s="1"), "time_s: found str '1'; give a number"),
        (lambda: replace(OF_FRAME, held_s=True), "held_s: found bool True"),
        (lambda: replace(OF_FRAME, travel_m=inf), "travel_m: inf is not a finite"),
        (lambda: replace(OF_FRAME, iop_pa=nan), "iop_pa: nan is not a finite number"),
        (lambda: sf.Needle(lean_rad=0.1), "lean_rad: 0.1; give its two ends"),
        (lambda: sf.ImportSettings(flip="x"), "flip: 'x'; give 'rows' or 'columns'"),
    ],
)
def test_an_impossible_record_is_refused_by_its_field(record: Any, words: str) -> None:
    with pytest.raises(InputError, match=f"^{words}"):
        record()


OF_FRAME = sf.Moment((sf.Frame(FRAME),))


@pytest.mark.parametrize(
    ("field", "small", "usual", "large"),
    [
        ("iop_sd_pa", 1.0, 0.05 * IOP_PA, 150.0),
        ("thickness_sd_m", 1e-6, 15e-6, 60e-6),
    ],
)
def test_an_uncertainty_of_the_eye_sets_the_width_of_the_interval(
    field: str, small: float, usual: float, large: float
) -> None:
    widths_n = [
        fit_width_n(**values) for values in ({field: small}, {}, {field: large})
    ]
    assert widths_n[0] < widths_n[1] < widths_n[2]
    assert fit_width_n(**{field: usual}) == pytest.approx(widths_n[1], rel=1e-9)


def test_a_radius_narrows_the_interval_by_its_uncertainty() -> None:
    unknown: dict[str, Any] = {"modulus": None}  # beside a known one it hardly counts
    told = unknown | {"radius_m": 12e-3}
    undeclared_n = fit_width_n(**unknown)
    told_n = fit_width_n(**told)
    exact_n = fit_width_n(**told, radius_sd_m=12e-6)
    unsure_n = fit_width_n(**told, radius_sd_m=1.2e-3)
    assert exact_n < told_n < undeclared_n < unsure_n
    assert fit_width_n(**told, radius_sd_m=0.02 * 12e-3) == told_n


def test_what_records_declare_reaches_the_imported_recording(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", FRAMES, photometric="minisblack")
    eye = sf.Eye(
        "b",
        iop_pa=2000.0,
        iop_sd_pa=150.0,
        thickness_m=650e-6,
        thickness_sd_m=20e-6,
        radius_m=11.5e-3,
        radius_sd_m=0.1e-3,
        globe=sf.Globe.declared("sealed", 1.5e8, "logarithmic", 30.0),
        relaxation=RELAXING,
    )
    needle = sf.Needle(
        diameter_m=0.7e-3,
        gap_m=0.6e-3,
        polar_rad=0.5,
        lean_rad=(0.1, 0.1),
        lean_azimuth_rad=0.2,
    )
    scan = sf.Scan(
        width_m=12e-3,
        depth_m=4e-3,
        refractive_index=1.38,
        bits=13,
        direction_rad=0.3,
        tilt_rad=0.05,
    )
    recording = sf.import_recording(
        tmp_path / "a.tif",
        tmp_path / "r",
        eye=eye,
        needle=needle,
        scan=scan,
        rate_hz=1.0,
    )
    info = recording.info
    for record, declared in (
        (info.eye.globe, eye.globe),
        (replace(info.eye, globe=eye.globe), eye),
        (info.needle, needle),
    ):
        for field, value in vars(declared).items():
            assert getattr(record, field) == approximately(value), field
    for field in ("width_m", "depth_m", "bits", "direction_rad", "tilt_rad"):
        assert getattr(info.scan, field) == approximately(getattr(scan, field)), field


@pytest.mark.parametrize(
    "found",
    [
        {"modulus": sf.Modulus.stated(0.3e6)},
        {"stiffening": 4.0},
        {"discrepancy": NO_DISCREPANCY},
        {"calibrated_lean_rad": 0.0},
    ],
)
def test_what_only_a_calibration_finds_is_told_to_none_and_to_no_recording(
    found: dict[str, Any], tmp_path: Path
) -> None:
    eye = sf.Eye(**found)
    (field,) = found
    with pytest.raises(InputError, match=f"^{field}: no recording states it"):
        imported(eye=eye)

    recording = write_small_recording(tmp_path / "small", frames=2)
    with pytest.raises(InputError, match=f"^{field}: is what a calibration finds"):
        sf.calibrate(recording, eye=eye)


def approximately(value: Any) -> Any:
    return pytest.approx(value, rel=1e-12) if isinstance(value, float) else value


@pytest.mark.parametrize(
    ("records", "field"),
    [
        ({"eye": sf.Eye(radius_m=11e-3), "second_opinion": False}, "eye.radius_m"),
        (
            {"eye": sf.Eye(globe=sf.Globe.declared("sealed", leak_time_s=20.0))},
            "eye.globe.leak_time_s",
        ),
        ({"needle": sf.Needle(diameter_m=0.65e-3)}, "needle.diameter_m"),
        ({"needle": sf.Needle(azimuth_rad=0.5)}, "needle.azimuth_rad"),
        (
            {
                "needle": sf.Needle(lean_rad=(0.1, 0.1), lean_azimuth_rad=0.2),
                "scan": sf.Scan(planes=(sf.Plane("a", 0, 0), sf.Plane("b", 0, 1.5))),
            },
            "needle.lean_azimuth_rad",
        ),
        ({"scan": sf.Scan(bits=12)}, "scan.bits"),
        ({"scan": sf.Scan(transposed=True)}, "scan.transposed"),
    ],
)
def test_a_monitor_refuses_what_it_cannot_use(
    records: dict[str, Any], field: str
) -> None:
    """As `sf.monitor` asks for it in a process of its own."""
    second_opinion = records.get("second_opinion", True)
    parts = {key: one for key, one in records.items() if key != "second_opinion"}
    request = MonitorRequest(
        model=SHIPPED_READER, setup=Setup(**parts), second_opinion=second_opinion
    )
    with pytest.raises(InputError, match=f"^{field}: "):
        prepare_monitor(request)


def test_a_calibration_in_memory_is_read_as_its_file_to_the_bit(tmp_path: Path) -> None:
    calibration = calibration_of_a_sealed_eye()
    write_calibration(calibration.to_dict(), tmp_path / "c.json")
    reader = force_reader(UNSURE)
    answers = [
        sf.read(reader, FRAME, calibration=given, eye="mine", iop_pa=IOP_PA, **SCAN)
        for given in (calibration, tmp_path / "c.json")
    ]
    assert answers[0].to_dict() == answers[1].to_dict()
    assert answers[0].usable


def test_a_leak_stays_with_a_calibrated_globe() -> None:
    summary = summary_of_calibration(calibration_of_a_sealed_eye())
    own = summary.eyes["mine"].eye.globe
    assert own is not None
    leaking = sf.Globe.declared("sealed", leak_time_s=20.0)

    for declared, leak_time_s in ((leaking, 20.0), (None, None)):
        known = known_of_eye(Setup(eye=sf.Eye("mine", globe=declared)), summary, "mine")
        assert known.eye.globe == replace(own, leak_time_s=leak_time_s)
        assert known.eye.leak_time_s == leak_time_s


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (
            lambda: read(scan=sf.Scan(rows=17, **SCAN), **KNOWN_EYE),
            "frame: rows: .*; the scan declares 17",
        ),
        (
            lambda: read(scan=sf.Scan(bits=1, **SCAN), **KNOWN_EYE),
            "frame: bits: a pixel of .*; the scan declares 1 bits",
        ),
        (
            lambda: read(calibration=5, **NEEDLE, **SCAN),
            "calibration: found int; give what",
        ),
        (lambda: sf.calibrate("eye-a", method="linear"), "method: found str 'linear'"),
        (lambda: sf.calibrate("eye-a", "study.toml"), "study: found str 'study.toml'"),
    ],
)
def test_what_does_not_fit_is_refused_by_its_field(
    ask: Callable[[], object], words: str
) -> None:
    with pytest.raises(InputError, match=f"^{words}"):
        ask()


def test_the_time_of_a_hold_narrows_the_reading_of_tissue_that_relaxes():
    eye = replace(OPEN_EYE, relaxation=RELAXING)
    frame = sf.Frame(FRAME)
    held, unknown = (
        read(moment, eye=eye, **NEEDLE, **SCAN)
        for moment in (sf.Moment((frame,), held_s=1.0), sf.Moment((frame,)))
    )
    assert np.ptp(held.interval_n) < np.ptp(unknown.interval_n)
