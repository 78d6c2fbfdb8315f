"""Headless Chromium with pages of the console."""

from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import sync_playwright

CHROMIUM = "/usr/bin/chromium"


@contextmanager
def open_pages(address: str, pages: int) -> Iterator[None]:
    """Show the console in some pages."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox"]
        )
        for _ in range(pages):
            browser.new_page(viewport={"width": 1280, "height": 720}).goto(address)

        try:
            yield
        finally:
            browser.close()
