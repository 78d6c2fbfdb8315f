"""Commands of scleraforce that the app runs, each in a process of its own, with its bar and its JSON.

The page shows the same words, so what it does can be done without it.
"""

import json
import os
import pty
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread
from typing import Any

COMMAND = (sys.executable, "-c", "from scleraforce.cli.main import main; main()")
BAR = re.compile(r"([A-Za-z ]+): +(\d+)%")  # tqdm's
INTERRUPTED = 130
KEPT = 4096  # last characters of a command's standard error
BYTES = 65536


def shown(words: Sequence[str]) -> str:
    """Return the command line that a user would type.

    >>> shown(["import", "my scan.tif", "--out", "eye-a"])
    "scleraforce import 'my scan.tif' --out eye-a"
    """
    return shlex.join(["scleraforce", *words])


@dataclass
class Job:
    """A command that runs, or has run: the title and the share of its bar, at the end its JSON or its fault."""

    words: tuple[str, ...]
    title: str = ""
    share: float = 0.0
    result: Any = None
    fault: str | None = None
    done: bool = False
    _process: "subprocess.Popen[bytes] | None" = field(default=None, repr=False)

    @classmethod
    def started(cls, words: Sequence[str], folder: Path) -> "Job":
        """Start a command in a folder."""
        job = cls(tuple(words))
        ours, theirs = pty.openpty()  # a bar is drawn for a terminal alone
        job._process = subprocess.Popen([*COMMAND, *words, "--json"], cwd=folder, stdin=subprocess.DEVNULL,
                                        stdout=subprocess.PIPE, stderr=theirs, start_new_session=True)  # fmt: skip
        os.close(theirs)
        Thread(target=job._finish, args=(ours,), daemon=True).start()
        return job

    def cancel(self) -> None:
        """Interrupt it as Ctrl-C does: nothing is left half-written."""
        if self._process is not None and self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGINT)

    def as_json(self) -> dict[str, Any]:
        """Return what the page shows."""
        state = {"title": self.title, "share": self.share, "done": self.done, "fault": self.fault}
        return {"command": shown(self.words), **state, "result": self.result if self.done else None}

    def _finish(self, terminal: int) -> None:
        process = self._process
        assert process is not None
        assert process.stdout is not None
        listener = Thread(target=self._listen, args=(terminal,), daemon=True)
        listener.start()
        with process.stdout as pipe:
            printed = pipe.read()
        code = process.wait()
        listener.join()
        try:
            self.result = json.loads(printed) if printed else None
        except ValueError:
            self.fault = f"{shown(self.words)}: printed no JSON"
        if code:
            self.fault = "stopped" if code in (INTERRUPTED, -signal.SIGINT) else self.fault or f"exit code {code}"
        self.done = True

    def _listen(self, terminal: int) -> None:
        text = ""
        while data := _read(terminal):
            text = (text + data.decode(errors="replace"))[-KEPT:]
            if bars := BAR.findall(text):
                self.title, self.share = bars[-1][0].strip(), float(f"{bars[-1][1]}e-2")
        os.close(terminal)
        faults = re.findall(r"^error: (.*?)\r?$", text, re.MULTILINE)
        self.fault = faults[-1] if faults else None


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, BYTES)
    except OSError:  # all of its other side's descriptors are closed
        return b""
