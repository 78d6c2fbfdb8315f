"""Known inputs of a frame and its eye are used, or refused with one line."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from analytic_frames import KNOWN, SCALE, image, tip_of, wall_section
from small_models import force_reader

import scleraforce as sf
from scleraforce.errors import FrameError, InputError
from scleraforce.known import REFERENCE_RIGIDITY
from scleraforce.models import SHIPPED_READER
from scleraforce.notebook import counting_for
from scleraforce.notebook.calibrating import calibrate
from scleraforce.notebook.frames import evaluate, read, segment
from scleraforce.notebook.libraries import library_for
from scleraforce.notebook.training import train
from scleraforce.reader import load_force_reader
from scleraforce.reader.answer import Reading
from scleraforce.study import Study

FRAME = image(wall_section(tip_of(0.020)))
SIZE = {"width_m": 15e-3, "depth_m": 4e-3}


def test_an_array_is_read_as_the_reader_reads_it() -> None:
    expected = force_reader().read(FRAME, SCALE, KNOWN)
    assert KNOWN.modulus is not None
    given = {"iop_pa": KNOWN.iop_pa, "thickness_m": KNOWN.thickness_m, "gap_m": KNOWN.gap_m, "globe": "open"}
    answer = read(force_reader(), FRAME, youngs_modulus_pa=KNOWN.modulus.mean_pa, **given, **SIZE)
    assert answer.force_n == pytest.approx(expected.force_n, rel=0.01)
    assert answer.usable


def test_a_declared_globe_decides_the_pressure_at_the_dent() -> None:
    given = {"youngs_modulus_pa": 0.3e6, "iop_pa": KNOWN.iop_pa, "gap_m": KNOWN.gap_m, **SIZE}
    unsure = Reading(probabilities=(0.2, 0.5, 0.3), force_n=0.02, interval_n=(0.0, 0.06), contact_m=0.3e-3)
    vented = read(force_reader(unsure), FRAME, globe="open", **given)
    sealed = read(force_reader(unsure), FRAME, globe="sealed", rigidity_pa13_per_m3=REFERENCE_RIGIDITY / 3, **given)
    assert vented.iop_at_dent_pa == pytest.approx(KNOWN.iop_pa, rel=0.1)
    assert sealed.iop_at_dent_pa > 1.2 * vented.iop_at_dent_pa
    for globe, k, words in (
        (None, 1.5e8, "rigidity_pa13_per_m3: of a sealed globe"),
        ("open", 1.5e8, "rigidity_pa13_per_m3: of a sealed globe"),
        ("shut", None, "shut"),
        ("sealed", 0.03, "rigidity_mmhg13_per_ul"),
    ):
        with pytest.raises(InputError, match=words):
            read(force_reader(), FRAME, globe=globe, rigidity_pa13_per_m3=k, **given)


def test_an_array_is_segmented() -> None:
    assert segment(FRAME, **SIZE).thickness_m == pytest.approx(0.65e-3, rel=0.03)


def test_a_frame_that_cannot_be_used_is_one_clear_line() -> None:
    cases: list[tuple[Any, dict[str, float], str]] = [
        (FRAME, {}, "give width_m and depth_m"),
        (FRAME[0], SIZE, r"shape \(512,\); give one frame"),
        ([[1, 2], [3, 4]], SIZE, "frame: a frame of 2 dimensions and type int64"),
        (FRAME.astype(float), SIZE, "type float64"),
        (FRAME, {"width_m": 15.0, "depth_m": 4.0}, r"width_m: 15 .*did you mean 0\.015 m \(15 mm\)"),
        (FRAME, {**SIZE, "refractive_index": 3.0}, "refractive index of 3"),
        ("nowhere.png", SIZE, "nowhere.png"),
    ]
    for frame, size, words in cases:
        with pytest.raises(FrameError, match=words):
            segment(frame, **size)
        with pytest.raises(FrameError, match=words):
            read(force_reader(), frame, **size)


def test_inputs_that_would_be_ignored_are_refused() -> None:
    with pytest.raises(InputError, match="eye: 'eye-a' names an eye of a calibration"):
        read(force_reader(), FRAME, eye="eye-a", **SIZE)
    with pytest.raises(InputError, match="youngs_modulus_pa: the calibration gives the modulus"):
        read(force_reader(), FRAME, youngs_modulus_pa=0.3e6, calibration="modulus.json", **SIZE)


def test_a_path_in_the_place_of_a_model_says_how_to_load_it() -> None:
    with pytest.raises(InputError, match=r"give sf\.load_model\('reader'\)"):
        read("reader", FRAME, **SIZE)  # type: ignore[arg-type]  # the mistake
    with pytest.raises(InputError, match=r"give sf\.load_model\('reader'\)"):
        evaluate("reader", "eye-a")  # type: ignore[arg-type]  # the mistake


def test_wrong_input_of_a_calibration_or_a_training_is_one_clear_line() -> None:
    for given, words in (
        ({"mechanics": "soft"}, "mechanics: 'soft'"),
        ({"parameters": "e,iop"}, "parameters: 'e,iop'; give a list"),
        ({"parameters": ["iop"]}, "parameters"),
        ({"frames": 0}, "frames: 0"),
    ):
        with pytest.raises(InputError, match=words):
            calibrate("eye-a", sf.Study(), **given)
    with pytest.raises(InputError, match="recordings: none"):
        calibrate([])
    with pytest.raises(InputError, match="source: found str"):
        train("slices", "model")  # type: ignore[arg-type]  # the mistake


def test_progress_counts_its_own_work_alone() -> None:
    counted: list[int] = []
    for title in ("library", "frames"):
        with counting_for(counted.append, "frames")(title, 3) as advance:
            advance(2)
    assert counted == [2]


def test_linear_mechanics_needs_no_library_and_the_papers_is_the_bundled_readers(tmp_path: Path, monkeypatch) -> None:
    assert library_for(Study(), "linear", counting_for(None, "library")) is None
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    ticks: list[int] = []
    found = library_for(Study(), "finite-strain", counting_for(ticks.append, "library"))
    assert found is not None
    np.testing.assert_array_equal(found.walls.values(), load_force_reader(SHIPPED_READER).library.walls.values())
    assert not ticks
    assert not list(tmp_path.iterdir())
