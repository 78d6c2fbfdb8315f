"""The limits of a reader are noted at once, in the same words, by every command that meets the recording."""

import re
from pathlib import Path

import pytest
from small_recordings import looked_at_frames

import scleraforce as sf
from scleraforce.cli.main import run

CHANGES = {
    "frames of 6 x 4 mm: at most 6.0 mm of the wall are visible; at least 9.8 mm are needed": (
        "width_m = 15e-3",
        "width_m = 6e-3",
    ),
    "IOP 15 mmHg, the model was trained on 0.5 to 5 mmHg": ('id = "eye"', 'id = "eye"\niop_pa = 1999.84'),
    "wall thickness 1000 µm, the model was trained on 380 to 900 µm": ('id = "eye"', 'id = "eye"\nthickness_m = 1e-3'),
    "needle of 30 gauge, the model was trained on 22 gauge (0.7 mm)": ("gauge = 22", "gauge = 30"),
}


def changed_recording(folder: Path, old: str, new: str) -> Path:
    """A recording of one frame with another statement in its recording.toml."""
    looked_at_frames(folder, 1)
    info = folder / "recording.toml"
    assert old in info.read_text()
    info.write_text(info.read_text().replace(old, new))
    return folder


@pytest.mark.parametrize("sentence", CHANGES)
def test_every_command_has_the_same_sentence(tmp_path: Path, sentence: str, shell) -> None:
    recording = changed_recording(tmp_path / "r", *CHANGES[sentence])
    frame, stated = recording / "frames" / "0001.png", (recording / "recording.toml").read_text()
    eye = ["--thickness-um", 1000] * ("thickness_m = 1e-3" in stated) + ["--iop-mmhg", 15] * ("iop_pa" in stated)
    source = (frame, "--like", recording, "--eye", "a", *eye, "--out", tmp_path / "i")
    said = {
        "show": shell.json("show", recording)["notes"],
        "import": shell.json("import", *source)["notes"],
        "evaluate": shell.json("evaluate", "default", recording)["notes"],
        "read": shell.json("read", "default", frame)["notes"],
        "sf.read": list(sf.read(sf.load_model("default"), frame).warnings),
    }
    counts = {name: sum(note.endswith(f": {sentence}") for note in found) for name, found in said.items()}
    assert counts == dict.fromkeys(said, 1)


def test_another_model_has_other_limits(tmp_path: Path, shell) -> None:
    recording = changed_recording(tmp_path / "r", "slice_gap_m = 5e-4", "slice_gap_m = 8e-4")
    assert shell.json("show", recording)["notes"] == []
    (found,) = shell.json("show", recording, "--model", "paper")["notes"]
    assert found.startswith("outside the range of paper: gap ")
    again = ["import", recording / "frames", "--like", recording, "--eye", "a", "--out", tmp_path / "i", "--model"]
    assert "nowhere: no such folder" in shell.refused(*again, "nowhere")
    assert [path.name for path in tmp_path.iterdir()] == ["r"]
    assert found in shell.json(*again, "paper")["notes"]


def test_the_ranges_of_a_model_are_shown(shell) -> None:
    reads = shell.json("show", "default")["reads"]
    text = shell.run("show", "default")[0]
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


def test_calibrate_prefers_the_given_thickness_and_notes_limits_at_once(pushed: Path, tmp_path: Path, shell) -> None:
    assert "eye.thickness_m: missing" in shell.refused("calibrate", pushed, "--out", tmp_path / "none.json")

    def calibrated(name: str, *options: object) -> float:
        found = shell.json("calibrate", pushed, "--parameters", "e", "--out", tmp_path / name, *options)
        return found["eyes"]["eye"]["mean_mpa"]

    given = ["--thickness-um", 650]
    alone = calibrated("given.json", *given)
    lines = shell.run("calibrate", pushed, *given, "--parameters", "e", "--out", tmp_path / "a.json")[0].splitlines()
    assert lines[0].startswith(f"note: {pushed}:")
    assert "IOP 15 mmHg" in " ".join(lines[:3])
    info = pushed / "recording.toml"
    before = info.read_text()
    info.write_text(before.replace("[eye]", "[eye]\nthickness_m = 4e-4"))
    try:
        stated, both = calibrated("stated.json"), calibrated("both.json", *given)
    finally:
        info.write_text(before)
    assert both == alone
    assert stated > 1.3 * alone


def test_one_thickness_is_not_that_of_two_eyes(pushed: Path, tmp_path: Path) -> None:
    changed_recording(tmp_path / "other", 'id = "eye"', 'id = "other"')
    with pytest.raises(sf.InputError, match="thickness_m: of one eye; the recordings are of eye, other"):
        sf.calibrate([pushed, tmp_path / "other"], thickness_m=650e-6)
    with pytest.raises(sf.InputError, match=r"thickness_m: 0\.65"):
        sf.calibrate(pushed, thickness_m=0.65)
