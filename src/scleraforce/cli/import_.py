"""`scleraforce import`: a laboratory's frames and force log as a recording folder."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from scleraforce import __version__
from scleraforce.cli.importing.options import OPTION, ImportAnswers, answer_options
from scleraforce.cli.output import count_bar, print_json, progress_bar, say

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from scleraforce.cli.importing.complete import Complete
    from scleraforce.formats.gather import Gathered
    from scleraforce.formats.greys import Greys
    from scleraforce.recording.files import Recording

__all__ = ["import_"]


def _like(ctx: click.Context, _: click.Parameter, folder: Path | None) -> Path | None:
    """Take what another recording was imported with as the defaults of the options."""
    if folder is not None:
        from scleraforce.formats.answers import answers_like

        ctx.default_map = answers_like(folder)
    return folder


@click.command("import")
@click.argument("sources", metavar="SOURCE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True,
              help="Recording folder to write; must not exist.")  # fmt: skip
@click.option("--like", type=click.Path(path_type=Path), is_eager=True, callback=_like, metavar="RECORDING",
              help="Take scanner, needle, sensor and the columns of the log from another recording.")  # fmt: skip
@answer_options
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
@click.pass_context
def import_(
    ctx: click.Context, /, sources: tuple[Path, ...], out: Path, like: Path | None, as_json: bool, **told: Any
) -> None:
    """Write a laboratory's frames and force log as a recording folder.

    A SOURCE is an image, a stack, a volume, a film, a ROS bag, a force log, or
    a folder of images (docs/formats.md lists the formats). What they do not
    state (scale, times, columns of a log, needle) is asked for; without a
    terminal, the command ends and names the option for each.

    RECORDING/preview.png shows the first frames with scale bars, and the force
    curve: look at it. RECORDING/import.json says where each value comes from.

    Example: scleraforce import scan.dcm forces.csv --out eye-3 --like eye-2
    """
    # Imported here: formats and figures take longer to import than the help to print.
    from scleraforce.cli.importing.complete import complete
    from scleraforce.cli.importing.questions import can_ask
    from scleraforce.cli.importing.told import entries, lines, record_text
    from scleraforce.formats.answers import IMPORT_RECORD
    from scleraforce.formats.imported import folder_when_whole, written

    ask = can_ask(as_json)
    with folder_when_whole(out) as part:
        gathered, answers = _gathered(sources, ImportAnswers(**told), ask)
        greys = _greys(gathered, answers)
        done = complete(gathered, greys, answers, _origins(ctx, like), ask)
        _write(part, done, greys)
        (part / IMPORT_RECORD).write_text(record_text(done, greys, answers), encoding="utf-8")
        _write_preview(written(part, out))
    if as_json:
        print_json(entries(out, done, greys))
    else:
        for line in lines(out, done, greys):
            say(line)


def _origins(ctx: click.Context, like: Path | None) -> dict[str, str]:
    """Return who told the value of each option that has one."""
    words = {ParameterSource.COMMANDLINE: OPTION, ParameterSource.DEFAULT_MAP: f"like {like}"}
    return {name: words[origin] for name in ctx.params if (origin := ctx.get_parameter_source(name)) in words}


def _gathered(sources: tuple[Path, ...], answers: ImportAnswers, ask: bool) -> "tuple[Gathered, ImportAnswers]":
    """Read the sources, asking until they leave nothing open."""
    from scleraforce.cli.importing.questions import answered
    from scleraforce.formats.gather import gather
    from scleraforce.formats.scan import UnansweredError
    from scleraforce.formats.sources import files_of

    while True:
        try:
            with count_bar("sources", len(files_of(sources))) as seen:
                return gather(sources, answers.asked(), seen), answers
        except UnansweredError as open_point:
            answers = answered(answers, open_point, ask)


def _greys(gathered: "Gathered", answers: ImportAnswers) -> "Greys":
    from scleraforce.formats.greys import find_greys

    scan = gathered.scan
    with progress_bar(scan.pictures(), "grey levels", len(scan.names)) as pictures:
        return find_greys(pictures, answers.grey_range, scan.names[0])


def _write(part: Path, done: "Complete", greys: "Greys") -> None:
    from scleraforce.formats.imported import frame_files, write_frames, write_log

    scan = done.gathered.scan

    def counts() -> "Iterator[tuple[str, float, NDArray[np.uint16]]]":
        with progress_bar(scan.pictures(), "frames", len(scan.names)) as pictures:
            for file, time_s, picture in zip(
                frame_files(scan.names), done.times.time_s.tolist(), pictures, strict=True
            ):
                yield file, time_s, greys.counts(picture)

    comment = f"imported by scleraforce {__version__}; import.json says from what"
    write_frames(part, done.info, comment, counts())
    if done.log is not None:
        write_log(part, done.log)


def _write_preview(recording: "Recording") -> None:
    from scleraforce.cli.importing.told import PREVIEW
    from scleraforce.report.files import write_figure
    from scleraforce.report.recording_preview import SHOWN_FRAMES, FirstFrame, draw_preview

    shown = recording.frames[:SHOWN_FRAMES]
    frames = [FirstFrame(entry.file, entry.time_s, recording.frame(entry)) for entry in shown]
    write_figure(draw_preview(recording, frames), recording.path / PREVIEW)
