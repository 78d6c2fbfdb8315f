"""Write a file whole or not at all."""

import os
from pathlib import Path

from scleraforce.errors import InputError
from scleraforce.report.html import Html

__all__ = ["write_page", "write_whole"]


def write_page(content: Html, path: Path, *, overwrite: bool = False) -> None:
    """Write a page.

    Raises:
        InputError: the file exists and may not be overwritten, or its folder cannot be written to.
    """
    if path.exists() and not overwrite:
        raise InputError(f"{path}: exists already; remove it or choose another name")
    write_whole(content, path)


def write_whole(content: str, path: Path) -> None:
    """Write text under a temporary name beside `path` and rename it, so that no half of it is ever there.

    Raises:
        InputError: its folder cannot be written to.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        part.write_text(content, encoding="utf-8")
        part.replace(path)
    except OSError as fault:
        raise InputError(f"{path}: {fault.strerror}") from fault
    finally:
        part.unlink(missing_ok=True)
