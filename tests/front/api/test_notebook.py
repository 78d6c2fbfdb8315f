"""The functions of a notebook: frames, calibrations and imports as the commands do
them.
"""

import inspect
import re
from dataclasses import fields
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from analytic_frames import KNOWN, SCALE, image, tip_of, wall_section
from effects import contents
from foreign_files import FRAMES, write_log
from small_models import force_reader
from small_recordings import calibration_text, write_small_recording

import scleraforce as sf
from scleraforce.base.errors import FrameError, InputError
from scleraforce.front.api.calibrating import calibrate, library_for
from scleraforce.front.api.importing import ImportSettings, ImportShorthand
from scleraforce.front.api.progress import counting_for
from scleraforce.front.api.reading_frames import evaluate, read, segment
from scleraforce.front.api.shorthand import SetupShorthand
from scleraforce.front.api.training import train
from scleraforce.front.cli.main import run
from scleraforce.reading.answer import Reading
from scleraforce.reading.load_model import load_force_reader
from scleraforce.recordings.import_sources import ImportOptions
from scleraforce.records.eye import Eye
from scleraforce.records.globe import REFERENCE_RIGIDITY, Globe
from scleraforce.records.model_folder import SHIPPED_READER
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.study import Study
from scleraforce.records.tissue_relaxation import Relaxation

FRAME = image(wall_section(tip_of(0.020)))
SIZE = {"width_m": 15e-3, "depth_m": 4e-3}


def test_an_array_is_read_as_the_reader_reads_it() -> None:
    expected = force_reader().read(FRAME, SCALE, KNOWN)
    assert KNOWN.eye.modulus is not None
    given = {
        "iop_pa": KNOWN.eye.iop_pa,
        "thickness_m": KNOWN.eye.thickness_m,
        "gap_m": KNOWN.needle.gap_m,
        "globe": "open",
    }
    answer = read(
        force_reader(),
        FRAME,
        youngs_modulus_pa=KNOWN.eye.modulus.mean_pa,
        **given,
        **SIZE,
    )
    assert answer.force_n == pytest.approx(expected.force_n, rel=0.01)
    assert answer.usable


@pytest.mark.parametrize(
    ("eyes", "words"),
    [
        (("mine",), "has 1 eye: give mine; any other gets"),
        (("mine", "yours"), "has 2 eyes: give one of mine, yours; any other gets"),
    ],
)
@pytest.mark.parametrize("frame", [FRAME, np.stack([FRAME, FRAME])])
def test_an_array_with_a_calibration_needs_the_name_of_its_eye(
    frame: np.ndarray, eyes: tuple[str, ...], words: str, tmp_path: Path
) -> None:
    file = tmp_path / "c.json"
    file.write_text(calibration_text(eyes={eye: {"mean_mpa": 0.3} for eye in eyes}))
    with pytest.raises(InputError, match=f"eye: missing; no recording.*{words}"):
        read(force_reader(), frame, calibration=file, **SIZE)
    assert read(force_reader(), frame, calibration=file, eye="mine", **SIZE)


def test_a_result_prints_as_one_short_line() -> None:
    reader = force_reader()
    blank = np.zeros_like(FRAME)
    answers = [reader.read(pixels, SCALE, KNOWN) for pixels in (FRAME, blank)]
    walls = [segment(pixels, **SIZE) for pixels in (FRAME, blank)]
    lines = [
        repr(one) for one in (*answers, *walls, reader, reader.study, reader.library)
    ]
    assert all("\n" not in line and len(line) < 120 for line in lines), lines
    assert lines[0].startswith("<Answer: class 1, ")
    assert "not usable: the frame is empty" in lines[1]
    assert re.fullmatch(r"<Segmentation: wall of 6\d\d µm, usable>", lines[2])


