"""Work on numbered units in processes or on a Dask cluster (extra `[cluster]`), by
executors of `concurrent.futures`.

Consecutive units may share what is costly to prepare. So each process is an executor of
its own with a contiguous run of units; it takes units from the end of the longest other
run only when its own is done. A cluster's scheduler gives a unit to another worker if
one dies. Results come to this process, which alone writes.
"""

import logging
import multiprocessing
import os
import pickle
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Future,
    ProcessPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from functools import partial
from itertools import islice, pairwise
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread, local
from typing import Any, NamedTuple, TypeVar

from scleraforce.base.errors import InputError, SolverError
from scleraforce.base.version import __version__

Result = TypeVar("Result")
Submit = Callable[[int], "Future[Any]"]

CONNECT_S = 10.0


class ClusterWorkers(int):
    """The number of threads of a Dask scheduler's workers, at least 1, with the
    scheduler's address.

    Every function that takes a number of workers takes this one instead.
    """

    scheduler: str


def cluster_workers(scheduler: str) -> ClusterWorkers:
    """Return the workers of a Dask scheduler at an address like tcp://127.0.0.1:8786;
    work waits until it has some.

    It raises `InputError` if Dask is not installed, or no scheduler answers.
    """
    with _connected(scheduler) as client:
        workers = ClusterWorkers(max(1, sum(client.nthreads().values())))
    workers.scheduler = scheduler
    return workers


@contextmanager
def _submitting_to_cluster(work: bytes, workers: ClusterWorkers) -> Iterator[Submit]:
    """Give a function that submits a unit; each worker gets `work` once.

    It raises `InputError` if the scheduler no longer answers, `SolverError` if it ended
    or a unit killed workers.
    """
    with _connected(workers.scheduler) as client:
        # 220 ms, and an extra: not without a cluster
        import distributed
        from distributed.comm.core import CommClosedError

        # As the result of a task it is sent to each worker once, and survives the death
        # of any.
        kept = client.submit(bytes, work, pure=False)

        try:
            yield partial(client.get_executor(pure=False).submit, _do, kept)
        except distributed.KilledWorker as fault:
            found = (
                f"{workers.scheduler}: its workers die one after the other ({fault});"
                " see their logs"
            )
            raise SolverError(found) from fault
        except (CancelledError, CommClosedError) as fault:
            raise SolverError(
                f"{workers.scheduler}: the scheduler has ended; run the same command"
                " again"
            ) from fault


def _connected(scheduler: str) -> Any:
    try:
        # 220 ms, and an extra: not without a cluster
        import distributed
    except ImportError as fault:
        raise InputError(
            "`scheduler`: Dask is not installed; run pip install 'scleraforce[cluster]'"
        ) from fault

    client: Any = distributed.Client  # without type annotations
    # a lost scheduler is reported above
    logging.getLogger("distributed").setLevel(logging.CRITICAL)

    try:
        return client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as fault:
        raise InputError(
            f"`scheduler`: no Dask scheduler answers at {scheduler} ({fault})"
        ) from fault


# A process is started by `python -c`, which would take a `signal.py` of the current
# folder for the standard library's.
OWN_MODULES = {"PYTHONSAFEPATH": "1"}
# Workers that have workers of their own end without removing their semaphores. The
# tracker removes them, and would warn of each.
QUIET_TRACKER = {"PYTHONWARNINGS": "ignore:resource_tracker:UserWarning"}
THREAD_SETTINGS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
# submitted units for each worker of a cluster: neither it nor the scheduler holds all
# of a large run
AHEAD = 8
LEAST_AHEAD = 256  # submitted units of a cluster at least: workers may join later


