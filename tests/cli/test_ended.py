"""A command that is ended from outside: by `kill`, or by the scheduler of a cluster."""

import signal
import subprocess
import sys
import time
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from foreign_files import told

from scleraforce.cli import main as entry


def test_an_import_that_is_ended_leaves_nothing(tmp_path: Path) -> None:
    many = (200, 512, 512)  # of noise: to write them takes seven times as long as to begin
    np.save(tmp_path / "a.npy", np.random.default_rng(0).integers(0, 2**16, many, np.uint16))
    told_all = told("--axes", "frame,depth,lateral", "--width-mm", 10, "--depth-mm", 4, "--bits", 16, "--rate-hz", 1)
    command = ["import", str(tmp_path / "a.npy"), "--out", str(tmp_path / "r"), *map(str, told_all)]
    code = "from scleraforce.cli.main import main; main()"
    child = subprocess.Popen([sys.executable, "-c", code, *command], stderr=subprocess.PIPE, text=True)
    while child.poll() is None and not list(tmp_path.glob(".scleraforce-*.part")):
        time.sleep(0.002)
    child.send_signal(signal.SIGTERM)
    _, error = child.communicate(timeout=300)
    assert (child.returncode, error.strip()) == (130, "error: interrupted")
    assert [path.name for path in tmp_path.iterdir()] == ["a.npy"]


def test_an_interruption_that_reaches_a_library_only_is_no_internal_fault(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def compile_(*_: object, **__: object) -> None:  # as Numba does when LLVM's callback was interrupted
        entry._note_interruption(SimpleNamespace(exc_type=KeyboardInterrupt))
        raise RuntimeError("no compiled object yet")

    monkeypatch.setattr(entry, "interrupted", Event())
    monkeypatch.setattr(entry.cli, "main", compile_)
    assert entry.run(["doctor"]) == 130
    assert capsys.readouterr().err == "error: interrupted\n"
