"""What packages raise over a damaged file, as one error that names it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from scleraforce.errors import FrameError, InputError


@contextmanager
def named_faults(path: Path, kind: str) -> Iterator[None]:
    """Name the file and its kind in whatever the reading of it raises; the system's own errors pass.

    Raises:
        FrameError: what was read is damaged.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as fault:  # packages raise whatever the damage leads to: OSError without a name, MemoryError
        if isinstance(fault, OSError) and fault.filename is not None:
            raise
        words = " ".join(str(fault).split()) or type(fault).__name__
        raise FrameError(f"{path}: damaged or an unknown kind of {kind}: {words}") from fault
