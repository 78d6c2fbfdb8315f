"""`make bench`: every figure of speed from one run, beside what one would use instead.

Each part runs in a process of its own. RESULTS.md, results.json and a picture are
written when all of them are done; a run that is interrupted writes nothing. Parts that
are named are only printed.
"""

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import click

from provenance.stamps import new_stamp
from scleraforce.base.errors import InputError, ScleraforceError
from scleraforce.base.plain_json import finite_json
from scleraforce.base.whole_files import KINDS, read_text, write_whole
from scleraforce.front.cli.output import progress_bar
from scleraforce.front.report.figure_files import write_figure
from speed.lock import alone
from speed.machine import machine_in_words
from speed.page import PICTURE, as_markdown, table_lines
from speed.parts import (
    another_load,
    axisymmetric,
    classifier,
    commands,
    dataset,
    finite_strain,
    frame,
    network,
    pipeline,
    reader_training,
    static_solve,
    wire,
)
from speed.picture import draw_solves
from speed.record import Results, Table, failed_table, table_of
from speed.run import OPTIONS, ROOT, Run

PARTS: dict[str, Callable[[Run], Table]] = {
    "static_solve": static_solve.measure,
    "another_load": another_load.measure,
    "finite_strain": finite_strain.measure,
    "axisymmetric": axisymmetric.measure,  # leaves the library
    "dataset": dataset.measure,  # leaves the data set
    "classifier": classifier.measure,
    "reader_training": reader_training.measure,
    "frame": frame.measure,
    "network": network.measure,
    "wire": wire.measure,
    "commands": commands.measure,
    "pipeline": pipeline.measure,
}
FIGURES = "results.json"
PAGE = "RESULTS.md"
TO_END_S = 30.0  # that an interrupted part is given: a monitor has processes of its own
USUAL_FOLDER = ROOT / "benchmarks"
QUICK_FOLDER = ROOT / "out" / "bench"


@click.command()
@click.argument("names", metavar="[PART]...", nargs=-1, type=click.Choice(list(PARTS)))
@click.option(
    "--quick",
    is_flag=True,
    help="Every part at reduced size, in some minutes: the figures mean nothing.",
)
@click.option(
    "--training",
    is_flag=True,
    help="Train the reader to the end (five minutes more), not a part of it.",
)
@click.option(
    "--reproduce", is_flag=True, help="Run `scleraforce reproduce` (ten minutes more)."
)
@click.option(
    "--tests", is_flag=True, help="Run the default tests (some minutes more)."
)
@click.option(
    "--render",
    is_flag=True,
    help="Measure nothing: write page and picture anew from results.json.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help=(
        "Folder of RESULTS.md, results.json and the picture; by "
        "default that of the benchmarks, out/bench with --quick."
    ),
)
@click.option(
    "--folder",
    type=click.Path(path_type=Path),
    hidden=True,
    help="What parts leave to later ones.",
)
def main(
    names: tuple[str, ...],
    quick: bool,
    render: bool,
    out: Path | None,
    folder: Path | None,
    **given: bool,
) -> None:
    """Measure speed: all of it, written to files, or the PARTs that are named,
    printed.
    """
    options = tuple(name for name in OPTIONS if given[name])
    if folder is not None:  # a part, for the process that runs them all
        click.echo(
            json.dumps(
                asdict(PARTS[names[0]](Run(quick, folder, options))), allow_nan=False
            )
        )
        return
    if names and (out or render):
        raise click.UsageError(
            "PARTs are printed, and nothing is written; leave --out and --render out"
        )

    out = out or (QUICK_FOLDER if quick else USUAL_FOLDER)
    if render:
        click.echo(f"wrote {', '.join(map(str, _render(out)))}")
        return

    with (
        alone(),
        TemporaryDirectory(prefix="bench-", ignore_cleanup_errors=True) as made,
    ):
        run = Run(quick, Path(made), options)
        if names:
            for table in _tables(names, run).values():
                click.echo("\n".join(["", table.title, *table_lines(table)]))

            return

        results = _measure(run)

    out.mkdir(parents=True, exist_ok=True)
    write_whole(
        json.dumps(finite_json(results.as_json()), indent=1, allow_nan=False) + "\n",
        out / FIGURES,
    )
    click.echo(f"wrote {', '.join(map(str, [out / FIGURES, *_render(out)]))}")

    if failed := [name for name, table in results.tables.items() if table.failed]:
        raise ScleraforceError(f"{', '.join(failed)}: failed; RESULTS.md says how")


def _measure(run: Run) -> Results:
    """Run all parts."""
    start = perf_counter()
    machine = machine_in_words()
    stamp = new_stamp("make bench")
    tables = _tables(tuple(PARTS), run)

    return Results(
        made=str(stamp),
        quick=run.quick,
        machine=machine,
        seconds=perf_counter() - start,
        tables=tables,
    )


def _tables(names: Sequence[str], run: Run) -> dict[str, Table]:
    tables = {}
    with progress_bar(names, "benchmarks") as bar:
        for name in bar:
            bar.set_postfix_str(name)
            start = perf_counter()
            tables[name] = _in_process(name, run)
            if not sys.stderr.isatty():
                click.echo(f"{name}: {perf_counter() - start:.0f} s", err=True)

    return tables


def _in_process(name: str, run: Run) -> Table:
    """Run a part in a process of its own; what it says goes to standard error."""
    words = [
        *(["--quick"] if run.quick else []),
        *(f"--{option}" for option in run.options),
        "--folder",
        run.folder,
    ]
    command = [sys.executable, "-m", "speed", name, *map(str, words)]

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
        return failed_table(
            name, f"code {process.returncode}; what it said is on the terminal"
        )

    return table_of(json.loads(told.splitlines()[-1]))


def _render(out: Path) -> list[Path]:
    """Write page and picture of the figures that are kept in a folder.

    Raises:
        InputError: they cannot be read.
    """
    try:
        results = Results.from_json(
            json.loads(read_text(out / FIGURES, KINDS["result"]))
        )
    except (ValueError, KeyError, TypeError, AttributeError) as fault:
        raise InputError(
            f"{out / FIGURES}: not the figures of a run ({fault})"
        ) from fault

    write_figure(draw_solves(results.tables["static_solve"].rows), out / PICTURE)
    write_whole(as_markdown(results), out / PAGE)
    return [out / PICTURE, out / PAGE]


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
