"""What a reader would refuse is said at once, in the same words, by every command that meets the recording."""

import json
import re
from pathlib import Path

import pytest
from small_recordings import looked_at_frames

import scleraforce as sf
from scleraforce.cli.main import run

CHANGES = {
    "frames of 6 x 4 mm: at most 6.0 mm of the wall are seen, not 9.8 mm": ("width_m = 15e-3", "width_m = 6e-3"),
    "IOP 15 mmHg, the model was trained on 0.5 to 5 mmHg": ('id = "eye"', 'id = "eye"\niop_pa = 1999.84'),
    "wall thickness 1000 µm, the model was trained on 380 to 900 µm": ('id = "eye"', 'id = "eye"\nthickness_m = 1e-3'),
    "needle of 30 gauge, the model was trained on 22 gauge (0.7 mm)": ("gauge = 22", "gauge = 30"),
}


@pytest.fixture(params=CHANGES)
def limited(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, str]:
    """A recording of one frame that is outside in one thing, and the sentence on that."""
    looked_at_frames(tmp_path / "r", 1)
    info = tmp_path / "r" / "recording.toml"
    assert CHANGES[request.param][0] in info.read_text()
    info.write_text(info.read_text().replace(*CHANGES[request.param]))
    return tmp_path / "r", request.param


def notes(capsys: pytest.CaptureFixture[str], *command: object) -> list[str]:
    assert run([*map(str, command), "--json"]) == 0, capsys.readouterr().err
    return json.loads(capsys.readouterr().out)["notes"]


def test_every_command_has_the_same_sentence(limited: tuple[Path, str], capsys: pytest.CaptureFixture[str]) -> None:
    recording, sentence = limited
    frame = recording / "frames" / "0001.png"
    stated = re.search(r"thickness_m = (.*)", (recording / "recording.toml").read_text())
    wall = ["--thickness-um", float(stated[1]) * 1e6] if stated else []
    pressure = ["--iop-mmhg", 15] if "iop_pa" in (recording / "recording.toml").read_text() else []
    said = {
        "show": notes(capsys, "show", recording),
        "import": notes(capsys, "import", frame, "--like", recording, "--eye", "a", *wall, *pressure,
                        "--out", recording.parent / "i"),
        "evaluate": notes(capsys, "evaluate", "default", recording),
        "classify": notes(capsys, "classify", "default", frame),
        "sf.read": list(sf.read(sf.load_model("default"), frame).warnings),
    }  # fmt: skip
    counts = {name: sum(note.endswith(f": {sentence}") for note in found) for name, found in said.items()}
    assert counts == dict.fromkeys(said, 1)


def test_another_model_has_other_limits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    looked_at_frames(tmp_path / "r", 1)
    info = tmp_path / "r" / "recording.toml"
    info.write_text(info.read_text().replace("slice_gap_m = 5e-4", "slice_gap_m = 8e-4"))
    assert notes(capsys, "show", tmp_path / "r") == []
    (found,) = notes(capsys, "show", tmp_path / "r", "--model", "paper")
    assert found.startswith("outside the range of paper: gap ")
    again = ["import", tmp_path / "r" / "frames", "--like", tmp_path / "r", "--eye", "a", "--out", tmp_path / "i"]
    assert found in notes(capsys, *again, "--model", "paper")


def test_a_model_that_cannot_be_used_imports_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    looked_at_frames(tmp_path / "r", 1)
    source = ["import", tmp_path / "r" / "frames", "--like", tmp_path / "r", "--eye", "a", "--out", tmp_path / "i"]
    assert run([*map(str, source), "--model", "nowhere"]) == 2
    assert "nowhere: no such folder" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["r"]


def test_the_ranges_of_a_model_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["show", "default", "--json"]) == 0
    reads = json.loads(capsys.readouterr().out)["reads"]
    assert run(["show", "default"]) == 0
    text = capsys.readouterr().out
    assert len(reads) > 5
    assert all(re.search(rf"{re.escape(name)} +{re.escape(words)}", text) for name, words in reads.items())


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A virtual recording with forces that states no thickness, of an eye of 15 mmHg."""
    folder = tmp_path_factory.mktemp("pushed")
    study = folder / "study.toml"
    study.write_text("[mesh]\ncore = 4\nrings = 8\n")
    made = ["phantom", "--study", study, "--out", folder / "r", "--eye", "eye", "--thickness-um", 650,
            "--youngs-modulus-mpa", 0.3, "--iop-mmhg", 15, "--forces-mn", "12,24,3",
            "--mechanics", "finite-strain"]  # fmt: skip
    assert run(list(map(str, made))) == 0
    info = folder / "r" / "recording.toml"
    info.write_text(re.sub(r"(?m)^thickness_m.*\n", "", info.read_text()))
    return folder / "r"


def calibrated(capsys: pytest.CaptureFixture[str], recording: Path, out: Path, *options: object) -> dict:
    command = ["calibrate", recording, "--parameters", "e", "--out", out, *options, "--json"]
    assert run(list(map(str, command))) == 0, capsys.readouterr().err
    return json.loads(capsys.readouterr().out)


def test_calibrate_takes_a_thickness_before_that_of_the_recording(
    pushed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert run(["calibrate", str(pushed), "--out", str(tmp_path / "none.json")]) == 2
    assert "eye.thickness_m: missing" in capsys.readouterr().err
    given = calibrated(capsys, pushed, tmp_path / "given.json", "--thickness-um", 650)
    info = pushed / "recording.toml"
    before = info.read_text()
    info.write_text(before.replace("[eye]", "[eye]\nthickness_m = 4e-4"))
    try:
        stated = calibrated(capsys, pushed, tmp_path / "stated.json")
        both = calibrated(capsys, pushed, tmp_path / "both.json", "--thickness-um", 650)
    finally:
        info.write_text(before)
    means = [found["eyes"]["eye"]["mean_mpa"] for found in (given, both, stated)]
    assert means[0] == means[1]
    assert means[2] > 1.3 * means[0]


def test_calibrate_says_what_a_reader_would_refuse_before_it_begins(
    pushed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    options = ["--thickness-um", "650", "--parameters", "e", "--out", str(tmp_path / "a.json")]
    assert run(["calibrate", str(pushed), *options]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(f"note: {pushed}:")
    assert "IOP 15 mmHg" in " ".join(lines[:3])


def test_one_thickness_is_not_that_of_two_eyes(pushed: Path, tmp_path: Path) -> None:
    looked_at_frames(tmp_path / "other", 1)
    info = tmp_path / "other" / "recording.toml"
    info.write_text(info.read_text().replace('id = "eye"', 'id = "other"'))
    with pytest.raises(sf.InputError, match="thickness_m: of one eye; the recordings are of eye, other"):
        sf.calibrate([pushed, tmp_path / "other"], thickness_m=650e-6)
    with pytest.raises(sf.InputError, match=r"thickness_m: 0\.65"):
        sf.calibrate(pushed, thickness_m=0.65)
