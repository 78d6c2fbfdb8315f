"""Stages of a run for a second process, which imports them by name."""

import os

from scleraforce.base.errors import SolverError
from scleraforce.front.paper.run_folder import Progress, Run

BESIDE_STEPS = 3


def beside(run: Run, progress: Progress) -> None:
    """A stage that writes its process and its workers."""
    for _ in range(BESIDE_STEPS):
        progress(1)
    (run.folder / "beside").write_text(f"{os.getpid()} {run.workers}")


def failing_beside(_: Run, __: Progress) -> None:
    """A stage that fails."""
    raise SolverError("no equilibrium")
