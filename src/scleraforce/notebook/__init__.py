"""The functions that a notebook calls, one a task, SI in and out (docs/python.md), and how they count their work."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

# Context manager of a title and a number of steps; it gives a function to call with the number of newly done steps.
Counting = Callable[[str, int], AbstractContextManager[Callable[[int], None]]]


def counting_for(progress: Callable[[int], object] | None, title: str) -> Counting:
    """Return a counting that reports the work with one title to `progress`, and no other work."""

    @contextmanager
    def counting(name: str, _total: int) -> Iterator[Callable[[int], None]]:
        def advance(count: int) -> None:
            if progress is not None and name == title:
                progress(count)

        yield advance

    return counting
