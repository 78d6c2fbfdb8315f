"""`scleraforce scanner`: measure a scanner on its own frames, for a simulation."""

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scleraforce import __version__
from scleraforce.cli.options import FRAME_SIZE, PATH, new_file, options
from scleraforce.cli.output import Command, Report, progress_bar
from scleraforce.errors import FrameError, InputError
from scleraforce.plain_text import wrapped
from scleraforce.study import PhantomStudy
from scleraforce.study.fields import field_key, field_unit
from scleraforce.units import from_si
from scleraforce.whole_files import write_whole

if TYPE_CHECKING:
    from scleraforce.laboratory.scanner import MeasuredRange, MeasuredScanner
    from scleraforce.laboratory.scanner_display import ImagedEye, Unmeasured
    from scleraforce.recording.folder import ScaledFrame, Scanner
    from scleraforce.segmentation.wall_finder import WallFinder

SEED = 0  # of the drawn frame
# Of a quantity: the median beyond which it is noted.
NOTED = {
    "noise_looks": (1.5, "the noise is averaged ({median:.1f} looks) or smoothed, or the display is not logarithmic: "
                    "its scale is taken from the wall's speckle; a study draws noise of one look, which is rougher"),
    "noise_misfit_db": (0.5, "the noise differs by {median:.1f} dB from that of a {kind} display: it is processed, or "
                        "contains other light"),
    "speckle_skew": (-0.05, "the wall's speckle has a skew of {median:.2f} in dB, speckle of one look has -0.20: it "
                     "contains fibres, or the display is not {kind}, and levels in dB are wrong"),
}  # fmt: skip
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
@click.option("--bits", type=click.IntRange(8, 16),
              help="Bits of a pixel that are used; default: the recording's, or 8 if pixels are bytes.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True, callback=_new_study,
              help="Study file to write (.toml); its picture has the same name, .png.")  # fmt: skip
