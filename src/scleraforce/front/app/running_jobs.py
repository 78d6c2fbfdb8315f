"""Jobs that run in processes of their own: their progress, their end, and their
results, which are kept.
"""

import atexit
import os
import pickle
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from subprocess import DEVNULL, Popen
from threading import Thread, Timer
from typing import Any

from scleraforce.base.errors import InputError
from scleraforce.base.kept_results import keep_result
from scleraforce.front.api.reading_frames import utc_now
from scleraforce.front.app.asked_jobs import CommandWords, command_line, command_of
from scleraforce.front.app.job_messages import (
    EvaluateJob,
    Failed,
    Finished,
    FromWorker,
    Job,
    Noted,
    Progressed,
)

# -P: modules in the working directory, the folder of data, are not imported.
WORKER = (sys.executable, "-P", "-m", "scleraforce.front.app.job_worker")
INTERRUPTED = 130  # exit code of a worker that was interrupted
KILL_S = 10.0  # after an interruption that does not end it
TICK_S = 0.1  # between looks whether a silent worker is alive
STOPPED = "stopped"


@dataclass
class RunningJob:
    """A job that runs, or has run: title and progress of its part, notes; at the end
    its fault, if any.

    Its result is written to `kept`, with the command, the time, and the rows, model,
    calibration and recordings of an evaluation.
    """

    job: Job
    line: str
    kept: Path
    spelled: CommandWords
    title: str = ""
    share: float = 0.0
    notes: list[str] = field(default_factory=list)
    fault: str | None = None
    done: bool = False
    stopping: bool = False
    _process: "Popen[bytes] | None" = field(default=None, repr=False)

    @classmethod
    def started(
        cls,
        job: Job,
        words: Sequence[str],
        folder: Path,
        kept: Path,
        spelled: CommandWords,
    ) -> "RunningJob":
        """Start the worker of a job in a folder; it is interrupted when this process
        ends. `words` are those of its command.
        """
        running = cls(job, command_line(words), kept, spelled)
        ours, theirs = Pipe()

        try:
            running._process = Popen(
                [*WORKER, str(theirs.fileno())],
                cwd=folder,
                stdin=DEVNULL,
                stdout=DEVNULL,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        except OSError:
            ours.close()
            raise
        finally:
            theirs.close()

        atexit.register(running.cancel)
        listener = Thread(
            target=running._follow, args=(running._process, ours), daemon=True
        )
        listener.start()
        return running

    def cancel(self) -> None:
        """Interrupt it as Ctrl-C does: nothing is left half-written. It is killed if it
        does not end.
        """
        process = self._process
        if process is None or self.done or self.stopping:
            return

        self.stopping = True
        _signal(process, signal.SIGINT)
        killer = Timer(KILL_S, self._kill)
        killer.daemon = True
        killer.start()

    def _kill(self) -> None:
        """Kill the worker and what it started, unless it has ended: its number may be
        another process's then.
        """
        if self._process is not None and not self.done:
            _signal(self._process, signal.SIGKILL)

    def as_json(self) -> dict[str, Any]:
        """Return what the page shows, without the result, which may be large."""
        return {
            "command": self.line,
            "title": self.title,
            "share": self.share,
            "notes": list(self.notes),
            "done": self.done,
            "fault": self.fault,
        }

    def _follow(self, process: "Popen[bytes]", connection: Connection) -> None:
        """Take the worker's messages until it ends, and note how it did."""
        end: Finished | Failed | None = None
        with connection:
            # a worker that dies before it takes the job, leaves the pipe broken
            with suppress(OSError):
                connection.send((self.job, self.spelled))
            while (message := _next(connection, process)) is not None:
                if isinstance(message, Progressed):
                    self.title = message.title
                    self.share = message.done / max(message.total, 1)
                elif isinstance(message, Noted):
                    self.notes.append(self._worded(message.words))
                else:
                    end = message

        code = process.wait()
        self._kill()  # what it may have started
        self.fault = self._fault(end, code)
        self.done = True

    def _fault(self, end: Finished | Failed | None, code: int) -> str | None:
        """Return why there is no result; None once it is kept."""
        if isinstance(end, Finished):
            return self._keep(end)
        if self.stopping or code in (INTERRUPTED, -signal.SIGINT):
            return STOPPED
        if isinstance(end, Failed):
            return self.spelled.fault(end.words, command_of(self.job))

        return f"{command_of(self.job)}: {_death(code)}"

    def _keep(self, end: Finished) -> str | None:
        """Write the result; return why that failed."""
        ended = {
            "command": self.line,
            "time_utc": utc_now(),
            "result": self._worded(end.result),
        }
        if isinstance(self.job, EvaluateJob):
            ended["rows"] = self._worded(end.rows)
            ended["model"] = self.job.model
            ended["calibration"] = self.job.calibration
            ended["recordings"] = list(self.job.recordings)

        try:
            self.kept.parent.mkdir(exist_ok=True)
            keep_result(ended, self.kept)
        except (OSError, InputError, ValueError) as fault:
            return str(fault)

        return None

    def _worded(self, found: Any) -> Any:
        return self.spelled.worded(found, command_of(self.job))


def _next(connection: Connection, process: "Popen[bytes]") -> FromWorker | None:
    """Return the next message of a worker; None once it sends no more."""
    try:
        while not connection.poll(TICK_S):
            if process.poll() is not None and not connection.poll():
                return None
        message: FromWorker = connection.recv()
    except (EOFError, OSError, pickle.UnpicklingError):  # it ended, maybe in a message
        return None
    return message


def _death(code: int) -> str:
    """Return why a worker ended that said nothing."""
    if code >= 0:
        return f"its process ended with exit code {code}, without a result"
    name = signal.Signals(-code).name
    if -code == signal.SIGKILL:
        return (
            f"its process was killed ({name}), as systems do where memory runs out;"
            " free some, or give fewer recordings at once"
        )
    return f"its process crashed ({name}); run the command in a terminal to see more"


def _signal(process: "Popen[bytes]", number: int) -> None:
    """Send a signal to a worker and the processes that it started."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, number)
