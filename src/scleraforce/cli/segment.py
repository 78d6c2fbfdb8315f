"""`scleraforce segment`: masks of the wall in raw frames."""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from scleraforce.cli.inputs import scale_entry
from scleraforce.cli.options import FRAME_SIZE, PATH, options
from scleraforce.cli.output import Command, Report, each_of
from scleraforce.errors import FrameError, InputError
from scleraforce.plain_text import wrapped
from scleraforce.study import OctStudy
from scleraforce.units import from_si
from scleraforce.whole_files import KINDS, read_bytes, write_whole

if TYPE_CHECKING:
    from scleraforce.recording.folder import Scanner
    from scleraforce.recording.pixels import Pixels
    from scleraforce.segmentation.wall_finder import WallFinder


ASSUMED = "assumed"  # the source of a value that nobody states


@dataclass(frozen=True)
class _Source:
    """One frame to segment, and where its mask goes."""

    frame: Path
    mask: Path


@click.command(cls=Command)
@click.argument("frames", metavar="FRAME...", nargs=-1, required=True, type=PATH)
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True, help="Folder for the masks.")
@options(*FRAME_SIZE)
@click.option("--overlay", is_flag=True, help="Write NAME.overlay.png too: the boundaries drawn on the frame.")
@options("finder", "force", force="Replace masks that exist.")
def segment(
    frames: tuple[Path, ...],
    out: Path,
    width_m: float | None,
    depth_m: float | None,
    refractive_index: float | None,
    transpose: bool,
    overlay: bool,
    finder: Path | None,
    force: bool,
) -> Report:
    """Find the wall in raw frames (PNG, TIFF, JPEG, DICOM) or recordings.

    Writes a mask for each frame, of the same size and name (.png): 255 is
    wall, from the tissue's surface to the inner boundary, or to 1 mm below the
    surface where that boundary cannot be seen. Frames of several recordings go
    into a folder for each. If the size of a frame is not stated, 15 x 4 mm are
    assumed, and said.

    Two methods to find the wall check each other: one follows steps of light,
    the other is a network that learned from drawn scenes. A frame in which they
    differ by more than they are unsure of is not usable.

    Example: scleraforce segment recordings/eye-1 --out masks --overlay
    """
    from scleraforce.notebook.frames import finder_of
    from scleraforce.recording.folder import Scanner

    size, network = Scanner(width_m=width_m, depth_m=depth_m, refractive_index=refractive_index), finder_of(finder)
    found = list(
        each_of(_plan_masks(frames, out), lambda one: _segment_frame(one, size, transpose, network, overlay, force))
    )
    faults = [entry for _, entry in found if isinstance(entry, InputError)]
    usable = [entry for _, entry in found if not isinstance(entry, InputError)]
    return Report({"out": str(out), "frames": [_entry(*each) for each in found]}, _lines(usable), faults)


def _plan_masks(given: tuple[Path, ...], out: Path) -> list[_Source]:
    """Return the frames of the files and recording folders that were given, and where their masks go.

    Raises:
        InputError: nothing is there, or two masks would have one name, or a mask would replace a frame.
    """
    found = [pair for path in given for pair in _frames_of(path)]
    recordings = {recording.resolve() for _, recording in found if recording is not None}
    sources = []
    for frame, recording in found:
        folder = out / recording.resolve().name if recording is not None and len(recordings) > 1 else out
        sources.append(_Source(frame, folder / f"{frame.stem}.png"))
    _check_names(sources)
    return sources


def _frames_of(path: Path) -> list[tuple[Path, Path | None]]:
    """Return frames with their recording: all of a recording folder, or the one file."""
    from scleraforce.recording.folder import read_recording, recording_of

    if not os.path.isdir(path):
        return [(path, recording_of(path))]
    recording = read_recording(path)
    return [(recording.frame_path(entry), path) for entry in recording.frames]


def _check_names(sources: list[_Source]) -> None:
    taken: dict[Path, _Source] = {}
    frames = {source.frame.resolve() for source in sources}
    for source in sources:
        other = taken.setdefault(source.mask, source)
        if other is not source:
            raise InputError(
                f"{source.frame}: its mask would be {source.mask}, as that of {other.frame}; use two folders"
            )
        if source.mask.resolve() in frames:
            raise InputError(f"--out: the mask {source.mask} would replace a frame; choose another folder")


