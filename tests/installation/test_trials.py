"""The small runs of `doctor` find what is wrong."""

import subprocess
import sys

import pytest

from scleraforce import installation
from scleraforce.installation import TRIALS, Finding, tried


@pytest.fixture(autouse=True)
def _anew() -> None:
    installation._path.cache_clear()


@pytest.mark.parametrize("name", ["a solve", "a reading"])
def test_a_solve_and_a_reading_are_right_here(name: str) -> None:
    found = tried(name)
    assert (found.name, found.state) == (name, "ok")
    assert "mN" in found.found


def test_a_wall_that_bends_otherwise_has_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installation, "THICKNESS_M", 0.61e-3)
    right = installation._path()
    monkeypatch.setattr(installation, "THICKNESS_M", 0.6e-3)
    assert installation._path() is right  # kept from before: the solve of this trial is another wall's
    found = tried("a solve")
    assert found.state == "failed"
    assert "are right" in found.found


def test_a_force_that_is_read_wrong_has_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installation, "READ_WITHIN_N", 1e-9)
    assert tried("a reading").state == "failed"


def test_what_a_trial_raises_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> Finding:
        raise ImportError("libgomp.so.1: cannot open shared object file")

    monkeypatch.setattr(installation, "TRIALS", {"a solve": broken})
    assert tried("a solve").found == "ImportError: libgomp.so.1: cannot open shared object file"
    assert tried("a solve").state == "failed"


@pytest.mark.slow
def test_without_pytorch_training_is_missing_and_with_it_a_model_is_trained() -> None:
    script = "import sys; {block}; from scleraforce.installation import tried; print(tried('a training'))"
    states = {}
    for block in ("sys.modules['torch'] = None", "pass"):
        done = subprocess.run(
            [sys.executable, "-c", script.format(block=block)], capture_output=True, text=True, check=True
        )
        states[block] = done.stdout
    first, second = states.values()
    assert "state='missing'" in first
    assert "pip install 'scleraforce[train]'" in first
    assert "state='ok'" in second
    assert set(TRIALS) == {"a solve", "a reading", "a training"}
