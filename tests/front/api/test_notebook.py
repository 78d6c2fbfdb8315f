"""The functions of a notebook: frames, calibrations and imports as the commands do
them.
"""

from contextlib import nullcontext
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from analytic_frames import SIZE, frame_under
from effects import contents
from foreign_files import FRAMES, write_log, write_table
from small_models import force_reader
from small_recordings import calibration_text

import scleraforce as sf
from scleraforce.base.units import to_si
from scleraforce.front.api.calibrating import library_for

FRAME = frame_under(0.020)


@pytest.mark.parametrize(
    ("eyes", "frame", "words"),
    [
        ("mine", FRAME, "has 1 eye: give mine; any other gets"),
        ("mine yours", np.stack([FRAME, FRAME]), "has 2 eyes: give one of mine, yours"),
    ],
)
def test_an_array_with_a_calibration_needs_the_name_of_its_eye(
    eyes: str, frame: np.ndarray, words: str, tmp_path: Path
) -> None:
    file = tmp_path / "c.json"
    entries = {eye: {"mean_mpa": 0.3} for eye in eyes.split()}
    file.write_text(calibration_text(eyes=entries))
    with pytest.raises(sf.InputError, match=f"eye: missing; no recording.*{words}"):
        sf.read(force_reader(), frame, calibration=file, **SIZE)
    assert sf.read(force_reader(), frame, calibration=file, eye="mine", **SIZE)


@pytest.mark.parametrize("function", ["segment", "read"])
@pytest.mark.parametrize(
    ("frame", "given", "words"),
    [
        (FRAME, {}, "give width_m and depth_m"),
        (FRAME[0], SIZE, r"shape \(512,\); give one frame"),
        ([[1, 2], [3, 4]], SIZE, "a frame of 2 x 2 pixels: give at least 16 x 16"),
        (FRAME.astype(complex), SIZE, "pixels of type complex128"),
        ("nowhere.png", SIZE, "nowhere.png"),
        (
            FRAME,
            {"width_m": 15.0, "depth_m": 4.0},
            r"width_m: 15 .*did you mean 0\.015 m \(15 mm\)",
        ),
        (FRAME, {**SIZE, "refractive_index": 3.0}, "refractive_index: 3 is above"),
    ],
)
def test_a_frame_that_cannot_be_used_is_one_clear_line(
    function: str, frame: Any, given: dict[str, float], words: str
) -> None:
    model = (force_reader(),) * (function == "read")
    with pytest.raises(sf.InputError, match=words):
        getattr(sf, function)(*model, frame, **given)


@pytest.mark.parametrize(
    ("model", "given", "words"),
    [
        ("default", {"eye": "eye-a"}, "eye: 'eye-a' names an eye of a calibration"),
        ("default", {"globe": "shut"}, "shut"),
        (
            "default",
            {"youngs_modulus_pa": 0.3e6, "calibration": "modulus.json"},
            "the calibration gives the modul",
        ),
        ("nothing", {}, "nothing: no such folder; give one, or a bundled model"),
    ],
)
def test_inputs_that_would_be_ignored_and_a_missing_model_are_refused(
    model: str, given: dict[str, Any], words: str
) -> None:
    with pytest.raises(sf.InputError, match=words):
        sf.read(model, FRAME, **given, **SIZE)


@pytest.mark.parametrize(
    ("recordings", "given", "words"),
    [
        ("eye-a", {"mechanics": "soft"}, "mechanics: 'soft'"),
        ("eye-a", {"estimator": "ekf"}, "`estimator`: 'ekf'; give ours or roukf"),
        (
            "eye-a",
            {"estimator": "roukf", "mechanics": "finite-strain"},
            "`estimator`: roukf has linear mechanics, not finite-strain",
        ),
        (
            "eye-a",
            {"estimator": "ours", "mechanics": "linear"},
            "`estimator`: ours has finite-strain mechanics, not linear",
        ),
        (
            "eye-a",
            {"estimator": "roukf", "without_force": True},
            "leave out `estimator`, `mechanics` and `parameters`",
        ),
        ("eye-a", {"parameters": "e,iop"}, "parameters: 'e,iop'; give a list"),
        ("eye-a", {"parameters": ["iop"]}, "parameters"),
        ("eye-a", {"frames": 0}, "frames: 0"),
        ([], {}, "recordings: none"),
    ],
)
def test_wrong_input_of_a_calibration_is_one_clear_line(
    recordings: Any, given: dict[str, Any], words: str
) -> None:
    with pytest.raises(sf.InputError, match=words):
        sf.calibrate(recordings, **given)


def test_a_training_needs_a_source() -> None:
    with pytest.raises(sf.InputError, match="source: found str"):
        sf.train("slices", "model")  # type: ignore[arg-type]  # the mistake


def test_linear_mechanics_needs_no_library_and_the_papers_is_the_bundled_readers(
    tmp_path: Path, monkeypatch
) -> None:
    counted: list[int] = []

    def library(mechanics: str) -> Any:
        bar = nullcontext(counted.append)
        return library_for(sf.Study(), mechanics, lambda *_: bar)

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert library("linear") is None
    bundled = sf.load_model("default").library
    found = library("finite-strain")
    np.testing.assert_array_equal(found.curves_tpdbnc(), bundled.curves_tpdbnc())
    assert counted == []
    assert list(tmp_path.iterdir()) == []