def test_a_declared_globe_decides_the_pressure_at_the_dent() -> None:
    given = {
        "youngs_modulus_pa": 0.3e6,
        "iop_pa": KNOWN.eye.iop_pa,
        "gap_m": KNOWN.needle.gap_m,
        **SIZE,
    }
    unsure = Reading(
        probabilities=(0.2, 0.5, 0.3),
        force_n=0.02,
        interval_n=(0.0, 0.06),
        contact_m=0.3e-3,
    )
    vented = read(force_reader(unsure), FRAME, globe="open", **given)
    sealed = read(
        force_reader(unsure),
        FRAME,
        eye=Eye(globe=Globe.declared("sealed", REFERENCE_RIGIDITY / 3)),
        **given,
    )
    assert vented.iop_at_dent_pa == pytest.approx(KNOWN.eye.iop_pa, rel=0.1)
    assert sealed.iop_at_dent_pa > 1.2 * vented.iop_at_dent_pa

    with pytest.raises(InputError, match="shut"):
        read(force_reader(), FRAME, globe="shut", **given)

    for globe, k, words in (
        (None, 1.5e8, "rigidity_pa13_per_m3: of a sealed globe"),
        ("open", 1.5e8, "rigidity_pa13_per_m3: of a sealed globe"),
        ("shut", None, "shut"),
        ("sealed", 0.03, "rigidity_pa13_per_m3: 0.03 is below"),
    ):
        with pytest.raises(InputError, match=words):
            Globe.declared(globe, k)


def test_a_frame_that_cannot_be_used_is_one_clear_line() -> None:
    cases: list[tuple[Any, dict[str, float], str]] = [
        (FRAME, {}, "give width_m and depth_m"),
        (FRAME[0], SIZE, r"shape \(512,\); give one frame"),
        (
            [[1, 2], [3, 4]],
            SIZE,
            "frame: a frame of 2 x 2 pixels: give at least 16 x 16",
        ),
        (FRAME.astype(complex), SIZE, "pixels of type complex128"),
        ("nowhere.png", SIZE, "nowhere.png"),
    ]
    for frame, size, words in cases:
        with pytest.raises(FrameError, match=words):
            segment(frame, **size)

        with pytest.raises(FrameError, match=words):
            read(force_reader(), frame, **size)

    for size, words in (
        (
            {"width_m": 15.0, "depth_m": 4.0},
            r"width_m: 15 .*did you mean 0\.015 m \(15 mm\)",
        ),
        ({**SIZE, "refractive_index": 3.0}, "refractive_index: 3 is above"),
    ):
        with pytest.raises(InputError, match=words):
            segment(FRAME, **size)

        with pytest.raises(InputError, match=words):
            read(force_reader(), FRAME, **size)


def test_inputs_that_would_be_ignored_and_a_missing_model_are_refused() -> None:
    for model, given, words in (
        (
            force_reader(),
            {"eye": "eye-a"},
            "eye: 'eye-a' names an eye of a calibration",
        ),
        (
            force_reader(),
            {"youngs_modulus_pa": 0.3e6, "calibration": "modulus.json"},
            "the calibration gives the modul",
        ),
        ("nothing", {}, "nothing: no such folder; give one, or a bundled model"),
    ):
        with pytest.raises(InputError, match=words):
            read(model, FRAME, **given, **SIZE)

    with pytest.raises(
        InputError, match="nothing: no such folder; give one, or a bundled"
    ):
        evaluate("nothing", "eye-a")


def test_a_model_may_be_named(tmp_path: Path) -> None:
    given = {"youngs_modulus_pa": 0.3e6, **SIZE}
    named = read("default", FRAME, **given)
    assert named.force_n == read(sf.load_model("default"), FRAME, **given).force_n
    recording = write_small_recording(tmp_path / "r", frames=12, log=False)
    assert len(evaluate("default", recording).frames) == 12


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


def test_linear_mechanics_needs_no_library_and_the_papers_is_the_bundled_readers(
    tmp_path: Path, monkeypatch
) -> None:
    assert library_for(Study(), "linear", counting_for(None, "library")) is None
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    ticks: list[int] = []
    found = library_for(Study(), "finite-strain", counting_for(ticks.append, "library"))
    assert found is not None
    np.testing.assert_array_equal(
        found.curves_tpdbnc(), load_force_reader(SHIPPED_READER).library.curves_tpdbnc()
    )
    assert not ticks
    assert not list(tmp_path.iterdir())