def available_cores() -> int:
    """Return the number of cores that this process may use; of the machine, if the
    system has no such limit.
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def work_units(
    prepare: Callable[[], Callable[[int], Result]], units: Sequence[int], workers: int
) -> Generator[tuple[int, Result], None, None]:
    """Work on numbered units in at most `workers` processes; yield (unit, result) in
    the order of completion.

    A single worker is a process too: every number is then computed in the same way,
    with one thread of BLAS. The processes are spawned and end when the iterator is
    closed. `prepare` is pickled and called once in each process, or thread of a
    cluster's worker; it returns the function of a unit. It raises the
    `ScleraforceError` that a worker raised, and `SolverError` if a worker died or could
    not be started.
    """
    on_cluster = isinstance(workers, ClusterWorkers)
    most = 1 if on_cluster else workers
    bounds = pairwise(len(units) * number // most for number in range(most + 1))
    runs = [deque(units[low:high]) for low, high in bounds if low < high]
    ahead = max(LEAST_AHEAD, AHEAD * workers) if on_cluster else 1
    waiting = dict[Future[Result], tuple[int, int]]()

    with ExitStack() as stack:
        lanes = [
            stack.enter_context(_submitting(prepare, workers if on_cluster else 1))
            for _ in runs
        ]

        def ask(lane: int) -> None:
            if (unit := next_unit(runs, lane)) is not None:
                waiting[lanes[lane](unit)] = lane, unit

        for lane in ahead * list(range(len(lanes))):
            ask(lane)

        while waiting:
            for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                lane, unit = waiting.pop(future)
                result = _result(future)
                ask(lane)
                yield unit, result


def work_in_order(
    prepare: Callable[[], Callable[[int], Result]],
    units: Sequence[int],
    workers: int,
    ahead: int,
) -> Generator[Result, None, None]:
    """Work on units as `work_units`; yield the results in the order of the units.

    At most `ahead` units are done or worked on before the caller asks for them.
    """
    with _submitting(
        prepare,
        workers if isinstance(workers, ClusterWorkers) else min(workers, len(units)),
    ) as submit:
        coming = iter(units)
        waiting = deque(submit(unit) for unit in islice(coming, ahead))

        while waiting:
            result = _result(waiting.popleft())
            waiting.extend(submit(unit) for unit in islice(coming, 1))
            yield result


@contextmanager
def work_beside(
    prepare: Callable[[], Callable[[int], Result]],
) -> Iterator[Callable[[int], "Future[Result]"]]:
    """Give a function that submits a unit to one process, which starts with the first,
    does one after the other, and ends with the block.

    `finished_result` gives the result.
    """
    with _submitting(prepare, 1) as submit:
        yield submit


def finished_result(future: "Future[Result]") -> Result:
    """Return the result of a unit of `work_beside`, once: its file is removed."""
    result: Result = _result(future)
    return result


def next_unit(runs: Sequence[deque[int]], number: int) -> int | None:
    """Take the next unit of a worker's own run, or the last of the longest run; None
    when all is done.
    """
    if runs[number]:
        return runs[number].popleft()
    longest = max(runs, key=len)
    return longest.pop() if longest else None


@contextmanager
def _submitting(
    prepare: Callable[[], Callable[[int], Any]], workers: int
) -> Iterator[Submit]:
    """Give a function that submits a unit to an executor of some workers, which end
    with the block.
    """
    work = pickle.dumps((__version__, prepare))
    if isinstance(workers, ClusterWorkers):
        with _submitting_to_cluster(work, workers) as submit:
            yield submit

        return

    context = multiprocessing.get_context("spawn")
    watched, held = context.Pipe(duplex=False)

    with watched, TemporaryDirectory(prefix="scleraforce-") as folder:
        # A process that dies at its start would block for ever whoever writes more to
        # it than a pipe holds.
        file = Path(folder) / "work"
        file.write_bytes(work)

        with no_interrupts():  # semaphores start the resource tracker
            executor = ProcessPoolExecutor(
                max(workers, 1), context, _end_with_parent, (watched,)
            )

        with executor, held:

            def start_and_submit(unit: int) -> "Future[Any]":
                try:
                    with one_thread(), _environment(OWN_MODULES), no_interrupts():
                        return executor.submit(_do, file, unit)
                except OSError as fault:
                    raise SolverError(
                        f"a worker could not be started ({fault.strerror or fault})"
                    ) from fault

            try:
                yield start_and_submit
            except BrokenProcessPool as fault:
                raise SolverError(
                    "a worker ended abruptly; fewer `workers` need less memory"
                ) from fault


def _end_with_parent(parent: Connection) -> None:
    """End this worker, whatever it does, when the parent closes its end of a pipe or
    dies.
    """

    def watch() -> None:
        with suppress(EOFError, OSError):
            parent.recv_bytes()
        os._exit(1)

    Thread(target=watch, daemon=True).start()


def _result(future: "Future[Any]") -> Any:
    """Return the result of a submitted unit; a process leaves it in a file, which is
    removed.
    """
    result = future.result()
    if not isinstance(result, _Stored):
        return result
    loaded = pickle.loads(result.file.read_bytes())
    result.file.unlink()
    return loaded


class _Stored(NamedTuple):
    """The result of a process: the executor's pipe would block for ever if the process
    died while writing to it.
    """

    file: Path


_prepared = local()  # the last preparation of this thread of a worker


def _do(work: bytes | Path, unit: int) -> Any:
    """Do a unit, in a worker; `work` is what this package pickled, or the file that
    holds it.
    """
    try:
        if getattr(_prepared, "work", None) != work:
            version, prepare = pickle.loads(
                work if isinstance(work, bytes) else work.read_bytes()
            )
            if version != (own := __version__):
                raise InputError(
                    f"a worker has scleraforce {own}, this process {version}; install"
                    " the same"
                )

            _prepared.do = prepare()
            _prepared.work = work  # not before: a preparation that fails is none

        result = _prepared.do(unit)
        if isinstance(work, bytes):
            return result

        try:
            file = work.with_name(str(unit))
            file.write_bytes(pickle.dumps(result, pickle.HIGHEST_PROTOCOL))
        except OSError:  # no room for it there: the pipe takes it
            return result

        return _Stored(file)
    except Exception as fault:
        try:
            pickle.loads(pickle.dumps(fault))
        except Exception:
            # the constructor of an exception that does not survive pickling may raise
            # anything
            raise SolverError(f"{type(fault).__name__} in a worker: {fault}") from None

        raise


def one_thread() -> AbstractContextManager[None]:
    """Give processes that start in the block one thread of BLAS each: there is a
    process for every core.
    """
    return _environment(dict.fromkeys(THREAD_SETTINGS, "1"))


@contextmanager
def _environment(settings: Mapping[str, str]) -> Iterator[None]:
    """Change the environment of processes that start in the block."""
    before = {name: os.environ[name] for name in settings if name in os.environ}
    os.environ.update(settings)

    try:
        yield
    finally:
        for name in settings:
            del os.environ[name]
        os.environ.update(before)


@contextmanager
def no_interrupts() -> Iterator[None]:
    """Block Ctrl-C, which reaches the whole group, in processes that start in the
    block: the parent ends them.

    Windows has no signal masks: its processes receive Ctrl-C.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return

    with _environment(OWN_MODULES | QUIET_TRACKER):
        # starting it later would unblock the signal again
        resource_tracker.ensure_running()

    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