STATED = {"width_m": 12e-3, "depth_m": 4e-3, "refractive_index": 1.38, "bits": 13}
NEEDLE = {"eye": "eye-1", "gauge": 22, "gap_m": 0.6e-3}
FORCE = {"contact_sign": -1, "clock_offset_s": 0.5}
TOLD = {**STATED, **NEEDLE, **FORCE, "rate_hz": 1.0}
OPTIONS = (
    "--width-mm 12 --depth-mm 4 --refractive-index 1.38 --bits 13 --rate-hz 1"
    " --gauge 22 --gap-mm 0.6 --contact-sign -1 --clock-offset-s 0.5 --average-s 0.5"
    " --eye eye-1 --thickness-um 650 --iop-mmhg 15 --globe sealed"
    " --polar-angle-deg 30 --relaxation 0.12:1.2,0.15:12.0"
)


@pytest.fixture
def sources(tmp_path: Path) -> list[Path]:
    """A stack that states nothing, and a log whose columns say what they are."""
    tifffile.imwrite(tmp_path / "a.tif", FRAMES, photometric="minisblack")
    write_log(tmp_path / "log.csv")
    return [tmp_path / "a.tif", tmp_path / "log.csv"]


def test_it_writes_what_the_command_writes(
    sources: list[Path], tmp_path: Path, shell
) -> None:
    eye = sf.Eye(
        "eye-1",
        thickness_m=650e-6,
        iop_pa=to_si(15.0, "mmhg"),
        globe=sf.Globe.declared("sealed"),
        relaxation=sf.Relaxation.declared([(0.12, 1.2), (0.15, 12.0)]),
    )
    recording = sf.import_recording(
        sources,
        tmp_path / "r",
        **TOLD | {"eye": eye},
        needle=sf.Needle(polar_rad=radians(30.0)),
        settings=sf.ImportSettings(average_s=0.5),
    )
    shell.run("import", *sources, OPTIONS, "--out", tmp_path / "s")
    command = sf.read_recording(tmp_path / "s")
    assert recording.path == tmp_path / "r"
    assert recording.frames == command.frames
    assert recording.info.scan == command.info.scan
    for part in ("eye", "needle", "force"):
        mine, theirs = (getattr(one.info, part) for one in (recording, command))
        for name, value in vars(theirs).items():
            close = pytest.approx(value, rel=1e-12) if type(value) is float else value
            assert getattr(mine, name) == close, name

    written, by_command = (
        {
            name: content
            for name, content in contents(one.path).items()
            if not name.endswith(".toml")
        }
        for one in (recording, command)
    )
    assert written == by_command


def test_missing_metadata_is_named_by_arguments_all_at_once(
    sources: list[Path], tmp_path: Path
) -> None:
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(sf.InputError) as told:
        sf.import_recording(sources, tmp_path / "r")

    names = [*STATED, *NEEDLE, *FORCE, "rate_hz` or `times"]
    assert all(f"(`{name}`)" in str(told.value) for name in names), told.value
    assert "thickness_m" not in str(told.value)
    assert "--" not in str(told.value)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"width_m": 12.0}, "width_m: 12 is above the largest allowed value 0.1"),
        ({"bits": -1}, "bits: -1 is below"),
        ({"rate_hz": 0.0}, "^`rate_hz`: 0; give the frames taken in a second"),
        ({"contact_sign": 0}, "contact_sign: 0 is not a sign"),
        (
            {"settings": sf.ImportSettings(grey_range=(9.0, 1.0))},
            "^`grey_range`: 9 1; give the darkest",
        ),
        ({"columns": ["fz=pull"]}, "^`columns`: 'fz=pull'; give COLUMN=NAME:UNIT"),
        ({"globe": "shut"}, "globe: "),
    ],
)
def test_a_wrong_value_is_refused_by_its_argument(
    sources: list[Path], tmp_path: Path, changed: dict[str, Any], words: str
) -> None:
    with pytest.raises(sf.InputError, match=words):
        sf.import_recording(sources, tmp_path / "r", **{**TOLD, **changed})
    assert not (tmp_path / "r").exists()


def test_a_property_that_a_source_leaves_open_is_named_by_its_argument(
    sources: list[Path], tmp_path: Path
) -> None:
    np.save(tmp_path / "a.npy", FRAMES)
    with pytest.raises(sf.InputError, match=r"a\.npy: an array of .*; give `axes`$"):
        sf.import_recording(tmp_path / "a.npy", tmp_path / "r", **TOLD)

    rows = [(n / 200, -0.1 * n) for n in range(900)]
    write_table(sources[1], "when,pull", *rows)
    open_columns = r"; give columns=\['time=NAME:UNIT', 'fz=NAME:UNIT'\]$"
    with pytest.raises(sf.InputError, match=open_columns):
        sf.import_recording(sources, tmp_path / "r", **TOLD)

    columns = ["time=when:s", "fz=pull:mN"]
    recording = sf.import_recording(sources, tmp_path / "r", **TOLD, columns=columns)
    assert recording.forces.force_n("fz")[100] == pytest.approx(-10e-3)


@pytest.mark.parametrize(
    ("sources", "out", "like", "words"),
    [
        ([], "r", None, "sources: none; give at least one"),
        ("nowhere.tif", "r", None, "nowhere.tif: No such file or directory"),
        ("a.tif", ".", None, "exists already; remove it or choose another `out`$"),
        ("a", "r", "nowhere", "nowhere: no such folder; give a recording folder"),
    ],
)
def test_a_missing_source_is_one_line(
    tmp_path: Path, sources: Any, out: str, like: str | None, words: str
) -> None:
    with pytest.raises(sf.InputError, match=words) as refused:
        sf.import_recording(sources, tmp_path / out, like=like)
    assert "\n" not in str(refused.value)
