"""`scleraforce import`: a laboratory's frames and force log as a recording folder."""

import sys
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from scleraforce.base.plain_text import printable
from scleraforce.base.units import from_si
from scleraforce.front.cli.field_flags import flag_of
from scleraforce.front.cli.options import (
    GLOBE,
    MODEL,
    PATH,
    PLANE,
    PlacedPlane,
    Quantity,
    RelaxationOption,
    added,
    planes_of,
)
from scleraforce.front.cli.output import (
    Command,
    Report,
    count_bar,
    is_json,
    say,
    worded,
    wrapped,
)
from scleraforce.recordings.formats.picture_streams import UnansweredError
from scleraforce.recordings.import_answers import (
    Asker,
    LikeRecording,
    PreparedImport,
    Question,
    read_like,
)
from scleraforce.recordings.import_sources import OPTION, ImportOptions
from scleraforce.records.model_folder import SHIPPED_READER
from scleraforce.records.remark import sentences

OPEN = "-"  # leaves an optional question open
UNITS = {"_mm": "mm", "_um": "µm"}


class ClockOffset(click.ParamType[float | str]):
    """A number of seconds, or `auto`."""

    name = "s|auto"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float | str:
        """Return the number, or "auto"."""
        if value == "auto":
            return "auto"
        return click.FLOAT.convert(value, param, ctx)


_given = partial(Quantity, in_si=False)
OPTIONS = (
    click.option(
        "--axes",
        metavar="NAME,NAME,...",
        help=(
            "Order of the axes frame, depth and lateral in an array or "
            "volume; of pictures frame,lateral,depth where A-scans lie along the rows."
        ),
    ),
    click.option(
        "--flip",
        type=click.Choice(["rows", "columns"]),
        help="Turn pictures that are upside down (rows) or mirrored (columns).",
    ),
    click.option("--array", help="Name of the array in a .npz."),
    click.option(
        "--width-mm",
        type=_given("width_mm"),
        help="Width of the frames; default: the file's.",
    ),
    click.option(
        "--depth-mm",
        type=_given("depth_mm"),
        help="Depth of the frames as stored; default: the file's.",
    ),
    click.option(
        "--refractive-index",
        type=click.FloatRange(1.0, 2.0),
        help="Refractive index of the depth axis; 1 if the scanner has corrected it.",
    ),
    click.option(
        "--bits",
        type=click.IntRange(8, 16),
        help="Bits of a 16-bit pixel that are used.",
    ),
    click.option(
        "--first-frame",
        type=click.IntRange(1),
        help=(
            "First frame to import, counted from 1; --times and "
            "--rate-hz are of the frames that are imported."
        ),
    ),
    click.option("--last-frame", type=click.IntRange(1), help="Last frame to import."),
    click.option(
        "--grey-range",
        type=float,
        nargs=2,
        metavar="LOW HIGH",
        help=(
            "Pixel values that become black and "
            "white; default for floats and wide numbers: the smallest and the largest."
        ),
    ),
    click.option(
        "--rate-hz", type=click.FloatRange(1e-3, 1e6), help="Frames per second."
    ),
    click.option(
        "--times",
        type=PATH,
        help=(
            "Table of the frames' times (time_s or another unit, or dates), with a"
            " column of file names or in the frames' order."
        ),
    ),
    click.option(
        "--frames-by",
        metavar="numbers|times[:UNIT]|order",
        help=(
            "What orders and times frames in files of their own: the numbers in their"
            " names (or DICOM's), of which a missing one is a missing frame at"
            " --rate-hz; the times in their names; or the order in which they are"
            " listed, evenly spaced. Asked where numbers have gaps or repeats."
        ),
    ),
    click.option(
        "--clock-offset-s",
        type=ClockOffset(),
        help=(
            "Force log's clock minus the frames' clock, in seconds; 0: they share one"
            " clock. auto, the default unless one bag has both: found from the dents."
        ),
    ),
    click.option(
        "--column",
        "columns",
        multiple=True,
        metavar="COLUMN=NAME:UNIT",
        help=(
            "Column of a force log: time, fx, fy, fz, tx, ty, tz or status, like"
            " fz=Pull:mN; 1000/N where 1000 counts are 1 N. Once for each."
        ),
    ),
    click.option(
        "--axis",
        type=click.Choice(["fx", "fy", "fz"]),
        help="Axis of the force sensor along the needle.",
    ),
    click.option(
        "--contact-sign",
        type=click.Choice(["1", "-1"]),
        help="Sign of that axis in contact.",
    ),
    click.option(
        "--average-s",
        type=click.FloatRange(0.01, 60.0),
        help="Averaging time of a label; default: 2; give less for a moving needle.",
    ),
    click.option(
        "--range-n",
        type=click.FloatRange(1e-3, 1e6),
        help="Largest force that the sensor measures; larger readings are none.",
    ),
    click.option(
        "--image-topic", help="Topic of the images in a ROS bag, if it has several."
    ),
    click.option(
        "--force-topic", help="Topic of the forces in a ROS bag, if it has several."
    ),
    click.option(
        "--by-arrival",
        is_flag=True,
        help=(
            "Use the arrival times of a bag's messages, if they have no capture stamp."
        ),
    ),
    click.option("--eye", help="Name of the eye."),
    click.option(
        "--thickness-um",
        type=_given("thickness_um"),
        help="Measured thickness of the wall.",
    ),
    click.option(
        "--iop-mmhg",
        type=_given("iop_mmhg"),
        help="Measured intraocular pressure at rest.",
    ),
    click.option(
        "--globe",
        type=GLOBE,
        help="Open (infused or vented), or sealed (closed); default: unknown.",
    ),
    click.option("--gauge", type=click.IntRange(10, 36), help="Gauge of the needle."),
    click.option(
        "--gap-mm",
        type=_given("gap_mm"),
        help="Distance of the B-scan plane from the needle axis.",
    ),
    click.option(
        "--polar-angle-deg",
        type=_given("polar_angle_deg"),
        help="Measured polar angle of the contact.",
    ),
    click.option(
        "--relaxation",
        type=RelaxationOption(),
        metavar="none|SHARE:SECONDS,...",
        help=(
            "How the tissue relaxes: the share of a held force that is lost, and its"
            " time constant; none: it is elastic; default: unknown."
        ),
    ),
)


