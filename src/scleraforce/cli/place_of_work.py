"""The options by which a command is told where its work is done: processes of this machine, or a Dask cluster."""

from collections.abc import Callable
from typing import Any, TypeVar

import click

Command = TypeVar("Command", bound=Callable[..., Any])


def worker_options(work: str) -> Callable[[Command], Command]:
    """Return a decorator that adds `--scheduler` and `--workers`, the arguments of `chosen_workers`.

    Args:
        work: what the workers of the scheduler do, like "solve the paths".
    """

    def decorated(command: Command) -> Command:
        scheduler = click.option("--scheduler", metavar="ADDRESS", help=f"Dask scheduler whose workers {work}.")
        workers = click.option("--workers", type=click.IntRange(min=1), help="Processes; default: one for each core.")
        return scheduler(workers(command))

    return decorated


def chosen_workers(scheduler: str | None, workers: int | None) -> int | None:
    """Return the processes, or the workers of the scheduler; None where neither is told.

    Raises:
        UsageError: both are told.
        InputError: Dask is not installed, or no scheduler answers.
    """
    if scheduler is None:
        return workers
    if workers is not None:
        raise click.UsageError(f"--workers {workers}: --scheduler has workers of its own; give one of the two")
    from scleraforce.cluster import cluster_workers

    return cluster_workers(scheduler)
