"""Commands of scleraforce that the app runs, each in its own process, with its progress
bar and its result.

The page shows the same command lines, so that every step can be repeated without the
app.
"""

import atexit
import json
import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread
from typing import Any

from scleraforce.base.errors import InputError
from scleraforce.base.kept_results import keep_result
from scleraforce.front.api.reading_frames import utc_now

try:
    from pty import openpty
except ImportError:  # Windows has none: no progress is shown
    from os import pipe as openpty


# -P: modules in the working directory, the folder of data, are not imported.
COMMAND = (
    sys.executable,
    "-P",
    "-c",
    "from scleraforce.front.cli.main import main; main()",
)
BAR = re.compile(r"([A-Za-z ]+): +(\d+)%")  # tqdm's
INTERRUPTED = 130
KEPT = 4096  # last characters of a command's standard error
BYTES = 65536


@dataclass(frozen=True)
class CommandWords:
    """The command line's spelling of fields, which the command `app` hands down."""

    flag_of: Callable[[str], str]  # of a field
    worded: Callable[[Any], Any]  # puts flags in place of fields in texts of JSON


def command_line(words: Sequence[str]) -> str:
    """Return the command line that a user would type.

    >>> command_line(["show", "my scan.tif"])
    "scleraforce show 'my scan.tif'"
    """
    return shlex.join(["scleraforce", *words])


@dataclass
class Job:
    """A command that runs, or has run: title and share of its progress bar; at the end
    its fault, if any.

    Its result is written to `kept`, with the command and the time.
    """

    words: tuple[str, ...]
    kept: Path
    title: str = ""
    share: float = 0.0
    fault: str | None = None
    done: bool = False
    _process: "subprocess.Popen[bytes] | None" = field(default=None, repr=False)

    @classmethod
    def started(
        cls, words: Sequence[str], folder: Path, kept: Path, json_flag: str
    ) -> "Job":
        """Start a command in a folder; it is interrupted when this process ends.

        `json_flag` makes it print its result as JSON.
        """
        job = cls(tuple(words), kept)
        ours, theirs = openpty()  # progress bars are drawn for a terminal only

        try:
            job._process = subprocess.Popen(
                [*COMMAND, *words, json_flag],
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=theirs,
                start_new_session=True,
            )
        except OSError:
            os.close(ours)
            raise
        finally:
            os.close(theirs)

        atexit.register(job.cancel)
        Thread(target=job._finish, args=(job._process, ours), daemon=True).start()
        return job

    def cancel(self) -> None:
        """Interrupt it as Ctrl-C does: nothing is left half-written."""
        if self._process is not None and self._process.poll() is None:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGINT)

    def as_json(self) -> dict[str, Any]:
        """Return what the page shows, without the result, which may be large."""
        state = {
            "title": self.title,
            "share": self.share,
            "done": self.done,
            "fault": self.fault,
        }
        return {"command": command_line(self.words), **state}

    def _finish(self, process: "subprocess.Popen[bytes]", terminal: int) -> None:
        listener = Thread(target=self._listen, args=(terminal,), daemon=True)
        listener.start()
        printed = process.communicate()[0]
        listener.join()

        if code := process.returncode:
            self.fault = (
                "stopped"
                if code in (INTERRUPTED, -signal.SIGINT)
                else self.fault or f"exit code {code}"
            )
        else:
            self.fault = self._keep(printed)

        self.done = True

    def _keep(self, printed: bytes) -> str | None:
        """Write the result; return why that failed."""
        try:
            ended = {
                "command": command_line(self.words),
                "time_utc": utc_now(),
                "result": json.loads(printed),
            }
            self.kept.parent.mkdir(exist_ok=True)
            keep_result(ended, self.kept)
        except (OSError, InputError, ValueError) as fault:
            return str(fault)

        return None

    def _listen(self, terminal: int) -> None:
        text = ""
        while data := _read(terminal):
            text = (text + data.decode(errors="replace"))[-KEPT:]
            if bars := BAR.findall(text):
                self.title = bars[-1][0].strip()
                self.share = float(f"{bars[-1][1]}e-2")

        os.close(terminal)
        self.fault = (re.findall(r"^error: (.*?)\r?$", text, re.MULTILINE) or [None])[
            -1
        ]


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, BYTES)
    except OSError:  # the command has closed its end
        return b""
