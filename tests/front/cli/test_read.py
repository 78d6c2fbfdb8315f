"""`read`: sources of a frame's scale and of an eye's known inputs; bad files."""

import json
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from analytic_frames import (
    MODULUS_PA,
    SCALE,
    SMALL_LIBRARY,
    image,
    recording_toml,
    tip_of,
    wall_section,
    write_one_frame,
)
from small_models import write_fixed_reader
from small_recordings import calibration_text

import scleraforce as sf
from scleraforce.base.units import from_si

pytest.importorskip("torch")

SIZE = ["--width-mm", 15, "--depth-mm", 4]
MODULUS = ["--youngs-modulus-mpa", MODULUS_PA / 1e6]
STATED = recording_toml(
    "mine", globe="", needle="polar_angle_rad = 0.6", more="plane_tilt_rad = 0.2"
)


@pytest.fixture(scope="module")
def pixels() -> np.ndarray:
    return image(wall_section(tip_of(0.015)))


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
def loose(tmp_path: Path, pixels: np.ndarray) -> Path:
    """The same frame, in no recording."""
    cv2.imwrite(str(tmp_path / "loose.png"), pixels)
    return tmp_path / "loose.png"


@pytest.fixture
def read(model, shell):
    """Read one frame with options; return its entry."""

    def entry(*words: object, code: int = 0) -> dict:
        (found,) = shell.json("read", model, *words, code=code)["frames"]
        return found

    return entry


def test_scale_and_eye_come_from_the_recording_beside_the_frame(read, frame) -> None:
    entry = read(frame, *MODULUS, "--globe", "open")
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
    entry = read(
        frame,
        *(
            word
            for name, value in given.items()
            for word in (f"--{name.replace('_', '-')}", value)
        ),
    )
    found = entry["scale"] | entry["known"]
    assert [found[name] for name in given] == [
        {"value": value, "source": "option"} for value in given.values()
    ]
    assert found["depth_mm"] == {"value": 4.0, "source": "recording.toml"}
    assert read(frame, "--iop-mmhg", 30)["reason"].startswith("IOP 30 mmHg")


K = "rigidity_mmhg13_per_ul"
RECORDED = {
    "globe": {"value": "sealed", "source": "recording.toml"},
    K: {"value": 0.03, "source": "recording.toml"},
}


def test_the_globe_is_the_options_then_the_recordings_then_unknown(read, frame) -> None:
    stiff = f'globe = "sealed"\n{K} = 0.03'
    opened, closed = (
        {"globe": {"value": kind, "source": "option"}} for kind in ("open", "sealed")
    )

    for stated, options, used in (
        ("", [], {"globe": {"value": None, "source": "unknown"}}),
        ("", ["--globe", "open"], opened),
        (
            'globe = "sealed"',
            [],
            {"globe": {"value": "sealed", "source": "recording.toml"}},
        ),
        (stiff, [], RECORDED),
        (stiff, ["--globe", "open"], opened),
        (stiff, ["--globe", "closed"], RECORDED | closed),
        (
            stiff,
            ["--globe", "sealed", "--rigidity", 0.012],
            closed | {K: {"value": 0.012, "source": "option"}},
        ),
    ):
        (frame.parents[1] / "recording.toml").write_text(
            STATED.replace("[needle]", f"{stated}\n[needle]")
        )
        entry = read(frame, *options)
        assert {
            key: known for key, known in entry["known"].items() if key in RECORDED
        } == used


def test_a_frame_has_the_pressure_at_its_dent_which_is_higher_in_a_sealed_eye(
    read, model, frame, shell
) -> None:
    # far from 30 mN, whatever the network reads
    cv2.imwrite(str(frame), image(wall_section(tip_of(0.008))))
    vented, sealed, unknown = (
        read(frame, *MODULUS, *globe)
        for globe in (
            ["--globe", "open"],
            ["--globe", "sealed", "--rigidity", 0.03],
            [],
        )
    )
    assert vented["pressure_mmhg"] == pytest.approx(2.025, rel=0.1)
    assert vented["pressure_pa"] == pytest.approx(
        133.322 * vented["pressure_mmhg"], rel=1e-4
    )
    assert sealed["pressure_mmhg"] > 1.2 * vented["pressure_mmhg"]
    widths = [
        entry["interval_mn"][1] - entry["interval_mn"][0] for entry in (vented, unknown)
    ]
    assert widths[1] > 1.5 * widths[0]
    assert "mmHg at the dent" in shell.text("read", model, frame, "--globe", "open")
    (frame.parents[1] / "recording.toml").write_text(
        STATED.replace("[needle]", 'globe = "open"\n[needle]')
    )
    (evaluated,) = shell.json("evaluate", model, frame.parents[1])["frames"]
    assert evaluated["pressure_mmhg"] == pytest.approx(read(frame)["pressure_mmhg"])


