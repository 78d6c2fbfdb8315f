"""`read`: sources of a frame's scale and of an eye's known inputs; bad files."""

import json
import os
from pathlib import Path
from shutil import copy

import cv2
import numpy as np
import pytest
import tifffile
from analytic_frames import (
    MODULUS_PA,
    SCALE,
    SMALL_LIBRARY,
    frame_under,
    recording_toml,
    write_one_frame,
)
from small_models import write_fixed_reader
from small_recordings import calibration_text

import scleraforce as sf
from scleraforce.base.units import from_si

pytest.importorskip("torch")

SIZE = "--width-mm 15 --depth-mm 4"
MODULUS = f"--youngs-modulus-mpa {MODULUS_PA / 1e6}"
STATED = recording_toml(
    "mine", globe="", needle="polar_angle_rad = 0.6", more="plane_tilt_rad = 0.2"
)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "reader"
    write_fixed_reader(path, SMALL_LIBRARY, (0.0, 0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    return path


@pytest.fixture
def frame(tmp_path: Path) -> Path:
    """A frame in a recording."""
    return write_one_frame(tmp_path / "session", STATED, 0.015)


@pytest.fixture
def loose(tmp_path: Path, frame: Path) -> Path:
    """The same frame, in no recording."""
    return Path(copy(frame, tmp_path / "loose.png"))


@pytest.fixture
def read(model, shell):
    """Read one frame with options; return its entry."""

    def entry(*words: object, code: int = 0) -> dict:
        (found,) = shell.json("read", model, *words, code=code)["frames"]
        return found

    return entry


@pytest.fixture
def state(frame: Path):
    """Change what the recording states of the eye."""

    def write(lines: str) -> None:
        text = STATED.replace("[eye]", f"[eye]\n{lines}")
        (frame.parents[1] / "recording.toml").write_text(text)

    return write


def test_scale_and_eye_come_from_the_recording_beside_the_frame(read, frame) -> None:
    entry = read(frame, MODULUS, "--globe open")
    assert entry["predicted_force_mn"] == pytest.approx(15.0, abs=1.0)
    assert entry["scale"] == {
        "width_mm": {"value": 15.0, "source": "recording.toml"},
        "depth_mm": {"value": 4.0, "source": "recording.toml"},
        "refractive_index": {"value": 1.0, "source": "recording.toml"},
    }
    assert {name: known["source"] for name, known in entry["known"].items()} == {
        "youngs_modulus_mpa": "option",
        "iop_mmhg": "recording.toml",
        "thickness_um": "recording.toml",
        "gap_mm": "recording.toml",
        "polar_angle_deg": "recording.toml",
        "plane_direction_deg": "unknown",
        "globe": "option",
    }
    assert entry["known"]["thickness_um"]["value"] == 650.0


def test_options_take_precedence_over_the_recording(read, frame) -> None:
    given = {
        "width_mm": 14.0,
        "refractive_index": 1.1,
        "gap_mm": 0.5,
        "plane_direction_deg": -120.0,
    }
    options = [f"--{name.replace('_', '-')} {value}" for name, value in given.items()]
    entry = read(frame, *options)
    found = entry["scale"] | entry["known"]
    for name, value in given.items():
        assert found[name] == {"value": value, "source": "option"}
    assert found["depth_mm"] == {"value": 4.0, "source": "recording.toml"}
    assert read(frame, "--iop-mmhg 30")["reason"].startswith("IOP 30 mmHg")


K = "rigidity_mmhg13_per_ul"
STIFF = f'globe = "sealed"\n{K} = 0.03'


@pytest.mark.parametrize(
    ("stated", "options", "used"),
    [
        ("", "", [(None, "unknown")]),
        (STIFF, "", [("sealed", "recording.toml"), (0.03, "recording.toml")]),
        (STIFF, "--globe closed", [("sealed", "option"), (0.03, "recording.toml")]),
        (
            STIFF,
            "--globe sealed --rigidity 0.012",
            [("sealed", "option"), (0.012, "option")],
        ),
    ],
)
def test_the_globe_is_the_options_then_the_recordings_then_unknown(
    read, frame, state, stated: str, options: str, used: list
) -> None:
    state(stated)
    known = read(frame, options)["known"]
    found = [known[key] for key in ("globe", K) if key in known]
    assert [(one["value"], one["source"]) for one in found] == used


def test_a_frame_has_the_pressure_at_its_dent_which_is_higher_in_a_sealed_eye(
    read, model, frame, state, shell
) -> None:
    # far from 30 mN, whatever the network reads
    cv2.imwrite(str(frame), frame_under(0.008))
    vented, sealed, unknown = (
        read(frame, MODULUS, globe)
        for globe in ("--globe open", "--globe sealed --rigidity 0.03", "")
    )
    vented_mmhg = vented["pressure_mmhg"]
    assert vented_mmhg == pytest.approx(2.025, rel=0.1)
    assert vented["pressure_pa"] == pytest.approx(133.322 * vented_mmhg, rel=1e-4)
    assert sealed["pressure_mmhg"] > 1.2 * vented_mmhg
    assert np.ptp(unknown["interval_mn"]) > 1.5 * np.ptp(vented["interval_mn"])
    assert "mmHg at the dent" in shell.text("read", model, frame, "--globe open")
    state('globe = "open"')
    (evaluated,) = shell.json("evaluate", model, frame.parents[1])["frames"]
    assert evaluated["pressure_mmhg"] == pytest.approx(read(frame)["pressure_mmhg"])


def test_a_calibration_gives_the_modulus_as_it_gives_it_to_python(
    read, model, frame, tmp_path, shell
) -> None:
    file = tmp_path / "modulus.json"
    eyes = {"mine": {"mean_mpa": 0.31}, "other": {"mean_mpa": 0.29}}
    file.write_text(calibration_text(eyes=eyes))
    given = f"--calibration {file}"
    own = read(frame, given)
    known = {"value": 0.31, "source": "calibration"}
    assert own["known"]["youngs_modulus_mpa"] == known
    assert own["known"]["iop_mmhg"]["source"] == "recording.toml"
    answer = sf.read(model, frame, calibration=file)
    assert own["predicted_force_mn"] == from_si(answer.force_n, "mn")
    assert own["interval_mn"] == [from_si(end, "mn") for end in answer.interval_n]
    other = read(frame, given, "--eye other")
    assert other["known"]["youngs_modulus_mpa"]["value"] == 0.29
    nobody = shell.text("classify", model, frame, given, "--eye nobody")
    assert "nobody is not in" in nobody


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            f"--calibration e.json {MODULUS}",
            "error: --youngs-modulus-mpa: the calibration gives the modulus",
        ),
        ("--calibration e.json", "error: --eye: missing"),
        ("--eye mine", "error: --eye: 'mine' names an eye"),
        ("--globe sealed --rigidity 5", "'--rigidity': 5 is above the largest"),
        ("--mask a.png --mask b.png", "2 for 1 frames"),
        ("--mask-sd-rows 0", "--mask-sd-rows"),
    ],
)
def test_options_that_contradict_each_other_are_refused_by_name(
    model, loose, monkeypatch, shell, options: str, words: str
) -> None:
    monkeypatch.chdir(loose.parent)
    Path("e.json").write_text(calibration_text(eyes={"mine": {"mean_mpa": 0.31}}))
    assert words in shell.refused("read", model, loose, SIZE, options)


