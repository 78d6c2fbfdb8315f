"""`scleraforce show` and `export`: an artefact in words, as a picture, or in the formats of other programs."""

import json
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import click

from scleraforce.cli.options import PATH, options
from scleraforce.cli.output import Command, Report
from scleraforce.errors import InputError
from scleraforce.plain_json import finite
from scleraforce.plain_text import wrapped
from scleraforce.recording import export as formats
from scleraforce.recording.folder import read_recording
from scleraforce.recording.importing import clock_origin_s
from scleraforce.study import ClassesStudy, format_record
from scleraforce.whole_files import write_whole

if TYPE_CHECKING:
    from scleraforce.report.shown import Thing

TABLES = (".csv", ".json")
ENDINGS = (*TABLES, ".mcap", ".nrrd")


@click.command(cls=Command)
@click.argument("thing", type=PATH)
@options("plot")
@click.option("--model", type=PATH, help="For a recording: model whose training limits are noted; default: the bundled "
              "reader.")  # fmt: skip
def show(thing: Path, plot: Path | None, model: Path | None) -> Report:
    """Describe THING: its kind and its content.

    THING is a study, a library, a data set, a model (or the name of a bundled
    one: default, living, paper, wall-finder), a recording, a calibration file,
    or the log of a black box; its kind is found from its content.

    Example: scleraforce show eye-a --plot eye-a.svg
    """
    from scleraforce.report.files import write_figure
    from scleraforce.report.shown import thing_at

    found = thing_at(thing, model)
    if plot is not None:
        write_figure(found.draw(), plot)
    written = [] if plot is None else [str(plot)]
    return Report(
        {"kind": found.kind, "path": str(thing), **found.facts, "wrote": written},
        [*_lines(thing, found), *(f"wrote {path}" for path in written)],
    )


def _lines(path: Path, found: "Thing") -> list[str]:
    said = [row for row in found.rows if row[1]]
    width = max(len(name) for name, _ in said) + 2
    rows = [wrapped(words, f"{name:<{width}}") for name, words in said]
    return [f"{path}: {found.kind}", "", *rows, *([""] if found.lines else []),
            *(fill(line, 80, subsequent_indent="    ") for line in found.lines)]  # fmt: skip


@click.command(cls=Command)
@click.argument("thing", type=PATH)
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True,
              help="File to write; its ending decides: .csv, .json, .mcap or .nrrd.")  # fmt: skip
@click.option("--answers", type=PATH, help="Output of evaluate, read or segment with --json on the recording, to "
              "add to the rows of its frames.")  # fmt: skip
@options("force", force="Replace a file that exists.")
def export(thing: Path, out: Path, answers: Path | None, force: bool) -> Report:
    """Write a recording, or a file of answers, for other programs.

    THING is a recording folder, or the output of evaluate, read or segment
    with --json. .csv and .json have a row for each frame: time, measured force,
    class, answers. .mcap has images, wrenches and rows for ROS 2 and Foxglove;
    .nrrd has the frames as a sequence for 3D Slicer. Both need a recording.

    Example: scleraforce export eye-1 --answers answers.json --out eye-1.csv
    """
    if out.suffix.lower() not in ENDINGS:
        raise InputError(f"--out: {out}: give a name that ends in {', '.join(ENDINGS)}")
    if out.exists() and not force:
        raise InputError(f"{out}: exists already; choose another name, or --force to replace it")
    rows = _exported(thing, out, answers)
    return Report({"out": str(out), "rows": rows}, [f"wrote {out}: {rows} frames"])


def _exported(thing: Path, out: Path, answers: Path | None) -> int:
    """Write a recording, or answers alone, in the format of the file's ending; return the number of frames."""
    kind = out.suffix.lower()
    if not os.path.isdir(thing):
        if answers is not None:
            raise InputError(f"--answers: {thing} is a file of answers already; give a recording folder for THING")
        rows = formats.read_answers(thing)
        if kind not in TABLES:
            way = "give their recording, and them as --answers"
            raise InputError(f"--out: {out}: answers alone become .csv or .json; {way}")
        return _write_table({}, rows, out)
    recording = read_recording(thing)
    if recording.info.oct.plane and kind not in TABLES:
        raise InputError(f"--out: {out}: has room for frames of one plane; give a .csv or .json")
    if kind == ".nrrd":
        if answers is not None:
            raise InputError(f"--answers: {out} has room for frames only; give a .csv, .json or .mcap")
        formats.write_sequence(recording, out)
        return len(recording.frames)
    rows = formats.frame_rows(recording, ClassesStudy())
    if answers is not None:
        rows = formats.with_answers(rows, formats.read_answers(answers), thing)
    if kind != ".mcap":
        return _write_table(tomllib.loads(format_record(recording.info)), rows, out)
    formats.write_mcap(recording, rows, clock_origin_s(thing), out)
    return len(rows)


def _write_table(stated: Mapping[str, Any], rows: list[formats.Row], out: Path) -> int:
    if out.suffix.lower() == ".csv":
        write_whole(formats.csv_text(rows), out)
    else:
        write_whole(json.dumps(finite({**stated, "frames": rows}), indent=2, allow_nan=False) + "\n", out)
    return len(rows)
