"""Processes that work on numbered units, each with its own run of consecutive ones.

Consecutive units may share what is costly to prepare; so each worker gets a contiguous run of units, and takes units
from the end of the longest other run only when its own is done.
"""

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

from scleraforce.errors import SolverError

__all__ = ["available_cores", "next_unit", "no_interrupts", "one_thread", "own_modules", "split_runs", "work_units"]

Result = TypeVar("Result")

THREAD_SETTINGS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


def work_units(
    prepare: Callable[[], Callable[[int], Result]], units: Sequence[int], workers: int
) -> Generator[tuple[int, Result], None, None]:
    """Work on units in `workers` processes; yield (unit, result) as they are done.

    One worker is a process too: every number is then computed in the same way, with one thread of BLAS. The processes
    are spawned and end when the iterator is closed.

    Args:
        prepare: called once in each process; returns what does a unit. It is pickled.
        units: numbers of the units.
        workers: processes, at most.

    Raises:
        ScleraforceError: what a worker raised; SolverError where a worker died.
    """
    runs = split_runs(units, workers)
    lanes: list[tuple[BaseProcess, Connection]] = []
    try:
        lanes += [_start(prepare) for _ in runs]
        busy: dict[object, int] = {}
        for number, (_, connection) in enumerate(lanes):
            _ask(connection, next_unit(runs, number))
            busy[connection] = number
        while busy:
            for ready in wait([lanes[number][1] for number in busy.values()]):
                number = busy[ready]
                unit, result = _receive(*lanes[number])
                following = next_unit(runs, number)
                if following is None:
                    del busy[ready]
                else:
                    _ask(lanes[number][1], following)
                yield unit, result
    finally:
        for process, connection in lanes:
            process.terminate()
            process.join()
            connection.close()


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


def _start(prepare: Callable[[], Callable[[int], Any]]) -> tuple[BaseProcess, Connection]:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs, prepare), daemon=True)
    with one_thread(), own_modules(), no_interrupts():
        process.start()
    theirs.close()
    return process, ours


def _ask(connection: Connection, unit: int | None) -> None:
    with suppress(OSError):  # where the worker has died, receiving its answer says so
        connection.send(unit)


def _receive(process: BaseProcess, connection: Connection) -> tuple[int, Any]:
    try:
        answer = connection.recv()
    except (EOFError, OSError) as fault:
        process.join()
        raise SolverError(f"a worker ended with code {process.exitcode}; fewer --workers need less memory") from fault
    if isinstance(answer, Exception):
        raise answer
    unit, result = answer
    return unit, result


def _work(connection: Connection, prepare: Callable[[], Callable[[int], Any]]) -> None:
    """Answer unit numbers with results, in a worker, until the other end closes."""
    work = prepare()
    while True:
        try:
            unit = connection.recv()
            connection.send((unit, work(unit)))
        except (EOFError, BrokenPipeError):
            return
        except Exception as fault:  # the parent raises it
            connection.send(fault)


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
    """Let processes that start meanwhile never see Ctrl-C, which reaches the whole group: the parent ends them."""
    with own_modules():
        resource_tracker.ensure_running()  # starting it later would unblock the signal again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