def test_a_frame_of_unknown_scale_is_refused_and_the_options_are_named(
    read, model, loose, shell
) -> None:
    error = shell.refused("read", model, loose)
    assert error.startswith(f"error: {loose}: its size is neither in the file nor in a")
    assert "give --width-mm and --depth-mm" in error
    entry = read(loose, SIZE)
    assert entry["usable"]
    sources = {size["source"] for size in entry["scale"].values()}
    assert sources == {"option", "model's study"}


def test_the_scale_of_a_tiff_is_used_unless_no_scan_has_it(
    read, loose, tmp_path
) -> None:
    pixels = sf.read_frame(loose)
    expected = read(loose, SIZE)
    per_cm = (0.01 / SCALE.lateral_m, 0.01 / SCALE.depth_m)
    for name, resolution in (("a.tif", per_cm), ("b.tif", (1.0, 2.0))):
        unit = {"resolution": resolution, "resolutionunit": "CENTIMETER"}
        tifffile.imwrite(tmp_path / name, pixels, **unit)

    entry = read(tmp_path / "a.tif")
    width = entry["scale"]["width_mm"]
    assert width == {"value": pytest.approx(15.0, rel=1e-5), "source": "file"}
    force_mn = pytest.approx(expected["predicted_force_mn"], rel=1e-3)
    assert entry["predicted_force_mn"] == force_mn
    error = read(tmp_path / "b.tif", code=2)["error"]
    assert "width_mm: 5120 is above the largest allowed value 100; did you" in error
    assert "(stated by: file); give --width-mm" in error


def test_a_frame_that_contradicts_its_recording_is_refused(read, frame) -> None:
    cv2.imwrite(str(frame), np.zeros((100, 120), np.uint16))
    error = read(frame, code=2)["error"]
    assert "100 x 120 pixels (rows x columns); recording.toml says 512 x 512" in error


def test_bad_files_are_reported_and_the_others_are_answered(
    model, frame, tmp_path, shell
) -> None:
    cv2.imwrite(str(frame), frame_under(0.008))
    empty = tmp_path / "empty.png"
    missing = tmp_path / ("x" * 300)
    pipe = tmp_path / "pipe.png"
    empty.touch()
    os.mkfifo(pipe)
    given = [empty, frame, missing, pipe]
    entries = json.loads(shell.run("read", model, *given, "--json", code=2)[0])[
        "frames"
    ]
    assert [entry["file"] for entry in entries] == [str(path) for path in given]
    assert ["error" in entry for entry in entries] == [True, False, True, True]
    for entry in entries:
        if "error" in entry:
            assert (entry["predicted"], entry["usable"]) == (2, False)
    out, err = shell.run("read", model, *given, code=2)
    assert out.startswith(f"{frame}: class 1")
    errors = ["an empty file; give", "File name too long", "a named pipe; give"]
    for line, path, words in zip(
        err.splitlines(), (empty, missing, pipe), errors, strict=True
    ):
        assert line.startswith(f"error: {path}: {words}")


