"""Work on the workers of an existing Dask cluster (extra `[cluster]`), through an executor of `concurrent.futures`.

The scheduler gives a unit to another worker if one dies. Results come to this process, which alone writes.
"""

import logging
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from typing import Any

from scleraforce.errors import InputError, SolverError

CONNECT_S = 10.0


class ClusterWorkers(int):
    """The number of threads of a Dask scheduler's workers, at least 1, with the scheduler's address.

    Every function that takes a number of workers takes this one instead.
    """

    scheduler: str


def cluster_workers(scheduler: str) -> ClusterWorkers:
    """Return the workers of a Dask scheduler at an address like tcp://127.0.0.1:8786; work waits until it has some.

    Raises:
        InputError: Dask is not installed, or no scheduler answers.
    """
    with _connected(scheduler) as client:
        workers = ClusterWorkers(max(1, sum(client.nthreads().values())))
    workers.scheduler = scheduler
    return workers


@contextmanager
def cluster_submit(
    do: Callable[[bytes, int], Any], work: bytes, workers: ClusterWorkers
) -> Iterator[Callable[[int], "Future[Any]"]]:
    """Give a function that submits `do(work, unit)` for a unit; each worker gets `work` once.

    Raises:
        InputError: the scheduler no longer answers.
        SolverError: a unit killed several workers, or the scheduler ended.
    """
    with _connected(workers.scheduler) as client:
        import distributed
        from distributed.comm.core import CommClosedError

        kept = client.submit(_same, work, pure=False)
        executor = client.get_executor(pure=False)
        try:
            yield lambda unit: executor.submit(do, kept, unit)
        except distributed.KilledWorker as fault:
            found = f"{workers.scheduler}: its workers die one after the other ({fault}); see their logs"
            raise SolverError(found) from fault
        except (CancelledError, CommClosedError) as fault:
            raise SolverError(f"{workers.scheduler}: the scheduler has ended; run the same command again") from fault


def _connected(scheduler: str) -> Any:
    try:
        import distributed
    except ImportError as fault:
        raise InputError("--scheduler: Dask is not installed; run pip install 'scleraforce[cluster]'") from fault
    client: Any = distributed.Client  # without type annotations
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # a lost scheduler is reported above
    try:
        return client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as fault:
        raise InputError(f"--scheduler: no Dask scheduler answers at {scheduler} ({fault})") from fault


def _same(work: bytes) -> bytes:
    """Return the work: as the result of a task it is sent to each worker once, and survives the death of any."""
    return work
