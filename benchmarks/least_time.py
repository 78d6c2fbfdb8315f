"""The least time of work that is done again and again: what other programs on the machine disturb least."""

from collections.abc import Callable
from time import process_time

__all__ = ["least_s"]


def least_s(work: Callable[[], object], repeats: int = 3) -> float:
    """Return the least processor time of `work`."""
    times = []
    for _ in range(repeats):
        start = process_time()
        work()
        times.append(process_time() - start)
    return min(times)
