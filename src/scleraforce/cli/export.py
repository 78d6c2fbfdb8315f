"""`scleraforce export`: recordings and answers in the formats of other programs."""

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scleraforce.cli.options import PATH, options
from scleraforce.cli.output import Command, Report
from scleraforce.errors import InputError

if TYPE_CHECKING:
    from scleraforce.recording.export import Row
    from scleraforce.recording.folder import Recording

TABLES = (".csv", ".json")
ENDINGS = (*TABLES, ".mcap", ".nrrd")


@click.command(cls=Command)
@click.argument("thing", type=PATH)
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True,
              help="File to write; its ending decides: .csv, .json, .mcap or .nrrd.")  # fmt: skip
@click.option("--answers", type=PATH, help="What evaluate, read or segment printed with --json on the recording: it "
              "joins the rows of its frames.")  # fmt: skip
@options("force", force="Replace a file that exists.")
def export(thing: Path, out: Path, answers: Path | None, force: bool) -> Report:
    """Write a recording, or a file of answers, for other programs.

    THING is a recording folder, or what evaluate, read or segment printed
    with --json. .csv and .json have a row for each frame: time, measured force,
    class, answers. .mcap has images, wrenches and rows as ROS 2 and Foxglove
    read them; .nrrd the frames as a sequence of 3D Slicer. The last two take a
    recording.

    Example: scleraforce export eye-1 --answers answers.json --out eye-1.csv
    """
    kind = out.suffix.lower()
    if kind not in ENDINGS:
        raise InputError(f"--out: {out}: give a name that ends in {', '.join(ENDINGS)}")
    if out.exists() and not force:
        raise InputError(f"{out}: exists already; choose another name, or --force to replace it")
    write = _export_recording if os.path.isdir(thing) else _export_answers
    rows = write(thing, out, answers)
    return Report({"out": str(out), "rows": rows}, [f"wrote {out}: {rows} frames"])


def _export_answers(thing: Path, out: Path, answers: Path | None) -> int:
    """Write the rows of a file of answers; return how many there are."""
    from scleraforce.recording.export import read_answers

    if answers is not None:
        raise InputError(f"--answers: {thing} is a file of answers already; give a recording folder for THING")
    rows = read_answers(thing)
    if out.suffix.lower() not in TABLES:
        raise InputError(
            f"--out: {out}: answers alone become .csv or .json; give their recording, and them as --answers"
        )
    _write_table({}, rows, out)
    return len(rows)


def _export_recording(thing: Path, out: Path, answers: Path | None) -> int:
    """Write a recording; return how many frames it has."""
    from scleraforce.recording.export import frame_rows, read_answers, with_answers
    from scleraforce.recording.folder import read_recording
    from scleraforce.recording.importing import clock_origin_s
    from scleraforce.study import ClassesStudy

    recording = read_recording(thing)
    kind = out.suffix.lower()
    if kind == ".nrrd":
        from scleraforce.recording.export import write_sequence

        if answers is not None:
            raise InputError(f"--answers: {out} has room for frames only; give a .csv, .json or .mcap")
        write_sequence(recording, out)
        return len(recording.frames)
    rows = frame_rows(recording, ClassesStudy())
    if answers is not None:
        rows = with_answers(rows, read_answers(answers), thing)
    if kind == ".mcap":
        from scleraforce.recording.export import write_mcap

        write_mcap(recording, rows, clock_origin_s(thing), out)
    else:
        _write_table(_stated(recording), rows, out)
    return len(rows)


def _stated(recording: "Recording") -> dict[str, Any]:
    """Return what recording.toml says, under its keys."""
    import tomllib

    from scleraforce.study.toml import format_record

    return tomllib.loads(format_record(recording.info))


def _write_table(stated: dict[str, Any], rows: "list[Row]", out: Path) -> None:
    from scleraforce.plain_json import finite
    from scleraforce.recording.export import csv_text
    from scleraforce.whole_files import write_whole

    if out.suffix.lower() == ".csv":
        write_whole(csv_text(rows), out)
    else:
        write_whole(json.dumps(finite({**stated, "frames": rows}), indent=2, allow_nan=False) + "\n", out)
