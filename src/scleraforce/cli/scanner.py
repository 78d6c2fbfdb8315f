"""`scleraforce scanner`: what a simulation needs to know of a scanner, measured on its own frames."""

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scleraforce import __version__
from scleraforce.cli.options import FRAME_SIZE, PATH, options
from scleraforce.cli.output import Command, Report, progress_bar, refuse_existing
from scleraforce.errors import FrameError, InputError
from scleraforce.plain_text import wrapped
from scleraforce.units import from_si
from scleraforce.whole_files import write_whole

if TYPE_CHECKING:
    from scleraforce.laboratory.scanner import MeasuredRange, MeasuredScanner
    from scleraforce.laboratory.scanner_display import ImagedEye
    from scleraforce.recording.folder import ScaledFrame, Scanner
    from scleraforce.segmentation.wall_finder import WallFinder

SEED = 0  # of the drawn frame
MOST_LOOKS = 1.5  # of the noise: beyond, it is averaged
LOG_MISFIT_DB = 0.5  # of the noise: beyond, the display is another one, or the noise is no noise
LOG_SKEW = -0.05  # of the wall's speckle in dB: beyond, likewise
DRAWN_OVERLAP = 0.8  # of the histograms: below, the drawn frame looks otherwise


@click.command(cls=Command)
@click.argument("frames", metavar="FRAME...", nargs=-1, required=True, type=PATH)
@options(*FRAME_SIZE)
@click.option("--bits", type=click.IntRange(8, 16),
              help="Bits of a pixel that are used; by default the recording's, or 8 of a frame of bytes.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True,
              help="Study file to write (.toml); its picture has the same name, .png.")  # fmt: skip
@options("finder")
def scanner(
    frames: tuple[Path, ...],
    width_m: float | None,
    depth_m: float | None,
    refractive_index: float | None,
    transpose: bool,
    bits: int | None,
    out: Path,
    finder: Path | None,
) -> Report:
    """Measure a scanner on its own frames of an eye at rest, for a simulation.

    Noise, display, speckle, attenuation, the surface's reflection, the layer
    below the wall, shadows, lines and black bands become ranges of [phantom] in
    a study: `phantom --study` draws recordings of such frames, and
    `train LIBRARY --kind raw-reader --study` learns to read them. (No other
    network learns from [phantom].) The picture beside it shows a real frame, a
    drawn one and the histograms of both. What the frames do not show is left as
    in the paper's study, and said.

    Example: scleraforce scanner rest/*.png --width-mm 15 --depth-mm 4 --bits 12
    --out study.toml
    """
    from scleraforce.laboratory.scanner import measure_scanner
    from scleraforce.recording.folder import Scanner

    if out.suffix != ".toml":
        raise InputError(f"--out: {out}: give a name that ends in .toml")
    picture = out.with_suffix(".png")
    refuse_existing(out, picture)
    size = Scanner(width_m=width_m, depth_m=depth_m, refractive_index=refractive_index)
    measured = measure_scanner(_imaged(frames, size, transpose, bits, finder))
    overlap = _write(measured, frames, out, picture)
    result = {"out": str(out), "picture": str(picture), **_entries(measured), "histogram_overlap": overlap}
    return Report(result, _lines(measured, out, picture, overlap))


def _imaged(
    frames: Sequence[Path], size: "Scanner", transpose: bool, bits: int | None, finder: Path | None
) -> "Iterator[ImagedEye]":
    """Read frame after frame and find its wall.

    Raises:
        InputError: a frame cannot be read or used, or is not of the size of the first.
    """
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
    """Return a frame with its wall."""
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
    return ImagedEye(str(path), frame.pixels, frame.scale, bits, found, found.inner_found)


def _write(measured: "MeasuredScanner", frames: Sequence[Path], out: Path, picture: Path) -> float:
    """Write the picture, then the study; return how far the histograms of a real and a drawn frame agree."""
    import numpy as np

    from scleraforce.laboratory.scanner import drawn_alike, histogram_overlap, oct_of, study_text
    from scleraforce.report.files import write_figure
    from scleraforce.report.model_figures import FramePair, draw_scanner

    frame = measured.frames[0]
    drawn = drawn_alike(frame, measured.phantom(), np.random.default_rng(SEED))
    size = oct_of(frame.eye)
    text = study_text(measured, [str(path) for path in frames], datetime.now(UTC).date().isoformat(), __version__)
    pair = FramePair(frame.eye.pixels, drawn, (size.width_m, size.depth_m), frame.eye.top)
    write_figure(draw_scanner(pair), picture)
    write_whole(text, out)
    return histogram_overlap(frame.eye.pixels, drawn, frame.eye.top)


