"""Folders that nobody but their user writes to: for machine code and keys.

Windows gives a user's folders such rights by itself; there nothing is checked.
"""

import os
import stat
from pathlib import Path

OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
MOST_BYTES = 2**30
ROOT = 0  # can do anything anyway
# no link is followed, and no pipe waited for
FLAGS = (
    getattr(os, "O_NOFOLLOW", 0)
    | getattr(os, "O_NONBLOCK", 0)
    | getattr(os, "O_BINARY", 0)
)


def make_private(folder: Path) -> None:
    """Make a folder for the user alone, if there is none."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)


def folder_fault(folder: Path) -> str | None:
    """Return why another user could have put files into a folder, or why it cannot be
    looked at; None if it is the user's own, or does not exist.

    Its owner has to be the user or root, its mode has to keep all others from writing,
    and a folder above that everybody may write to has to keep them from renaming (as
    /tmp does).
    """
    try:
        found = folder.lstat()
    except FileNotFoundError:
        return None
    except OSError as fault:  # above it is a file, or a folder that may not be entered
        return f"{folder}: {fault.strerror}"

    if not stat.S_ISDIR(found.st_mode):
        return f"{folder}: not a folder"
    if os.name != "posix":
        return None
    if _is_anothers(found):
        return f"{folder}: belongs to another user"
    if found.st_mode & OTHERS_WRITE:
        return f"{folder}: others can write to it"

    parent = folder.parent.resolve()
    for above in (parent, *parent.parents):
        mode = above.stat().st_mode
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            return f"{folder}: everybody can replace what is in {above}"

    return None


def read_own(path: Path, most_bytes: int = MOST_BYTES) -> bytes:
    """Read a file of the user; raises `PermissionError` if it is another user's, no
    file, a link, or too large.

    Its mode does not count: that of its folder does (`folder_fault`).
    """
    descriptor = os.open(path, os.O_RDONLY | FLAGS)
    with open(descriptor, "rb") as file:
        found = os.fstat(descriptor)
        is_own = stat.S_ISREG(found.st_mode) and not _is_anothers(found)
        if not is_own or found.st_size > most_bytes:
            raise PermissionError(f"{path}: not a file of this user, or too large")
        return file.read(most_bytes)


def _is_anothers(found: os.stat_result) -> bool:
    return hasattr(os, "geteuid") and found.st_uid not in (os.geteuid(), ROOT)
