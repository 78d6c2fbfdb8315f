"""`scleraforce simulate` and `phantom`: virtual eyes; `scanner`: measure the scanner
that is to image them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from click.core import ParameterSource

import scleraforce as sf
from scleraforce.base.errors import FrameError, InputError
from scleraforce.base.units import from_si, to_si
from scleraforce.base.version import __version__
from scleraforce.base.whole_files import write_whole
from scleraforce.front.api.progress import Bars
from scleraforce.front.cli.options import (
    FRAME_SIZE,
    PATH,
    PLANE,
    Quantity,
    in_si,
    new_file,
    options,
)
from scleraforce.front.cli.output import (
    Command,
    Report,
    count_bar,
    progress_bar,
    share_bar,
    wrapped,
)
from scleraforce.records.fields import field_key, field_unit
from scleraforce.records.frame import OpenedFrame
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan, parse_plane
from scleraforce.records.study import PhantomStudy, Study

if TYPE_CHECKING:
    from scleraforce.lab.scanner.measured_scanner import MeasuredScanner
    from scleraforce.lab.scanner.scanner_display import ImagedEye
    from scleraforce.lab.virtual_eye import SimulatedEye
    from scleraforce.wall.wall_network import WallFinder

STUDYS = "the study's"
GLOBE = f"{STUDYS} (open, if it sets none); sealed needs finite strain"
RIGIDITY = f"{STUDYS} (0.03, if it sets none)"
MECHANICS = (
    "Small displacements (linear) or large ones; default: the study's (linear, if it"
    " sets none)."
)
THICKNESS_M = to_si(600.0, "um")


@click.command(cls=Command)
@options("study", "thickness_m", required=("thickness_m",))
@click.option(
    "--force-mn",
    "force_n",
    type=Quantity("force_mn"),
    help="Force of the needle, along the inward normal; this or --displacement-mm.",
)
@click.option(
    "--displacement-mm",
    "displacement_m",
    type=Quantity("displacement_mm"),
    help="Find the force that moves the contact inward by this, from rest.",
)
@options(
    "youngs_modulus_pa",
    "iop_pa",
    "polar_angle_rad",
    "gap_m",
    "globe",
    "rigidity_pa13_per_m3",
    "mechanics",
    default=STUDYS,
    polar_angle_rad="the middle of the study's range",
    globe=GLOBE,
    rigidity_pa13_per_m3=RIGIDITY,
    mechanics=MECHANICS,
)
@click.option(
    "--vtu",
    type=PATH,
    callback=new_file,
    help="File to write: the mesh and its displacement (VTK).",
)
@options(
    "plot", plot="Picture to write: the deformed mesh and the slice (PNG, SVG, PDF)."
)
def simulate(study: Study, vtu: Path | None, plot: Path | None, **given: Any) -> Report:
    """Bend one eye by one force: displacement, slice, picture.

    Example: scleraforce simulate --thickness-um 500 --force-mn 30 --plot eye.png

    The force that makes a dent: scleraforce simulate --thickness-um 500
    --displacement-mm 1
    """
    if (given["force_n"] is None) is (given["displacement_m"] is None):
        raise click.UsageError("give either --force-mn or --displacement-mm")

    # 500 ms: Numba and SciPy, not for --help
    from scleraforce.front.api.simulating import declared_study
    from scleraforce.lab.virtual_eye import write_vtu

    study = declared_study(
        study,
        *(given.pop(name) for name in ("mechanics", "globe", "rigidity_pa13_per_m3")),
    )
    needle = Needle(polar_rad=given.pop("polar_angle_rad"))
    start = perf_counter()

    with share_bar("load path") as reach:
        eye = sf.simulate(study, needle=needle, progress=reach, **given)

    seconds = perf_counter() - start
    if vtu is not None:
        write_vtu(eye, vtu)

    if plot is not None:
        # 540 ms: Matplotlib, not without --plot
        from scleraforce.front.report.figure_files import write_figure
        from scleraforce.front.report.model_figures import draw_simulation

        write_figure(draw_simulation(eye), plot)

    result = {
        "force_mn": from_si(eye.force_n, "mn"),
        "tip_displacement_mm": from_si(eye.tip_m, "mm"),
        "dent_mm": from_si(eye.dent_m, "mm"),
        "pressure_mmhg": from_si(eye.pressure_pa, "mmhg"),
        "globe": study.globe.kind,
        "stiffening": study.tissue.stiffening,
        "elements": len(eye.mesh.cells_en),
        "dofs": eye.mesh.points_nc.size,
        "seconds": round(seconds, 3),
        "mechanics": study.mechanics.kind,
    }
    resting_pa = study.eye.iop_pa if given["iop_pa"] is None else given["iop_pa"]
    size = f"{result['elements']} elements, {result['dofs']} unknowns, {seconds:.1f} s"
    written = [f"wrote {path}" for path in (vtu, plot) if path is not None]

    return Report(result, [*_lines(eye, study, resting_pa), size, *written])


def _lines(eye: "SimulatedEye", study: Study, resting_pa: float) -> Iterator[str]:
    yield (
        f"the contact sinks in by {from_si(eye.tip_m, 'mm'):.3f} mm under"
        f" {from_si(eye.force_n, 'mn'):.4g} mN"
    )
    if study.globe.kind == "sealed":
        resting, loaded = (
            from_si(pressure_pa, "mmhg")
            for pressure_pa in (resting_pa, eye.pressure_pa)
        )
        yield (
            f"the pressure rises from {resting:.3g} to {loaded:.3g} mmHg; the dent is"
            f" {from_si(eye.dent_m, 'mm'):.3f} mm deep, from the undented wall at that"
            " pressure"
        )

    if study.mechanics.kind == "linear" and eye.tip_m > eye.mesh.thickness_m:
        ratio = eye.tip_m / eye.mesh.thickness_m
        yield (
            f"that is {ratio:.1f} times the wall's thickness: more than linear"
            " mechanics describes"
        )


def _forces_n(
    ctx: click.Context, param: click.Parameter, words: str
) -> tuple[float, ...]:
    try:
        return tuple(
            Quantity("force_mn").convert(each, param, ctx)
            for each in map(float, words.split(","))
        )
    except ValueError:
        raise click.BadParameter(
            f"{words!r} is not a list of forces in mN; give for example 2,10,40"
        ) from None


@click.command(cls=Command)
@click.option(
    "--out", type=PATH, required=True, help="Recording folder to write; must not exist."
)
@options("study")
@click.option(
    "--eye", "name", default="eye-1", show_default=True, help="Name of the eye."
)
@click.option(
    "--forces-mn",
    "forces_n",
    metavar="MN,MN,...",
    callback=_forces_n,
    show_default=True,
    default="2,8,14,20,26,34,40,48,56",
    help="True force at each frame, in mN: one step-and-hold push each.",
)
@click.option(
    "--rate-hz",
    type=click.FloatRange(0.1, 1000),
    help=(
        "Frames per second of a moving needle: --forces-mn are then the turning points"
        " of its force on an elastic wall, which begins at 0."
    ),
)
@click.option(
    "--ramp-mn-per-s",
    "ramp_n_per_s",
    type=click.FloatRange(0.01, 1e5),
    callback=in_si("mn_per_s"),
    help="Rate of change of a moving needle's force; default: 20.",
)
@click.option(
    "--hold-s",
    type=click.FloatRange(0, 3600),
    help="Time at each turning point; default: 1.",
)
@click.option(
    "--puncture-mn",
    "puncture_n",
    type=Quantity("force_mn"),
    help=(
        "Force at which a moving needle goes through the wall, after --forces-mn, none"
        " by default; frames.csv gets its travel."
    ),
)
@options(
    "thickness_m",
    "youngs_modulus_pa",
    "iop_pa",
    "gap_m",
    "polar_angle_rad",
    default=STUDYS,
    thickness_m="600",
    polar_angle_rad="35",
)
@click.option(
    "--azimuth-deg",
    "azimuth_rad",
    type=float,
    callback=in_si("deg"),
    help="Azimuth of the contact about the pole; default: 0.",
)
@click.option(
    "--direction-deg",
    "direction_rad",
    type=float,
    callback=in_si("deg"),
    help="Rotation of the B-scan plane about the needle axis; default: 0.",
)
@click.option(
    "--tilt-deg",
    "tilt_rad",
    type=float,
    callback=in_si("deg"),
    help="Tilt of the B-scan plane against the needle axis; default: 0.",
)
@click.option(
    "--plane",
    "planes",
    metavar=PLANE,
    multiple=True,
    help=(
        "One of several planes of each moment, as a cross of two (finite strain only);"
        " the gap is then that of the scanner's axis."
    ),
)
@options(
    "globe",
    "rigidity_pa13_per_m3",
    "mechanics",
    globe=GLOBE,
    rigidity_pa13_per_m3=RIGIDITY,
    mechanics=MECHANICS,
)
@click.option(
    "--seed",
    type=click.IntRange(0, 2**31 - 1),
    help="Seed of all random choices; default: the study's.",
)
def phantom(
    out: Path,
    study: Study,
    name: str,
    forces_n: tuple[float, ...],
    planes: tuple[str, ...],
    seed: int | None,
    **values: Any,
) -> Report:
    """Make a virtual acquisition: raw B-scans, a force log, truth.json.

    [phantom] of the study has the ranges from which light, noise, shadows,
    timing and sensor are drawn; [form] shapes eyes that are not spheres
    (finite strain only).

    Example: scleraforce phantom --out eye-1 --thickness-um 800 --forces-mn 2,10,40

    A needle that a robot moves, at 100 frames a second: scleraforce phantom --out
    moving --rate-hz 100 --forces-mn 20,5,35 --ramp-mn-per-s 15
    """
    # 530 ms: Numba and SciPy, not for --help
    from scleraforce.front.api.simulating import declared_study, given_values

    study = declared_study(
        study,
        *(values.pop(key) for key in ("mechanics", "globe", "rigidity_pa13_per_m3")),
    )

    moves = given_values(
        **{field.name: values.pop(field.name) for field in fields(sf.Motion)}
    )
    if moves and "rate_hz" not in moves:
        raise click.UsageError(
            "--ramp-mn-per-s, --hold-s, --puncture-mn: of a needle that moves; give"
            " --rate-hz too"
        )

    source = click.get_current_context().get_parameter_source("forces_n")
    if "puncture_n" in moves and source is ParameterSource.DEFAULT:
        forces_n = ()

    seed = study.phantom.seed if seed is None else seed
    needle = Needle(
        polar_rad=values.pop("polar_angle_rad"), azimuth_rad=values.pop("azimuth_rad")
    )
    scan = Scan(
        direction_rad=values.pop("direction_rad"),
        tilt_rad=values.pop("tilt_rad") or 0.0,
        planes=tuple(parse_plane(words) for words in planes),
    )
    made = sf.phantom(
        out,
        study,
        forces_n=forces_n,
        eye=name,
        needle=needle,
        scan=scan,
        motion=sf.Motion(**moves) if moves else None,
        progress=Bars(count_bar),
        seed=seed,
        **{"thickness_m": THICKNESS_M} | given_values(**values),
    )
    wrote = {"recording": str(out), "frames": len(made.frames), "seed": seed}
    more = {
        "mechanics": study.mechanics.kind,
        "globe": study.globe.kind,
        "stiffening": study.tissue.stiffening,
    }

    return Report(
        {**wrote, **more}, [f"wrote {out}: {len(made.frames)} frames, seed {seed}"]
    )


SEED = 0  # of the drawn frame
# Of a quantity: the median beyond which it is noted.
NOTED = {
    "noise_looks": (
        1.5,
        (
            "the noise is averaged ({median:.1f} looks) or smoothed, or the display is"
            " not logarithmic: its scale is taken from the wall's speckle; a study"
            " draws noise of one look, which is rougher"
        ),
    ),
    "noise_misfit_db": (
        0.5,
        (
            "the noise differs by {median:.1f} dB from that of a {kind} display: it is"
            " processed, or contains other light"
        ),
    ),
    "speckle_skew": (
        -0.05,
        (
            "the wall's speckle has a skew of {median:.2f} in dB, speckle of one look"
            " has -0.20: it contains fibres, or the display is not {kind}, and levels"
            " in dB are wrong"
        ),
    ),
}
DRAWN_OVERLAP = 0.8  # of the histograms: below, the drawn frame looks otherwise


def _new_study(ctx: click.Context, option: click.Parameter, path: Path) -> Path:
    if path.suffix != ".toml":
        raise InputError(f"--out: {path}: give a name that ends in .toml")
    new_file(ctx, option, path.with_suffix(".png"))
    new_file(ctx, option, path)
    return path


@click.command(cls=Command)
@click.argument("frames", metavar="FRAME...", nargs=-1, required=True, type=PATH)
@options(*FRAME_SIZE)
@click.option(
    "--bits",
    type=click.IntRange(8, 16),
    help=(
        "Bits of a pixel that are used; default: the recording's, or 8 if pixels are"
        " bytes."
    ),
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    callback=_new_study,
    help="Study file to write (.toml); its picture has the same name, .png.",
)
@options("wall_finder")
def scanner(
    frames: tuple[Path, ...],
    transpose: bool,
    bits: int | None,
    out: Path,
    wall_finder: Path | None,
    **size: Any,
) -> Report:
    """Measure a scanner on its own frames of an eye at rest, for a simulation.

    It writes a study whose [phantom] has the measured ranges of noise, display,
    speckle, attenuation, reflection of the surface, the layer below the wall,
    shadows, lines and black bands. `phantom --study` draws such frames, and
    `train LIBRARY --kind raw-reader --study` learns to read them. Its [scenes]
    have the frame's size, speckle, light, noise and display, and `train --kind
    wall-finder --study` learns them. The picture beside the study compares a real
    frame and a drawn one, with their histograms. Quantities that cannot be
    measured keep the values of the paper's study; the report names them.

    Example: scleraforce scanner rest/*.png --width-mm 15 --depth-mm 4 --bits 12
    --out study.toml
    """
    # 810 ms: Numba and SciPy, not for --help
    from scleraforce.lab.scanner.measured_scanner import measure_scanner

    measured = measure_scanner(
        _imaged(frames, Scan(transposed=transpose, **size), bits, wall_finder)
    )
    picture = out.with_suffix(".png")
    overlap = _write(measured, frames, out, picture)
    result = {
        "out": str(out),
        "picture": str(picture),
        **_entries(measured),
        "histogram_overlap": overlap,
    }
    notes = (wrapped(f"note: {note}") for note in _notes(measured, overlap))

    return Report(
        result, [*_scanner_lines(result), *notes, f"wrote {out} and {picture}"]
    )


def _imaged(
    frames: Sequence[Path],
    scan: Scan,
    bits: int | None,
    finder: Path | None,
) -> "Iterator[ImagedEye]":
    # 380 ms: Numba and the models, not for --help
    from scleraforce.front.api.opened_frames import finder_of, located, opened_frame

    network = finder_of(finder)
    first: tuple[Any, ...] = ()

    for path in progress_bar(frames, "frames"):
        opened = opened_frame(located(path), scan, Scan(), "")
        eye = _eye(path, opened, bits, network)
        kind = (eye.pixels.shape, eye.bits, eye.scale)

        first = first or kind
        if kind != first:
            raise FrameError(
                f"{path}: another size, scale or number of bits than {frames[0]}; give"
                " frames of one kind"
            )

        yield eye


def _eye(
    path: Path, frame: OpenedFrame, given: int | None, finder: "WallFinder | None"
) -> "ImagedEye":
    # 770 ms: Numba and SciPy, not for --help
    from scleraforce.lab.scanner.scanner_display import ImagedEye
    from scleraforce.wall.find_wall import find_wall

    most = 8 * frame.pixels.itemsize
    rows, columns = frame.pixels.shape

    bits = given or (frame.info.scan.bits if frame.info else 8 if most == 8 else None)
    if bits is None:
        raise FrameError(
            f"{path}: the number of its 16 bits that are used is not stated; give"
            " --bits"
        )
    if bits > most or int(frame.pixels.max()) >= 2**bits:
        raise FrameError(
            f"{path}: pixels of {most} bits, up to {int(frame.pixels.max())}; --bits"
            f" says {bits}"
        )
    if not (32 <= rows <= 8192 and 32 <= columns <= 8192):
        raise FrameError(f"{path}: {rows} x {columns} pixels; a study takes 32 to 8192")

    found = find_wall(frame.pixels, frame.scale, finder=finder)
    if not found.usable:
        raise FrameError(f"{path}: {found.reason}; nothing can be measured on it")
    if found.needle is not None:
        raise FrameError(f"{path}: a needle crosses it; give frames of an eye at rest")

    return ImagedEye(str(path), frame.pixels, frame.scale, bits, found)


def _write(
    measured: "MeasuredScanner", frames: Sequence[Path], out: Path, picture: Path
) -> float:
    # 1,300 ms: Matplotlib, not for --help
    from scleraforce.front.report.figure_files import write_figure
    from scleraforce.front.report.frame_figures import draw_scanner
    from scleraforce.lab.scanner.measured_scanner import (
        drawn_alike,
        histogram_overlap,
        oct_of,
        study_text,
    )

    frame = measured.frames[0]
    drawn = drawn_alike(frame, measured.phantom(), np.random.default_rng(SEED))
    size = oct_of(frame.eye)
    text = study_text(
        measured,
        [str(path) for path in frames],
        datetime.now(UTC).date().isoformat(),
        __version__,
    )
    write_figure(
        draw_scanner(
            frame.eye.pixels, drawn, (size.width_m, size.depth_m), frame.eye.top
        ),
        picture,
    )
    write_whole(text, out)

    return histogram_overlap(frame.eye.pixels, drawn, frame.eye.top)


def _entries(measured: "MeasuredScanner") -> dict[str, Any]:
    """Return the ranges by their keys in a study, in the unit of the key; quantities
    that it does not draw, apart.
    """
    # 780 ms: Numba and SciPy, not for --help
    from scleraforce.lab.scanner.measured_scanner import MeasuredRange

    items = {item.name: item for item in fields(PhantomStudy)}
    found: dict[str, dict[str, Any]] = {
        "measured": {},
        "not_measured": {},
        "not_drawn": {},
    }

    for name, result in measured.ranges.items():
        key, change = (
            (field_key(items[name]), field_unit(items[name]).from_si)
            if name in items
            else (name, float)
        )
        if name == "roll_off_db_per_m":
            key = "roll_off_db_per_mm"
            change = partial(from_si, unit="per_mm")

        if isinstance(result, MeasuredRange):
            numbers = {
                "median": change(result.median),
                "min": change(result.low),
                "max": change(result.high),
            }
            numbers |= {"seen": result.seen, "at_most": result.at_most}
            found["measured" if name in items else "not_drawn"][key] = numbers
        else:
            found["not_measured"][key] = result.reason

    counts = {name: list(counts) for name, counts in measured.counts.items()}
    return {
        "frames": len(measured.frames),
        "display": measured.display.name,
        "counts": counts,
        **found,
    }


def _scanner_lines(entries: Mapping[str, Any]) -> Iterator[str]:
    yield f"display = {entries['display']}"
    for key, numbers in entries["measured"].items():
        median, low, high = (
            f"{numbers[name]:.4g}" for name in ("median", "min", "max")
        )
        remark = "" if low == high else f" ({low} to {high})"
        if numbers["at_most"]:
            remark = " at most: finer than the pixels show"
        yield f"{key} = {median}{remark}"

    for name, counts in entries["counts"].items():
        yield f"{name} = {', '.join(map(str, counts))} (of each frame)"

    drawn = {field_key(item) for item in fields(PhantomStudy)}
    for key in (key for key in entries["not_measured"] if key in drawn):
        yield wrapped(f"not measured: {key}: {entries['not_measured'][key]}")


def _notes(measured: "MeasuredScanner", overlap: float) -> Iterator[str]:
    # 780 ms: Numba and SciPy, not for --help
    from scleraforce.lab.scanner.measured_scanner import MeasuredRange

    kind = measured.display.name
    ranges = measured.ranges
    slope = ranges["spread_slope"]
    roll_off = ranges["roll_off_db_per_m"]

    if not isinstance(slope, MeasuredRange):
        yield f"the display is taken to be {kind} from its noise: {slope.reason}"

    if isinstance(roll_off, MeasuredRange) and roll_off.low * roll_off.high > 0.0:
        yield (
            f"the wall's light changes by {-from_si(roll_off.median, 'per_mm'):.1f}"
            " dB/mm with the depth of the surface in the frame (roll-off, focus, or"
            " the angle); a study draws no roll-off"
        )

    for name, (most, words) in NOTED.items():
        found = ranges[name]
        if isinstance(found, MeasuredRange) and found.median > most:
            yield words.format(median=found.median, kind=kind)

    if overlap < DRAWN_OVERLAP:
        yield (
            f"the histograms of the real frame and the drawn one have {overlap:.0%} in"
            " common: look at the picture before you train on this study"
        )