STATED = {"width_m": 12e-3, "depth_m": 4e-3, "refractive_index": 1.38, "bits": 13}
NEEDLE = {"eye": "eye-1", "gauge": 22, "gap_m": 0.6e-3}
FORCE = {"contact_sign": -1, "clock_offset_s": 0.5}
TOLD = {**STATED, **NEEDLE, "rate_hz": 1.0}
OPTIONS = [
    "--width-mm",
    "12",
    "--depth-mm",
    "4",
    "--refractive-index",
    "1.38",
    "--bits",
    "13",
    "--eye",
    "eye-1",
    "--gauge",
    "22",
    "--gap-mm",
    "0.6",
    "--rate-hz",
    "1",
    "--contact-sign",
    "-1",
    "--clock-offset-s",
    "0.5",
    "--thickness-um",
    "650",
    "--iop-mmhg",
    "15",
    "--globe",
    "sealed",
    "--polar-angle-deg",
    "30",
    "--relaxation",
    "0.12:1.2,0.15:12.0",
    "--average-s",
    "0.5",
]


@pytest.fixture
def sources(tmp_path: Path) -> list[Path]:
    """A stack that states nothing, and a log whose columns say what they are."""
    tifffile.imwrite(tmp_path / "a.tif", FRAMES, photometric="minisblack")
    write_log(tmp_path / "log.csv")
    return [tmp_path / "a.tif", tmp_path / "log.csv"]


def test_it_writes_what_the_command_writes(sources: list[Path], tmp_path: Path) -> None:
    told = {name: value for name, value in TOLD.items() if name != "eye"}
    recording = sf.import_recording(
        sources,
        tmp_path / "r",
        **told,
        **FORCE,
        eye=Eye(
            "eye-1",
            thickness_m=650e-6,
            iop_pa=15 * 133.322387415,
            globe=Globe.declared("sealed"),
            relaxation=Relaxation.declared([(0.12, 1.2), (0.15, 12.0)]),
        ),
        needle=Needle(polar_rad=radians(30.0)),
        settings=ImportSettings(average_s=0.5),
    )
    assert (
        run(["import", *map(str, sources), "--out", str(tmp_path / "s"), *OPTIONS]) == 0
    )
    command = sf.read_recording(tmp_path / "s")
    assert recording.path == tmp_path / "r"
    assert recording.frames == command.frames
    assert recording.info.scan == command.info.scan

    for part in ("eye", "needle", "force"):
        mine = vars(getattr(recording.info, part))
        theirs = vars(getattr(command.info, part))
        assert mine == {
            key: pytest.approx(value, rel=1e-12) if isinstance(value, float) else value
            for key, value in theirs.items()
        }

    written = contents(tmp_path / "r")
    by_command = contents(tmp_path / "s")
    assert set(written) == set(by_command)
    assert [
        name
        for name in written
        if written[name] != by_command[name] and not name.endswith(".toml")
    ] == []


def test_missing_metadata_is_named_by_arguments_all_at_once(
    sources: list[Path], tmp_path: Path
) -> None:
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(sf.InputError) as told:
        sf.import_recording(sources, tmp_path / "r")

    names = [*STATED, *NEEDLE, *FORCE, "rate_hz` or `times"]
    assert all(f"(`{name}`)" in str(told.value) for name in names), told.value
    assert "--" not in str(told.value)
    assert sorted(tmp_path.rglob("*")) == before


