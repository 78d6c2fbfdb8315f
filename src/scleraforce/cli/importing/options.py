"""The options of `import`: the fields of `recording.importing.ImportAnswers`."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from scleraforce.cli.quantities import Possible
from scleraforce.study.eye import GLOBES

Command = TypeVar("Command", bound=Callable[..., Any])

LENGTH, GAP = Possible("width_mm"), Possible("gap_mm")
THICKNESS, IOP = Possible("thickness_um"), Possible("iop_mmhg")
INDEX, RATE = click.FloatRange(1.0, 2.0), click.FloatRange(1e-3, 1e6)
BITS, GAUGE = click.IntRange(8, 16), click.IntRange(10, 36)
AXIS, SIGN = click.Choice(["fx", "fy", "fz"]), click.Choice(["1", "-1"])
OPTIONS = (
    click.option("--axes", metavar="NAME,NAME,...", help="Order of the axes frame, depth and lateral in an array or "
                 "volume; of pictures frame,lateral,depth where A-scans lie along the rows."),
    click.option("--array", help="Name of the array in a .npz."),
    click.option("--width-mm", type=LENGTH, help="Width of the frames; by default their own."),
    click.option("--depth-mm", type=LENGTH, help="Depth of the frames, as stored; by default their own."),
    click.option("--refractive-index", type=INDEX, help="By which depth is stretched; 1 where the scanner has "
                 "corrected it."),
    click.option("--bits", type=BITS, help="Bits of a 16-bit pixel that are used."),
    click.option("--grey-range", type=float, nargs=2, metavar="LOW HIGH", help="Pixel values that become black and "
                 "white; floats and wide numbers are scaled from their smallest and largest by default."),
    click.option("--rate-hz", type=RATE, help="Frames taken in a second."),
    click.option("--times", type=click.Path(path_type=Path), help="Table of the frames' times (time_s or another "
                 "unit), with a column of file names or in the frames' order."),
    click.option("--clock-offset-s", type=float, help="What the force log's clock shows more than the frames'."),
    click.option("--column", "columns", multiple=True, metavar="COLUMN=NAME:UNIT", help="Column of a force log: time, "
                 "fx, fy, fz, tx, ty, tz or status, like fz=Pull:mN; 1000/N where 1000 counts are 1 N. Once for each."),
    click.option("--axis", type=AXIS, help="Axis of the force sensor along the needle."),
    click.option("--contact-sign", type=SIGN, help="Sign of that axis in contact."),
    click.option("--average-s", type=click.FloatRange(0.01, 60.0), help="Time over which a label averages; 2 by "
                 "default, shorter for a needle that moves."),
    click.option("--image-topic", help="Topic of the images in a ROS bag, where there are several."),
    click.option("--force-topic", help="Topic of the forces, likewise."),
    click.option("--by-arrival", is_flag=True, help="Take the times at which a bag's messages arrived, where they have "
                 "no capture stamp."),
    click.option("--eye", help="Name of the eye."),
    click.option("--thickness-um", type=THICKNESS, help="Thickness of its wall, where it was measured."),
    click.option("--iop-mmhg", type=IOP, help="Its pressure at rest, where it was measured."),
    click.option("--globe", type=click.Choice(GLOBES), help="Whether it is infused or vented, or sealed; unknown by "
                 "default."),
    click.option("--gauge", type=GAUGE, help="Gauge of the needle."),
    click.option("--gap-mm", type=GAP, help="B-scan plane to needle axis."),
    click.option("--polar-angle-deg", type=Possible("polar_angle_deg"), help="Contact, from the pole, where it is "
                 "known."),
)  # fmt: skip


def answer_options(command: Command) -> Command:
    """Add the options to a command: the fields of `ImportAnswers`."""
    for option in reversed(OPTIONS):
        command = option(command)
    return command
