"""`doctor` prints what was found; where anything has failed, the exit code is 1."""

import json

import pytest

from scleraforce import installation
from scleraforce.cli.main import run
from scleraforce.installation import Finding

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
