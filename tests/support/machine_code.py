"""Loops that Numba compiles, in tests: it is switched off for the monitors that tests start (`conftest`)."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from importlib import import_module, reload
from pathlib import Path
from types import ModuleType
from typing import TypeVar

import pytest
from platformdirs import user_cache_path

from scleraforce import compiled
from scleraforce.compiled import SWITCH, can_compile
from scleraforce.segmentation import compiling

__all__ = [
    "CHOSEN",
    "by_arrays_and_loops",
    "cache_of_its_own",
    "compile_chosen",
    "compiled_again",
    "compiled_loops_of",
    "loops_in_use",
    "walls_by_loops",
]

Answer = TypeVar("Answer")

# Modules of loops that `loops_are_compiled` chooses, those that others take loops from first.
CHOSEN = (
    "scleraforce.library.compiled_states",
    "scleraforce.library.compiled_pressures",
    "scleraforce.fitting.compiled_depths",
    "scleraforce.fitting.compiled_prediction",
    "scleraforce.mechanics.axisymmetric.compiled_solid",
)


def cache_of_its_own(folder: Path) -> dict[str, str]:
    """What the environment of commands has to say for a cache in a folder; only compiled loops are those of all."""
    kept = user_cache_path("scleraforce") / "compiled"
    kept.mkdir(parents=True, exist_ok=True)
    (folder / "scleraforce").mkdir()
    (folder / "scleraforce" / "compiled").symlink_to(kept)
    return {"XDG_CACHE_HOME": str(folder), SWITCH: "1"}


@contextmanager
def compiled_again(*modules: ModuleType) -> Iterator[None]:
    """Have modules of loops compiled, those that others take loops from first; skip the test without Numba."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(SWITCH, "1")
        if not can_compile():
            pytest.skip("Numba is not installed")
        for module in modules:
            reload(module)
        yield


def compile_chosen() -> None:
    """Compile the modules of `CHOSEN` that a test before has imported as they are, if Numba is there.

    Uncompiled loops answer likewise, and take a hundred times as long.
    """
    for name in CHOSEN:
        module = import_module(name)
        if can_compile() and not compiled_loops_of(module):
            reload(module)


def compiled_loops_of(module: ModuleType) -> list[str]:
    """Return the names of the module's own loops that are compiled."""
    own = {name: value for name, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__}
    return [name for name, value in own.items() if hasattr(value, "py_func")]


@contextmanager
def loops_in_use(in_use: bool = True) -> Iterator[None]:
    """Have this process use compiled loops where it has others, too, or not."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled, "_in_use", in_use)
        yield


@contextmanager
def walls_by_loops(in_use: bool = True) -> Iterator[None]:
    """Have this process find walls by compiled loops, or not; they are compiled within `compiled_again`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiling, "_compiles", in_use)
        yield


def by_arrays_and_loops(
    call: Callable[[], Answer], switch: Callable[[bool], AbstractContextManager[None]] = loops_in_use
) -> tuple[Answer, Answer]:
    """What a call returns by arrays and by loops, which are compiled within `compiled_again`."""
    with switch(False):
        by_arrays = call()
    with switch(True):
        return by_arrays, call()
