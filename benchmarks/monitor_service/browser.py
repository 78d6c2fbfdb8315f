"""Headless Chromium with the console's page, and what it takes of the processor."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from playwright.sync_api import sync_playwright

CHROMIUM = "/usr/bin/chromium"


@contextmanager
def open_pages(address: str, pages: int) -> Iterator[None]:
    """Show the console in headless Chromium."""
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


def cpu_s(pids: list[int]) -> float:
    """Processor time of processes that still run."""
    ticks = 0
    for pid in pids:
        with suppress(OSError):
            fields = (
                Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()
            )
            ticks += int(fields[11]) + int(fields[12])

    return ticks / os.sysconf("SC_CLK_TCK")


def browser_pids() -> list[int]:
    """All processes of Chromium below this one."""
    parents = {}
    for entry in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            name, _, rest = entry.read_text("utf-8").rpartition(")")
            parents[int(entry.parent.name)] = int(rest.split()[1]), "chrom" in name

    below = {os.getpid()}
    while (
        more := {pid for pid, (parent, _) in parents.items() if parent in below} - below
    ):
        below |= more

    return [pid for pid in below if parents.get(pid, (0, False))[1]]
