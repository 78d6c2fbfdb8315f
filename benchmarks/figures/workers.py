"""Work in processes of their own, one for each piece: what a piece took of memory ends with it, and one may fail."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from multiprocessing.connection import wait
from multiprocessing.process import BaseProcess
from queue import SimpleQueue
from typing import TypeVar

__all__ = ["in_processes"]

Piece = TypeVar("Piece")

THREAD_SETTINGS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def in_processes(
    work: Callable[[Piece], None],
    pieces: Sequence[Piece],
    workers: int,
    progress: Callable[[Piece, int | None], None],
) -> None:
    """Do pieces of work in at most `workers` processes at a time; those that run end with this call, whatever ends it.

    Args:
        work: what is done; a function of a module, for the processes are spawned.
        pieces: what it is done to.
        workers: how many at a time, each with one thread of BLAS.
        progress: called with a piece and the exit code of its process as each is done.
    """
    os.environ.update(dict.fromkeys(THREAD_SETTINGS, "1"))  # for the processes, which read it as they start
    waiting: SimpleQueue[Piece] = SimpleQueue()
    for piece in pieces:
        waiting.put(piece)
    running: dict[int, tuple[BaseProcess, Piece]] = {}
    try:
        while running or not waiting.empty():
            while len(running) < workers and not waiting.empty():
                piece = waiting.get()
                process = _started(work, piece)
                running[process.sentinel] = process, piece
            for sentinel in wait(list(running)):
                assert isinstance(sentinel, int)
                process, piece = running.pop(sentinel)
                process.join()
                progress(piece, process.exitcode)
    finally:
        for process, _ in running.values():
            process.terminate()
            process.join()


def _started(work: Callable[[Piece], None], piece: Piece) -> BaseProcess:
    process = multiprocessing.get_context("spawn").Process(target=_run, args=(work, piece), daemon=True)
    process.start()
    return process


def _run(work: Callable[[Piece], None], piece: Piece) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group: the parent ends its children
    work(piece)
