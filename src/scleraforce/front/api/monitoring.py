"""A monitor for tests of a user's own robot: the command, in a process of its own, for
the time of a block.
"""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from typing import IO, Any

from scleraforce.base.errors import InputError
from scleraforce.live.network.operator_reset import ask_reset
from scleraforce.reading.reading_models import Reader
from scleraforce.records.model_folder import model_folder, model_name
from scleraforce.records.scan import Plane

# -P: no module of this folder. The child turns fields into the command's words.
COMMAND = (
    sys.executable,
    "-P",
    "-c",
    "from scleraforce.front.cli.monitor_child import main; main()",
)
END_S = 30.0  # for the black box to write its last entries
LAST_LINES_S = 1.0


@dataclass(kw_only=True)
class RunningMonitor:
    """A monitor's OpenIGTLink address and the token of its reset; `lines` are what its
    operator sees.

    `summary` has the frames and withdrawals of the session, once the monitor has ended.
    """

    host: str = "127.0.0.1"
    port: int = 0
    token: str = field(default="", repr=False)
    lines: list[str] = field(default_factory=list, repr=False)
    summary: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def reset(self) -> tuple[bool, str]:
        """Ask for the end of a withdrawal; return whether it is granted, and why."""
        return ask_reset(self.host, self.port, self.token)


@contextmanager
def monitor(
    model: Reader | str | PathLike[str] = "default",
    *,
    calibration: str | PathLike[str] | None = None,
    eye: str | None = None,
    youngs_modulus_pa: float | None = None,
    iop_pa: float | None = None,
    thickness_m: float | None = None,
    gap_m: float | None = None,
    globe: str | None = None,
    rigidity_pa13_per_m3: float | None = None,
    planes: Sequence[Plane] = (),
    second_opinion: bool = True,
    record: str | PathLike[str] | None = None,
    black_box: str | PathLike[str] | None = None,
) -> Iterator[RunningMonitor]:
    """Run a monitor on a free port of this machine while the block lasts. Linux only.

    Args:
        model: a reader, or the name or path of one.
        calibration: file of `calibrate`, with the name of the `eye`.
        eye: its name.
        youngs_modulus_pa: of this eye, in place of a calibration.
        iop_pa: intraocular pressure.
        thickness_m: of the wall.
        gap_m: distance of the B-scan plane from the needle axis.
        globe: "open" or "sealed".
        rigidity_pa13_per_m3: of a sealed globe.
        planes: of a scanner that takes several at once.
        second_opinion: read the frames with the fit as well, in another process.
        record: recording folder to write the session to; must not exist.
        black_box: folder of the log; None: a temporary one.

    Raises:
        InputError: the monitor does not start; the message is the command's.

    >>> import scleraforce as sf
    >>> known = {"youngs_modulus_pa": 0.3e6, "globe": "open"}
    >>> with sf.monitor("default", second_opinion=False, **known) as running:
    ...     print(running.host, running.port > 0)
    127.0.0.1 True
    >>> running.summary["frames"]
    0
    """
    path = model.path if isinstance(model, Reader) else model_folder(model)
    fields: dict[str, Any] = {
        "youngs_modulus_pa": youngs_modulus_pa,
        "iop_pa": iop_pa,
        "thickness_m": thickness_m,
        "gap_m": gap_m,
        "rigidity_pa13_per_m3": rigidity_pa13_per_m3,
        "calibration": calibration,
        "eye": eye,
        "globe": globe,
        "record": record,
        "planes": [
            (plane.name, plane.offset_m, plane.direction_rad) for plane in planes
        ],
        "second_opinion": second_opinion,
    }
    # the black box of a monitor that died may still write there
    with TemporaryDirectory(
        prefix="scleraforce-", ignore_cleanup_errors=True
    ) as folder:
        fields["black_box"] = black_box or Path(folder) / "black-box"
        process = subprocess.Popen(
            [*COMMAND, model_name(path), json.dumps(fields, default=str)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

        running = RunningMonitor()
        listener = None
        try:
            listener = _await_start(process, running)
            yield running
        finally:
            running.summary = _ended(process)
            _hear_out(process, listener)


def _await_start(process: "subprocess.Popen[str]", running: RunningMonitor) -> Thread:
    """Read the operator's lines until the last one of the start; return the thread that
    reads the others, so that the pipe never fills.
    """
    assert process.stderr is not None
    for line in process.stderr:
        running.lines.append(line.rstrip())
        name, *words = line.split()
        if name == "listens":
            running.port = int(words[1].rpartition(":")[2])
        if name == "reset":
            running.token = words[-1]
            listener = Thread(
                target=_listen, args=(process.stderr, running.lines), daemon=True
            )
            listener.start()
            return listener

    raise InputError(
        running.lines[-1].removeprefix("error: ")
        if running.lines
        else "monitor: it ended at its start"
    )


def _listen(said: IO[str], lines: list[str]) -> None:
    with said:
        lines.extend(map(str.rstrip, said))


def _ended(process: "subprocess.Popen[str]") -> Mapping[str, Any]:
    """End the monitor as Ctrl-C does and return its summary; one that does not end in
    time is killed.
    """
    if process.poll() is None:
        process.send_signal(signal.SIGINT)

    try:
        process.wait(END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()

    assert process.stdout is not None
    with process.stdout:
        text = process.stdout.read()
    summary: dict[str, Any] = json.loads(text) if text else {}
    return summary


def _hear_out(process: "subprocess.Popen[str]", listener: Thread | None) -> None:
    """Wait for the last lines of a monitor that has ended.

    Where it died, its watchdog and its black box may hold the pipe for long: until the
    last client has left, and until the last frames are written.
    """
    if listener is not None:
        listener.join(LAST_LINES_S)
    elif process.stderr is not None:
        process.stderr.close()
