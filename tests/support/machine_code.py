"""Loops that Numba compiles, in tests: it is switched off for the monitors that tests start (`conftest`)."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import reload
from pathlib import Path
from types import ModuleType

import pytest
from platformdirs import user_cache_path

from scleraforce.compiled import SWITCH, can_compile

__all__ = ["cache_of_its_own", "compiled_again"]


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
