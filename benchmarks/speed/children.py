"""Programs that are timed as a whole: started, waited for, their answer read."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

FOLDER = Path(__file__).parents[1]


def ask_module(module: str, *words: str) -> tuple[dict[str, Any], float]:
    """Run a module on one thread of BLAS; return the JSON object that it prints last,
    and the seconds of its process.

    Raises:
        subprocess.CalledProcessError: it failed.
    """
    start = perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", module, *words],
        env=_environment() | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )

    return json.loads(done.stdout.splitlines()[-1]), perf_counter() - start


def command_seconds(command: Sequence[str], *, heard: bool = False) -> float:
    """Run a command without its output, or with that on standard error; return its
    seconds.

    Raises:
        subprocess.CalledProcessError: it failed.
    """
    start = perf_counter()
    subprocess.run(
        command,
        env=_environment(),
        stdout=sys.stderr if heard else subprocess.DEVNULL,
        stderr=None if heard else subprocess.DEVNULL,
        check=True,
    )

    return perf_counter() - start


def _environment() -> dict[str, str]:
    """Return an environment as users have it, who cache bytecode, with the modules of
    the benchmarks.
    """
    path = os.pathsep.join([str(FOLDER), os.environ.get("PYTHONPATH", "")])
    users = {**os.environ, "PYTHONPATH": path.rstrip(os.pathsep)}
    users.pop("PYTHONDONTWRITEBYTECODE", None)
    return users
