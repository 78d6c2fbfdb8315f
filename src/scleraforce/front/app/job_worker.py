"""The process of one job: it calls the public functions in the app's folder, and
reports to the app.

`python -P -m scleraforce.front.app.job_worker DESCRIPTOR`; the descriptor is of its end
of the connection. An interruption (SIGINT or SIGTERM) ends it as Ctrl-C ends a command:
nothing is left half-written. It does not outlive the app, whose end closes the
connection.
"""

import logging
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Thread
from time import sleep

from scleraforce.base.errors import ScleraforceError
from scleraforce.base.foreign_settings import leave_unread
from scleraforce.base.plain_json import finite_json
from scleraforce.base.units import to_si
from scleraforce.front.api.calibrating import CalibrationMethod, calibrate
from scleraforce.front.api.importing import (
    ImportRequest,
    import_result,
    write_imported,
)
from scleraforce.front.api.progress import Bars, Counting
from scleraforce.front.api.reading_frames import evaluate, load_model
from scleraforce.front.app.asked_jobs import command_of
from scleraforce.front.app.job_messages import (
    CalibrateJob,
    EvaluateJob,
    Failed,
    Finished,
    FromWorker,
    ImportJob,
    Job,
    Noted,
    Progressed,
)
from scleraforce.front.app.source_views import given_answers
from scleraforce.recordings.import_sources import OPTION
from scleraforce.records.eye import Eye

INTERRUPTED = 130  # exit code, as of a command after Ctrl-C
END_S = 5.0  # to clean up, after the app has gone

Send = Callable[[FromWorker], object]
Worded = Callable[[str], str]  # puts flags in place of fields


def finished(job: Job, send: Send, worded: Worded) -> Finished:
    """Do a job in the current folder and return its result; `send` gets its progress.

    Raises:
        ScleraforceError: as the public functions do.
    """
    if isinstance(job, ImportJob):
        return _imported(job, send)
    if isinstance(job, CalibrateJob):
        return _calibrated(job, send)
    return _evaluated(job, send, worded)


def _imported(job: ImportJob, send: Send) -> Finished:
    request = ImportRequest(
        sources=[Path(source) for source in job.sources],
        out=Path(job.out),
        answers=job.options,
        origins=dict.fromkeys(given_answers(job.options), OPTION),
        planes=job.planes,
    )
    done = write_imported(request, _counting(send))

    return Finished(finite_json(import_result(done, request.out)))


def _calibrated(job: CalibrateJob, send: Send) -> Finished:
    notes = list[str]()

    def note(sentence: str) -> None:
        notes.append(sentence)
        send(Noted(sentence))

    found = calibrate(
        job.recordings,
        frames=job.frames,
        method=CalibrationMethod(
            parameters=job.parameters,
            without_force=job.without_force,
            prior=job.calibration,
        ),
        eye=Eye(thickness_m=to_si(job.thickness_um, "um")),
        out=job.out,
        note=note,
        progress=Bars(_counting(send)),
    )

    return Finished(finite_json({**found.to_dict(), "notes": notes}))


def _evaluated(job: EvaluateJob, send: Send, worded: Worded) -> Finished:
    found = evaluate(
        load_model(job.model),
        job.recordings,
        job.calibration,
        progress=Bars(_counting(send)),
    )

    if job.html is not None:
        # 790 ms: Matplotlib, not without a page
        from scleraforce.front.report.evaluation_page import write_answers_page

        write_answers_page(found, Path(job.html), worded)

    return Finished(found.to_dict(), tuple(found.rows()))


def _counting(send: Send) -> Counting:
    """Return a counting that sends each step."""

    @contextmanager
    def counting(title: str, total: int) -> Iterator[Callable[[int], None]]:
        done = 0
        send(Progressed(title, done, total))

        def advance(count: int) -> None:
            nonlocal done
            done += count
            send(Progressed(title, done, total))

        yield advance

    return counting


def fault_words(fault: Exception) -> str:
    """Return a fault in one line, as commands print it.

    >>> fault_words(OSError(28, "No space left on device"))
    'No space left on device'
    """
    if isinstance(fault, ScleraforceError):
        return str(fault)
    if isinstance(fault, MemoryError):
        return "not enough memory; free some, or give fewer recordings at once"
    if isinstance(fault, OSError) and fault.strerror:
        parts = (fault.filename, fault.strerror)
        return ": ".join(str(part) for part in parts if part)
    return f"internal fault: {type(fault).__name__}: {fault}"


class _Interruption:
    """The handler of signals: the first one interrupts the work; others would interrupt
    the cleaning up.
    """

    def __init__(self) -> None:
        self.came = False

    def __call__(self, *_: object) -> None:
        if not self.came:
            self.came = True
            raise KeyboardInterrupt


def _end_with_app(connection: Connection) -> None:
    """Interrupt this process and those that it started when the app closes its end of
    the connection, or dies; kill them if they do not end.
    """
    try:
        connection.recv_bytes()  # nothing comes: it waits for the end
    except (EOFError, OSError):
        os.killpg(0, signal.SIGINT)
        sleep(END_S)
        os.killpg(0, signal.SIGKILL)


def main() -> int:
    """Do the job that the app sends; return the exit code."""
    interruption = _Interruption()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interruption)

    os.environ.pop("MPLBACKEND", None)  # as for commands (front.cli.main)
    leave_unread("matplotlib")
    descriptor = int(sys.argv[1])
    os.set_inheritable(descriptor, False)
    connection = Connection(descriptor)

    try:
        job, words = connection.recv()
        Thread(target=_end_with_app, args=(connection,), daemon=True).start()
        worded = partial(words.worded, command=command_of(job))
        connection.send(finished(job, connection.send, worded))
    except (KeyboardInterrupt, EOFError):
        return _interrupted()
    except Exception as fault:
        if interruption.came:  # a library's callback could not pass it on
            return _interrupted()
        connection.send(Failed(fault_words(fault)))
        return 1

    return 0


def _interrupted() -> int:
    logging.getLogger("asyncio").disabled = True  # zarr's loop would report its tasks
    return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