def test_tissue_that_relaxes_gives_the_force_on_the_needle_and_the_elastic_one(
    read, frame, state
) -> None:
    given = (frame, MODULUS, "--globe open")
    elastic = read(*given)
    elastic_mn = elastic["predicted_force_mn"]
    assert elastic["elastic_force_mn"] is None
    state("relaxation = [[0.12, 1.2], [0.15, 12.0]]")
    unknown, soon, late = (
        read(*given, held) for held in ("", "--held-s 0.1", "--held-s 60")
    )
    for entry in (unknown, soon, late):
        assert entry["elastic_force_mn"] == pytest.approx(elastic_mn)
        assert entry["predicted_force_mn"] < elastic_mn

    late_mn = late["predicted_force_mn"]
    assert late_mn == pytest.approx(0.73 * elastic_mn, rel=0.01)
    assert soon["predicted_force_mn"] > late_mn
    low_mn, high_mn = unknown["interval_mn"]
    assert low_mn < late_mn < elastic_mn < high_mn + 1.0


def test_a_hold_needs_a_known_relaxation_and_changes_no_elastic_tissue(
    read, frame, state
) -> None:
    error = read(frame, MODULUS, "--held-s 1", code=2)["error"]
    assert "held_s: nothing says how the tissue relaxes" in error
    before = read(frame, MODULUS)
    state("relaxation = []")
    held = read(frame, MODULUS, "--held-s 1")
    assert held["predicted_force_mn"] == before["predicted_force_mn"]


@pytest.mark.parametrize(
    "terms", ["[[0.6, 1.0], [0.5, 2.0]]", "[[0.1]]", "[[0.1, 0.0]]", "[0.1, 1.0]"]
)
def test_an_impossible_relaxation_is_refused_with_its_file_and_line(
    read, frame, state, terms: str
) -> None:
    state(f"relaxation = {terms}")
    error = read(frame, MODULUS, code=2)["error"]
    assert "recording.toml:3: eye.relaxation" in error


def test_what_frames_csv_states_of_a_frame_counts(read, frame: Path) -> None:
    table = frame.parents[1] / "frames.csv"
    given = (frame, MODULUS, "--globe open")
    usual = read(*given)
    table.write_text("file,time_s,iop_pa\n1.png,1.0,300.0\n")
    entry = read(*given)
    iop = entry["known"]["iop_mmhg"]
    assert iop == {"value": pytest.approx(300 / 133.322387415), "source": "frames.csv"}
    assert entry["predicted_force_mn"] != usual["predicted_force_mn"]
    declared = read(*given, "--iop-mmhg 2")
    assert declared["known"]["iop_mmhg"] == {"value": 2.0, "source": "option"}

    # nothing needs the hold of elastic tissue
    table.write_text("file,time_s,held_s\n1.png,1.0,3.0\n")
    held = read(*given)
    assert held["predicted_force_mn"] == usual["predicted_force_mn"] is not None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("file,time_s,iop_pa\n1.png,1.0,99999\n", "iop_pa: 99999 is above"),
        ("file,time_s\n1.png,soon\n", "time_s"),
        ("file,time_s,held_s\n1.png,1.0,3.0\n", "held-s"),
        (None, "frames.csv"),
    ],
)
def test_a_fault_of_frames_csv_is_named_once(
    frame: Path, shell, text: str | None, words: str
) -> None:
    table = frame.parents[1] / "frames.csv"
    table.unlink()
    if text is None:
        table.symlink_to(frame.parent / "nowhere.csv")
    else:
        table.write_text(text)
    frames = [frame, Path(copy(frame, frame.with_name("2.png")))]
    held = "--held-s 3" if words == "held-s" else ""
    said = shell.refused("read default", *(frames[:1] if held else frames), held)
    assert words in said


def test_a_foreign_modulus_is_remarked_once_by_each_door(
    frame: Path, tmp_path: Path, shell
) -> None:
    calibration = tmp_path / "others.json"
    calibration.write_text(calibration_text(MODULUS_PA / 1e6, {"other": {}}))
    answer = sf.read("default", frame, calibration=calibration)
    codes = [remark.code for remark in answer.remarks]
    assert codes.count("population-modulus") == 1
    found = shell.json("read default", frame, "--calibration", calibration)
    for part in (found, found["frames"][0]):
        codes = [remark["code"] for remark in part["remarks"]]
        assert codes.count("population-modulus") == 1
