"""What all tests share."""

import gc
import os
import signal
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings
from machine_code import compile_chosen

import scleraforce  # noqa: F401 - before ONNX Runtime, which tests import too: it switches off what that sends
from scleraforce.compiled import SWITCH, use_compiled_loops

# A shell without job control starts background jobs with SIGINT and SIGQUIT ignored, and children inherit that: tests
# that send these to a child would wait for ever where CI runs that way.
for ignored, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGQUIT, signal.SIG_DFL)):
    if signal.getsignal(ignored) is signal.SIG_IGN:
        signal.signal(ignored, handler)

# Monitors that tests start answer at once, and do not compile first; the tests of compiled loops switch it on.
os.environ.setdefault(SWITCH, "0")

# No timed assertions: a machine with other work may draw slowly.
settings.register_profile("untimed", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("untimed")

# What collection makes - thousands of tests, the modules that they import - stays to the end: the collector of cycles
# looks at it never again.
gc.disable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.get_closest_marker("first") is None)


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="module")
def compiled_loops() -> Iterator[None]:
    """Compiled loops, as commands have them, for what calibrates: in this process and those that it starts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("scleraforce.compiled._in_use", False)  # what it is afterwards
        patch.setenv(SWITCH, "1")
        compile_chosen()
        use_compiled_loops()
        yield
