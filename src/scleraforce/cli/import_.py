"""`scleraforce import`: a laboratory's frames and force log as a recording folder."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click
from click.core import ParameterSource

from scleraforce.cli.options import GLOBE, Quantity
from scleraforce.cli.output import count_bar, print_json, say

Command = TypeVar("Command", bound=Callable[..., Any])


def _given(key: str) -> Quantity:
    """Return the type of a number that stays in the unit of its key, for `import.json` and `--like`."""
    return Quantity(key, in_si=False)


OPTIONS = (
    click.option("--axes", metavar="NAME,NAME,...", help="Order of the axes frame, depth and lateral in an array or "
                 "volume; of pictures frame,lateral,depth where A-scans lie along the rows."),
    click.option("--array", help="Name of the array in a .npz."),
    click.option("--width-mm", type=_given("width_mm"), help="Width of the frames; by default their own."),
    click.option("--depth-mm", type=_given("depth_mm"), help="Depth of the frames, as stored; by default their own."),
    click.option("--refractive-index", type=click.FloatRange(1.0, 2.0), help="By which depth is stretched; 1 "
                 "where the scanner has corrected it."),
    click.option("--bits", type=click.IntRange(8, 16), help="Bits of a 16-bit pixel that are used."),
    click.option("--grey-range", type=float, nargs=2, metavar="LOW HIGH", help="Pixel values that become black and "
                 "white; floats and wide numbers are scaled from their smallest and largest by default."),
    click.option("--rate-hz", type=click.FloatRange(1e-3, 1e6), help="Frames taken in a second."),
    click.option("--times", type=click.Path(path_type=Path), help="Table of the frames' times (time_s or another "
                 "unit), with a column of file names or in the frames' order."),
    click.option("--clock-offset-s", type=float, help="What the force log's clock shows more than the frames'."),
    click.option("--column", "columns", multiple=True, metavar="COLUMN=NAME:UNIT", help="Column of a force log: time, "
                 "fx, fy, fz, tx, ty, tz or status, like fz=Pull:mN; 1000/N where 1000 counts are 1 N. Once for each."),
    click.option("--axis", type=click.Choice(["fx", "fy", "fz"]), help="Axis of the force sensor along the needle."),
    click.option("--contact-sign", type=click.Choice(["1", "-1"]), help="Sign of that axis in contact."),
    click.option("--average-s", type=click.FloatRange(0.01, 60.0), help="Time over which a label averages; 2 by "
                 "default, shorter for a needle that moves."),
    click.option("--image-topic", help="Topic of the images in a ROS bag, where there are several."),
    click.option("--force-topic", help="Topic of the forces in a ROS bag, where there are several."),
    click.option("--by-arrival", is_flag=True, help="Take the times at which a bag's messages arrived, where they have "
                 "no capture stamp."),
    click.option("--eye", help="Name of the eye."),
    click.option("--thickness-um", type=_given("thickness_um"), help="Thickness of its wall, where it was measured."),
    click.option("--iop-mmhg", type=_given("iop_mmhg"), help="Its pressure at rest, where it was measured."),
    click.option("--globe", type=GLOBE, help="Whether it is infused or vented, or sealed; unknown by "
                 "default."),
    click.option("--gauge", type=click.IntRange(10, 36), help="Gauge of the needle."),
    click.option("--gap-mm", type=_given("gap_mm"), help="B-scan plane to needle axis."),
    click.option("--polar-angle-deg", type=_given("polar_angle_deg"), help="Contact, from the pole, where it is "
                 "known."),
)  # fmt: skip


def _import_options(command: Command) -> Command:
    """Add the options that are fields of `ImportOptions`."""
    for option in reversed(OPTIONS):
        command = option(command)
    return command


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
@_import_options
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
    **given: Any,
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
    from scleraforce.cli.import_terminal import asker, entries, lines
    from scleraforce.models import SHIPPED_READER
    from scleraforce.notebook.importing import write_imported
    from scleraforce.recording.sources import OPTION, ImportOptions

    words = {ParameterSource.COMMANDLINE: OPTION, ParameterSource.DEFAULT_MAP: f"like {like}"}
    origins = {name: words[origin] for name in ctx.params if (origin := ctx.get_parameter_source(name)) in words}
    questions = asker(as_json, {param.name or "": param.type for param in ctx.command.params})
    model = model or SHIPPED_READER
    done = write_imported(sources, out, ImportOptions(**given), origins, count_bar, questions, model)
    if as_json:
        print_json(entries(out, done))
    else:
        for line in lines(out, done):
            say(line)