def test_a_calibration_gives_the_modulus_as_it_gives_it_to_python(
    read, model, frame, tmp_path, shell
) -> None:
    file = tmp_path / "modulus.json"
    file.write_text(
        calibration_text(eyes={"mine": {"mean_mpa": 0.31}, "other": {"mean_mpa": 0.29}})
    )
    own = read(frame, "--calibration", file)
    assert own["known"]["youngs_modulus_mpa"] == {
        "value": 0.31,
        "source": "calibration",
    }
    assert own["known"]["iop_mmhg"]["source"] == "recording.toml"
    answer = sf.read(sf.load_model(model), frame, calibration=file)
    assert own["predicted_force_mn"] == from_si(answer.force_n, "mn")
    assert own["interval_mn"] == [from_si(end, "mn") for end in answer.interval_n]
    other = read(frame, "--calibration", file, "--eye", "other")
    assert other["known"]["youngs_modulus_mpa"]["value"] == 0.29
    nobody = shell.text(
        "classify", model, frame, "--calibration", file, "--eye", "nobody"
    )
    assert "nobody is not in" in nobody


def test_options_that_contradict_each_other_are_refused_by_name(
    model, loose, tmp_path, shell
) -> None:
    file = tmp_path / "modulus.json"
    file.write_text(calibration_text(eyes={"mine": {"mean_mpa": 0.31}}))

    for options, words in (
        (
            ["--calibration", file, *MODULUS],
            "error: --youngs-modulus-mpa: the calibration gives the modulus",
        ),
        (
            ["--calibration", file, "--stiffening", 3],
            "error: --stiffening: the calibration gives the stiffening",
        ),
        (["--calibration", file], "error: --eye: missing"),
        (["--eye", "mine"], "error: --eye: 'mine' names an eye"),
        (["--calibration", "nowhere.json"], "nowhere.json"),
        (["--rigidity", 0.03], "--rigidity: of a sealed globe"),
        (["--globe", "open", "--rigidity", 0.03], "--rigidity: of a sealed globe"),
        (
            ["--globe", "sealed", "--rigidity", 5],
            "'--rigidity': 5 is above the largest allowed value 1",
        ),
    ):
        assert words in shell.refused("read", model, loose, *SIZE, *options)


def test_a_frame_of_unknown_scale_is_refused_and_the_options_are_named(
    read, model, loose, shell
) -> None:
    place = f"error: {loose}: its size is neither in the file nor in a recording.toml"
    assert (
        shell.refused("read", model, loose)
        == f"{place}; give --width-mm and --depth-mm\n"
    )
    entry = read(loose, *SIZE)
    assert entry["usable"]
    assert {size["source"] for size in entry["scale"].values()} == {
        "option",
        "model's study",
    }


def test_the_scale_of_a_tiff_is_used_unless_no_scan_has_it(
    read, loose, pixels, tmp_path
) -> None:
    expected = read(loose, *SIZE)
    per_cm = (0.01 / SCALE.lateral_m, 0.01 / SCALE.depth_m)
    tifffile.imwrite(
        tmp_path / "a.tif", pixels, resolution=per_cm, resolutionunit="CENTIMETER"
    )
    entry = read(tmp_path / "a.tif")
    assert entry["scale"]["width_mm"] == {
        "value": pytest.approx(15.0, rel=1e-5),
        "source": "file",
    }
    assert entry["predicted_force_mn"] == pytest.approx(
        expected["predicted_force_mn"], rel=1e-3
    )
    tifffile.imwrite(
        tmp_path / "b.tif", pixels, resolution=(1.0, 2.0), resolutionunit="CENTIMETER"
    )
    error = read(tmp_path / "b.tif", code=2)["error"]
    assert (
        "width_mm: 5120 is above the largest allowed value 100; did you mean 5.12 mm"
        " (5120 µm)?" in error
    )
    assert "(stated by: file); give --width-mm" in error


def test_a_frame_that_contradicts_its_recording_is_refused(read, frame) -> None:
    cv2.imwrite(str(frame), np.zeros((100, 120), np.uint16))
    assert (
        "100 x 120 pixels (rows x columns); recording.toml says 512 x 512"
        in read(frame, code=2)["error"]
    )


def test_bad_files_are_reported_and_the_others_are_answered(
    model, frame, tmp_path, shell
) -> None:
    cv2.imwrite(str(frame), image(wall_section(tip_of(0.008))))
    empty = tmp_path / "empty.png"
    missing = tmp_path / ("x" * 300)
    empty.write_bytes(b"")
    os.mkfifo(tmp_path / "pipe.png")
    given = [empty, frame, missing, tmp_path / "pipe.png"]
    entries = json.loads(shell.run("read", model, *given, "--json", code=2)[0])[
        "frames"
    ]
    assert [entry["file"] for entry in entries] == [str(path) for path in given]
    assert ["error" in entry for entry in entries] == [True, False, True, True]
    assert all(
        (entry["predicted"], entry["usable"]) == (2, False)
        for entry in entries
        if "error" in entry
    )
    out, err = shell.run("read", model, *given, code=2)
    assert out.startswith(f"{frame}: class 1")
    assert err.splitlines() == [
        (
            f"error: {empty}: an empty file; give a PNG, TIFF, JPEG or a single DICOM"
            " image"
        ),
        f"error: {missing}: File name too long",
        f"error: {tmp_path / 'pipe.png'}: a named pipe; give a regular file",
    ]


