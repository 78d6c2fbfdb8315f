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
ROLES = {
    "scleraforce.live.companions.black_box": "black box",
    "scleraforce.live.companions.second_opinion": "second opinion",
    "scleraforce.live.companions.watchdog": "watchdog",
    "scleraforce.live.console.server": "console",
}


@dataclass(frozen=True)
class Resources:
    """Resources of a process: memory in kB (RSS, its own part, proportional share),
    open descriptors.
    """

    rss_kb: int
    own_kb: int
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
        words = self._await_reset_line().split()
        self.port = int(words[words.index("--port") + 1])
        self.token = words[-1]
        self.pids = {"monitor": process.pid, **_children(process.pid)}

    def _await_reset_line(self) -> str:
        """Wait until it listens: it says last how to reset, but for its console, which
        speaks when it likes.
        """
        end_s = monotonic() + START_S
        while monotonic() < end_s and self.process.poll() is None:
            if found := re.search(r"^reset .*\n", self.said, re.MULTILINE):
                return found[0]
            sleep(0.02)
        raise SystemExit(f"the monitor did not start:\n{self.said}")

    @property
    def said(self) -> str:
        """All that it has written for the operator."""
        return self._said.read_text(encoding="utf-8")

    @property
    def console(self) -> str:
        """The address of its console, once that is said."""
        end_s = monotonic() + START_S
        while monotonic() < end_s and self.alive:
            if found := re.search(r"^console +(\S+)\n", self.said, re.MULTILINE):
                return found[1]
            sleep(0.02)
        raise SystemExit(f"the console did not start:\n{self.said}")

    @property
    def alive(self) -> bool:
        """True while its process runs."""
        return self.process.poll() is None

    def prune(self) -> None:
        """Remove what the black box has kept, now and then: a withdrawal every second
        would fill any disk.
        """
        if monotonic() - self._pruned_s < PRUNE_S:
            return

        self._pruned_s = monotonic()
        folders = [
            str(path)
            for path in (self._black_box / "withdrawals").glob("*Z-*")
            if path.name[0] != "."
        ]
        if folders:
            subprocess.Popen(["rm", "-rf", *folders], start_new_session=True)


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
    truth = json.loads((recording / "truth.json").read_text(encoding="utf-8"))
    eye = truth["eye"]
    told = {
        "--iop-mmhg": eye["iop_pa"] / to_si(1.0, "mmhg"),
        "--thickness-um": eye["thickness_m"] * 1e6,
        "--youngs-modulus-mpa": eye["youngs_modulus_pa"] / 1e6,
        "--gap-mm": eye["gap_m"] * 1e3,
        "--polar-angle-deg": degrees(eye["polar_rad"]),
    }
    known = [text for name, value in told.items() for text in (name, f"{value:.6g}")]
    known += ["--globe", truth["globe"]["kind"]]

    with TemporaryDirectory(
        prefix="bench-monitor-", ignore_cleanup_errors=True
    ) as folder:
        said = Path(folder, "said")
        black_box = Path(folder, "box")
        command = [
            sys.executable,
            "-c",
            "from scleraforce.front.cli.main import main; main()",
            "monitor",
            model_name(model_folder(model)),
        ]
        command += [*known, "--port", "0", "--black-box", str(black_box), *options]
        command = (
            command if real_time else ["setpriv", "--bounding-set=-sys_nice", *command]
        )

        with said.open("wb") as errors, no_interrupts():
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
            )

        pids: dict[str, int] = {}
        try:
            monitor = Monitor(process, said, black_box)
            pids = monitor.pids

            if pinned:
                first, others = cores()
                for role, pid in pids.items():
                    pin(pid, first if role == "monitor" else others)

            yield monitor
        finally:
            _end(process, pids)


def _end(process: subprocess.Popen[bytes], pids: dict[str, int]) -> None:
    """End a monitor as planned; kill what is left of it after a while."""
    with suppress(ProcessLookupError):
        os.kill(process.pid, signal.SIGCONT)
        process.send_signal(signal.SIGTERM)

    try:
        process.wait(20.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()

    end_s = monotonic() + 10.0
    left = {role: pid for role, pid in pids.items() if role != "monitor"}
    while left and monotonic() < end_s:
        left = {role: pid for role, pid in left.items() if _module(pid) == role}
        sleep(0.02 if left else 0.0)

    for pid in left.values():
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def _children(pid: int) -> dict[str, int]:
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()
    return {role: int(child) for child in found if (role := _module(int(child)))}


def _module(pid: int) -> str | None:
    """Return the role of a process, from the module that it runs; None if it has ended
    or is another's.
    """
    try:
        words = Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8").split("\0")
    except OSError:
        return None
    return next((ROLES[word] for word in words if word in ROLES), None)


def cores() -> tuple[set[int], set[int]]:
    """Return the monitor's core and the cores of all others; the same if there is only
    one.
    """
    return {CORES[0]}, set(CORES[1:] or CORES)


def pin(pid: int, to: set[int]) -> None:
    """Keep a process, with its threads, on some cores."""
    for thread in Path(f"/proc/{pid}/task").iterdir():
        with suppress(ProcessLookupError):
            os.sched_setaffinity(int(thread.name), to)


def resources(pid: int) -> Resources | None:
    """Return what a process holds; None where it has ended."""
    try:
        fields = dict(
            line.split(":", 1)
            for line in Path(f"/proc/{pid}/status").read_text("utf-8").splitlines()
        )
        mapped = (
            Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines()
        )
        pss_kb = next(
            int(line.split()[1]) for line in mapped if line.startswith("Pss:")
        )
        descriptors = len(os.listdir(f"/proc/{pid}/fd"))

        return Resources(
            _kb(fields["VmRSS"]), _kb(fields["RssAnon"]), pss_kb, descriptors
        )
    except (OSError, KeyError, StopIteration):
        return None


def _kb(text: str) -> int:
    return int(text.split()[0])
