"""Headless Chromium: pages of the console, and pictures of the pages of the docs."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
from playwright.sync_api import Browser, Locator, Page, sync_playwright

CHROMIUM = "/usr/bin/chromium"
IMAGES = Path(__file__).parents[2] / "docs" / "images"


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start the browser."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox"]
        )
        try:
            yield browser
        finally:
            browser.close()


def keep_picture(shown: Page | Locator, name: str) -> None:
    """Keep what is shown as a picture of the docs, packed as small as PNG can be."""
    path = IMAGES / f"{name}.png"
    shown.screenshot(path=path)
    pixels = cv2.imread(str(path))
    assert pixels is not None
    cv2.imwrite(str(path), pixels, (cv2.IMWRITE_PNG_COMPRESSION, 9))


@contextmanager
def open_pages(address: str, pages: int) -> Iterator[None]:
    """Show the console in some pages."""
    with chromium() as browser:
        for _ in range(pages):
            browser.new_page(viewport={"width": 1280, "height": 720}).goto(address)

        yield
