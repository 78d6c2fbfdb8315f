"""`read`: where the scale of a frame and what is known of its eye come from; what happens to bad files."""

import json
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from analytic_frames import MODULUS_PA, SCALE, SMALL_LIBRARY, image, recording_toml, tip_of, wall_section
from small_models import write_fixed_reader
from small_recordings import calibration_text

import scleraforce as sf
from scleraforce.cli.main import run
from scleraforce.units import from_si

pytest.importorskip("torch")

SIZE = ["--width-mm", "15", "--depth-mm", "4"]
STATED = recording_toml("mine", globe="", needle="polar_angle_rad = 0.6", more="plane_tilt_rad = 0.2")


@pytest.fixture(scope="module")
def pixels() -> np.ndarray:
    return image(wall_section(tip_of(0.015)))


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "reader"
    write_fixed_reader(path, SMALL_LIBRARY, (0.0, 0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    return path


@pytest.fixture
def frame(tmp_path: Path, pixels: np.ndarray) -> Path:
    """A frame in a recording."""
    path = tmp_path / "session" / "frames" / "1.png"
    path.parent.mkdir(parents=True)
    (path.parents[1] / "recording.toml").write_text(STATED)
    cv2.imwrite(str(path), pixels)
    return path


@pytest.fixture
def loose(tmp_path: Path, pixels: np.ndarray) -> Path:
    """The same frame, in no recording."""
    cv2.imwrite(str(tmp_path / "loose.png"), pixels)
    return tmp_path / "loose.png"


def read(capsys: pytest.CaptureFixture[str], *arguments: object, code: int = 0) -> list[dict]:
    assert run(["read", *map(str, arguments), "--json"]) == code
    return json.loads(capsys.readouterr().out)["frames"]


def test_scale_and_eye_come_from_the_recording_beside_the_frame(model, frame, capsys) -> None:
    (entry,) = read(capsys, model, frame, "--youngs-modulus-mpa", MODULUS_PA / 1e6, "--globe", "open")
    assert entry["predicted_force_mn"] == pytest.approx(15.0, abs=1.0)
    assert entry["scale"] == {
        "width_mm": {"value": 15.0, "source": "recording.toml"},
        "depth_mm": {"value": 4.0, "source": "recording.toml"},
        "refractive_index": {"value": 1.0, "source": "recording.toml"},
    }
    assert {name: told["source"] for name, told in entry["known"].items()} == {
        "youngs_modulus_mpa": "option", "iop_mmhg": "recording.toml", "thickness_um": "recording.toml",
        "gap_mm": "recording.toml", "polar_angle_deg": "recording.toml", "plane_direction_deg": "unknown",
        "globe": "option",
    }  # fmt: skip
    assert entry["known"]["thickness_um"]["value"] == 650.0


def test_options_come_before_the_recording(model, frame, capsys) -> None:
    (entry,) = read(capsys, model, frame, "--width-mm", 14, "--gap-mm", 0.5, "--refractive-index", 1.1)
    assert entry["scale"]["width_mm"] == {"value": 14.0, "source": "option"}
    assert entry["scale"]["depth_mm"] == {"value": 4.0, "source": "recording.toml"}
    assert entry["scale"]["refractive_index"] == {"value": 1.1, "source": "option"}
    assert entry["known"]["gap_mm"] == {"value": 0.5, "source": "option"}
    (entry,) = read(capsys, model, frame, "--polar-angle-deg", 40, "--plane-direction-deg", -120)
    assert entry["known"]["polar_angle_deg"] == {"value": 40.0, "source": "option"}
    assert entry["known"]["plane_direction_deg"] == {"value": -120.0, "source": "option"}
    (refused,) = read(capsys, model, frame, "--iop-mmhg", 30)
    assert refused["reason"].startswith("IOP 30 mmHg")


K = "rigidity_mmhg13_per_ul"
RECORDED = {
    "globe": {"value": "sealed", "source": "recording.toml"},
    K: {"value": 0.03, "source": "recording.toml"},
}


def test_the_globe_is_that_of_the_option_then_of_the_recording_then_unknown(model, frame, capsys) -> None:
    stiff = f'globe = "sealed"\n{K} = 0.03'
    opened, closed = ({"globe": {"value": kind, "source": "option"}} for kind in ("open", "sealed"))
    for stated, options, used in (
        ("", [], {"globe": {"value": None, "source": "unknown"}}),
        ("", ["--globe", "open"], opened),
        ('globe = "sealed"', [], {"globe": {"value": "sealed", "source": "recording.toml"}}),
        (stiff, [], RECORDED),
        (stiff, ["--globe", "open"], opened),
        (stiff, ["--globe", "sealed"], RECORDED | closed),
        (stiff, ["--globe", "sealed", "--rigidity", 0.012], closed | {K: {"value": 0.012, "source": "option"}}),
    ):
        (frame.parents[1] / "recording.toml").write_text(STATED.replace("[needle]", f"{stated}\n[needle]"))
        (entry,) = read(capsys, model, frame, *options)
        assert {key: known for key, known in entry["known"].items() if key in RECORDED} == used


def test_a_frame_says_the_pressure_at_its_dent_which_is_higher_in_a_sealed_eye(model, frame, capsys) -> None:
    cv2.imwrite(str(frame), image(wall_section(tip_of(0.008))))  # far from 30 mN, whatever the network reads
    told = ["--youngs-modulus-mpa", MODULUS_PA / 1e6]
    (vented,) = read(capsys, model, frame, *told, "--globe", "open")
    (sealed,) = read(capsys, model, frame, *told, "--globe", "sealed", "--rigidity", 0.03)
    (unknown,) = read(capsys, model, frame, *told)
    assert vented["pressure_mmhg"] == pytest.approx(2.025, rel=0.1)
    assert sealed["pressure_mmhg"] > 1.2 * vented["pressure_mmhg"]
    widths = [entry["interval_mn"][1] - entry["interval_mn"][0] for entry in (vented, unknown)]
    assert widths[1] > 1.5 * widths[0]
    assert run(["read", str(model), str(frame), "--globe", "open"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "mmHg at the dent" in text
    assert "globe open (option)" in text


def test_evaluate_has_the_pressure_at_each_dent_too(model, frame, capsys) -> None:
    (frame.parents[1] / "recording.toml").write_text(STATED.replace("[needle]", 'globe = "open"\n[needle]'))
    (frame.parents[1] / "frames.csv").write_text("file,time_s\n1.png,1.0\n")
    (entry,) = read(capsys, model, frame)
    assert run(["evaluate", str(model), str(frame.parents[1]), "--json"]) == 0
    (answered,) = json.loads(capsys.readouterr().out)["frames"]
    assert answered["pressure_mmhg"] == pytest.approx(entry["pressure_mmhg"])
    for one in (answered, entry):
        assert one["pressure_pa"] == pytest.approx(133.322 * one["pressure_mmhg"], rel=1e-4)
    assert answered["pressure_mmhg"] == pytest.approx(2.025, rel=0.1)


def test_a_rigidity_wants_a_globe_that_is_told_sealed(model, frame, capsys) -> None:
    for options, words in (
        (["--rigidity", "0.03"], "--rigidity: of a sealed globe"),
        (["--globe", "open", "--rigidity", "0.03"], "--rigidity: of a sealed globe"),
        (["--globe", "sealed", "--rigidity", "5"], "'--rigidity': 5 is above the largest allowed value 1"),
        (["--globe", "sealed", "--rigidity", "nan"], "'--rigidity': nan is not a finite number"),
    ):
        assert run(["read", str(model), str(frame), *options]) == 2
        assert words in capsys.readouterr().err


def test_a_closed_globe_is_a_sealed_one_and_classify_is_read(model, frame, capsys) -> None:
    sealed = read(capsys, model, frame, "--globe", "sealed")
    assert read(capsys, model, frame, "--globe", "closed") == sealed
    assert run(["classify", str(model), str(frame), "--globe", "closed", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == sealed


def test_a_calibration_gives_the_modulus_as_it_gives_it_to_python(model, frame, tmp_path, capsys) -> None:
    file = tmp_path / "modulus.json"
    file.write_text(calibration_text(eyes={"mine": {"mean_mpa": 0.31}, "other": {"mean_mpa": 0.29}}))
    (own,) = read(capsys, model, frame, "--calibration", file)
    assert own["known"]["youngs_modulus_mpa"] == {"value": 0.31, "source": "calibration"}
    assert own["known"]["iop_mmhg"]["source"] == "recording.toml"
    answer = sf.read(sf.load_model(model), frame, calibration=file)
    assert own["predicted_force_mn"] == from_si(answer.force_n, "mn")
    assert own["interval_mn"] == [from_si(end, "mn") for end in answer.interval_n]
    (other,) = read(capsys, model, frame, "--calibration", file, "--eye", "other")
    assert other["known"]["youngs_modulus_mpa"]["value"] == 0.29
    assert run(["read", str(model), str(frame), "--calibration", str(file), "--eye", "nobody"]) == 0
    assert "note: nobody is not in" in " ".join(capsys.readouterr().out.split())


def test_what_a_calibration_does_not_go_with_is_refused_by_its_option(model, loose, tmp_path, capsys) -> None:
    file = tmp_path / "modulus.json"
    file.write_text(calibration_text(eyes={"mine": {"mean_mpa": 0.31}}))
    given = ["read", str(model), str(loose), *SIZE, "--calibration", str(file)]
    for arguments, words in (
        ([*given, "--youngs-modulus-mpa", "0.3"], "error: --youngs-modulus-mpa: the calibration gives the modulus"),
        ([*given, "--stiffening", "3"], "error: --stiffening: the calibration gives the stiffening"),
        (given, "error: --eye: missing"),
        (["read", str(model), str(loose), *SIZE, "--eye", "mine"], "error: --eye: 'mine' names an eye"),
        ([*given[:-1], "nowhere.json"], "nowhere.json"),
    ):
        assert run(arguments) == 2
        error = capsys.readouterr().err
        assert words in error
        assert error.count("\n") == 1


def test_a_frame_of_unknown_scale_is_refused_and_the_options_are_named(model, loose, capsys) -> None:
    assert run(["read", str(model), str(loose)]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    place = f"error: {loose}: its size is neither in the file nor in a recording.toml"
    assert told.err == f"{place}; give --width-mm and --depth-mm\n"
    (entry,) = read(capsys, model, loose, *SIZE)
    assert entry["usable"]
    assert {size["source"] for size in entry["scale"].values()} == {"option", "model's study"}


def test_the_scale_of_a_tiff_is_used(model, loose, pixels, tmp_path, capsys) -> None:
    (expected,) = read(capsys, model, loose, *SIZE)
    per_cm = (0.01 / SCALE.lateral_m, 0.01 / SCALE.depth_m)
    tifffile.imwrite(tmp_path / "a.tif", pixels, resolution=per_cm, resolutionunit="CENTIMETER")
    (entry,) = read(capsys, model, tmp_path / "a.tif")
    assert entry["scale"]["width_mm"] == {"value": pytest.approx(15.0, rel=1e-5), "source": "file"}
    assert entry["predicted_force_mn"] == pytest.approx(expected["predicted_force_mn"], rel=1e-3)


def test_a_scale_that_no_scan_has_is_refused(model, pixels, tmp_path, capsys) -> None:
    options = {"resolution": (1.0, 2.0), "resolutionunit": "CENTIMETER"}
    tifffile.imwrite(tmp_path / "a.tif", pixels, **options)
    (entry,) = read(capsys, model, tmp_path / "a.tif", code=2)
    assert "width_mm: 5120 is above the largest allowed value 100; did you mean 5.12 mm (5120 µm)?" in entry["error"]
    assert "(stated by: file); give --width-mm" in entry["error"]


def test_a_frame_that_is_not_what_its_recording_says_is_refused(model, frame, capsys) -> None:
    cv2.imwrite(str(frame), np.zeros((100, 120), np.uint16))
    (entry,) = read(capsys, model, frame, code=2)
    assert "100 x 120 pixels (rows x columns); recording.toml says 512 x 512" in entry["error"]


def test_text_says_what_was_read_with_and_where_the_recording_is_outside_the_training(model, frame, capsys) -> None:
    assert run(["read", str(model), str(frame), "--gap-mm", "0.5"]) == 0
    lines = capsys.readouterr().out.splitlines()
    text = " ".join(" ".join(lines).split())
    assert "15 x 4 mm (recording.toml), refractive index 1 (recording.toml); modulus unknown, IOP 2.025 mmHg" in text
    assert "gap 0.5 mm (option), polar angle 34.38° (recording.toml)" in text
    assert f"{frame.parents[1]}: tilt of the B-scan 11.46 °, the model was trained on -5 to 5 °" in text
    assert max(len(line) for line in lines if str(frame.parents[1]) not in line) <= 80


def test_a_transposed_frame_is_read_as_the_upright_one(model, loose, pixels, tmp_path, capsys) -> None:
    cv2.imwrite(str(tmp_path / "turned.png"), pixels.T)
    (upright,) = read(capsys, model, loose, *SIZE)
    (turned,) = read(capsys, model, tmp_path / "turned.png", *SIZE, "--transpose")
    assert turned["predicted_force_mn"] == upright["predicted_force_mn"]
    assert turned["contact_mm"] == upright["contact_mm"]


def test_a_bad_file_is_told_and_the_others_are_answered(model, frame, tmp_path, capsys) -> None:
    cv2.imwrite(str(frame), image(wall_section(tip_of(0.008))))
    empty, missing = tmp_path / "empty.png", tmp_path / ("x" * 300)
    empty.write_bytes(b"")
    os.mkfifo(tmp_path / "pipe.png")
    given = [empty, frame, missing, tmp_path / "pipe.png"]
    entries = read(capsys, model, *given, code=2)
    assert [entry["file"] for entry in entries] == [str(path) for path in given]
    assert ["error" in entry for entry in entries] == [True, False, True, True]
    assert all((entry["predicted"], entry["usable"]) == (2, False) for entry in entries if "error" in entry)
    assert run(["read", str(model), *map(str, given)]) == 2
    told = capsys.readouterr()
    assert told.out.startswith(f"{frame}: class 1")
    assert told.err.splitlines() == [
        f"error: {empty}: an empty file; give a PNG, TIFF, JPEG or a single DICOM image",
        f"error: {missing}: File name too long",
        f"error: {tmp_path / 'pipe.png'}: a named pipe; give a regular file",
    ]


def test_a_folder_is_an_error_that_names_evaluate(model, frame, capsys) -> None:
    folder = frame.parents[1]
    assert run(["read", str(model), str(folder)]) == 2
    assert f"a folder; `scleraforce evaluate {model} {folder}` reads a recording" in capsys.readouterr().err


OCT = Path(__file__).parents[3] / "shared" / "real-oct" / "anterior-segment" / "107.jpg"


@pytest.mark.real
@pytest.mark.skipif(not OCT.is_file(), reason="no ../shared")
def test_a_scan_without_a_needle_is_not_read_as_a_force(model, capsys) -> None:
    assert run(["read", str(model), str(OCT)]) == 2
    assert "give --width-mm and --depth-mm" in capsys.readouterr().err
