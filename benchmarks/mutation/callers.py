"""A pytest plugin: note in the file `MUTATION_NOTE` the functions of the package that
each test calls, its fixtures included.

Functions that are compiled, or that run in a child process, are not noted.
"""

import json
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import pytest

NOTE = os.environ.get("MUTATION_NOTE")
PACKAGE = f"{os.sep}src{os.sep}scleraforce{os.sep}"
noted: dict[str, set[str]] = {}


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Note each of our functions that a test calls, its fixtures included."""
    called: set[str] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and PACKAGE in frame.f_code.co_filename:
            module = frame.f_code.co_filename.partition(PACKAGE)[2]
            called.add(f"{module}:{frame.f_code.co_qualname}")

    if NOTE is not None:
        sys.setprofile(note)
        threading.setprofile(note)  # of threads that start from now on
    try:
        return (yield)
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
        noted[item.nodeid] = called


def pytest_sessionfinish() -> None:
    """Write what was noted."""
    if NOTE is not None:
        names = {test: sorted(called) for test, called in noted.items()}
        Path(NOTE).write_text(json.dumps(names), encoding="utf-8")
