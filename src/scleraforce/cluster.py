"""Work on numbered units by the workers of an existing Dask cluster (extra `[cluster]`).

The scheduler hands a unit to another worker where one has died. Results come to this process, which alone writes.
"""

import logging
import pickle
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from itertools import islice
from typing import Any, NamedTuple, TypeVar
from uuid import uuid4

from scleraforce.errors import InputError, SolverError

Result = TypeVar("Result")

CONNECT_S = 10.0
AHEAD = 8  # units for each worker that the scheduler knows of: neither it nor the workers hold all of a large run
LEAST_AHEAD = 256  # so many at least: workers may join later


class ClusterWorkers(int):
    """How many threads the workers of a Dask scheduler have, 1 at least, and the address of the scheduler.

    It is a number, so that what takes a number of workers takes those of a cluster in their place.
    """

    scheduler: str


def cluster_workers(scheduler: str) -> ClusterWorkers:
    """Return the workers of a Dask scheduler.

    Args:
        scheduler: address, like tcp://127.0.0.1:8786. It may have no workers yet: work waits for some.

    Raises:
        InputError: no Dask here, or no scheduler there.
    """
    with _connected(scheduler) as client:
        workers = ClusterWorkers(max(1, sum(client.nthreads().values())))
    workers.scheduler = scheduler
    return workers


def work_on_cluster(
    prepare: Callable[[], Callable[[int], Result]], units: Sequence[int], workers: ClusterWorkers
) -> Generator[tuple[int, Result], None, None]:
    """Do units on the workers of a Dask scheduler; yield (unit, result) as they are done.

    Args:
        prepare: called once in each thread of a worker; returns what does a unit. It is pickled, and its modules are
            installed on the workers.
        units: numbers of the units.
        workers: those of the scheduler.

    Raises:
        InputError: no scheduler there any more, or workers of another version of this package.
        SolverError: a unit killed one worker after the other, or the scheduler ended.
        ScleraforceError: what a unit raised.
    """
    with _session(prepare, workers) as session:
        import distributed

        coming = iter(units)
        done: Any = distributed.as_completed  # not annotated there
        first = [session.submit(unit) for unit in islice(coming, max(LEAST_AHEAD, AHEAD * workers))]
        finished = done(first, loop=session.client.loop)
        for future in finished:
            yield future.key[1], future.result()
            future.release()
            finished.update([session.submit(unit) for unit in islice(coming, 1)])


def work_in_order_on_cluster(
    prepare: Callable[[], Callable[[int], Result]], units: Sequence[int], workers: ClusterWorkers, ahead: int
) -> Generator[Result, None, None]:
    """Do units on the workers of a Dask scheduler; yield the results in the order of the units.

    Args:
        prepare: as of `work_on_cluster`, and so are the next two.
        units: numbers of the units.
        workers: those of the scheduler.
        ahead: units, at most, that are done or worked on before they are asked for.

    Raises:
        ScleraforceError: as `work_on_cluster`.
    """
    with _session(prepare, workers) as session:
        coming = iter(units)
        waiting = deque(session.submit(unit) for unit in islice(coming, ahead))
        while waiting:
            result = waiting.popleft().result()
            waiting.extend(session.submit(unit) for unit in islice(coming, 1))
            yield result


class _Session(NamedTuple):
    """A connection to a scheduler, a name for what is submitted, and what is to be done, kept on the workers."""

    client: Any
    name: str
    work: Any

    def submit(self, unit: int) -> Any:
        """Let a worker do a unit."""
        return self.client.submit(_do, self.work, unit, key=(self.name, unit), pure=False)


@contextmanager
def _session(prepare: Callable[[], Callable[[int], Any]], workers: ClusterWorkers) -> Iterator[_Session]:
    """Connect, hand over what is to be done, and take back in the end what is not done; speak plainly of what fails."""
    import distributed
    from distributed.comm.core import CommClosedError

    with _connected(workers.scheduler) as client:
        name = f"scleraforce-{uuid4().hex}"
        work = client.submit(_same, pickle.dumps((_version(), prepare)), key=f"{name}-work", pure=False)
        session = _Session(client, name, work)
        try:
            yield session
        except distributed.KilledWorker as fault:
            found = f"{workers.scheduler}: its workers die one after the other ({fault}); see their logs"
            raise SolverError(found) from fault
        except (CancelledError, CommClosedError) as fault:
            raise SolverError(f"{workers.scheduler}: the scheduler has ended; the same command goes on") from fault


def _connected(scheduler: str) -> Any:
    try:
        import distributed
    except ImportError as fault:
        raise InputError("--scheduler: Dask is not installed; run pip install 'scleraforce[cluster]'") from fault
    client: Any = distributed.Client  # not annotated there
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # of a scheduler that has gone it is said below
    try:
        return client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as fault:
        raise InputError(f"--scheduler: no Dask scheduler answers at {scheduler} ({fault})") from fault


_prepared = threading.local()  # what this thread of a worker has prepared last


def _same(work: bytes) -> bytes:
    """Return what is to be done: as the result of a task it goes to each worker once, and outlives any of them."""
    return work


def _do(work: bytes, unit: int) -> Any:
    """Do a unit, in a worker."""
    if getattr(_prepared, "work", None) != work:
        version, prepare = pickle.loads(work)
        if version != _version():
            raise InputError(f"a worker has scleraforce {_version()}, this process {version}; install the same")
        _prepared.work, _prepared.do = work, prepare()
    return _prepared.do(unit)


def _version() -> str:
    from importlib.metadata import version  # a tenth of a second, with all that it imports

    return version("scleraforce")
