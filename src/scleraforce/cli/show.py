"""`scleraforce show`: a study, library, data set, model, recording, calibration or decision log, in words or drawn."""

from datetime import UTC, datetime
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from scleraforce.cli.options import PATH, options
from scleraforce.cli.output import Command, Report, progress_bar, refuse_existing
from scleraforce.errors import InputError
from scleraforce.plain_text import wrapped

if TYPE_CHECKING:
    from scleraforce.report.shown.kinds import Thing


@click.command(cls=Command)
@click.argument("thing", type=PATH)
@options("plot", "html", plot="Draw it to this file as well (PNG, SVG, PDF).",
         html="Of a recording: page to browse its frames, read with --model; must not exist.")  # fmt: skip
@click.option("--model", type=PATH, help="Of a recording: the model that reads the frames of --html, and whose limits "
              "are noted; by default those of the bundled reader.")  # fmt: skip
@options("calibration", "finder", calibration="File of `calibrate`: gives a reader the eye's modulus.")
@click.pass_context
def show(
    ctx: click.Context,
    /,
    thing: Path,
    plot: Path | None,
    html: Path | None,
    model: Path | None,
    calibration: Path | None,
    finder: Path | None,
) -> Report:
    """Say what THING is and what is in it.

    THING is a study, a library, a data set, a model (or the name of one that
    ships: default, paper, wall-finder), a recording, a calibration file, or
    the log of a black box; its kind is found from its content.

    Example: scleraforce show eye-a --plot eye-a.svg
    """
    from scleraforce.report.files import check_figure_path, write_figure
    from scleraforce.report.shown.kinds import thing_at

    if html is not None and model is None:
        raise InputError("--html: shows what a model reads; give --model, like default")
    for name, flag in (("calibration", "--calibration"), ("finder", "--wall-finder")):
        if html is None and ctx.get_parameter_source(name) != ParameterSource.DEFAULT:
            raise InputError(f"{flag}: only used with --html")
    if plot is not None:
        check_figure_path(plot)
    refuse_existing(plot, html)
    found = thing_at(thing, model)
    if html is not None and found.kind != "recording":
        raise InputError(f"{thing}: a {found.kind}; --html browses recordings")
    if html is not None and model is not None:
        _write_page(thing, html, model, calibration, finder)
    if plot is not None:
        write_figure(found.draw(), plot)
    written = [str(path) for path in (plot, html) if path is not None]
    return Report(
        {"kind": found.kind, "path": str(thing), **found.facts, "wrote": written},
        [*_lines(thing, found), *(f"wrote {path}" for path in written)],
    )


def _write_page(recording: Path, html: Path, model: Path, calibration: Path | None, finder: Path | None) -> None:
    """Read every frame and write the page that browses them."""
    import scleraforce as sf
    from scleraforce.report.browser import write_browser_html

    reader = sf.load_model(model, wall_finder=finder)
    frames = len(sf.read_recording(recording).frames)
    with progress_bar(range(2 * frames), "frames") as bar:
        evaluation = sf.evaluate(reader, recording, calibration, progress=bar.update)
        write_browser_html(evaluation, html, datetime.now(UTC), bar.update)


def _lines(path: Path, found: "Thing") -> list[str]:
    width = max(len(name) for name, _ in found.rows) + 2
    rows = [wrapped(words, f"{name:<{width}}") for name, words in found.rows]
    return [f"{path}: {found.kind}", "", *rows, *([""] if found.lines else []),
            *(fill(line, 80, subsequent_indent="    ") for line in found.lines)]  # fmt: skip
