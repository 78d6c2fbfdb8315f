"""`make bench`: every figure of speed from one run, beside what one would use instead.

Each part runs in a process of its own. RESULTS.md and results.json are written when all
of them are done; a run that is interrupted writes nothing. Parts that are named are
only printed.
"""

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import click

from provenance.stamps import new_stamp
from scleraforce.base.errors import InputError, ScleraforceError
from scleraforce.base.plain_json import finite_json
from scleraforce.base.whole_files import KINDS, read_text, write_whole
from scleraforce.front.cli.output import progress_bar
from speed.lock import alone
from speed.machine import machine_in_words
from speed.page import as_markdown, table_lines
from speed.parts import (
    another_load,
    axisymmetric,
    classifier,
    commands,
    dataset,
    finite_strain,
    frame,
    reader_training,
    static_solve,
    wire,
)
from speed.record import Results, Table, failed_table, table_of
from speed.run import ROOT, Run

# axisymmetric leaves the library to later parts, dataset the data set
PARTS: dict[str, Callable[[Run], Table]] = {
    module.__name__.rpartition(".")[2]: module.measure
    for module in (
        static_solve,
        another_load,
        finite_strain,
        axisymmetric,
        dataset,
        classifier,
        reader_training,
        frame,
        wire,
        commands,
    )
}
FIGURES = "results.json"
RELEASED = ROOT / "benchmarks" / "released.json"
PAGE = "RESULTS.md"
TO_END_S = 30.0  # that an interrupted part is given: a monitor has processes of its own
USUAL_FOLDER = ROOT / "benchmarks"
QUICK_FOLDER = ROOT / "out" / "bench"


_flag = partial(click.option, is_flag=True)


@click.command()
@click.argument("names", metavar="[PART]...", nargs=-1, type=click.Choice(list(PARTS)))
@_flag("--quick", help="Every part small, in some minutes: the figures mean nothing.")
@_flag("--training", help="Train the reader to the end (five minutes more).")
@_flag("--render", help="Only write the page anew from results.json.")
@_flag("--release", help="Keep results.json as what this release takes.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder of page and figures; out/bench with --quick.",
)
@click.option("--folder", type=click.Path(path_type=Path), hidden=True)
def main(
    names: tuple[str, ...],
    quick: bool,
    training: bool,
    render: bool,
    release: bool,
    out: Path | None,
    folder: Path | None,
) -> None:
    """Measure speed: all of it, written to files, or the PARTs that are named,
    printed.
    """
    if folder is not None:  # a part, for the process that runs them all
        table = PARTS[names[0]](Run(quick, folder, training))
        click.echo(json.dumps(asdict(table), allow_nan=False))
        return
    if names and (out or render or release):
        raise click.UsageError(
            "PARTs are printed, and nothing is written; leave --out, --render and"
            " --release out"
        )

    out = out or (QUICK_FOLDER if quick else USUAL_FOLDER)
    if release:
        kept = read_results(out / FIGURES)
        write_whole(as_text(kept), RELEASED)
        click.echo(f"wrote {RELEASED}")
        return
    if render:
        click.echo(f"wrote {_render(out)}")
        return

    start = perf_counter()
    machine = machine_in_words()
    made = str(new_stamp("make bench"))
    with (
        alone(),
        TemporaryDirectory(prefix="bench-", ignore_cleanup_errors=True) as folder_name,
    ):
        tables = _tables(names or tuple(PARTS), Run(quick, Path(folder_name), training))

    if names:
        for table in tables.values():
            click.echo("\n".join(["", table.title, *table_lines(table)]))
        return

    results = Results(
        made=made,
        quick=quick,
        machine=machine,
        seconds=perf_counter() - start,
        tables=tables,
    )
    out.mkdir(parents=True, exist_ok=True)
    write_whole(as_text(results), out / FIGURES)
    click.echo(f"wrote {out / FIGURES}, {_render(out)}")

    if failed := [name for name, table in tables.items() if table.failed]:
        raise ScleraforceError(f"{', '.join(failed)}: failed; RESULTS.md says how")


def _tables(names: Sequence[str], run: Run) -> dict[str, Table]:
    tables = {}
    for name in progress_bar(names, "benchmarks"):
        start = perf_counter()
        tables[name] = _in_process(name, run)
        click.echo(f"{name}: {perf_counter() - start:.0f} s", err=True)

    return tables


def _in_process(name: str, run: Run) -> Table:
    """Run a part in a process of its own; what it says goes to standard error."""
    command = [sys.executable, "-m", "speed", name, "--folder", str(run.folder)]
    command += ["--quick"] if run.quick else []
    command += ["--training"] if run.training else []
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            told, _ = process.communicate()
        except KeyboardInterrupt:
            # Ctrl-C has reached it as well, and it ends what it has started
            with suppress(subprocess.TimeoutExpired):
                process.wait(TO_END_S)

            process.kill()
            raise

    if process.returncode:
        words = f"code {process.returncode}; what it said is on the terminal"
        return failed_table(name, words)

    return table_of(json.loads(told.splitlines()[-1]))


def as_text(results: Results) -> str:
    """Return the text of the file that keeps a run's figures."""
    return json.dumps(finite_json(results.as_json()), indent=1, allow_nan=False) + "\n"


def read_results(path: Path) -> Results:
    """Read the figures that a file keeps.

    Raises:
        InputError: they cannot be read.
    """
    try:
        return Results.from_json(json.loads(read_text(path, KINDS["result"])))
    except (ValueError, KeyError, TypeError, AttributeError) as fault:
        raise InputError(f"{path}: not the figures of a run ({fault})") from fault


def _render(out: Path) -> Path:
    """Write the page of the figures that are kept in a folder."""
    results = read_results(out / FIGURES)
    released = read_results(RELEASED) if RELEASED.exists() else None
    write_whole(as_markdown(results, released), out / PAGE)
    return out / PAGE


if __name__ == "__main__":
    try:
        main(standalone_mode=False)
    except click.ClickException as fault:
        fault.show()
        sys.exit(fault.exit_code)
    except ScleraforceError as fault:
        click.echo(f"error: {fault}", err=True)
        sys.exit(2 if isinstance(fault, InputError) else 1)
    except (KeyboardInterrupt, click.Abort):
        if "--folder" not in sys.argv:
            # a part leaves that to the process that runs them all
            click.echo("interrupted; nothing was written", err=True)
        sys.exit(130)
