"""Loops compiled by Numba (the extra `fast`), where it is installed and SCLERAFORCE_COMPILED is not 0.

The machine code is kept in the user's cache, under a hash of the sources: another version finds none of this one's.
Modules with such loops are imported only by who reads many frames, as the import of Numba takes 0.3 s.
"""

import os
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar, cast

from platformdirs import user_cache_path

from scleraforce.source_hash import hash_sources

__all__ = ["SWITCH", "can_compile", "compiled"]

SWITCH = "SCLERAFORCE_COMPILED"
KEY_LETTERS = 32  # of the hash, in a file name

Loops = TypeVar("Loops", bound=Callable[..., object])


@cache
def can_compile() -> bool:
    """Return whether `compiled` compiles in this process."""
    return os.environ.get(SWITCH) != "0" and find_spec("numba") is not None


def compiled(loops: Loops) -> Loops:
    """Return a function of loops over arrays as machine code; as it is where that cannot be had.

    It is compiled when it is first called with arguments of some types, which takes seconds, and kept for all later
    processes. It runs without the lock of the interpreter, and rounds as the plain function does.
    """
    if not can_compile():
        return loops
    import numba

    config: Any = numba.config  # not annotated there
    before, config.CACHE_DIR = config.CACHE_DIR, str(_code_cache(loops.__module__))
    try:
        return cast(Loops, numba.njit(cache=True, nogil=True, fastmath=False, error_model="numpy")(loops))
    finally:
        config.CACHE_DIR = before


@cache
def _code_cache(module: str) -> Path:
    """Return the folder for a module's code; Numba itself would not notice that one which it imports is another."""
    return user_cache_path("scleraforce") / "compiled" / hash_sources(module)[:KEY_LETTERS]
