"""Loops that Numba compiles, in tests: it is switched off for the monitors that tests start (`conftest`)."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import reload
from types import ModuleType

import pytest

from scleraforce.compiled import SWITCH, can_compile

__all__ = ["compiled_again"]


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
