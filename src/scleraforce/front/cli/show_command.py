"""`scleraforce show` and `export`: an artefact in words, as a picture, or in the
formats of other programs.
"""

from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

import click

import scleraforce as sf
from scleraforce.front.cli.options import MODEL, PATH, THING, options
from scleraforce.front.cli.output import (
    Command,
    Report,
    wrapped,
)
from scleraforce.records.model_folder import SHIPPED, model_name

if TYPE_CHECKING:
    from scleraforce.front.report.description import Description


@click.command(cls=Command)
@click.argument("thing", type=THING)
@options("plot")
@click.option(
    "--model",
    type=MODEL,
    help=(
        "For a recording: model whose training limits are noted; default: the bundled "
        "reader."
    ),
)
def show(thing: Path, plot: Path | None, model: Path | None) -> Report:
    """Describe THING: its kind and its content.

    THING is a study, a library, a data set, a model (or the name of a bundled
    one: default, living, paper, wall-finder), a recording, a calibration file,
    or the log of a black box; its kind is found from its content.

    Example: scleraforce show eye-a --plot eye-a.svg
    """
    # 600 ms: Matplotlib and the models, not for `export` and --help
    from scleraforce.front.report.described_paths import thing_at
    from scleraforce.front.report.figure_files import write_figure

    found = thing_at(thing, model)
    if plot is not None:
        write_figure(found.draw(), plot)

    written = [] if plot is None else [str(plot)]
    name = model_name(thing) if thing in SHIPPED.values() else str(thing)
    return Report(
        {"kind": found.kind, "path": name, **found.facts, "wrote": written},
        [*_lines(name, found), *(f"wrote {path}" for path in written)],
    )


def _lines(name: str, found: "Description") -> list[str]:
    said = [row for row in found.rows if row[1]]
    width = max(len(fact) for fact, _ in said) + 2
    rows = [wrapped(words, f"{fact:<{width}}") for fact, words in said]
    return [
        f"{name}: {found.kind}",
        "",
        *rows,
        *([""] if found.lines else []),
        *(fill(line, 80, subsequent_indent="    ") for line in found.lines),
    ]


@click.command(cls=Command)
@click.argument("thing", type=PATH)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="File to write; its ending decides: .csv, .json, .mcap or .nrrd.",
)
@click.option(
    "--answers",
    type=PATH,
    help=(
        "Output of evaluate, read or segment with --json on the recording, to "
        "add to the rows of its frames."
    ),
)
@options("force", force="Replace a file that exists.")
def export(thing: Path, out: Path, answers: Path | None, force: bool) -> Report:
    """Write a recording, or a file of answers, for other programs.

    THING is a recording folder, or the output of evaluate, read or segment
    with --json. .csv and .json have a row for each frame: time, measured force,
    class, answers. .mcap has images, wrenches and rows for ROS 2 and Foxglove;
    .nrrd has the frames as a sequence for 3D Slicer. Both need a recording.

    Example: scleraforce export eye-1 --answers answers.json --out eye-1.csv
    """
    rows = sf.export(thing, out, answers=answers, replace=force)
    return Report({"out": str(out), "rows": rows}, [f"wrote {out}: {rows} frames"])
