"""Prompts of `import` on a terminal: a wrong answer is asked for again, and leaving writes nothing."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from foreign_files import FRAMES, options_of, write_log
from small_recordings import looked_at_frames

from scleraforce.cli import import_ as terminal
from scleraforce.cli.import_ import import_
from scleraforce.recording.folder import read_recording


@pytest.fixture(autouse=True)
def on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(terminal, "_can_ask", lambda: True)


def asked(answers: list[str], *arguments: object) -> Result:
    return CliRunner().invoke(import_, list(map(str, arguments)), "".join(f"{answer}\n" for answer in answers))


def volume(tmp_path: Path) -> Path:
    np.save(tmp_path / "a.npy", FRAMES)
    return tmp_path / "a.npy"


SCALE = ["--width-mm", 10, "--depth-mm", 4]


def test_an_answer_that_the_source_contradicts_is_asked_for_again(tmp_path: Path) -> None:
    lines = ["when,pull", *(f"{n / 200},{-0.001 * n}" for n in range(400))]
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    options = [*options_of("--bits", 13, "--rate-hz", 5, "--clock-offset-s", 0, "--contact-sign", -1), *SCALE]
    axes = ["nonsense", "frame,depth", "frame,depth,lateral"]
    columns = ["when:s", "pull:kg", "when:s", "push:N", "when:s", "pull:N"]
    done = asked([*axes, *columns, "-"], volume(tmp_path), tmp_path / "log.csv", "--out", tmp_path / "r", *options)
    assert done.exit_code == 0, done.stderr
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 4
    assert "'kg'" in errors[2]
    assert "push" in errors[3]
    assert len(read_recording(tmp_path / "r").forces.time_s) == 400


def test_each_answer_is_checked_where_it_is_given(tmp_path: Path) -> None:
    answers = ["zwei", "-3", "10", "4", "3", "1.38", "8", "13", "0", "5", "", "a\teye", "eye-1", "9", "22", "0.6"]
    wall = ["0.65", "650"]
    source = [volume(tmp_path), "--axes", "frame,depth,lateral"]
    done = asked([*answers, *wall], *source, "--out", tmp_path / "r")
    assert done.exit_code == 0, done.stderr
    assert done.stderr.count("Error: ") == 8
    info = read_recording(tmp_path / "r").info
    assert (info.eye.id, info.oct.bits, info.needle.gauge) == ("eye-1", 13, 22)
    assert info.eye.thickness_m == pytest.approx(650e-6)
    assert json.loads((tmp_path / "r" / "import.json").read_text())["values"]["thickness_um"] == "answer"


def test_answers_that_do_not_go_together_are_asked_for_again(tmp_path: Path) -> None:
    write_log(tmp_path / "log.csv")
    source = [volume(tmp_path), tmp_path / "log.csv", "--axes", "frame,depth,lateral", *SCALE]
    options = options_of("--bits", 13, "--rate-hz", 5, "--contact-sign", -1)
    done = asked(["1000", "0.5", "-"], *source, "--out", tmp_path / "r", *options)
    assert done.exit_code == 0, done.stderr
    assert "error: " in done.stderr
    assert read_recording(tmp_path / "r").frames[0].time_s == 0.5


@pytest.mark.parametrize("answers", [[], ["10", "4"], ["10", "4", "1", "13", "5", "eye", "22", "0.5"]])
def test_one_who_leaves_leaves_nothing_behind(tmp_path: Path, answers: list[str]) -> None:
    source = volume(tmp_path)
    done = asked(answers, source, "--axes", "frame,depth,lateral", "--out", tmp_path / "r")
    assert done.exit_code != 0
    assert sorted(tmp_path.iterdir()) == [source]


@pytest.mark.parametrize(("answer", "thickness_um", "stated"), [
    ("", 600.0, "measured on the first frames"), ("580", 580.0, "answer"), ("-", None, None),
])  # fmt: skip
def test_the_wall_that_the_frames_show_is_offered(
    tmp_path: Path, answer: str, thickness_um: float | None, stated: str | None
) -> None:
    looked_at_frames(tmp_path / "r", 2)
    source = [tmp_path / "r" / "frames", "--like", tmp_path / "r", "--eye", "again", "--rate-hz", 1]
    done = asked([answer], *source, "--out", tmp_path / "s")
    assert done.exit_code == 0, done.stderr
    assert "the first frames show" in done.stderr
    found = read_recording(tmp_path / "s").info.eye.thickness_m
    kept = json.loads((tmp_path / "s" / "import.json").read_text())
    assert kept["values"].get("thickness_um") == stated
    assert (found is None) == (thickness_um is None) == any("--thickness-um" in note for note in kept["notes"])
    if thickness_um is not None:
        assert found == pytest.approx(thickness_um * 1e-6, rel=0.1)  # drawn along the depth, measured along the normal
