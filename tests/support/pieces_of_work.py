"""What spawned processes of tests do: functions that they can import."""

import os
import threading
import time
from pathlib import Path
from uuid import uuid4

from scleraforce.errors import InputError

__all__ = [
    "ends_its_process",
    "fails_oddly",
    "leave_a_mark_for_each",
    "leave_a_mark_or_fail",
    "leave_a_mark_or_wait",
    "named_threads",
    "no_preparation",
    "slowly_tripled",
    "tripled",
]


def leave_a_mark_for_each(folder: Path):
    """Work that makes a file named like its unit."""

    def work(unit: int) -> int:
        (folder / str(unit)).touch()
        return unit

    return work


def leave_a_mark_or_fail(path: Path) -> None:
    """Make a file; end with code 3 where it would be named `fails`."""
    if path.name == "fails":
        os._exit(3)
    path.touch()


def leave_a_mark_or_wait(path: Path) -> None:
    """Make a file, and then wait for an hour where it is named `waits`."""
    path.touch()
    if path.name == "waits":
        time.sleep(3600)


def tripled(weight: bytes):
    """Work that triples a number, some of them late; `weight` is only carried along."""

    def work(unit: int) -> int:
        time.sleep(0.05 * (unit % 2))
        return 3 * unit + 0 * len(weight)

    return work


def no_preparation():
    """A preparation that fails."""
    raise InputError("this eye is too small")


class OddError(Exception):
    """One that cannot be made from its arguments alone."""

    def __init__(self, one, other):
        super().__init__(f"{one} and {other}")


def fails_oddly():
    """Work that fails with an exception that does not survive the way to another process."""

    def work(unit: int) -> int:
        raise OddError(unit, "this")

    return work


def slowly_tripled():
    """Work that triples a number in a while."""

    def work(unit: int) -> int:
        time.sleep(0.1)
        return 3 * unit

    return work


def ends_its_process():
    """Work that no process survives."""
    return os._exit


def named_threads():
    """Work that tells the process and the thread that have prepared it, the preparation, and those that do it."""
    prepared = os.getpid(), threading.get_ident()
    preparation = uuid4().hex
    return lambda _unit: (prepared, preparation, (os.getpid(), threading.get_ident()))
