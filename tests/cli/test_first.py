"""`doctor` and `reproduce`: findings and their exit code; intervals, and progress with and without a terminal."""

import re
import sys

import pytest
from small_recordings import frame_answer

from scleraforce import installation
from scleraforce.cli.first import _coverage_words, _stage
from scleraforce.installation import Finding
from scleraforce.reader.evaluate import Evaluation

FOUND = [
    Finding("packages", "ok", "numpy 2.4.6"),
    Finding("extra [train]", "missing", "no torch", "pip install 'scleraforce[train]'"),
]


def find(monkeypatch: pytest.MonkeyPatch, found: list[Finding]) -> None:
    for name, value in {"packages": lambda: found, "machine": list, "TRIALS": ()}.items():
        monkeypatch.setattr(installation, name, value)


def test_doctor_prints_a_line_for_each_finding_and_its_remedy(monkeypatch: pytest.MonkeyPatch, shell) -> None:
    find(monkeypatch, FOUND)
    head, *lines = shell.run("doctor")[0].splitlines()
    assert head.startswith("scleraforce ")
    assert lines == [
        "ok       packages        numpy 2.4.6",
        "missing  extra [train]   no torch",
        "                         -> pip install 'scleraforce[train]'",
    ]


def test_a_failed_finding_ends_doctor_with_code_1(monkeypatch: pytest.MonkeyPatch, shell) -> None:
    find(monkeypatch, [*FOUND, Finding("a solve", "failed", "wrong", "report")])
    result = shell.json("doctor", code=1)
    assert not result["ok"]
    assert result["findings"][-1] == {"name": "a solve", "state": "failed", "found": "wrong", "remedy": "report"}
    assert {"scleraforce", "python", "system", "seconds"} <= result.keys()


@pytest.mark.slow
def test_this_installation_is_well(shell) -> None:
    states = {finding["name"]: finding["state"] for finding in shell.json("doctor")["findings"]}
    assert states["packages"] == states["a solve"] == states["a reading"] == "ok"


def test_intervals_are_counted_against_the_log_and_against_the_truth() -> None:
    """Two frames are read 0.5 mN off the truth, the log is 2 mN off; intervals of 1 mN to either side."""
    frames = tuple(
        frame_answer(
            measured_force_n=1e-3 * (force_mn + 2.0),
            true_force_n=1e-3 * force_mn,
            force_n=1e-3 * (force_mn + 0.5),
            interval_n=(1e-3 * (force_mn - 0.5), 1e-3 * (force_mn + 1.5)),
        )
        for force_mn in (10.0, 20.0)
    )
    evaluation = Evaluation(model="reader", bounds_n=(5e-3, 30e-3), max_force_n=60e-3, youngs_modulus_pa=0.25e6,
                            frames=frames, kind="reader")  # fmt: skip
    words = _coverage_words(evaluation)
    assert "hold 2 of 2 true forces: 2 of 2 of eye; they agree with 0 of 2 labels" in words


def test_a_stage_is_a_line_with_its_time_in_a_pipe_unless_it_is_interrupted(capsys) -> None:
    with _stage("1/13 phantom", 3) as progress:
        progress(2)
        assert capsys.readouterr().err == ""
        progress(1)
    printed = capsys.readouterr()
    assert re.fullmatch(r"1/13 phantom: \d+\.\d s\n", printed.err)
    assert printed.out == ""
    with pytest.raises(KeyboardInterrupt), _stage("1/13 phantom", 3):
        raise KeyboardInterrupt
    assert capsys.readouterr().err == ""


def test_a_stage_is_a_bar_on_a_terminal(capsys, monkeypatch) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with _stage("1/13 phantom", 3) as progress:
        progress(1)
    said = capsys.readouterr().err
    assert "1/13 phantom" in said
    assert not said.endswith("s\n")
