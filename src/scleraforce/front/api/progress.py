"""The functions that a notebook calls, one a task, SI in and out (docs/python.md), and
how they count their work.
"""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass

from scleraforce.base.errors import InputError
from scleraforce.base.units import from_si

# Context manager of a title and a number of steps; it gives a function to call with the
# number of newly done steps.
Counting = Callable[[str, int], AbstractContextManager[Callable[[int], None]]]


@dataclass(frozen=True)
class Bars:
    """A bar for each part of the work, in place of a function that counts the main
    one.
    """

    bar: Counting


Progress = Callable[[int], object] | Bars


def counting_for(progress: Progress | None, title: str) -> Counting:
    """Return a counting that reports the work with one title to `progress`, and no
    other work; bars get all of it.
    """
    if isinstance(progress, Bars):
        return progress.bar

    @contextmanager
    def counting(name: str, _total: int) -> Iterator[Callable[[int], None]]:
        def advance(count: int) -> None:
            if progress is not None and name == title:
                progress(count)

        yield advance

    return counting


def by_percent(advance: Callable[[int], None]) -> Callable[[float], None]:
    """Return a function of the completed share of the work; it counts steps of one per
    cent.
    """
    done = 0

    def reach(share: float) -> None:
        nonlocal done
        newly = max(int(from_si(share, "percent")) - done, 0)
        done += newly
        advance(newly)

    return reach


def check_rigidity(globe: str | None, rigidity_pa13_per_m3: float | None) -> None:
    """Raise an InputError for a rigidity of a globe that is not sealed."""
    if rigidity_pa13_per_m3 is not None and globe != "sealed":
        raise InputError(
            "rigidity_pa13_per_m3: of a sealed globe; declare the globe sealed, or"
            " leave the rigidity out"
        )
