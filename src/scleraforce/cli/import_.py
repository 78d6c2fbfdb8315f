"""`scleraforce import`: a laboratory's frames and force log as a recording folder."""

from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from scleraforce.cli.importing.options import answer_options
from scleraforce.cli.output import count_bar, print_json, say


def _like(ctx: click.Context, _: click.Parameter, folder: Path | None) -> Path | None:
    """Take what another recording was imported with as the defaults of the options."""
    if folder is not None:
        from scleraforce.recording.importing import answers_like

        ctx.default_map = answers_like(folder)
    return folder


@click.command("import")
@click.argument("sources", metavar="SOURCE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True,
              help="Recording folder to write; must not exist.")  # fmt: skip
@click.option("--like", type=click.Path(path_type=Path), is_eager=True, callback=_like, metavar="RECORDING",
              help="Take scanner, needle, sensor and the columns of the log from another recording.")  # fmt: skip
@answer_options
@click.option("--model", type=click.Path(path_type=Path), help="Model whose limits are noted; by default the reader "
              "that ships.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
@click.pass_context
def import_(
    ctx: click.Context,
    /,
    sources: tuple[Path, ...],
    out: Path,
    like: Path | None,
    model: Path | None,
    as_json: bool,
    **told: Any,
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
    from scleraforce.cli.importing.questions import asker
    from scleraforce.cli.importing.told import entries, lines
    from scleraforce.models.shipped import SHIPPED_READER
    from scleraforce.notebook.importing import write_imported
    from scleraforce.recording.importing import ImportAnswers

    asked, origins = ImportAnswers(**told), _origins(ctx, like)
    imported = write_imported(sources, out, asked, origins, count_bar, asker(as_json), model or SHIPPED_READER)
    if as_json:
        print_json(entries(out, imported.done, imported.greys))
    else:
        for line in lines(out, imported.done, imported.greys):
            say(line)


def _origins(ctx: click.Context, like: Path | None) -> dict[str, str]:
    """Return who told the value of each option that has one."""
    from scleraforce.recording.importing import OPTION

    words = {ParameterSource.COMMANDLINE: OPTION, ParameterSource.DEFAULT_MAP: f"like {like}"}
    return {name: words[origin] for name in ctx.params if (origin := ctx.get_parameter_source(name)) in words}
