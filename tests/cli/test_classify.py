"""`classify`: where the scale of a frame and what is known of its eye come from; what happens to bad files."""

import json
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from analytic_frames import MODULUS_PA, SCALE, SMALL_LIBRARY, image, recording_toml, tip_of, wall_section
from fixed_reader import write_fixed_reader

from scleraforce.cli.main import run

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


def classified(capsys: pytest.CaptureFixture[str], *arguments: object, code: int = 0) -> list[dict]:
    assert run(["classify", *map(str, arguments), "--json"]) == code
    return json.loads(capsys.readouterr().out)["frames"]


def test_scale_and_eye_come_from_the_recording_beside_the_frame(model, frame, capsys) -> None:
    (entry,) = classified(capsys, model, frame, "--youngs-modulus-mpa", MODULUS_PA / 1e6, "--globe", "open")
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
    (entry,) = classified(capsys, model, frame, "--width-mm", 14, "--gap-mm", 0.5, "--refractive-index", 1.1)
    assert entry["scale"]["width_mm"] == {"value": 14.0, "source": "option"}
    assert entry["scale"]["depth_mm"] == {"value": 4.0, "source": "recording.toml"}
    assert entry["scale"]["refractive_index"] == {"value": 1.1, "source": "option"}
    assert entry["known"]["gap_mm"] == {"value": 0.5, "source": "option"}
    (entry,) = classified(capsys, model, frame, "--polar-angle-deg", 40, "--plane-direction-deg", -120)
    assert entry["known"]["polar_angle_deg"] == {"value": 40.0, "source": "option"}
    assert entry["known"]["plane_direction_deg"] == {"value": -120.0, "source": "option"}
    (refused,) = classified(capsys, model, frame, "--iop-mmhg", 30)
    assert refused["reason"].startswith("IOP 30 mmHg")


K = "rigidity_mmhg13_per_ul"
RECORDED = {
    "globe": {"value": "sealed", "source": "recording.toml"},
    K: {"value": 0.03, "source": "recording.toml"},
}


@pytest.mark.parametrize(
    ("stated", "options", "used"),
    [
        ("", [], {"globe": {"value": None, "source": "unknown"}}),
        ("", ["--globe", "open"], {"globe": {"value": "open", "source": "option"}}),
        ('globe = "sealed"', [], {"globe": {"value": "sealed", "source": "recording.toml"}}),
        (f'globe = "sealed"\n{K} = 0.03', [], RECORDED),
        (f'globe = "sealed"\n{K} = 0.03', ["--globe", "open"], {"globe": {"value": "open", "source": "option"}}),
        (
            f'globe = "sealed"\n{K} = 0.03',
            ["--globe", "sealed"],
            {**RECORDED, "globe": {"value": "sealed", "source": "option"}},
        ),
        (
            f'globe = "sealed"\n{K} = 0.03',
            ["--globe", "sealed", "--rigidity", 0.012],
            {"globe": {"value": "sealed", "source": "option"}, K: {"value": 0.012, "source": "option"}},
        ),
    ],
)
def test_the_globe_is_that_of_the_option_then_of_the_recording_then_unknown(
    model, frame, capsys, stated, options, used
) -> None:
    (frame.parents[1] / "recording.toml").write_text(STATED.replace("[needle]", f"{stated}\n[needle]"))
    (entry,) = classified(capsys, model, frame, *options)
    assert {key: told for key, told in entry["known"].items() if key in RECORDED} == used


