"""A monitor for tests of a user's own robot: the command, in a process of its own, for
the time of a block.
"""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from typing import IO, Any, Unpack

from scleraforce.base.errors import InputError
from scleraforce.front.api.shorthand import (
    SetupShorthand,
    declared_setup,
    setup_of_options,
)
from scleraforce.live.network.operator_reset import ask_reset
from scleraforce.reading.needle_lean import MOST_LEAN_RAD
from scleraforce.reading.reading_models import Reader
from scleraforce.records.eye import Eye
from scleraforce.records.model_folder import model_folder, model_name
from scleraforce.records.needle import Needle, one_lean
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup

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
        eye: what is known of the eye, or its name in the calibration.
        needle: its gap from the B-scan, the place of its contact, its lean.
        scan: the frames that the scanner will send; None: those of the model's study.
        calibration: file of `calibrate`: gives the eye's modulus, or the population's.
        second_opinion: read the frames with the fit as well, in another process.
        record: recording folder to write the session to; must not exist.
        black_box: folder of the log; None: a temporary one.
        short: `iop_pa`, `thickness_m`, `youngs_modulus_pa`, `globe`, `gap_m`,
            `width_m`, `depth_m`, `refractive_index`, in place of records.

    Raises:
        InputError: a value is stated that a monitor does not use, or the monitor does
            not start; the message is then the command's.

    >>> import scleraforce as sf
    >>> eye = sf.Eye("eye-a", modulus=sf.Modulus.stated(0.3e6))
    >>> with sf.monitor("default", eye=eye, second_opinion=False) as running:
    ...     print(running.host, running.port > 0)
    127.0.0.1 True
    >>> running.summary["frames"]
    0
    """
    path = model.path if isinstance(model, Reader) else model_folder(model)
    fields = {
        **_fields_of(declared_setup(eye, needle, scan, short)),
        "calibration": calibration,
        "record": record,
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


def _fields_of(setup: Setup) -> dict[str, Any]:
    """Return the options that declare an experiment to a monitor; raises `InputError`
    for a value that it has no option for.
    """
    eye = setup.eye
    needle = setup.needle
    scan = setup.scan
    modulus_pa = None if eye.modulus is None else eye.modulus.mean_pa
    kind = None if eye.globe is None else eye.globe.kind
    rigidity = eye.globe.mean if eye.globe and eye.globe.rigidity_told else None
    lean_rad = one_lean(needle.lean_rad)
    leans_unknown = needle.lean_rad == (0.0, MOST_LEAN_RAD)

    options = {
        "eye": eye.name,
        "youngs_modulus_pa": modulus_pa,
        "iop_pa": eye.iop_pa,
        "thickness_m": eye.thickness_m,
        "globe": kind,
        "rigidity_pa13_per_m3": rigidity,
        "stiffening": eye.stiffening,
        "gap_m": needle.gap_m,
        "polar_angle_rad": needle.polar_rad,
        "lean_rad": "unknown" if leans_unknown else lean_rad,
        "rows": scan.rows,
        "columns": scan.columns,
        "width_m": scan.width_m,
        "depth_m": scan.depth_m,
        "refractive_index": scan.refractive_index,
        "plane_direction_rad": scan.direction_rad,
        "planes": [
            (plane.name, plane.offset_m, plane.direction_rad) for plane in scan.planes
        ],
    }

    declared = setup_of_options(options)
    told = Setup(
        eye=replace(declared.eye, name=eye.name),
        needle=declared.needle,
        scan=replace(
            declared.scan,
            rows=scan.rows,
            columns=scan.columns,
            width_m=scan.width_m,
            depth_m=scan.depth_m,
            refractive_index=scan.refractive_index,
            planes=scan.planes,
        ),
    )
    for part, given in vars(setup).items():
        for name, value in vars(given).items():
            if value != getattr(getattr(told, part), name):
                raise InputError(
                    f"{name}: {part}.{name} is nothing that a monitor takes, or not in"
                    " full; leave it out, or state it in a calibration"
                )

    return options


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
