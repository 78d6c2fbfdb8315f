"""Fixtures of all tests."""

import gc
import signal
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

import scleraforce  # noqa: F401 - before ONNX Runtime, which tests import too: it switches off what that sends

# A shell without job control starts background jobs with SIGINT and SIGQUIT ignored,
# and `nohup` ignores SIGHUP. Children inherit that: tests that send these to a child
# would wait for ever where CI runs that way.
for ignored, handler in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGQUIT, signal.SIG_DFL),
    (signal.SIGHUP, signal.SIG_DFL),
):
    if signal.getsignal(ignored) is signal.SIG_IGN:
        signal.signal(ignored, handler)

# No timed assertions: a machine with other work may draw slowly.
settings.register_profile(
    "untimed", deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("untimed")

# What collection makes - thousands of tests, the modules that they import - stays to
# the end: the collector of cycles looks at it never again.
gc.disable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.get_closest_marker("first") is None)


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A browser without a window, for the tests of a module."""
    from chromium import CHROMIUM, sync_playwright  # for the tests that need them alone

    with sync_playwright() as playwright:
        started = playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox"]
        )
        yield started
        started.close()
