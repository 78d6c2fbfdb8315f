"""`scleraforce doctor`: the installation checked."""

import platform
import time
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from scleraforce import __version__
from scleraforce.cli.output import print_json, progress_bar, say
from scleraforce.plain_text import wrapped

if TYPE_CHECKING:
    from scleraforce.installation import Finding

INDENT = " " * 25


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def doctor(as_json: bool) -> None:
    """Check this installation: packages, machine, and three small runs.

    A load path is solved, a frame read and a reader trained, ten seconds in
    all. What is `missing` one can do without, and the line below says how to
    get it; where anything has `failed`, the exit code is 1.
    """
    start = time.perf_counter()
    found = list(_findings())
    about = {
        "scleraforce": __version__,
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
    }
    ok = all(finding.state != "failed" for finding in found)
    seconds = time.perf_counter() - start
    if as_json:
        print_json({**about, "ok": ok, "findings": [asdict(finding) for finding in found], "seconds": seconds})
    else:
        say(f"scleraforce {__version__}, Python {about['python']}, {about['system']}")
        for finding in found:
            say("\n".join(_lines(finding)))
    if not ok:
        raise click.exceptions.Exit(1)


def _findings() -> "Iterator[Finding]":
    """Yield what was found, behind a bar."""
    # Imported here: mechanics takes longer to import than the help to print.
    from scleraforce.installation import TRIALS, machine, packages, tried

    yield from packages()
    yield from machine()
    for name in progress_bar(TRIALS, "trials", total=len(TRIALS)):
        yield tried(name)


def _lines(finding: "Finding") -> list[str]:
    head = f"{finding.state:<8} {finding.name:<15} "
    remedy = [wrapped(finding.remedy, f"{INDENT}-> ")] if finding.remedy else []
    return [wrapped(finding.found, head), *remedy]
