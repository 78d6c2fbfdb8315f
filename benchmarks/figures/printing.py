"""What all studies share: their options, and tables as Markdown."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import click

from markdown_tables import lines
from scleraforce.records.study import Study, read_study

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


def _study(value: str | Study) -> Study:
    return value if isinstance(value, Study) else read_study(Path(value))


PATH = click.Path(path_type=Path)
ROWS = click.option("--rows", type=int, help="Only the first N of each table.")
STUDY = click.option(
    "--study",
    type=_study,
    default=Study,
    metavar="FILE",
    help="A study file; the paper's study where none is given.",
)


def whole_number(name: str, default: int, what: str = "") -> Decorator:
    """Return an option that takes a whole number."""
    return click.option(
        name, type=click.IntRange(0), default=default, show_default=True, help=what
    )


def print_table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table as Markdown, each row as soon as it is computed."""
    for line in lines(head, rows):
        print(line, flush=True)


def listed(values: Iterable[float], form: str) -> str:
    """Return numbers in one cell, each in a format such as ".1f"."""
    return ", ".join(format(value, form) for value in values)


def picture(name: str) -> Decorator:
    """Return the option of the file that a picture of the pages is drawn into."""
    images = Path(__file__).parents[2] / "docs" / "images"
    return click.option(
        "--out",
        type=PATH,
        default=images / name,
        help="The picture; that of the pages where none is given.",
    )
