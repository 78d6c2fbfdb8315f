"""Commands that the app runs: their progress, their faults, and their end."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from waiting import wait_until

from scleraforce.base.kept_results import kept_result
from scleraforce.front.app.running_commands import Job

Start = Callable[[str], Job]


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Start:
    def start(code: str) -> Job:
        monkeypatch.setattr(
            "scleraforce.front.app.running_commands.COMMAND",
            (sys.executable, "-c", f"import sys, time; {code}"),
        )
        return Job.started(
            ["help"], tmp_path, tmp_path / "kept" / "help.json", "--json"
        )

    return start


def test_much_standard_error_neither_blocks_nor_hides_the_last_bar(
    started: Start, tmp_path: Path
) -> None:
    job = started("print('\\rframes:  50%|' * 100_000, file=sys.stderr); print('[1]')")
    wait_until(lambda: job.done)
    assert (job.title, job.share, job.fault) == ("frames", 0.5, None)
    kept = kept_result(tmp_path / "kept" / "help.json")
    assert (kept["command"], kept["result"]) == ("scleraforce help", [1])


def test_a_result_that_cannot_be_kept_is_a_fault(
    started: Start, tmp_path: Path
) -> None:
    (tmp_path / "kept").write_text("a file in place of the folder")
    job = started("print('[1]')")
    wait_until(lambda: job.done)
    assert "kept" in (job.fault or "")


def test_a_command_is_stopped_as_by_ctrl_c(started: Start) -> None:
    job = started(
        "print('\\rframes:  10%|', file=sys.stderr, flush=True); time.sleep(600)"
    )
    wait_until(lambda: bool(job.title))
    job.cancel()
    wait_until(lambda: job.done)
    assert job.fault == "stopped"
    job.cancel()  # one that has ended already


def test_modules_in_the_folder_of_data_are_not_imported(tmp_path: Path) -> None:
    (tmp_path / "click.py").write_text("open('ran', 'w')")
    job = Job.started(["show", "nothing"], tmp_path, tmp_path / "show.json", "--json")
    wait_until(lambda: job.done)
    assert "nothing" in (job.fault or "")
    assert not (tmp_path / "ran").exists()