def test_a_frame_says_the_pressure_at_its_dent_which_is_higher_in_a_sealed_eye(model, frame, capsys) -> None:
    cv2.imwrite(str(frame), image(wall_section(tip_of(0.008))))  # far from 30 mN, whatever the network reads
    told = ["--youngs-modulus-mpa", MODULUS_PA / 1e6]
    (vented,) = classified(capsys, model, frame, *told, "--globe", "open")
    (sealed,) = classified(capsys, model, frame, *told, "--globe", "sealed", "--rigidity", 0.03)
    (unknown,) = classified(capsys, model, frame, *told)
    assert vented["pressure_mmhg"] == pytest.approx(2.025, rel=0.1)
    assert sealed["pressure_mmhg"] > 1.2 * vented["pressure_mmhg"]
    widths = [entry["interval_mn"][1] - entry["interval_mn"][0] for entry in (vented, unknown)]
    assert widths[1] > 1.5 * widths[0]
    assert run(["classify", str(model), str(frame), "--globe", "open"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "mmHg at the dent" in text
    assert "globe open (option)" in text


def test_evaluate_has_the_pressure_at_each_dent_too(model, frame, capsys) -> None:
    (frame.parents[1] / "recording.toml").write_text(STATED.replace("[needle]", 'globe = "open"\n[needle]'))
    (frame.parents[1] / "frames.csv").write_text("file,time_s\n1.png,1.0\n")
    (entry,) = classified(capsys, model, frame)
    assert run(["evaluate", str(model), str(frame.parents[1]), "--json"]) == 0
    (answered,) = json.loads(capsys.readouterr().out)["frames"]
    assert answered["pressure_mmhg"] == pytest.approx(entry["pressure_mmhg"])
    for one in (answered, entry):
        assert one["pressure_pa"] == pytest.approx(133.322 * one["pressure_mmhg"], rel=1e-4)
    assert answered["pressure_mmhg"] == pytest.approx(2.025, rel=0.1)


def test_a_rigidity_wants_a_globe_that_is_told_sealed(model, frame, capsys) -> None:
    for options, words in (
        (["--rigidity", "0.03"], "--rigidity: of a sealed globe; tell --globe sealed, too, or leave 0.03 out"),
        (["--globe", "open", "--rigidity", "0.03"], "--rigidity: of a sealed globe"),
        (["--globe", "sealed", "--rigidity", "5"], "--rigidity: rigidity_mmhg13_per_ul: 5 is above"),
        (["--globe", "sealed", "--rigidity", "nan"], "--rigidity: nan is not a finite number"),
    ):
        assert run(["classify", str(model), str(frame), *options]) == 2
        assert words in capsys.readouterr().err


def test_a_frame_of_unknown_scale_is_refused_and_the_options_are_named(model, loose, capsys) -> None:
    assert run(["classify", str(model), str(loose)]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    place = f"error: {loose}: how large it is stands neither in it nor in a recording.toml"
    assert told.err == f"{place}; give --width-mm and --depth-mm\n"
    (entry,) = classified(capsys, model, loose, *SIZE)
    assert entry["usable"]
    assert {size["source"] for size in entry["scale"].values()} == {"option", "model's study"}


def test_the_scale_of_a_tiff_is_used(model, loose, pixels, tmp_path, capsys) -> None:
    (expected,) = classified(capsys, model, loose, *SIZE)
    per_cm = (0.01 / SCALE.lateral_m, 0.01 / SCALE.depth_m)
    tifffile.imwrite(tmp_path / "a.tif", pixels, resolution=per_cm, resolutionunit="CENTIMETER")
    (entry,) = classified(capsys, model, tmp_path / "a.tif")
    assert entry["scale"]["width_mm"] == {"value": pytest.approx(15.0, rel=1e-5), "source": "file"}
    assert entry["predicted_force_mn"] == pytest.approx(expected["predicted_force_mn"], rel=1e-3)


def test_a_scale_that_no_scan_has_is_refused(model, pixels, tmp_path, capsys) -> None:
    options = {"resolution": (1.0, 2.0), "resolutionunit": "CENTIMETER"}
    tifffile.imwrite(tmp_path / "a.tif", pixels, **options)
    (entry,) = classified(capsys, model, tmp_path / "a.tif", code=2)
    assert "5120 mm wide (file); no B-scan is: tell its size with --width-mm" in entry["error"]


def test_a_frame_that_is_not_what_its_recording_says_is_refused(model, frame, capsys) -> None:
    cv2.imwrite(str(frame), np.zeros((100, 120), np.uint16))
    (entry,) = classified(capsys, model, frame, code=2)
    assert "100 x 120 pixels (rows x columns); recording.toml says 512 x 512" in entry["error"]


def test_text_says_what_was_read_with_and_where_the_recording_is_outside_the_training(model, frame, capsys) -> None:
    assert run(["classify", str(model), str(frame), "--gap-mm", "0.5"]) == 0
    lines = capsys.readouterr().out.splitlines()
    text = " ".join(" ".join(lines).split())
    assert "15 x 4 mm (recording.toml), refractive index 1 (recording.toml); modulus unknown, IOP 2.025 mmHg" in text
    assert "gap 0.5 mm (option), polar angle 34.38° (recording.toml)" in text
    assert f"{frame.parents[1]}: tilt of the B-scan 11.46 °, the model was trained on -5 to 5 °" in text
    assert max(len(line) for line in lines if str(frame.parents[1]) not in line) <= 80


def test_a_transposed_frame_is_read_as_the_upright_one(model, loose, pixels, tmp_path, capsys) -> None:
    cv2.imwrite(str(tmp_path / "turned.png"), pixels.T)
    (upright,) = classified(capsys, model, loose, *SIZE)
    (turned,) = classified(capsys, model, tmp_path / "turned.png", *SIZE, "--transpose")
    assert turned["predicted_force_mn"] == upright["predicted_force_mn"]
    assert turned["contact_mm"] == upright["contact_mm"]


def test_a_bad_file_is_told_and_the_others_are_answered(model, frame, tmp_path, capsys) -> None:
    cv2.imwrite(str(frame), image(wall_section(tip_of(0.008))))
    empty, missing = tmp_path / "empty.png", tmp_path / ("x" * 300)
    empty.write_bytes(b"")
    os.mkfifo(tmp_path / "pipe.png")
    given = [empty, frame, missing, tmp_path / "pipe.png"]
    entries = classified(capsys, model, *given, code=2)
    assert [entry["file"] for entry in entries] == [str(path) for path in given]
    assert ["error" in entry for entry in entries] == [True, False, True, True]
    assert all((entry["predicted"], entry["usable"]) == (2, False) for entry in entries if "error" in entry)
    assert run(["classify", str(model), *map(str, given)]) == 2
    told = capsys.readouterr()
    assert told.out.startswith(f"{frame}: class 1")
    assert told.err.splitlines() == [
        f"error: {empty}: an empty file; give a PNG, TIFF, JPEG or a single DICOM image",
        f"error: {missing}: File name too long",
        f"error: {tmp_path / 'pipe.png'}: a named pipe; give a regular file",
    ]


def test_a_folder_is_an_error_that_names_evaluate(model, frame, capsys) -> None:
    folder = frame.parents[1]
    assert run(["classify", str(model), str(folder)]) == 2
    assert f"a folder; `scleraforce evaluate {model} {folder}` reads a recording" in capsys.readouterr().err


OCT = Path(__file__).parents[3] / "shared" / "real-oct" / "anterior-segment" / "107.jpg"


@pytest.mark.real
@pytest.mark.skipif(not OCT.is_file(), reason="no ../shared")
def test_a_scan_without_a_needle_is_not_read_as_a_force(model, capsys) -> None:
    assert run(["classify", str(model), str(OCT)]) == 2
    assert "give --width-mm and --depth-mm" in capsys.readouterr().err
