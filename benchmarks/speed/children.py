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


def command_seconds(command: Sequence[str]) -> float:
    """Run a command without its output; return its seconds.

    Raises:
        subprocess.CalledProcessError: it failed.
    """
    start = perf_counter()
    subprocess.run(
        command,
        env=_environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=True,
    )

    return perf_counter() - start


def scleraforce(*words: str) -> list[str]:
    """Return the command as users call it, with this Python and these sources."""
    return [
        sys.executable,
        "-c",
        "from scleraforce.front.cli.main import main; main()",
        *words,
    ]


def _environment() -> dict[str, str]:
    paths = [
        str(FOLDER),
        *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep)),
    ]
    # who cache it
    users = {
        name: value
        for name, value in os.environ.items()
        if name != "PYTHONDONTWRITEBYTECODE"
    }

    return {**users, "PYTHONPATH": os.pathsep.join(paths)}
