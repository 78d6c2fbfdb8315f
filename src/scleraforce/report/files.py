"""Write a file whole or not at all."""

import os
from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from scleraforce.errors import InputError
from scleraforce.report.html import Html

__all__ = ["write_figure", "write_page", "write_whole"]

FIGURE_KINDS = (".png", ".svg", ".pdf")


def write_page(content: Html, path: Path, *, overwrite: bool = False) -> None:
    """Write a page.

    Raises:
        InputError: the file exists and may not be overwritten, or its folder cannot be written to.
    """
    if path.exists() and not overwrite:
        raise InputError(f"{path}: exists already; remove it or choose another name")
    write_whole(content, path)


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, SVG or PDF, by the ending of `path`.

    Raises:
        InputError: another ending, or the folder cannot be written to.
    """
    if path.suffix.lower() not in FIGURE_KINDS:
        raise InputError(f"{path}: give a name that ends in {', '.join(FIGURE_KINDS)}")
    _write(path, lambda part: figure.savefig(part, format=path.suffix.lower().removeprefix(".")))


def write_whole(content: str, path: Path) -> None:
    """Write text under a temporary name beside `path` and rename it, so that no half of it is ever there.

    Raises:
        InputError: its folder cannot be written to.
    """
    _write(path, lambda part: part.write_text(content, encoding="utf-8"))


def _write(path: Path, write: Callable[[Path], object]) -> None:
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        write(part)
        part.replace(path)
    except OSError as fault:
        raise InputError(f"{path}: {fault.strerror}") from fault
    finally:
        part.unlink(missing_ok=True)
