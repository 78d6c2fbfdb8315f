"""`scleraforce show`: a study, library, data set, model, recording, calibration or decision log, in words or drawn."""

from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

import click

from scleraforce.cli.output import print_json, progress_bar, say
from scleraforce.cli.wall_finder_option import finder_folder, wall_finder_option
from scleraforce.errors import InputError
from scleraforce.plain_text import wrapped

if TYPE_CHECKING:
    from scleraforce.report.shown.kinds import Thing


@click.command()
@click.argument("thing", type=click.Path(path_type=Path))
@click.option("--plot", type=click.Path(path_type=Path), help="Draw it to this file as well (PNG, SVG, PDF).")
@click.option("--html", type=click.Path(path_type=Path),
              help="Of a recording: page to browse its frames, read with --model; must not exist.")  # fmt: skip
@click.option("--model", type=click.Path(path_type=Path), help="Of a recording: the model that reads the frames of "
              "--html, and whose limits are noted; by default those of the reader that ships.")  # fmt: skip
@click.option("--calibration", type=click.Path(path_type=Path),
              help="File of `calibrate`: gives a reader the eye's modulus.")  # fmt: skip
@wall_finder_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def show(
    thing: Path,
    plot: Path | None,
    html: Path | None,
    model: Path | None,
    calibration: Path | None,
    finder: Path | None,
    as_json: bool,
) -> None:
    """Say what THING is and what is in it.

    THING is a study, a library, a data set, a model (or the name of one that
    ships: default, paper, wall-finder), a recording, a calibration file, or
    the log of a black box; which of them is seen by itself.

    Example: scleraforce show eye-a --plot eye-a.svg
    """
    from scleraforce.report.shown.kinds import thing_at

    _check_options(plot, html, model, calibration, finder)
    found = thing_at(thing, model)
    if html is not None and found.kind != "recording":
        raise InputError(f"{thing}: a {found.kind}; --html browses recordings")
    if html is not None and model is not None:
        _write_page(thing, html, model, calibration, finder)
    if plot is not None:
        from scleraforce.report.files import write_figure

        write_figure(found.draw(), plot)
    written = [path for path in (plot, html) if path is not None]
    if as_json:
        print_json({"kind": found.kind, "path": str(thing), **found.facts, "wrote": [str(path) for path in written]})
        return
    for line in _lines(thing, found):
        say(line)
    for path in written:
        say(f"wrote {path}")


def _check_options(
    plot: Path | None, html: Path | None, model: Path | None, calibration: Path | None, finder: Path | None
) -> None:
    """Refuse what cannot be written, and options that would not be used."""
    from scleraforce.report.files import check_figure_path

    if html is not None and model is None:
        raise InputError("--html: shows what a model reads; give --model, like default")
    for name, given in (("--calibration", calibration), ("--wall-finder", finder)):
        if given is not None and html is None:
            raise InputError(f"{name}: only used with --html")
    if plot is not None:
        check_figure_path(plot)
    for path in (plot, html):
        if path is not None and path.exists():
            raise InputError(f"{path}: exists already; remove it or choose another name")


def _write_page(recording: Path, html: Path, model: Path, calibration: Path | None, finder: Path | None) -> None:
    """Read every frame and write the page that browses them."""
    from datetime import UTC, datetime

    from scleraforce.known.calibration_file import read_calibration
    from scleraforce.reader import load_model
    from scleraforce.reader.evaluate import evaluate_recordings
    from scleraforce.recording.folder import read_recording
    from scleraforce.report.browser import write_browser_html

    reader = load_model(model, finder=finder_folder(finder))
    summary = None if calibration is None else read_calibration(calibration)
    frames = len(read_recording(recording).frames)
    with progress_bar(range(2 * frames), "frames") as bar:
        evaluation = evaluate_recordings(reader, [recording], summary, bar.update)
        write_browser_html(evaluation, html, datetime.now(UTC), bar.update)


def _lines(path: Path, found: "Thing") -> list[str]:
    width = max(len(name) for name, _ in found.rows) + 2
    rows = [wrapped(words, f"{name:<{width}}") for name, words in found.rows]
    return [f"{path}: {found.kind}", "", *rows, *([""] if found.lines else []),
            *(fill(line, 80, subsequent_indent="    ") for line in found.lines)]  # fmt: skip