REFUSED: list[tuple[dict[str, object], str]] = [
    ({"width_m": 12.0}, "width_m: 12 is above the largest allowed value 0.1"),
    ({"bits": -1}, "bits: -1 is below"),
    ({"bits": 8}, "`bits` says 8"),
    ({"rate_hz": 0.0}, "^`rate_hz`: 0; give the frames taken in a second"),
    ({**FORCE, "contact_sign": 0}, "contact_sign: 0 is not a sign"),
    (
        {"settings": ImportSettings(grey_range=(9.0, 1.0))},
        "^`grey_range`: 9 1; give the darkest",
    ),
    ({"settings": ImportSettings(array="a")}, "^`array`: acts on an .npz file"),
    ({"columns": ["fz=pull"]}, "^`columns`: 'fz=pull'; give COLUMN=NAME:UNIT"),
    ({"globe": "shut"}, "globe: "),
]


def test_a_wrong_value_is_refused_by_its_argument(
    sources: list[Path], tmp_path: Path
) -> None:
    for changed, words in REFUSED:
        with pytest.raises(sf.InputError, match=words):
            sf.import_recording(sources, tmp_path / "r", **{**TOLD, **FORCE, **changed})
    assert not (tmp_path / "r").exists()

    for terms, words in (
        ([(0.6, 1.0), (0.5, 2.0)], "relaxation: shares are 0 or more"),
        ("none", "relaxation: a term is a share and a time"),
    ):
        with pytest.raises(sf.InputError, match=words):
            Relaxation.declared(terms)


def test_a_property_that_a_source_leaves_open_is_named_by_its_argument(
    sources: list[Path], tmp_path: Path
) -> None:
    np.save(tmp_path / "a.npy", FRAMES)
    with pytest.raises(sf.InputError, match=r"a\.npy: an array of .*; give `axes`$"):
        sf.import_recording(tmp_path / "a.npy", tmp_path / "r", **TOLD)

    sources[1].write_text(
        "\n".join(["when,pull", *(f"{n / 200},{-0.1 * n}" for n in range(900))]) + "\n"
    )
    with pytest.raises(
        sf.InputError, match=r"; give columns=\['time=NAME:UNIT', 'fz=NAME:UNIT'\]$"
    ):
        sf.import_recording(sources, tmp_path / "r", **TOLD, **FORCE)

    columns = ["time=when:s", "fz=pull:mN"]
    recording = sf.import_recording(
        sources, tmp_path / "r", **TOLD, **FORCE, columns=columns
    )
    assert recording.forces.force_n("fz")[100] == pytest.approx(-10e-3)


def test_a_missing_source_is_one_line(tmp_path: Path) -> None:
    new = tmp_path / "r"
    for sources, out, like, words in (
        ([], new, None, "sources: none; give at least one"),
        ("nowhere.tif", new, None, "nowhere.tif: No such file or directory"),
        ("a.tif", tmp_path, None, "exists already; remove it or choose another `out`$"),
        ("a", new, "nowhere", "nowhere: no such folder; give a recording folder"),
    ):
        with pytest.raises(sf.InputError, match=words) as refused:
            sf.import_recording(sources, out, like=like)
        assert "\n" not in str(refused.value)


SI_NAMES = {
    "eye": "name",
    "width_mm": "width_m",
    "depth_mm": "depth_m",
    "thickness_um": "thickness_m",
    "iop_mmhg": "iop_pa",
    "gauge": "diameter_m",
    "gap_mm": "gap_m",
    "polar_angle_deg": "polar_rad",
}


def test_every_option_of_the_command_is_a_field_of_a_record_in_si() -> None:
    options = {SI_NAMES.get(field.name, field.name) for field in fields(ImportOptions)}
    of_settings = {field.name for field in fields(ImportSettings)}
    of_setup = {
        field.name for record in (Eye, Needle, Scan) for field in fields(record)
    }
    assert options <= of_settings | of_setup
    assert of_settings - options == {"planes"}
    short = set(ImportShorthand.__annotations__) - set(SetupShorthand.__annotations__)
    assert short - {"gauge"} <= of_settings | of_setup
    assert set(inspect.signature(sf.import_recording).parameters) == {
        "sources",
        "out",
        "like",
        "eye",
        "needle",
        "scan",
        "settings",
        "progress",
        "short",
    }
