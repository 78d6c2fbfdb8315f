"""How much memory Python takes while something is done."""

import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["less_than"]


@contextmanager
def less_than(limit_bytes: float) -> Iterator[None]:
    """Check that at no time in between more memory is taken than this."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < limit_bytes
    finally:
        tracemalloc.stop()
