"""`doctor` and `reproduce`: findings and their exit code; intervals, and progress with and without a terminal."""

import json
import re
import sys
from pathlib import Path

import pytest
from small_recordings import frame_answer

from scleraforce import installation
from scleraforce.cli.first import _coverage_words, _stage, _true_metrics
from scleraforce.cli.main import run
from scleraforce.installation import Finding
from scleraforce.reader.evaluate import Evaluation

FOUND = [
    Finding("packages", "ok", "numpy 2.4.6"),
    Finding("extra [train]", "missing", "no torch", "pip install 'scleraforce[train]'"),
]


def find(monkeypatch: pytest.MonkeyPatch, found: list[Finding]) -> None:
    for name, value in {"packages": lambda: found, "machine": list, "TRIALS": ()}.items():
        monkeypatch.setattr(installation, name, value)


def test_it_prints_a_line_for_each_finding_and_what_to_do(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    find(monkeypatch, FOUND)
    assert run(["doctor"]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.startswith("scleraforce ")
    assert lines == [
        "ok       packages        numpy 2.4.6",
        "missing  extra [train]   no torch",
        "                         -> pip install 'scleraforce[train]'",
    ]


def test_what_has_failed_ends_it_with_code_1(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    find(monkeypatch, [*FOUND, Finding("a solve", "failed", "wrong", "report")])
    assert run(["doctor", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert not told["ok"]
    assert told["findings"][-1] == {"name": "a solve", "state": "failed", "found": "wrong", "remedy": "report"}
    assert {"scleraforce", "python", "system", "seconds"} <= told.keys()


@pytest.mark.slow
def test_this_installation_is_well(capsys) -> None:
    assert run(["doctor", "--json"]) == 0
    states = {finding["name"]: finding["state"] for finding in json.loads(capsys.readouterr().out)["findings"]}
    assert states["packages"] == states["a solve"] == states["a reading"] == "ok"


def read_beside_log_and_truth(folder: Path) -> Evaluation:
    """Two frames, read 0.5 mN off the truth, the log 2 mN off, intervals of 1 mN to either side; a third is refused."""
    true_mn = {"0.png": 10.0, "1.png": 20.0, "2.png": 30.0}
    frames = tuple(
        frame_answer(
            recording=str(folder),
            file=file,
            measured_force_n=1e-3 * (force_mn + 2.0),
            true_force_n=1e-3 * force_mn,
            force_n=1e-3 * (force_mn + 0.5),
            interval_n=(1e-3 * (force_mn - 0.5), 1e-3 * (force_mn + 1.5)),
        )
        for file, force_mn in list(true_mn.items())[:2]
    )
    refused = frame_answer(recording=str(folder), file="2.png", usable=False)
    return Evaluation(
        model="reader",
        bounds_n=(5e-3, 30e-3),
        max_force_n=60e-3,
        youngs_modulus_pa=0.25e6,
        frames=(*frames, refused),
        kind="reader",
    )


def test_intervals_are_counted_against_the_log_and_against_the_truth(tmp_path: Path) -> None:
    evaluation = read_beside_log_and_truth(tmp_path)
    words = _coverage_words(evaluation)
    assert "hold 2 of 2 true forces: 2 of 2 of eye; they agree with 0 of 2 labels" in words
    assert "share the error" in words
    metrics = _true_metrics(evaluation)
    assert metrics["true_mae_mn"] == pytest.approx(0.5)
    assert (metrics["true_coverage"], metrics["true_coverage_interval"]) == (1.0, (1.0, 1.0))
    assert metrics["true_coverage_by_eye"] == {"eye": 1.0}
    assert evaluation.coverage.value == 0.0


def test_without_a_terminal_a_stage_is_one_line_with_its_time_when_it_is_done(capsys) -> None:
    with _stage("1/13 phantom", 3) as progress:
        progress(2)
        assert capsys.readouterr().err == ""
        progress(1)
    printed = capsys.readouterr()
    assert re.fullmatch(r"1/13 phantom: \d+\.\d s\n", printed.err)
    assert printed.out == ""


def test_a_stage_that_is_interrupted_is_not_said_to_be_done(capsys) -> None:
    with pytest.raises(KeyboardInterrupt), _stage("1/13 phantom", 3):
        raise KeyboardInterrupt
    assert capsys.readouterr().err == ""


def test_on_a_terminal_a_stage_is_a_bar_and_no_line(capsys, monkeypatch) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with _stage("1/13 phantom", 3) as progress:
        progress(1)
    said = capsys.readouterr().err
    assert "1/13 phantom" in said
    assert not said.endswith("s\n")
