"""What all commands print with: JSON on standard output, progress on standard error."""

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import click
from tqdm import tqdm

from scleraforce.plain_json import finite
from scleraforce.units import from_si

Item = TypeVar("Item")

QUIET = f"{__name__}.quiet"  # in the meta of click's context, which a command shares with the group


def be_quiet(context: click.Context) -> None:
    """Have a command print neither report nor progress: what remains are errors, and the object of `--json`."""
    context.meta[QUIET] = True


def is_quiet() -> bool:
    """Return whether the command that runs was told to be quiet."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(QUIET))


def say(text: str, *, err: bool = False) -> None:
    """Print a line of a report, unless the command was told to be quiet."""
    if not is_quiet():
        click.echo(text, err=err)


def print_json(result: Mapping[str, Any]) -> None:
    """Print one JSON object; numbers that are not finite become null."""
    click.echo(json.dumps(finite(result), indent=2, allow_nan=False))


def progress_bar(items: Iterable[Item], title: str, total: int | None = None) -> "tqdm[Item]":
    """Show a bar on standard error while `items` are used up; nothing where that is not a terminal, or to be quiet."""
    disable = True if is_quiet() else None  # None: where it is not a terminal
    return tqdm(items, desc=title, total=total, file=sys.stderr, disable=disable, leave=False, dynamic_ncols=True)


@contextmanager
def count_bar(title: str, total: int) -> Iterator[Callable[[int], None]]:
    """Show a bar for work that says how many of its steps are newly done: what is yielded is called with that."""
    bar: tqdm[None]
    with progress_bar((), title, total=total) as bar:

        def advance(count: int) -> None:
            bar.update(count)

        yield advance


@contextmanager
def resumable_bar(out: Path, things: str, title: str, total: int) -> Iterator[Callable[[int], None]]:
    """Show a bar as `count_bar` does, for work that is resumed: Ctrl-C says how many things are kept in `out`."""
    done: list[int] = []
    try:
        with count_bar(title, total) as advance:

            def count(steps: int) -> None:
                done.append(steps)
                advance(steps)

            yield count
    except KeyboardInterrupt:
        say(f"{out}: {sum(done)} of {total} {things} are kept; the same command completes them", err=True)
        raise


@contextmanager
def share_bar(title: str) -> Iterator[Callable[[float], None]]:
    """Show a bar in per cent for work that says which share of it is done: what is yielded is called with that."""
    bar: tqdm[None]
    with progress_bar((), title, total=100) as bar:

        def reach(share: float) -> None:
            bar.update(max(int(from_si(share, "percent")) - bar.n, 0))

        yield reach
