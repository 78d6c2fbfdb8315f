"""`doctor` and `reproduce`: findings and their exit code; intervals, and progress with and without a terminal."""

import re

import pytest

from scleraforce import installation
from scleraforce.cli.first import _stage
from scleraforce.installation import Finding

FOUND = [
    Finding("packages", "ok", "numpy 2.4.6"),
    Finding("extra [train]", "missing", "no torch", "pip install 'scleraforce[train]'"),
]


def find(monkeypatch: pytest.MonkeyPatch, found: list[Finding]) -> None:
    for name, value in {"packages": lambda: found, "machine": list, "TRIALS": ()}.items():
        monkeypatch.setattr(installation, name, value)


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