def _segment_frame(
    source: _Source, size: "Scanner", transpose: bool, finder: "WallFinder | None", overlay: bool, force: bool
) -> dict[str, Any]:
    """Segment one frame, write its mask and, with `overlay`, its picture; return the frame's entry."""
    from scleraforce.notebook.frames import scaled
    from scleraforce.recording.folder import Scanner
    from scleraforce.segmentation.needle import needle_entry
    from scleraforce.segmentation.overlay import draw_overlay
    from scleraforce.segmentation.wall import find_wall

    usual = OctStudy()
    assumed = Scanner(width_m=usual.width_m, depth_m=usual.depth_m, refractive_index=usual.refractive_index)
    frame = scaled(source.frame, size, assumed, ASSUMED, transpose)
    try:
        thickness_m = None if frame.info is None else frame.info.eye.thickness_m
        found = find_wall(frame.pixels, frame.scale, thickness_m, finder)
    except ValueError as fault:
        raise FrameError(f"{source.frame}: {fault}") from fault
    _write(source.mask, found.mask.T if transpose else found.mask, force)
    if overlay:
        picture = draw_overlay(frame.pixels, found)
        _write(source.mask.with_suffix(".overlay.png"), picture.swapaxes(0, 1) if transpose else picture, force)
    return {
        "file": str(source.frame),
        "mask": str(source.mask),
        "usable": found.usable,
        "reason": found.reason,
        "inner_found": found.inner_found,
        "thickness_um": None if isnan(found.thickness_m) else from_si(found.thickness_m, "um"),
        "needle": needle_entry(found.needle),
        "conjunctiva_um": from_si(found.conjunctiva_m, "um"),
        "scale": scale_entry(frame),
        "notes": list(frame.notes),
    }


def _write(path: Path, picture: "Pixels", force: bool) -> None:
    """Write a PNG under a temporary name and rename it; another one that is there stays, unless `force`."""
    import cv2

    data = cv2.imencode(".png", np.ascontiguousarray(picture))[1].tobytes()
    if not force and path.exists() and read_bytes(path, KINDS["frame"]) != data:
        raise InputError(f"{path}: exists already and differs; choose another --out, or --force to replace it")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(data, path)


def _entry(source: _Source, found: dict[str, Any] | InputError) -> dict[str, Any]:
    if isinstance(found, InputError):
        return {"file": str(source.frame), "mask": None, "usable": False, "error": str(found)}
    return found


def _lines(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a line for each frame, and a note where a scale was assumed."""
    lines = [_line(entry) for entry in entries]
    lines += [wrapped(note, "note: ") for entry in entries for note in entry["notes"]]
    lines += [wrapped(words, "note: ") for words in _assumed(entries)]
    return lines


def _assumed(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return sentences on what nothing states of the frames' scale, and what was taken for it."""
    scanner = OctStudy()
    taken = {
        "width_mm": f"width (taken as {from_si(scanner.width_m, 'mm'):g} mm; give --width-mm)",
        "depth_mm": f"depth (taken as {from_si(scanner.depth_m, 'mm'):g} mm; give --depth-mm)",
        "refractive_index": f"refractive index (taken as {scanner.refractive_index:g}; give --refractive-index)",
    }
    missing = Counter(
        tuple(words for key, words in taken.items() if entry["scale"][key]["source"] == ASSUMED) for entry in entries
    )
    return [
        f"of {count} of {len(entries)} frames nothing states the {', the '.join(words)}"
        for words, count in missing.items()
        if words
    ]


def _line(entry: Mapping[str, Any]) -> str:
    if not entry["usable"]:
        return f"{entry['file']}: not usable: {entry['reason']}"
    if entry["thickness_um"] is None:
        return f"{entry['file']}: inner boundary not seen; the mask ends 1 mm below the surface"
    if not entry["inner_found"]:
        return f"{entry['file']}: wall of {entry['thickness_um']:.0f} µm; its inner boundary is the network's guess"
    return f"{entry['file']}: wall of {entry['thickness_um']:.0f} µm"
