"""The limits of a reader are noted at once, in the same words, by every command that meets the recording."""

import json
import re
from pathlib import Path

import pytest
from small_recordings import looked_at_frames

import scleraforce as sf
from scleraforce.cli.main import run

CHANGES = {
    "width_m = 0.015": "width_m = 0.006",
    'id = "eye"': 'id = "eye"\niop_pa = 1999.84\nthickness_m = 1e-3',
    "gauge = 22": "gauge = 30",
}
SENTENCES = (
    "frames of 6 x 4 mm: at most 6.0 mm of the wall are visible; at least 9.8 mm are needed without a calibration, "
    "and by the monitor",
    "IOP 15 mmHg, the model was trained on 0.5 to 5 mmHg",
    "wall thickness 1000 µm, the model was trained on 380 to 900 µm",
    "needle of 30 gauge, the model was trained on 22 gauge (0.7 mm)",
)


def changed_recording(folder: Path, changes: dict[str, str]) -> Path:
    """A recording of one frame with other statements in its recording.toml."""
    looked_at_frames(folder, 1)
    text = (folder / "recording.toml").read_text()
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    (folder / "recording.toml").write_text(text)
    return folder


def test_every_command_has_the_same_sentences(tmp_path: Path, shell) -> None:
    recording = changed_recording(tmp_path / "r", CHANGES)
    frame = recording / "frames" / "0001.png"
    eye = ("--eye", "a", "--thickness-um", 1000, "--iop-mmhg", 15)
    said = {
        "show": shell.json("show", recording)["notes"],
        "import": shell.json("import", frame, "--like", recording, *eye, "--out", tmp_path / "i")["notes"],
        "evaluate": shell.json("evaluate", "default", recording)["notes"],
        "read": shell.json("read", "default", frame)["notes"],
        "sf.read": list(sf.read(sf.load_model("default"), frame).warnings),
    }
    counts = {name: [sum(note.endswith(f": {one}") for note in found) for one in SENTENCES]
              for name, found in said.items()}  # fmt: skip
    assert counts == dict.fromkeys(said, [1] * len(SENTENCES))


def test_another_model_has_other_limits(tmp_path: Path, shell) -> None:
    recording = changed_recording(tmp_path / "r", {"slice_gap_m = 0.0005": "slice_gap_m = 0.0008"})
    assert shell.json("show", recording)["notes"] == []
    (found,) = shell.json("show", recording, "--model", "paper")["notes"]
    assert found.startswith("outside the range of paper: gap ")
    again = ["import", recording / "frames", "--like", recording, "--eye", "a", "--out", tmp_path / "i", "--model"]
    assert "nowhere: no such folder" in shell.refused(*again, "nowhere")
    assert [path.name for path in tmp_path.iterdir()] == ["r"]
    assert found in shell.json(*again, "paper")["notes"]


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

    given = ("calibrate", pushed, "--thickness-um", 650, "--parameters", "e", "--frames", 2, "--out")
    info = pushed / "recording.toml"
    before = info.read_text()
    means = []
    for n, thickness in enumerate(("", "\nthickness_m = 4e-4")):
        info.write_text(before.replace("[eye]", f"[eye]{thickness}"))
        first = " ".join(shell.run(*given, tmp_path / f"{n}.json")[0].split()[:40])  # lines wrap where the path ends
        assert first.startswith(f"note: {pushed}:")
        assert "IOP 15 mmHg" in first
        means.append(json.loads((tmp_path / f"{n}.json").read_text())["eyes"]["eye"]["mean_mpa"])
    info.write_text(before)
    assert means[0] == means[1]


def test_one_thickness_is_not_that_of_two_eyes(pushed: Path, tmp_path: Path) -> None:
    changed_recording(tmp_path / "other", {'id = "eye"': 'id = "other"'})
    with pytest.raises(sf.InputError, match="thickness_m: of one eye; the recordings are of eye, other"):
        sf.calibrate([pushed, tmp_path / "other"], thickness_m=650e-6)
    with pytest.raises(sf.InputError, match=r"thickness_m: 0\.65"):
        sf.calibrate(pushed, thickness_m=0.65)
