"""Loops compiled by Numba (the extra `fast`), where it is installed and SCLERAFORCE_COMPILED is not 0.

The machine code is cached for the user under a hash of the sources of all packages with such loops: another version
finds none of this one's.
Modules with such loops are imported only by who reads many frames, as the import of Numba takes 0.3 s.
"""

import os
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TypeVar, cast

from scleraforce.whole_files import hash_sources

SWITCH = "SCLERAFORCE_COMPILED"
PACKAGES = ("eye", "fitting", "library", "mechanics", "section", "segmentation")  # with compiled loops
KEY_LETTERS = 32  # of the hash, in a file name

Loops = TypeVar("Loops", bound=Callable[..., object])

_in_use = False  # of this process: see `use_compiled_loops`


def can_compile() -> bool:
    """Return whether `compiled` compiles."""
    return os.environ.get(SWITCH) != "0" and _numba_is_there()


@cache
def _numba_is_there() -> bool:
    try:
        import_module("numba")
    except ImportError:  # not installed, or not for this NumPy
        return False
    return True


def compiled(loops: Loops) -> Loops:
    """Return a function of loops over arrays as machine code; as it is where that cannot be had.

    It is compiled when it is first called with arguments of some types, which takes seconds, and kept for all later
    processes. It runs without the lock of the interpreter, and rounds as the plain function does.
    """
    if not can_compile():
        return loops
    from numba import njit
    from numba.core import config

    before = config.CACHE_DIR  # type: ignore[attr-defined]
    config.CACHE_DIR = str(_code_cache(loops.__module__))  # type: ignore[attr-defined]
    try:
        return cast(Loops, njit(cache=True, nogil=True, fastmath=False, error_model="numpy")(loops))
    finally:
        config.CACHE_DIR = before  # type: ignore[attr-defined]


def use_compiled_loops() -> None:
    """Have the fit and the library of this process use compiled loops from now on, where they can."""
    global _in_use
    _in_use = can_compile()


def loops_are_compiled() -> bool:
    """Return whether this process uses compiled loops where it has others, too."""
    return _in_use


def code_is_kept(module: str) -> bool:
    """Return whether a process before this one has left the code of a module."""
    return _code_cache(module).is_dir()


def _code_cache(module: str) -> Path:
    """Return the folder for the code of a module; Numba does not notice a change of one that it imports."""
    from platformdirs import user_cache_path  # imported here: who compiles nothing need not wait for it

    return user_cache_path("scleraforce") / "compiled" / _sources()[:KEY_LETTERS] / module


@cache
def _sources() -> str:
    return hash_sources(*PACKAGES)
