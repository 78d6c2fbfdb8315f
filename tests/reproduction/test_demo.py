"""`demo` makes a whole session that reads right; what it cannot finish leaves nothing."""

import json
from pathlib import Path

import pytest

from scleraforce.cli.main import run
from scleraforce.errors import SolverError
from scleraforce.known.calibration_file import read_calibration
from scleraforce.recording.folder import read_recording
from scleraforce.reproduction import demo


@pytest.mark.slow
def test_a_virtual_session_is_pushed_calibrated_read_and_shown(tmp_path: Path, capsys) -> None:
    out = tmp_path / "new" / "demo"
    assert run(["demo", "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["page"] == str(out / "answers.html")
    assert "Model" in (out / "answers.html").read_text()
    assert len(read_recording(out / "eye").frames) == told["frames"] == len(demo.FORCES_N)
    assert read_calibration(out / "modulus.json").eyes["demo"].mean_pa == pytest.approx(0.3e6, rel=0.1)
    assert told["read"] == told["right"] == len(demo.FORCES_N) - demo.TAUGHT
    assert told["mae_mn"] < 1.0


def test_a_session_that_ends_early_leaves_nothing(tmp_path: Path, monkeypatch, capsys) -> None:
    def failing(*_: object) -> None:
        raise SolverError("no equilibrium")

    monkeypatch.setattr(demo, "study_sections", lambda *_: lambda _: [])
    monkeypatch.setattr(demo, "write_phantom", lambda out, *_: (out.mkdir(parents=True), failing()))
    assert run(["demo", "--out", str(tmp_path / "demo")]) == 1
    assert capsys.readouterr().err == "error: no equilibrium\n"
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_there_stays(tmp_path: Path, capsys) -> None:
    (tmp_path / "mine").write_text("mine")
    assert run(["demo", "--out", str(tmp_path)]) == 2
    assert f"{tmp_path}: exists already" in capsys.readouterr().err
    assert (tmp_path / "mine").read_text() == "mine"
