"""A real Dask cluster on this machine, for tests: every part a process of its own, which may be killed."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TypeVar

import pytest

Result = TypeVar("Result")

SUPPORT = Path(__file__).parent
THREADS = 2  # of a worker: results must not depend on them
NEEDS_DASK = [
    pytest.mark.skipif(find_spec("distributed") is None, reason="the extra [cluster] is not installed"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning"),
]


class Cluster:
    """A scheduler and workers, each a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.processes: list[subprocess.Popen[bytes]] = []
        file = folder / "scheduler.json"
        options = ("--port", "0", "--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", file)
        self.scheduler = self.start("scheduler", *options)
        self.address = self.wait(lambda: json.loads(file.read_text())["address"])

    def start(self, kind: str, *options: object) -> "subprocess.Popen[bytes]":
        path = os.pathsep.join([str(SUPPORT), os.environ.get("PYTHONPATH", "")])
        environment = os.environ | {"PYTHONPATH": path, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "2"}
        log = (self.folder / f"{kind}{len(self.processes)}.log").open("w")
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *map(str, options)]
        self.processes.append(subprocess.Popen(command, env=environment, stdout=log, stderr=log, cwd=self.folder))
        log.close()
        return self.processes[-1]

    def worker(self, nanny: str = "--no-nanny") -> "subprocess.Popen[bytes]":
        """Start a worker; one of a nanny is started anew after each death."""
        options = (nanny, "--nthreads", THREADS, "--no-dashboard", "--host", "127.0.0.1")
        return self.start("worker", self.address, *options)

    @staticmethod
    def wait(found: Callable[[], Result], seconds: float = 300.0) -> Result:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            try:
                return found()
            except (OSError, ValueError, KeyError):
                time.sleep(0.05)
        raise AssertionError("the scheduler did not start")

    def end(self) -> None:
        """Kill them all."""
        for process in self.processes:
            process.kill()
            process.wait()
