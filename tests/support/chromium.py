"""A browser for pages: Chromium where the system has it."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from playwright.sync_api import Browser, sync_playwright

CHROMIUM = "/usr/bin/chromium"
NEEDS_CHROMIUM = [pytest.mark.slow, pytest.mark.skipif(shutil.which(CHROMIUM) is None, reason="needs chromium")]


def in_chromium(test: Callable[..., None]) -> Callable[..., None]:
    """Mark a test that needs it."""
    for mark in NEEDS_CHROMIUM:
        test = mark(test)
    return test


@contextmanager
def started_chromium() -> Iterator[Browser]:
    """A browser without a window; it ends with the block."""
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield started
        started.close()
