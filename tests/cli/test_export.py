"""`scleraforce export`."""

import csv
import json
from pathlib import Path

import pytest
from foreign_files import with_log
from small_recordings import write_small_recording

from scleraforce.cli.main import run

ANSWERS = {"frames": [{"file": "0001.png", "recording": "r", "predicted_force_mn": 4.5, "interval_mn": [3.0, 6.0]}]}


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    (tmp_path / "answers.json").write_text(json.dumps(ANSWERS))
    return with_log(write_small_recording(tmp_path / "r", frames=12))


def exported(*arguments: object) -> int:
    return run(["export", *map(str, arguments)])


def test_a_table_has_a_row_for_each_frame_with_its_answer(recording: Path, capsys) -> None:
    out = recording.parent / "a.csv"
    assert exported(recording, "--answers", recording.parent / "answers.json", "--out", out, "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"out": str(out), "rows": 12}
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert [row["file"] for row in rows] == [f"{n:04d}.png" for n in range(12)]
    assert [row["predicted_force_mn"] for row in rows[:3]] == ["", "4.5", ""]
    assert float(rows[5]["measured_force_mn"]) == pytest.approx(10.0, abs=0.3)
    assert rows[5]["target"] == "1"


def test_json_has_the_settings_of_the_recording_too(recording: Path) -> None:
    out = recording.parent / "a.json"
    assert exported(recording, "--out", out) == 0
    found = json.loads(out.read_text())
    assert (found["oct"]["bits"], found["needle"]["gauge"], len(found["frames"])) == (12, 22, 12)


def test_answers_alone_become_a_table(recording: Path) -> None:
    out = recording.parent / "b.csv"
    assert exported(recording.parent / "answers.json", "--out", out) == 0
    assert out.read_text() == (
        "file,recording,predicted_force_mn,interval_low_mn,interval_high_mn\n0001.png,r,4.5,3.0,6.0\n"
    )


@pytest.mark.parametrize("name", ["a.mcap", "a.nrrd", "a.seq.nrrd"])
def test_frames_become_a_file_that_import_takes(recording: Path, tmp_path: Path, name: str) -> None:
    pytest.importorskip("rosbags")
    pytest.importorskip("nrrd")
    assert exported(recording, "--out", tmp_path / name) == 0
    like = ["--like", recording, "--eye", "again", "--out", tmp_path / "back"]
    assert run(["import", str(tmp_path / name), *map(str, like)]) == 0


def test_a_file_that_is_there_stays_without_force(recording: Path, capsys) -> None:
    out = recording.parent / "a.csv"
    out.write_text("mine")
    assert exported(recording, "--out", out) == 2
    assert "exists already" in capsys.readouterr().err
    assert out.read_text() == "mine"
    assert exported(recording, "--out", out, "--force") == 0
    assert out.read_text().startswith("file,")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["r", "--out", "a.png"], "give a name that ends in .csv, .json, .mcap, .nrrd"),
        (["answers.json", "--out", "a.mcap"], "answers alone become .csv or .json"),
        (["answers.json", "--answers", "answers.json", "--out", "a.csv"], "is a file of answers already"),
        (["r", "--answers", "answers.json", "--out", "a.nrrd"], "has room for frames only"),
        (["gone", "--out", "a.csv"], "gone: No such file"),
    ],
)
def test_what_cannot_be_done_is_refused(
    recording: Path, monkeypatch: pytest.MonkeyPatch, capsys, arguments: list[str], message: str
) -> None:
    monkeypatch.chdir(recording.parent)
    assert exported(*arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (recording.parent / arguments[-1]).exists()
