"""`scleraforce reproduce`: what it says on standard error where no progress bar can be."""

import re
import sys

import pytest

from scleraforce.cli.reproduce import _stage


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
