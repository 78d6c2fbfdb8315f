"""Commands of `scleraforce`, run in the process of the test."""

import json
from collections.abc import Sequence
from shlex import split
from typing import Any

import pytest

from scleraforce.front.cli.main import run


class Shell:
    """Runs commands. Their words are given as they are typed, in one text or in
    several; paths and numbers are words of their own.
    """

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def run(self, *words: object, code: int | Sequence[int] = 0) -> tuple[str, str]:
        """Run a command that ends with this exit code; return its output and its
        errors.
        """
        typed = list[str]()
        for word in words:
            typed += split(word) if isinstance(word, str) else [str(word)]

        self._capsys.readouterr()
        found = run(typed)
        out, err = self._capsys.readouterr()
        assert found in ((code,) if isinstance(code, int) else code), err
        return out, err

    def json(self, *words: object, code: int = 0) -> dict[str, Any]:
        """Run a command with --json; return its object."""
        return json.loads(self.run(*words, "--json", code=code)[0])

    def text(self, *words: object) -> str:
        """Return the output of a command, its lines joined."""
        return " ".join(self.run(*words)[0].split())

    def refused(self, *words: object, codes: Sequence[int] = (2,)) -> str:
        """Run a command that ends with one of these exit codes and one line of error;
        return the line.
        """
        out, err = self.run(*words, code=codes)
        assert (out, err.count("\n")) == ("", 1)
        assert err.startswith("error: ")
        return err


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the picture of an imported recording: it takes most of the time."""
    report = "scleraforce.front.report"
    monkeypatch.setattr(f"{report}.recording_figures.draw_recording", lambda _: None)
    monkeypatch.setattr(f"{report}.figure_files.write_figure", lambda *_: None)


@pytest.fixture
def shell(capsys: pytest.CaptureFixture[str]) -> Shell:
    return Shell(capsys)