def _entries(measured: "MeasuredScanner") -> dict[str, Any]:
    """Return what was measured, by the study's keys, and why the rest was not."""
    from scleraforce.laboratory.scanner import MeasuredRange

    found: dict[str, Any] = {}
    missing: dict[str, str] = {}
    not_drawn: dict[str, Any] = {}
    for name, result in measured.ranges.items():
        key, change = _key(name)
        place = found if _is_drawn(name) else not_drawn
        if isinstance(result, MeasuredRange):
            place[key] = {
                "median": change(result.median),
                "min": change(result.low),
                "max": change(result.high),
                "seen": result.seen,
                "at_most": result.at_most,
            }
        else:
            missing[key] = result.reason
    return {
        "frames": len(measured.frames),
        "display": measured.display.name,
        "measured": found,
        "counts": {name: list(counts) for name, counts in measured.counts.items()},
        "not_measured": missing,
        "not_drawn": not_drawn,
    }


def _is_drawn(name: str) -> bool:
    from scleraforce.laboratory.scanner import NOT_DRAWN

    return name not in NOT_DRAWN


def _key(name: str) -> tuple[str, Any]:
    """Return the study's key of a field, and what turns its SI value into the key's unit."""
    from dataclasses import fields

    from scleraforce.study import PhantomStudy
    from scleraforce.study.fields import field_key, field_unit

    if name == "roll_off_db_per_m":
        return "roll_off_db_per_mm", lambda value: from_si(value, "per_mm")
    items = {item.name: item for item in fields(PhantomStudy)}
    if name not in items:
        return name, lambda value: value
    return field_key(items[name]), field_unit(items[name]).from_si


def _lines(measured: "MeasuredScanner", out: Path, picture: Path, overlap: float) -> list[str]:
    """Return what is told: a line for each key, what was not measured, and what the frames are doubted for."""
    from scleraforce.laboratory.scanner import MeasuredRange

    lines = [f"display = {measured.display.name}"]
    for name, found in measured.ranges.items():
        key, change = _key(name)
        if isinstance(found, MeasuredRange) and _is_drawn(name):
            lines.append(f"{key} = {_words(found, change)}")
    lines += [f"{name} = {', '.join(map(str, counts))} (of each frame)" for name, counts in measured.counts.items()]
    lines += [
        wrapped(f"not measured: {_key(name)[0]}: {found.reason}")
        for name, found in measured.ranges.items()
        if not isinstance(found, MeasuredRange) and _is_drawn(name)
    ]
    lines += [wrapped(f"note: {note}") for note in _notes(measured, overlap)]
    return [*lines, f"wrote {out} and {picture}"]


def _words(found: "MeasuredRange", change: Any) -> str:
    median, low, high = (f"{change(value):.4g}" for value in (found.median, found.low, found.high))
    if found.at_most:
        return f"{median} at most: finer than the pixels show"
    return median if low == high else f"{median} ({low} to {high})"


def _notes(measured: "MeasuredScanner", overlap: float) -> list[str]:
    """Return in what the scanner differs from what a study draws."""
    from scleraforce.laboratory.scanner import MeasuredRange

    notes = []
    kind = measured.display.name
    roll_off, looks, misfit, skew, slope = (
        measured.ranges[name]
        for name in ("roll_off_db_per_m", "noise_looks", "noise_misfit_db", "speckle_skew", "spread_slope")
    )
    if not isinstance(slope, MeasuredRange):
        notes.append(f"that the display is {kind} is taken for granted: {slope.reason}")
    if isinstance(roll_off, MeasuredRange) and roll_off.low * roll_off.high > 0.0:
        notes.append(
            f"the wall's light changes by {-from_si(roll_off.median, 'per_mm'):.1f} dB/mm with the depth of the "
            "surface in the frame (roll-off, focus, or the angle); a study draws no roll-off"
        )
    if isinstance(looks, MeasuredRange) and looks.median > MOST_LOOKS:
        notes.append(
            f"the noise is averaged ({looks.median:.1f} looks) or smoothed, or the display is not logarithmic: its "
            "scale is that of the wall's speckle; a study draws noise of one look, which is rougher"
        )
    if isinstance(misfit, MeasuredRange) and misfit.median > LOG_MISFIT_DB:
        notes.append(
            f"the noise lies {misfit.median:.1f} dB off that of a {kind} display: it is processed, or something "
            "shows in it"
        )
    if isinstance(skew, MeasuredRange) and skew.median > LOG_SKEW:
        notes.append(
            f"the wall's speckle has a skew of {skew.median:.2f} in dB, that of one look is -0.20: fibres lie among "
            f"it, or the display is no {kind} one, and levels in dB are wrong"
        )
    if overlap < DRAWN_OVERLAP:
        notes.append(
            f"the histograms of the real frame and the drawn one have {overlap:.0%} in common: look at the picture "
            "before you train on this study"
        )
    return notes
