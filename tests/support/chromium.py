"""A browser for pages: Chromium where the system has it."""

import shutil
from collections.abc import Callable

import pytest
from playwright.sync_api import sync_playwright as sync_playwright

CHROMIUM = "/usr/bin/chromium"
NEEDS_CHROMIUM = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which(CHROMIUM) is None, reason="needs chromium"),
]


def in_chromium(test: Callable[..., None]) -> Callable[..., None]:
    """Mark a test that needs it."""
    for mark in NEEDS_CHROMIUM:
        test = mark(test)
    return test