def _like(
    ctx: click.Context, _: click.Parameter, folder: Path | None
) -> LikeRecording | None:
    """Take the answers of another recording for the defaults of options."""
    if folder is None:
        return None

    like = read_like(folder)
    ctx.default_map = like.answers
    return like


@click.command("import", cls=Command)
@click.argument("sources", metavar="SOURCE...", nargs=-1, required=True, type=PATH)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Recording folder to write; must not exist.",
)
@click.option(
    "--like",
    type=PATH,
    is_eager=True,
    callback=_like,
    metavar="RECORDING",
    help=(
        "Take scanner, needle, sensor and the form of the sources from another"
        " recording; a note names what is not taken, of its eye and session."
    ),
)
@click.option(
    "--plane",
    "planes",
    cls=PlacedPlane,
    metavar=PLANE,
    multiple=True,
    help=(
        "Plane of the frames that follow: its distance from the scanner's axis, and the"
        " direction of its columns. The n-th frames of all planes are of one moment."
    ),
)
@added(OPTIONS)
@click.option(
    "--model",
    type=MODEL,
    help="Model whose training limits are noted; default: the bundled reader.",
)
@click.pass_context
def import_(
    ctx: click.Context,
    /,
    sources: tuple[Path, ...],
    out: Path,
    like: LikeRecording | None,
    planes: tuple[tuple[int, str], ...],
    model: Path | None,
    **given: Any,
) -> Report:
    """Write a laboratory's frames and force log as a recording folder.

    A SOURCE is an image, a stack, a volume, a film, a ROS bag, a force log, or
    a folder of images (docs/formats.md lists the formats). The command prompts
    for missing metadata (scale, times, columns of a log, needle); without a
    terminal, it ends and names the option for each.

    RECORDING/preview.png shows the first frames with scale bars, and the force
    curve: look at it. RECORDING/import.json says where each value comes from.

    Examples: scleraforce import scan.dcm forces.csv --out eye-3 --like eye-2

    scleraforce import forces.csv --plane along:0:0 along --plane across:0:90
    across --out eye-4
    """
    # 280 ms: Numba and the models, not for --help
    from scleraforce.front.api.importing import (
        ImportRequest,
        import_result,
        write_imported,
    )

    words = {
        ParameterSource.COMMANDLINE: OPTION,
        ParameterSource.DEFAULT_MAP: f"like {like.path}" if like else "",
    }
    origins = {
        name: words[origin]
        for name in ctx.params
        if (origin := ctx.get_parameter_source(name)) in words
    }
    asker = _asker({param.name or "": param.type for param in ctx.command.params})
    request = ImportRequest(
        sources=sources,
        out=out,
        answers=ImportOptions(**given),
        origins=origins,
        planes=planes_of(sources, planes) if planes else (),
        like=like,
    )
    done = write_imported(request, count_bar, asker, model or SHIPPED_READER)
    result = import_result(done, out)

    return Report(
        result,
        [*map(wrapped, _lines(done)), f"wrote {out}; look at {result['preview']}"],
    )


