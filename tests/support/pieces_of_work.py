"""What spawned processes of tests do: functions that they can import."""

import os
import time
from pathlib import Path

__all__ = ["leave_a_mark_or_fail", "leave_a_mark_or_wait"]


def leave_a_mark_or_fail(path: Path) -> None:
    """Make a file; end with code 3 where it would be named `fails`."""
    if path.name == "fails":
        os._exit(3)
    path.touch()


def leave_a_mark_or_wait(path: Path) -> None:
    """Make a file, and then wait for a minute where it is named `waits`."""
    path.touch()
    if path.name == "waits":
        time.sleep(60)
