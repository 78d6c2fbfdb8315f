"""A monitor for tests of a user's own robot: the service of the command, in a process
of its own, for the time of a block.
"""

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, Pipe
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from typing import Any, Unpack

from scleraforce.base.errors import InputError, LinkError
from scleraforce.base.worker_processes import one_thread
from scleraforce.front.api.shorthand import SetupShorthand, declared_setup
from scleraforce.live.monitor_process import refuse_other_systems
from scleraforce.live.monitor_request import (
    LOCAL,
    Address,
    Ended,
    Failed,
    MonitorMessage,
    MonitorRequest,
    OperatorLine,
    Refused,
    Started,
)
from scleraforce.live.network.operator_reset import ask_reset
from scleraforce.reading.reading_models import Reader
from scleraforce.records.eye import Eye
from scleraforce.records.model_folder import model_folder
from scleraforce.records.needle import Needle
from scleraforce.records.remark import Remark
from scleraforce.records.scan import Scan

# -P: no module of this folder
COMMAND = (
    sys.executable,
    "-P",
    "-c",
    "from scleraforce.front.api.monitor_child import main; main()",
)
END_S = 30.0  # for the black box to write its last entries
LAST_MESSAGES_S = 1.0


@dataclass(kw_only=True)
class RunningMonitor:
    """A monitor's OpenIGTLink address and the token of its reset.

    `lines` are what the operator of a command would read, with fields of records in
    backquotes in place of options; `remarks` are the warnings among them, as data.
    `summary` has the frames and withdrawals of the session, once the monitor has ended;
    it stays empty where the monitor died.
    """

    host: str = LOCAL
    port: int = 0
    token: str = field(default="", repr=False)
    lines: list[str] = field(default_factory=list, repr=False)
    remarks: list[Remark] = field(default_factory=list, repr=False)
    summary: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def reset(self) -> tuple[bool, str]:
        """Ask for the end of a withdrawal; return whether it is granted, and why."""
        return ask_reset(self.host, self.port, self.token)

    def _take(self, message: MonitorMessage) -> None:
        match message:
            case OperatorLine(text):
                self.lines.append(text)
            case Started():
                self.host = message.host
                self.port = message.port
                self.token = message.token
                self.remarks.extend(message.remarks)
            case Refused(words) | Failed(words):
                self.lines.append(words)
            case Ended(summary):
                self.summary = summary


@contextmanager
def monitor(
    model: Reader | str | PathLike[str] = "default",
    *,
    eye: Eye | str | None = None,
    needle: Needle | None = None,
    scan: Scan | None = None,
    calibration: str | PathLike[str] | None = None,
    second_opinion: bool = True,
    record: str | PathLike[str] | None = None,
    black_box: str | PathLike[str] | None = None,
    **short: Unpack[SetupShorthand],
) -> Iterator[RunningMonitor]:
    """Run a monitor on a free port of this machine while the block lasts. Linux only.

    Args:
        model: a reader, or the name or path of one.
        eye: what is known of the eye, or its name in the calibration; without a second
            opinion no radius.
        needle: its gap from the B-scan, the place of its contact, its lean.
        scan: the frames that the scanner will send; None: those of the model's study.
        calibration: file of `calibrate`: gives the eye's modulus, or the population's.
        second_opinion: read the frames with the fit as well, in another process.
        record: recording folder to write the session to; must not exist.
        black_box: folder of the log; None: a temporary one.
        short: `iop_pa`, `thickness_m`, `youngs_modulus_pa`, `globe`, `gap_m`,
            `width_m`, `depth_m`, `refractive_index`, in place of records.

    Raises:
        InputError: a value is stated that a monitor does not use, or the monitor
            refuses to start, for the reasons of the command.
        LinkError: it died at its start.

    >>> import scleraforce as sf
    >>> eye = sf.Eye("eye-a", modulus=sf.Modulus.stated(0.3e6))
    >>> with sf.monitor("default", eye=eye, second_opinion=False) as running:
    ...     print(running.host, running.port > 0)
    127.0.0.1 True
    >>> running.summary["frames"]
    0
    """
    refuse_other_systems()
    setup = declared_setup(eye, needle, scan, short)
    # the black box of a monitor that died may still write there
    with TemporaryDirectory(
        prefix="scleraforce-", ignore_cleanup_errors=True
    ) as folder:
        request = MonitorRequest(
            model=model.path if isinstance(model, Reader) else model_folder(model),
            setup=setup,
            calibration=None if calibration is None else Path(calibration),
            address=Address(LOCAL, 0),
            black_box=Path(black_box or Path(folder) / "black-box"),
            record=None if record is None else Path(record),
            second_opinion=second_opinion,
        )
        link, process = _start(request)
        running = RunningMonitor()
        listener = Thread(target=_listen, args=(link, running), daemon=True)
        try:
            _await_start(link, process, running)
            listener.start()
            yield running
        finally:
            _end(link, process)
            if listener.ident is not None:
                listener.join(LAST_MESSAGES_S)
            link.close()


def _start(request: MonitorRequest) -> tuple[Connection, "subprocess.Popen[bytes]"]:
    """Start the process of a monitor, and tell it what is asked for."""
    link, theirs = Pipe()
    with theirs, one_thread():
        process = subprocess.Popen(
            [*COMMAND, str(theirs.fileno()), str(os.getpid())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
            start_new_session=True,
        )

    with suppress(OSError):  # it died, which is noticed where it is heard
        link.send(request)
    return link, process


def _await_start(
    link: Connection, process: "subprocess.Popen[bytes]", running: RunningMonitor
) -> None:
    """Hear a monitor until it listens; raise what keeps it from that."""
    while True:
        try:
            message: MonitorMessage = link.recv()
        except (EOFError, OSError):
            with suppress(subprocess.TimeoutExpired):
                process.wait(END_S)
            raise LinkError(
                f"monitor: it died at its start, exit code {process.returncode}; what"
                " it wrote is on standard error"
            ) from None

        running._take(message)
        match message:
            case Started():
                return
            case Refused(words):
                raise InputError(words)
            case Failed(words):
                raise LinkError(f"monitor: it failed at its start: {words}")


def _listen(link: Connection, running: RunningMonitor) -> None:
    """Hear a monitor until it has ended, so that its pipe never fills."""
    with suppress(EOFError, OSError):
        while True:
            running._take(link.recv())


def _end(link: Connection, process: "subprocess.Popen[bytes]") -> None:
    """End the monitor as Ctrl-C does; one that does not end in time is killed."""
    with suppress(OSError):  # it has ended
        link.send(None)

    try:
        process.wait(END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