def _lines(done: PreparedImport) -> list[str]:
    scan = done.gathered.scan
    scanner = done.info.scan
    source = done.sources
    log = done.log
    shown = len(done.gathered.frames.names)
    planes = len(scanner.planes)
    count = (
        "1 frame"
        if shown == 1
        else f"{shown} frames{f' in {planes} planes' * bool(planes)}"
    )
    first_s = done.times.time_s[0]
    last_s = done.times.time_s[-1]
    begin = (
        f"; 0 s is {done.origin_s:.0f} s of the sources' clock" if done.origin_s else ""
    )
    found = [
        (
            f"{count} of {scan.rows} x {scan.columns} pixels (depth x lateral),"
            f" {scanner.bits} bits; {from_si(scanner.width_m, 'mm'):.4g} mm wide"
            f" ({source['width_mm']}), {from_si(scanner.depth_m, 'mm'):.4g} mm deep"
            f" ({source['depth_mm']}), refractive index {scanner.refractive_index:g}"
            f" ({source['refractive_index']})"
        ),
        f"times: {first_s:.3f} to {last_s:.3f} s ({source['times']}){begin}",
    ]

    if log is not None:
        columns = ", ".join(
            column.answer() for column in done.gathered.columns
        ) or ", ".join(log.columns)
        force = done.info.force
        sign = (
            ""
            if force is None
            else f"; contact is {'+' if force.contact_sign > 0 else '-'}{force.axis}"
        )
        found.append(
            f"forces: {len(log.time_s)} samples, {log.sample_rate_hz:.4g} a second"
            f" ({columns}){sign}"
        )

    return [*found, *(f"note: {words}" for words in sentences(done.remarks))]


def _asker(kinds: Mapping[str, click.ParamType[Any]]) -> Asker | None:
    if is_json() or not _can_ask():
        return None

    def ask(questions: Mapping[str, Question]) -> dict[str, Any]:
        return {
            name: _answer(name, question, kinds[name])
            for name, question in questions.items()
        }

    return Asker(_settle, ask, lambda fault: say(f"error: {fault}", err=True))


def _can_ask() -> bool:
    return sys.stdin.isatty() and sys.stderr.isatty()


def _settle(answers: ImportOptions, open_point: UnansweredError) -> ImportOptions:
    click.echo(printable(worded(str(open_point))), err=True)
    name = open_point.field
    if name == "by_arrival":
        return replace(
            answers, by_arrival=click.confirm("by arrival", abort=True, err=True)
        )
    if open_point.forms:
        shorts = [form.partition("=")[0] for form in open_point.forms]
        return replace(answers, columns=(*answers.columns, *map(_column, shorts)))

    answer: dict[str, Any] = {name: click.prompt(flag_of(name), err=True)}
    return replace(answers, **answer)


def _column(short: str) -> str:
    answer = click.prompt(f"{short} (NAME:UNIT)", err=True)
    return f"{short}={answer.strip().removeprefix(f'{short}=')}"


def _answer(name: str, question: Question, kind: click.ParamType[Any]) -> Any:
    def checked(text: str) -> Any:
        if question.optional and text.strip() == OPEN:
            return None
        value = kind.convert(text.strip(), None, None)
        if fault := question.fault(value):
            raise click.UsageError(fault)
        return value

    unit = next(
        (
            f", in {printed}"
            for ending, printed in UNITS.items()
            if name.endswith(ending)
        ),
        "",
    )
    words = (
        f"{worded(question.words)}{unit}"
        f"{f' ({OPEN}: not known)' if question.optional else ''}"
    )
    default = OPEN if question.optional else None

    if question.offered is not None:
        words = f"{words}; {question.offer} {question.offered:g}"
        default = f"{question.offered:g}"

    return click.prompt(words, default=default, value_proc=checked, err=True)
