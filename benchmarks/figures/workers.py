"""Work in processes of their own, one for each piece: what a piece took of memory ends
with it, and one may fail.
"""

import multiprocessing
from collections import deque
from collections.abc import Callable, Sequence
from multiprocessing.connection import wait
from multiprocessing.process import BaseProcess
from typing import TypeVar

from scleraforce.base.worker_processes import no_interrupts, one_thread

Piece = TypeVar("Piece")


def in_processes(
    work: Callable[[Piece], None],
    pieces: Sequence[Piece],
    workers: int,
    progress: Callable[[Piece, int | None], None],
) -> None:
    """Do pieces of work in at most `workers` processes at a time; all of them end with
    this call.

    Args:
        work: a function of a module, because the processes are spawned.
        pieces: its arguments.
        workers: processes at a time, each with one thread of BLAS.
        progress: called with a finished piece and the exit code of its process.
    """
    waiting = deque(pieces)
    running: dict[int, tuple[BaseProcess, Piece]] = {}

    try:
        while running or waiting:
            while len(running) < workers and waiting:
                piece = waiting.popleft()
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
    process = multiprocessing.get_context("spawn").Process(
        target=work, args=(piece,), daemon=True
    )
    with one_thread(), no_interrupts():
        process.start()
    return process
