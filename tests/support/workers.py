"""Functions that processes of tests run, and a real Dask cluster on this machine."""

import json
import os
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from waiting import HANGS_S, wait_until

from scleraforce.base.errors import InputError

SUPPORT = Path(__file__).parent
THREADS = 2  # of a worker: results must not depend on them
NEEDS_DASK = [
    pytest.mark.skipif(
        find_spec("distributed") is None, reason="the extra [cluster] is not installed"
    ),
    pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning"),
]


def _content(file: Path) -> dict[str, Any]:
    """Return what a JSON file says, nothing while it is written."""
    try:
        return dict(json.loads(file.read_text()))
    except ValueError:
        return {}


class Cluster:
    """A scheduler and workers, each a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.processes: list[subprocess.Popen[bytes]] = []
        file = folder / "scheduler.json"
        options = (
            "--port",
            "0",
            "--host",
            "127.0.0.1",
            "--no-dashboard",
            "--scheduler-file",
            file,
        )
        self.scheduler = self.start("scheduler", *options)
        wait_until(lambda: file.exists() and bool(_content(file)))
        self.address = _content(file)["address"]

    def start(self, kind: str, *options: object) -> "subprocess.Popen[bytes]":
        path = os.pathsep.join([str(SUPPORT), os.environ.get("PYTHONPATH", "")])
        environment = os.environ | {
            "PYTHONPATH": path,
            "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "2",
        }
        log = (self.folder / f"{kind}{len(self.processes)}.log").open("w")
        command = [
            sys.executable,
            "-m",
            f"distributed.cli.dask_{kind}",
            *map(str, options),
        ]
        self.processes.append(
            subprocess.Popen(
                command, env=environment, stdout=log, stderr=log, cwd=self.folder
            )
        )
        log.close()

        return self.processes[-1]

    def worker(self, nanny: str = "--no-nanny") -> "subprocess.Popen[bytes]":
        """Start a worker; one of a nanny is started anew after each death."""
        options = (
            nanny,
            "--nthreads",
            THREADS,
            "--no-dashboard",
            "--host",
            "127.0.0.1",
        )
        return self.start("worker", self.address, *options)

    def tasks(self) -> int:
        """Return the number of tasks that the scheduler knows of."""
        import distributed  # where the extra is installed

        with distributed.Client(self.address, set_as_default=False) as client:
            return client.run_on_scheduler(
                lambda dask_scheduler: len(dask_scheduler.tasks)
            )

    def end(self) -> None:
        """Kill them all."""
        for process in self.processes:
            process.kill()
            process.wait()


def leave_a_mark_for_each(folder: Path):
    """Work that makes a file named like its unit."""

    def work(unit: int) -> int:
        (folder / str(unit)).touch()
        return unit

    return work


class Large:
    """A result of some bytes that leaves a mark when a worker begins to pass it on."""

    def __init__(self, mark: Path, size: int) -> None:
        self.mark = mark
        self.size = size

    def __reduce__(self) -> tuple[type, tuple[bytes]]:
        self.mark.touch()
        return bytes, (bytes(self.size),)


def large(folder: Path, size: int):
    """Work with results of `size` bytes; each leaves a mark in a folder."""
    return lambda unit: Large(folder / str(unit), size)


def tripled(weight: bytes = b"", late_s: float = 0.05):
    """Work that triples a number, every second one late; `weight` is only carried
    along.
    """

    def work(unit: int) -> int:
        # results in another order than the units'; no test asserts how long it takes
        time.sleep(late_s * (unit % 2))
        return 3 * unit + 0 * len(weight)

    return work


def no_preparation():
    """A preparation that fails."""
    raise InputError("this eye is too small")


class OddError(Exception):
    """One that cannot be made from its arguments alone."""

    def __init__(self, one, other):
        super().__init__(f"{one} and {other}")


def fails_oddly():
    """Work that fails with an exception that does not survive the way to another
    process.
    """

    def work(unit: int) -> int:
        raise OddError(unit, "this")

    return work


def ends_its_process():
    """Work that no process survives."""
    return os._exit


def waits_at(gate: Path):
    """Work whose first unit, whichever a worker takes first, ends at once; every other
    one waits for a file.
    """
    first = gate.with_name(f"{gate.name}-first")

    def work(unit: int) -> int:
        try:
            first.touch(exist_ok=False)
        except FileExistsError:
            wait_until(gate.exists)
        return unit

    return work


def waits_for_ever(folder: Path):
    """Work whose first unit ends at once; every other one writes its process into a
    file and waits.
    """

    def work(unit: int) -> int:
        if unit:
            (folder / f"pid{unit}").write_text(str(os.getpid()))
            time.sleep(HANGS_S)
        return unit

    return work
