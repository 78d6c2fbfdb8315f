"""A pytest plugin: note the functions that each test calls, or run only the tests that
call a given one.

`MUTATION_NOTE=FILE` notes; `MUTATION_NOTED=FILE` and `MUTATION_FUNCTION=PATH:NAME`
select. Of a function that no test was seen to call (it is compiled, or runs in a child
process) all tests run.
"""

import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import pytest

NOTE = os.environ.get("MUTATION_NOTE")
NOTED = os.environ.get("MUTATION_NOTED")
FUNCTION = os.environ.get("MUTATION_FUNCTION", "")
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
    try:
        return (yield)
    finally:
        sys.setprofile(None)
        noted[item.nodeid] = called


def pytest_sessionfinish() -> None:
    """Write what was noted."""
    if NOTE is not None:
        names = {test: sorted(called) for test, called in noted.items()}
        Path(NOTE).write_text(json.dumps(names), encoding="utf-8")


def pytest_collection_modifyitems(
    config: pytest.Config, items: list[pytest.Item]
) -> None:
    """Keep the tests that call the given function."""
    if NOTED is None:
        return
    calls = json.loads(Path(NOTED).read_text(encoding="utf-8"))
    callers = [item for item in items if FUNCTION in calls.get(item.nodeid, [])]
    if callers:
        others = [item for item in items if item not in callers]
        config.hook.pytest_deselected(items=others)
        items[:] = callers
