"""The process that a monitor runs in: its standard files, the signals that end it, and
the program that it must not outlive.
"""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from threading import Thread, main_thread

from scleraforce.base.errors import InputError


def refuse_other_systems() -> None:
    """Raise an `InputError` on a system other than Linux, before anything is imported
    that it lacks.
    """
    if not sys.platform.startswith("linux"):
        raise InputError(
            "monitor: runs on Linux only, for its real-time priorities; this is"
            f" {sys.platform}"
        )


def open_standard_files() -> None:
    """Open each of the three standard files that is closed: a socket would take its
    number.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


@contextmanager
def ended_by_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Have Ctrl-C, a closed terminal, SIGTERM and SIGQUIT call `stop`.

    Signals that were ignored at the start, as by `nohup`, stay ignored. Writing to a
    terminal from the background must never stop the process.
    """
    ends = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
    heard = [
        number for number in ends if signal.getsignal(number) is not signal.SIG_IGN
    ]
    before = {number: signal.signal(number, lambda *_: stop()) for number in heard}
    before[signal.SIGTTOU] = signal.signal(signal.SIGTTOU, signal.SIG_IGN)

    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def end_with(link: Connection, parent: int) -> None:
    """Have this process end as by Ctrl-C once the program that started it says
    anything on the link, closes it, or has died.

    Its process id tells a death that the link does not: a process that the program
    forked holds a copy of its end.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)  # it may be ignored
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    watched: list[Connection | int] = [link]
    with suppress(OSError):  # a container may forbid it
        watched.append(os.pidfd_open(parent))

    def end(main: int) -> None:
        if os.getppid() == parent:  # else it has died before it was watched
            wait(watched)
        signal.pthread_kill(main, signal.SIGINT)

    Thread(target=end, args=(main_thread().ident,), daemon=True).start()
