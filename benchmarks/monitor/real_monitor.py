"""The monitor that is measured: as users start it, on a core of its own."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from math import degrees
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, sleep

from scleraforce.base.units import to_si
from scleraforce.base.worker_processes import no_interrupts
from scleraforce.records.model_folder import model_folder, model_name

START_S = 300.0  # where other work takes the processors, or loops are compiled first
PRUNE_S = 5.0
CORES = sorted(os.sched_getaffinity(0))
MONITOR_CORES = {CORES[0]}
OTHER_CORES = set(CORES[1:] or CORES)
ROLES = {
    "scleraforce.live.companions.black_box": "black box",
    "scleraforce.live.companions.second_opinion": "second opinion",
    "scleraforce.live.companions.watchdog": "watchdog",
    "scleraforce.live.console.server": "console",
}


@dataclass(frozen=True)
class Resources:
    """What a process holds.

    Attributes:
        rss_kb: resident memory.
        pss_kb: its proportional share of the memory.
        descriptors: open ones.
    """

    rss_kb: int
    pss_kb: int
    descriptors: int


class Monitor:
    """A monitor that `scleraforce monitor` runs; `pids` are its processes by role."""

    def __init__(
        self, process: subprocess.Popen[bytes], said: Path, black_box: Path
    ) -> None:
        self.process = process
        self._said = said
        self._black_box = black_box
        self._pruned_s = monotonic()
        # It says last how to reset, but for its console, which speaks when it likes.
        words = self._await(r"^reset .*\n")[0].split()
        self.port = int(words[words.index("--port") + 1])
        self.token = words[-1]
        self.pids = {"monitor": process.pid, **_children(process.pid)}

    @property
    def said(self) -> str:
        """All that it has written for the operator."""
        return self._said.read_text(encoding="utf-8")

    @property
    def console(self) -> str:
        """The address of its console, once that is said."""
        return self._await(r"^console +(\S+)\n")[1]

    def resources(self) -> dict[str, Resources]:
        """Return what each of its processes holds; none of one that has ended."""
        return {
            role: found
            for role, pid in self.pids.items()
            if (found := _resources(pid)) is not None
        }

    def prune(self) -> None:
        """Remove what the black box has kept, now and then: a withdrawal every second
        would fill any disk.
        """
        if monotonic() - self._pruned_s < PRUNE_S:
            return

        self._pruned_s = monotonic()
        folders = (self._black_box / "withdrawals").glob("[!.]*Z-*")
        if paths := list(map(str, folders)):
            subprocess.Popen(["rm", "-rf", *paths], start_new_session=True)

    def _await(self, pattern: str) -> re.Match[str]:
        """Wait until it has written a line."""
        end_s = monotonic() + START_S
        while monotonic() < end_s and self.process.poll() is None:
            if found := re.search(pattern, self.said, re.MULTILINE):
                return found
            sleep(0.02)
        raise SystemExit(f"the monitor did not start:\n{self.said}")


@contextmanager
def real_monitor(
    model: Path,
    recording: Path,
    *options: str,
    pinned: bool = True,
    real_time: bool = True,
) -> Iterator[Monitor]:
    """Start `scleraforce monitor` for the eye of a virtual recording; end all its
    processes.

    Args:
        model: folder of the model.
        recording: folder; its truth.json says what is known of the eye.
        options: further ones of the command.
        pinned: the monitor to the first core, its companions to the others.
        real_time: False takes away the right to real-time priority.
    """
    command = scleraforce("monitor", model_name(model_folder(model)))
    command += [*_known_of(recording), "--port", "0", *options]
    if not real_time:
        command = ["setpriv", "--bounding-set=-sys_nice", *command]

    with TemporaryDirectory(
        prefix="bench-monitor-", ignore_cleanup_errors=True
    ) as folder:
        said = Path(folder, "said")
        black_box = Path(folder, "box")
        with said.open("wb") as errors, no_interrupts():
            process = subprocess.Popen(
                [*command, "--black-box", str(black_box)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
            )

        pids: dict[str, int] = {}
        try:
            monitor = Monitor(process, said, black_box)
            pids = monitor.pids
            for role, pid in pids.items() if pinned else ():
                pin(pid, MONITOR_CORES if role == "monitor" else OTHER_CORES)

            yield monitor
        finally:
            _end(process, pids)


def scleraforce(*words: str) -> list[str]:
    """Return the command as users call it, with this Python and these sources."""
    start = "from scleraforce.front.cli.main import main; main()"
    return [sys.executable, "-c", start, *words]


@contextmanager
def server_process(module: str) -> Iterator[tuple[int, int]]:
    """Run a module that prints its port and ends with its standard input; give its port
    and the process's id.
    """
    with no_interrupts():
        process = subprocess.Popen(
            [sys.executable, "-m", module],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).parents[1],
        )

    assert process.stdin is not None
    assert process.stdout is not None
    try:
        yield int(process.stdout.readline()), process.pid
    finally:
        process.stdin.close()
        process.kill()
        process.wait()
        process.stdout.close()


def pin(pid: int, cores: set[int]) -> None:
    """Keep a process, with its threads, on some cores."""
    for thread in Path(f"/proc/{pid}/task").iterdir():
        with suppress(ProcessLookupError):
            os.sched_setaffinity(int(thread.name), cores)


def _known_of(recording: Path) -> list[str]:
    """Return the options that state the eye of a virtual recording."""
    truth = json.loads((recording / "truth.json").read_text(encoding="utf-8"))
    eye = truth["eye"]
    known = {
        "--iop-mmhg": eye["iop_pa"] / to_si(1.0, "mmhg"),
        "--thickness-um": eye["thickness_m"] * 1e6,
        "--youngs-modulus-mpa": eye["youngs_modulus_pa"] / 1e6,
        "--gap-mm": eye["gap_m"] * 1e3,
        "--polar-angle-deg": degrees(eye["polar_rad"]),
    }
    words = [word for name, value in known.items() for word in (name, f"{value:.6g}")]
    return [*words, "--globe", truth["globe"]["kind"]]


def _end(process: subprocess.Popen[bytes], pids: dict[str, int]) -> None:
    """End a monitor as planned; kill what is left of its processes after a while."""
    process.send_signal(signal.SIGCONT)
    process.terminate()
    try:
        process.wait(20.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()

    end_s = monotonic() + 10.0
    for role, pid in pids.items():
        while _role(pid) == role and monotonic() < end_s:
            sleep(0.02)
        if _role(pid) == role:
            os.kill(pid, signal.SIGKILL)


def _children(pid: int) -> dict[str, int]:
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()
    return {role: int(child) for child in found if (role := _role(int(child)))}


def _role(pid: int) -> str | None:
    """Return the role of a process, from the module that it runs; None if it has ended
    or is another's.
    """
    try:
        words = Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8").split("\0")
    except OSError:
        return None
    return next((ROLES[word] for word in words if word in ROLES), None)


def _resources(pid: int) -> Resources | None:
    """Return what a process holds; None where it has ended."""
    process = Path(f"/proc/{pid}")
    try:
        lines = [
            line.split()
            for name in ("status", "smaps_rollup")
            for line in (process / name).read_text("utf-8").splitlines()
        ]
        held = {words[0]: words[1] for words in lines if len(words) > 1}
        return Resources(
            rss_kb=int(held["VmRSS:"]),
            pss_kb=int(held["Pss:"]),
            descriptors=len(os.listdir(process / "fd")),
        )
    except (OSError, KeyError):
        return None
