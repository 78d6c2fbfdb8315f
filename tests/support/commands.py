"""Commands as a user starts them, and a limit on how long a test waits for their
output.
"""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from analytic_frames import SMALL_LIBRARY
from small_models import write_fixed_reader
from small_recordings import calibration_of_mine
from waiting import FUSE_S, ends

from scleraforce.front.cli.main import run


def said(capsys: pytest.CaptureFixture[str], *words: object, code: int = 0) -> str:
    """Return the standard output of a command, or its standard error if it fails."""
    assert run([str(word) for word in words]) == code
    printed = capsys.readouterr()
    return printed.err if code else printed.out


BINS = 64
BIN = 20


def monitor_folder(folder: Path) -> Path:
    """A reader whose network always answers the same small force, and whose fit reads;
    a calibration of one eye.
    """
    write_fixed_reader(
        folder / "reader",
        SMALL_LIBRARY,
        [float(number == BIN) for number in range(BINS)],
    )
    (folder / "calibration.json").write_text(calibration_of_mine())
    return folder


def program(folder: Path) -> Path:
    """A program as an installation makes it: the current folder is not where its
    modules come from.
    """
    found = folder / "scleraforce-program"
    found.write_text(
        "from scleraforce.front.cli.main import main\n\nif __name__ == '__main__':\n   "
        " main()\n"
    )
    return found


@dataclass
class Started:
    process: subprocess.Popen[str]
    port: int
    token: str
    lines: list[str]


PACED = Path(__file__).with_name("paced_monitor.py")


@contextmanager
def started(
    folder: Path, *options: str, here: Path | None = None, script: Path | None = None
) -> Iterator[Started]:
    """Start the command, or a script in its place, and wait until it listens; Ctrl-C
    ends it.
    """
    command = [
        sys.executable,
        str(script or program(folder)),
        "monitor",
        str(folder / "reader"),
        "--port",
        "0",
        "--json",
    ]
    process = subprocess.Popen(
        [*command, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=here,
    )
    assert process.stderr

    with ends(process.stderr):
        lines: list[str] = []
        while not lines or not lines[-1].startswith("reset"):
            lines.append(process.stderr.readline())
            assert lines[-1], lines

        words = lines[-1].split()
        monitor = Started(
            process, int(words[words.index("--port") + 1]), words[-1], lines
        )

        try:
            yield monitor
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            process.wait(FUSE_S)
            process.stderr.close()
            if process.stdout:
                process.stdout.close()
