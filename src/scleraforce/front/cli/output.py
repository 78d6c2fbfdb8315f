"""Output of commands: a report or its JSON on standard output, progress and errors on
standard error.
"""

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import click
from tqdm import tqdm

from scleraforce.base import plain_text
from scleraforce.base.errors import InputError
from scleraforce.base.plain_json import finite_json
from scleraforce.front.api.progress import by_percent
from scleraforce.front.cli.field_flags import flag_of, in_flags, json_in_flags
from scleraforce.front.cli.main import fail
from scleraforce.front.cli.options import STUDY_FILE

Item = TypeVar("Item")
Result = TypeVar("Result")

# In the meta of click's context, which a command shares with the group.
QUIET = f"{__name__}.quiet"
JSON = f"{__name__}.json"


class Report(NamedTuple):
    """Output of a command: `result` with --json, else `lines`; `faults`, which make its
    exit code 2; another `code`.
    """

    result: Mapping[str, Any]
    lines: Iterable[str] = ()
    faults: Sequence[InputError] = ()
    code: int = 0


class Command(click.Command):
    """A command with --json and --quiet that prints the `Report` of its function;
    errors name its options.
    """

    def __init__(self, *args: Any, can_be_quiet: bool = True, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.params.append(_flag(JSON, "--json", help="Print one JSON object."))

        if can_be_quiet:
            self.params.append(
                _flag(
                    QUIET,
                    "-q",
                    "--quiet",
                    help="Print errors only, and with --json its object.",
                )
            )

    def invoke(self, ctx: click.Context) -> None:
        """Run the function and print its report."""
        try:
            report: Report | None = super().invoke(ctx)
        except InputError as fault:
            if (text := _by_options(str(fault), ctx)) == str(fault):
                raise

            raise InputError(text) from fault

        if report is None:
            return

        if is_json():
            print_json(report.result)
        else:
            for line in report.lines:
                say(line)

        for text in dict.fromkeys(str(one) for one in report.faults):
            fail(_by_options(text, ctx), 2)

        if code := 2 if report.faults else report.code:
            raise click.exceptions.Exit(code)


def _flag(key: str, *names: str, help: str) -> click.Option:  # noqa: A002 - click's name
    return click.Option(
        names,
        is_flag=True,
        expose_value=False,
        help=help,
        callback=lambda context, _, given: context.meta.update({key: given}),
    )


def _by_options(text: str, ctx: click.Context) -> str:
    """Return an error with flags in place of fields, also where it begins with the name
    of one of the command's own; a study is its file.
    """
    text = in_flags(text, ctx.command.name)
    name, colon, rest = text.partition(":")
    if name == "study" and STUDY_FILE in ctx.meta:
        return f"{ctx.meta[STUDY_FILE]}:{rest}"

    names = {
        param.name for param in ctx.command.params if isinstance(param, click.Option)
    }
    if not colon or name not in names - {"study"}:
        return text
    return f"{flag_of(name, ctx.command.name)}:{rest}"


def worded(text: str) -> str:
    """Return a text with the flags that users of the current command type."""
    return in_flags(text, _command_name())


def wrapped(text: str, start: str = "") -> str:
    """Return a text with flags at 80 columns, behind what starts its line."""
    return plain_text.wrapped(worded(text), start)


def _command_name() -> str | None:
    context = click.get_current_context(silent=True)
    return None if context is None else context.command.name


def is_quiet() -> bool:
    """Return whether the current command has --quiet."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(QUIET))


def is_json() -> bool:
    """Return whether the current command has --json."""
    return bool(click.get_current_context().meta.get(JSON))


def say(text: str, *, err: bool = False) -> None:
    """Print a line of a report, unless --quiet is given."""
    if not is_quiet():
        click.echo(plain_text.printable(worded(text)), err=err)


def print_json(result: Mapping[str, Any]) -> None:
    """Print one JSON object; numbers that are not finite become null."""
    found = json_in_flags(finite_json(result), _command_name())
    click.echo(json.dumps(found, indent=2, allow_nan=False))


def each_of(
    items: Iterable[Item], read: Callable[[Item], Result]
) -> Iterator[tuple[Item, Result | InputError]]:
    """Yield each frame with its result, or with the error that it raises."""
    for item in progress_bar(items, "frames"):
        try:
            yield item, read(item)
        except InputError as fault:
            yield item, fault
        except OSError as fault:  # a name that is too long, a disk that is full
            yield item, InputError(f"{fault.filename}: {fault.strerror}")


def progress_bar(
    items: Iterable[Item], title: str, total: int | None = None
) -> "tqdm[Item]":
    """Show a bar on standard error while `items` are used up, if it is a terminal and
    --quiet is not given.
    """
    disable = True if is_quiet() else None  # None: unless it is a terminal
    return tqdm(
        items,
        desc=title,
        total=total,
        file=sys.stderr,
        disable=disable,
        leave=False,
        dynamic_ncols=True,
    )


@contextmanager
def count_bar(title: str, total: int) -> Iterator[Callable[[int], None]]:
    """Show a bar for counted work; yield a function of the number of newly done
    steps.
    """
    bar: tqdm[None]
    with progress_bar((), title, total=total) as bar:

        def advance(count: int) -> None:
            bar.update(count)

        yield advance


@contextmanager
def resumable_bar(
    out: Path, things: str, title: str, total: int
) -> Iterator[Callable[[int], None]]:
    """Show a bar as `count_bar` does, for work that can be resumed: Ctrl-C prints the
    number of things in `out`.
    """
    done: list[int] = []
    try:
        with count_bar(title, total) as advance:

            def count(steps: int) -> None:
                done.append(steps)
                advance(steps)

            yield count
    except KeyboardInterrupt:
        say(
            f"{out}: {sum(done)} of {total} {things} are kept; the same command"
            " completes them",
            err=True,
        )
        raise


@contextmanager
def share_bar(title: str) -> Iterator[Callable[[float], None]]:
    """Show a bar in per cent; yield a function of the share of the work that is
    done.
    """
    with count_bar(title, 100) as advance:
        yield by_percent(advance)