@options("wall_finder")
def scanner(
    frames: tuple[Path, ...], transpose: bool, bits: int | None, out: Path, wall_finder: Path | None, **size: Any
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
    from scleraforce.laboratory.scanner import measure_scanner
    from scleraforce.recording.folder import Scanner

    measured = measure_scanner(_imaged(frames, Scanner(**size), transpose, bits, wall_finder))
    picture = out.with_suffix(".png")
    overlap = _write(measured, frames, out, picture)
    result = {"out": str(out), "picture": str(picture), **_entries(measured), "histogram_overlap": overlap}
    return Report(result, [*_lines(measured, overlap), f"wrote {out} and {picture}"])


def _imaged(
    frames: Sequence[Path], size: "Scanner", transpose: bool, bits: int | None, finder: Path | None
) -> "Iterator[ImagedEye]":
    from scleraforce.notebook.frames import finder_of, scaled
    from scleraforce.recording.folder import Scanner

    network = finder_of(finder)
    first: tuple[Any, ...] = ()
    for path in progress_bar(frames, "frames"):
        frame = scaled(path, size, Scanner(), "", transpose)
        eye = _eye(path, frame, _bits(path, frame, bits), network)
        kind = (eye.pixels.shape, eye.bits, eye.scale)
        first = first or kind
        if kind != first:
            raise FrameError(f"{path}: another size, scale or number of bits than {frames[0]}; give frames of one kind")
        yield eye


def _bits(path: Path, frame: "ScaledFrame", given: int | None) -> int:
    most = 8 * frame.pixels.itemsize
    bits = given or (frame.info.oct.bits if frame.info else 8 if most == 8 else None)
    if bits is None:
        raise FrameError(f"{path}: the number of its 16 bits that are used is not stated; give --bits")
    if bits > most or int(frame.pixels.max()) >= 2**bits:
        raise FrameError(f"{path}: pixels of {most} bits, up to {int(frame.pixels.max())}; --bits says {bits}")
    return bits


def _eye(path: Path, frame: "ScaledFrame", bits: int, finder: "WallFinder | None") -> "ImagedEye":
    from scleraforce.laboratory.scanner_display import ImagedEye
    from scleraforce.segmentation.wall import find_wall

    rows, columns = frame.pixels.shape
    if not (32 <= rows <= 8192 and 32 <= columns <= 8192):
        raise FrameError(f"{path}: {rows} x {columns} pixels; a study takes 32 to 8192")
    found = find_wall(frame.pixels, frame.scale, finder=finder)
    if not found.usable:
        raise FrameError(f"{path}: {found.reason}; nothing can be measured on it")
    if found.needle is not None:
        raise FrameError(f"{path}: a needle crosses it; give frames of an eye at rest")
    return ImagedEye(str(path), frame.pixels, frame.scale, bits, found)


def _write(measured: "MeasuredScanner", frames: Sequence[Path], out: Path, picture: Path) -> float:
    import numpy as np

    from scleraforce.laboratory.scanner import drawn_alike, histogram_overlap, oct_of, study_text
    from scleraforce.report.files import write_figure
    from scleraforce.report.frame_figures import draw_scanner

    frame = measured.frames[0]
    drawn = drawn_alike(frame, measured.phantom(), np.random.default_rng(SEED))
    size = oct_of(frame.eye)
    text = study_text(measured, [str(path) for path in frames], datetime.now(UTC).date().isoformat(), __version__)
    write_figure(draw_scanner(frame.eye.pixels, drawn, (size.width_m, size.depth_m), frame.eye.top), picture)
    write_whole(text, out)
    return histogram_overlap(frame.eye.pixels, drawn, frame.eye.top)


def _ranges(measured: "MeasuredScanner") -> "Iterator[tuple[str, MeasuredRange | Unmeasured, bool]]":
    """Yield each quantity: its key in a study, its range in the unit of the key, and whether a study draws it."""
    from scleraforce.laboratory.scanner import NOT_DRAWN, MeasuredRange

    items = {item.name: item for item in fields(PhantomStudy)}
    for name, found in measured.ranges.items():
        key, change = (field_key(items[name]), field_unit(items[name]).from_si) if name in items else (name, float)
        if name == "roll_off_db_per_m":
            key, change = "roll_off_db_per_mm", lambda value: from_si(value, "per_mm")
        if isinstance(found, MeasuredRange):
            median, low, high = map(change, (found.median, found.low, found.high))
            found = replace(found, median=median, low=low, high=high)
        yield key, found, name not in NOT_DRAWN


def _entries(measured: "MeasuredScanner") -> dict[str, Any]:
    from scleraforce.laboratory.scanner import MeasuredRange

    found: dict[str, dict[str, Any]] = {"measured": {}, "not_measured": {}, "not_drawn": {}}
    for key, result, is_drawn in _ranges(measured):
        if isinstance(result, MeasuredRange):
            numbers = {"median": result.median, "min": result.low, "max": result.high}
            numbers |= {"seen": result.seen, "at_most": result.at_most}
            found["measured" if is_drawn else "not_drawn"][key] = numbers
        else:
            found["not_measured"][key] = result.reason
    counts = {name: list(counts) for name, counts in measured.counts.items()}
    return {"frames": len(measured.frames), "display": measured.display.name, "counts": counts, **found}


def _lines(measured: "MeasuredScanner", overlap: float) -> Iterator[str]:
    from scleraforce.laboratory.scanner import MeasuredRange

    yield f"display = {measured.display.name}"
    missing = []
    for key, found, is_drawn in _ranges(measured):
        if is_drawn and not isinstance(found, MeasuredRange):
            missing.append(f"not measured: {key}: {found.reason}")
        elif is_drawn and isinstance(found, MeasuredRange):
            median, low, high = (f"{value:.4g}" for value in (found.median, found.low, found.high))
            span = "" if low == high else f" ({low} to {high})"
            yield f"{key} = {median}{' at most: finer than the pixels show' if found.at_most else span}"
    for name, counts in measured.counts.items():
        yield f"{name} = {', '.join(map(str, counts))} (of each frame)"
    yield from map(wrapped, missing)
    yield from (wrapped(f"note: {note}") for note in _notes(measured, overlap))


def _notes(measured: "MeasuredScanner", overlap: float) -> Iterator[str]:
    from scleraforce.laboratory.scanner import MeasuredRange

    kind, ranges = measured.display.name, measured.ranges
    slope, roll_off = ranges["spread_slope"], ranges["roll_off_db_per_m"]
    if not isinstance(slope, MeasuredRange):
        yield f"the display is taken to be {kind} from its noise: {slope.reason}"
    if isinstance(roll_off, MeasuredRange) and roll_off.low * roll_off.high > 0.0:
        yield (
            f"the wall's light changes by {-from_si(roll_off.median, 'per_mm'):.1f} dB/mm with the depth of the "
            "surface in the frame (roll-off, focus, or the angle); a study draws no roll-off"
        )
    for name, (most, words) in NOTED.items():
        found = ranges[name]
        if isinstance(found, MeasuredRange) and found.median > most:
            yield words.format(median=found.median, kind=kind)
    if overlap < DRAWN_OVERLAP:
        yield (
            f"the histograms of the real frame and the drawn one have {overlap:.0%} in common: look at the picture "
            "before you train on this study"
        )