RELAXING = "relaxation = [[0.12, 1.2], [0.15, 12.0]]"


def relaxing(frame: Path, terms: str) -> None:
    text = (frame.parents[1] / "recording.toml").read_text()
    (frame.parents[1] / "recording.toml").write_text(
        text.replace("[eye]", f"[eye]\n{terms}")
    )


def test_tissue_that_relaxes_gives_the_force_on_the_needle_and_the_elastic_one(
    read, frame
) -> None:
    elastic = read(frame, *MODULUS, "--globe", "open")
    assert elastic["elastic_force_mn"] is None
    relaxing(frame, RELAXING)
    unknown, soon, late = (
        read(frame, *MODULUS, "--globe", "open", *held)
        for held in ((), ("--held-s", 0.1), ("--held-s", 60))
    )

    for entry in (unknown, soon, late):
        assert entry["elastic_force_mn"] == pytest.approx(elastic["predicted_force_mn"])
        assert entry["predicted_force_mn"] < entry["elastic_force_mn"]

    assert late["predicted_force_mn"] == pytest.approx(
        0.73 * elastic["predicted_force_mn"], rel=0.01
    )
    assert soon["predicted_force_mn"] > late["predicted_force_mn"]
    low_mn, high_mn = unknown["interval_mn"]
    assert (
        low_mn
        < late["predicted_force_mn"]
        < elastic["predicted_force_mn"]
        < high_mn + 1.0
    )


def test_a_hold_needs_a_known_relaxation_and_changes_no_elastic_tissue(
    shell, model, read, frame
) -> None:
    assert (
        "held_s: nothing says how the tissue relaxes"
        in shell.json("read", model, frame, *MODULUS, "--held-s", 1, code=2)["frames"][
            0
        ]["error"]
    )
    before = read(frame, *MODULUS)
    relaxing(frame, "relaxation = []")
    assert (
        read(frame, *MODULUS, "--held-s", 1)["predicted_force_mn"]
        == before["predicted_force_mn"]
    )


@pytest.mark.parametrize(
    "terms",
    [
        "[[0.6, 1.0], [0.5, 2.0]]",
        "[[0.1]]",
        "[[0.1, 0.0]]",
        "[[-0.1, 1.0]]",
        "[0.1, 1.0]",
    ],
)
def test_an_impossible_relaxation_is_refused_with_its_file_and_line(
    shell, model, frame, terms: str
) -> None:
    relaxing(frame, f"relaxation = {terms}")
    (entry,) = shell.json("read", model, frame, *MODULUS, code=2)["frames"]
    assert "recording.toml:3: eye.relaxation" in entry["error"]


def test_what_frames_csv_states_of_a_frame_counts_and_a_fault_in_it_is_named_once(
    frame: Path, shell
) -> None:
    table = frame.parents[1] / "frames.csv"
    other = frame.with_name("2.png")
    other.write_bytes(frame.read_bytes())
    usual = shell.json("read", "default", frame, *MODULUS)["frames"][0]
    table.write_text("file,time_s,iop_pa\n1.png,1.0,300.0\n")
    (entry,) = shell.json("read", "default", frame, *MODULUS)["frames"]
    assert entry["known"]["iop_mmhg"]["source"] == "frames.csv"
    assert entry["known"]["iop_mmhg"]["value"] == pytest.approx(300.0 / 133.322387415)
    assert entry["predicted_force_mn"] != usual["predicted_force_mn"]
    declared = shell.json("read", "default", frame, *MODULUS, "--iop-mmhg", 2)[
        "frames"
    ][0]
    assert declared["known"]["iop_mmhg"] == {"value": 2.0, "source": "option"}

    # nothing needs the hold of elastic tissue
    table.write_text("file,time_s,held_s\n1.png,1.0,3.0\n")
    held = shell.json("read", "default", frame, *MODULUS)["frames"][0]
    assert held["predicted_force_mn"] == usual["predicted_force_mn"]
    assert "held-s" in shell.refused("read", "default", frame, *MODULUS, "--held-s", 3)

    for text, words in (
        ("file,time_s,iop_pa\n1.png,1.0,99999\n", "iop_pa: 99999 is above"),
        ("file,time_s\n1.png,soon\n", "time_s"),
    ):
        table.write_text(text)
        said = shell.refused("read", "default", frame, other)
        assert str(table) in said
        assert words in said

    table.unlink()
    table.symlink_to(frame.parent / "nowhere.csv")
    assert "frames.csv" in shell.refused("read", "default", frame, *MODULUS)


def test_a_foreign_modulus_is_remarked_once_by_each_door(
    frame: Path, tmp_path: Path, shell
) -> None:
    calibration = tmp_path / "others.json"
    calibration.write_text(calibration_text(MODULUS_PA / 1e6, {"other": {}}))
    answer = sf.read("default", frame, calibration=calibration)
    codes = [remark.code for remark in answer.remarks]
    assert codes.count("population-modulus") == 1
    found = shell.json("read", "default", frame, "--calibration", calibration)
    for part in (found, found["frames"][0]):
        codes = [remark["code"] for remark in part["remarks"]]
        assert codes.count("population-modulus") == 1
