"""Processes that work on numbered units, each with its own run of consecutive ones; or the workers of a cluster.

Consecutive units may share what is costly to prepare; so each worker gets a contiguous run of units, and takes units
from the end of the longest other run only when its own is done.
"""

import multiprocessing
import os
import pickle
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import pairwise
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from typing import Any, TypeVar

from scleraforce.cluster import ClusterWorkers, work_in_order_on_cluster, work_on_cluster
from scleraforce.errors import SolverError

Result = TypeVar("Result")

THREAD_SETTINGS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def available_cores() -> int:
    """Return the number of cores that this process may use; of the machine, where the system knows no such limit."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def work_units(
    prepare: Callable[[], Callable[[int], Result]], units: Sequence[int], workers: int
) -> Generator[tuple[int, Result], None, None]:
    """Work on units in `workers` processes; yield (unit, result) as they are done.

    One worker is a process too: every number is then computed in the same way, with one thread of BLAS. The processes
    are spawned and end when the iterator is closed.

    Args:
        prepare: called once in each process; returns what does a unit. It is pickled.
        units: numbers of the units.
        workers: processes, at most; or the workers of a cluster, which do the units instead.

    Raises:
        ScleraforceError: what a worker raised; SolverError where a worker died or could not be started.
    """
    if isinstance(workers, ClusterWorkers):
        yield from work_on_cluster(prepare, units, workers)
        return
    runs = split_runs(units, workers)
    with _started(prepare, len(runs)) as lanes:
        busy = {lane.connection: number for number, lane in enumerate(lanes)}
        for lane, number in zip(lanes, busy.values(), strict=True):
            _ask(lane, next_unit(runs, number))
        while busy:
            for ready in wait(list(busy)):
                lane = lanes[busy[ready]]  # type: ignore[index]  # `wait` returns what it was given
                unit, result = _receive(lane)
                following = next_unit(runs, busy[lane.connection])
                if following is None:
                    del busy[lane.connection]
                else:
                    _ask(lane, following)
                yield unit, result


def work_in_order(
    prepare: Callable[[], Callable[[int], Result]], units: Sequence[int], workers: int, ahead: int
) -> Generator[Result, None, None]:
    """Work on units in `workers` processes; yield the results in the order of the units.

    Args:
        prepare: as of `work_units`, and so are the next two.
        units: numbers of the units.
        workers: processes, at most.
        ahead: units, at most, that are done or worked on before they are asked for.

    Raises:
        ScleraforceError: as `work_units`.
    """
    if isinstance(workers, ClusterWorkers):
        yield from work_in_order_on_cluster(prepare, units, workers, ahead)
        return
    with _started(prepare, min(workers, len(units))) as lanes:
        idle, busy = deque(lanes), dict[object, _Lane]()
        coming, done = deque(units), dict[int, Result]()
        for place, unit in enumerate(units):
            while True:
                while idle and coming and len(units) - len(coming) < place + ahead:
                    lane = idle.popleft()
                    busy[lane.connection] = lane
                    _ask(lane, coming.popleft())
                if unit in done:  # and what comes next is worked on while the caller has this one
                    break
                for ready in wait([lane.connection for lane in busy.values()]):
                    lane = busy.pop(ready)
                    number, result = _receive(lane)
                    done[number] = result
                    idle.append(lane)
            yield done.pop(unit)


def split_runs(units: Sequence[int], workers: int) -> list[deque[int]]:
    """Split units into at most `workers` contiguous runs of nearly equal length.

    >>> split_runs(range(5), 2)
    [deque([0, 1, 2]), deque([3, 4])]
    """
    bounds = [-(-len(units) * number // workers) for number in range(workers + 1)]
    runs = (deque(units[low:high]) for low, high in pairwise(bounds))
    return [run for run in runs if run]


def next_unit(runs: Sequence[deque[int]], number: int) -> int | None:
    """Take the next unit of a worker's own run, or the last of the longest run; None when all is done."""
    if runs[number]:
        return runs[number].popleft()
    longest = max(runs, key=len)
    return longest.pop() if longest else None


@dataclass(frozen=True, eq=False)
class _Lane:
    """A worker and the connection to it."""

    process: BaseProcess
    connection: Connection


@contextmanager
def _started(prepare: Callable[[], Callable[[int], Any]], workers: int) -> Iterator[list[_Lane]]:
    """Start workers and hand them their work; end them in the end.

    What they do goes to them when they run, and not with their start: the start of a process waits for ever where that
    is more than a pipe holds and the process has died before it read it (CPython's `multiprocessing.popen_spawn_posix`
    keeps the pipe's other end open meanwhile).
    """
    lanes: list[_Lane] = []
    try:
        lanes += [_start() for _ in range(workers)]
        work = ForkingPickler.dumps(prepare)
        for lane in lanes:
            with suppress(OSError):  # where the worker has died, receiving its answer says so
                lane.connection.send_bytes(work)
        yield lanes
    finally:
        for lane in lanes:
            lane.process.terminate()
            lane.process.join()
            lane.connection.close()


def _start() -> _Lane:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs,), daemon=True)
    try:
        with one_thread(), own_modules(), no_interrupts():
            process.start()
    except OSError as fault:
        raise SolverError(f"a worker could not be started ({fault.strerror or fault})") from fault
    finally:
        theirs.close()
    return _Lane(process, ours)


def _ask(lane: _Lane, unit: int | None) -> None:
    with suppress(OSError):  # as above
        lane.connection.send(unit)


def _receive(lane: _Lane) -> tuple[int, Any]:
    try:
        answer = lane.connection.recv()
    except (EOFError, OSError) as fault:
        lane.process.join()
        found = f"a worker ended with code {lane.process.exitcode}; fewer --workers need less memory"
        raise SolverError(found) from fault
    if isinstance(answer, Exception):
        raise answer
    unit, result = answer
    return unit, result


def _work(connection: Connection) -> None:
    """Get what is to be done, and answer unit numbers with results, in a worker, until the other end closes."""
    try:
        work = connection.recv()()
        while True:
            unit = connection.recv()
            connection.send((unit, work(unit)))
    except (EOFError, BrokenPipeError):
        return
    except Exception as fault:  # the parent raises it
        connection.send(_portable(fault))


def _portable(fault: Exception) -> Exception:
    """Return an exception that can be sent to another process: itself, if that can be read there."""
    try:
        pickle.loads(pickle.dumps(fault))
    except Exception:  # whatever its making asks for
        return SolverError(f"{type(fault).__name__} in a worker: {fault}")
    return fault


@contextmanager
def one_thread() -> Iterator[None]:
    """Let processes that start meanwhile use one thread of BLAS each: there is one process for every core."""
    with _environment(dict.fromkeys(THREAD_SETTINGS, "1")):
        yield


@contextmanager
def own_modules() -> Iterator[None]:
    """Let Python processes that start meanwhile not look for modules in the current folder, which may be anybody's.

    A worker is started by `python -c`, which would take a `signal.py` that lies there for the standard library's.
    """
    with _environment({"PYTHONSAFEPATH": "1"}):
        yield


@contextmanager
def _environment(settings: Mapping[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in settings}
    os.environ.update(settings)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def no_interrupts() -> Iterator[None]:
    """Let processes that start meanwhile never see Ctrl-C, which reaches the whole group: the parent ends them.

    Windows has no such masks: there they see it, too.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    with own_modules():
        resource_tracker.ensure_running()  # starting it later would unblock the signal again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
