"""`scleraforce segment`: masks of the wall in raw frames."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from scleraforce.cli.output import print_json, progress_bar
from scleraforce.errors import FrameError, InputError
from scleraforce.study import OctStudy
from scleraforce.whole_files import write_whole

if TYPE_CHECKING:
    from scleraforce.imaging.segmentation import Segmenter
    from scleraforce.recording.images import FrameImage, Pixels

__all__ = ["segment"]

LENGTH = click.FloatRange(0.01, 100.0)


@dataclass(frozen=True)
class Source:
    """One frame to segment, the recording folder that it belongs to (None: none), and where its mask goes."""

    frame: Path
    recording: Path | None
    mask: Path


@dataclass(frozen=True)
class Geometry:
    """The frames' size and refractive index, None where the recording, the file or the study decides."""

    width_mm: float | None
    depth_mm: float | None
    refractive_index: float | None
    transpose: bool


@click.command()
@click.argument("frames", metavar="FRAME...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True, help="Folder for the masks.")
@click.option("--width-mm", type=LENGTH, help="Width of the frames; by default their recording's, their own (DICOM), "
              "or 15.")  # fmt: skip
@click.option("--depth-mm", type=LENGTH, help="Depth of the frames, as stored; by default likewise, or 4.")
@click.option("--refractive-index", type=click.FloatRange(1.0, 2.0),
              help="By which depth is stretched (1: corrected already); by default the recording's, or 1.")  # fmt: skip
@click.option("--transpose", is_flag=True, help="The frames' depth runs along their rows, from left to right.")
@click.option("--overlay", is_flag=True, help="Write NAME.overlay.png too: the boundaries drawn on the frame.")
@click.option("--force", is_flag=True, help="Replace masks that are there.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def segment(
    frames: tuple[Path, ...],
    out: Path,
    width_mm: float | None,
    depth_mm: float | None,
    refractive_index: float | None,
    transpose: bool,
    overlay: bool,
    force: bool,
    as_json: bool,
) -> None:
    """Find the wall in raw frames (PNG, TIFF, JPEG, DICOM) or recordings.

    Writes a mask for each frame, of the same size and name (.png): 255 is
    wall, from the tissue's surface to the inner boundary, or to 1 mm below the
    surface where that boundary cannot be seen. Frames of several recordings go
    into a folder for each.

    Example: scleraforce segment recordings/eye-1 --out masks --overlay
    """
    from scleraforce.imaging.segmentation import Segmenter

    geometry = Geometry(width_mm, depth_mm, refractive_index, transpose)
    segmenters: dict[float, Segmenter] = {}
    sources = progress_bar(plan_masks(frames, out), "frames")
    entries = [segment_frame(source, geometry, segmenters, overlay, force) for source in sources]
    if as_json:
        print_json({"out": str(out), "frames": entries})
    else:
        click.echo("\n".join(_line(entry) for entry in entries))


def plan_masks(given: tuple[Path, ...], out: Path) -> list[Source]:
    """Return the frames of the files and recording folders that were given, and where their masks go.

    Raises:
        InputError: nothing is there, or two masks would have one name, or a mask would replace a frame.
    """
    found = [pair for path in given for pair in _frames_of(path)]
    recordings = {recording.resolve() for _, recording in found if recording is not None}
    sources = []
    for frame, recording in found:
        folder = out / recording.resolve().name if recording is not None and len(recordings) > 1 else out
        sources.append(Source(frame, recording, folder / f"{frame.stem}.png"))
    _check_names(sources)
    return sources


def _frames_of(path: Path) -> list[tuple[Path, Path | None]]:
    """Return frames with their recording: all of a recording folder, or the one file."""
    from scleraforce.recording.files import read_recording

    if path.is_dir():
        recording = read_recording(path)
        return [(recording.frame_path(entry), path) for entry in recording.frames]
    if not path.is_file():
        raise FrameError(f"{path}: no such file; give image files or recording folders")
    folder = path.parent.resolve()
    inside = folder.name == "frames" and (folder.parent / "recording.toml").is_file()
    return [(path, folder.parent if inside else None)]


def _check_names(sources: list[Source]) -> None:
    taken: dict[Path, Source] = {}
    frames = {source.frame.resolve() for source in sources}
    for source in sources:
        other = taken.setdefault(source.mask, source)
        if other is not source:
            raise InputError(
                f"{source.frame}: its mask would be {source.mask}, as that of {other.frame}; use two folders"
            )
        if source.mask.resolve() in frames:
            raise InputError(f"--out: the mask {source.mask} would replace a frame; choose another folder")


def segment_frame(
    source: Source, geometry: Geometry, segmenters: "dict[float, Segmenter]", overlay: bool, force: bool
) -> dict[str, Any]:
    """Segment one frame, write its mask and, where asked for, its overlay; return what is to be told about it."""
    from scleraforce.imaging.overlay import draw_overlay
    from scleraforce.imaging.segmentation import PixelScale, Segmenter
    from scleraforce.recording.images import read_frame_image

    image = read_frame_image(source.frame)
    pixels: Pixels = image.pixels.T if geometry.transpose else image.pixels
    lateral_m, depth_m, index = _scale(source, image, geometry)
    segmenter = segmenters.setdefault(index, Segmenter(index))
    try:
        found = segmenter.segment(pixels, PixelScale(lateral_m, depth_m))
    except ValueError as fault:
        raise FrameError(f"{source.frame}: {fault}") from fault
    _write(source.mask, found.mask.T if geometry.transpose else found.mask, force)
    if overlay:
        picture = draw_overlay(pixels, found)
        _write(
            source.mask.with_suffix(".overlay.png"), picture.swapaxes(0, 1) if geometry.transpose else picture, force
        )
    return {
        "file": str(source.frame),
        "mask": str(source.mask),
        "usable": found.usable,
        "reason": found.reason,
        "inner_found": found.inner_found,
        "thickness_um": found.thickness_m * 1e6,
    }


def _scale(source: Source, image: "FrameImage", geometry: Geometry) -> tuple[float, float, float]:
    """Return the pixel's size (lateral, depth) in m and the refractive index.

    What was given comes first, then what the recording says, then the file's own tags, then the study's defaults.
    """
    from scleraforce.recording.files import read_recording

    rows, columns = image.pixels.shape[::-1] if geometry.transpose else image.pixels.shape
    lateral_m, depth_m = image.lateral_pixel_m, image.depth_pixel_m
    if geometry.transpose:
        lateral_m, depth_m = depth_m, lateral_m
    oct_info = OctStudy()
    lateral_m, depth_m = lateral_m or oct_info.width_m / columns, depth_m or oct_info.depth_m / rows
    index = oct_info.refractive_index
    if source.recording is not None:
        stated = read_recording(source.recording).info.oct
        lateral_m, depth_m, index = stated.width_m / columns, stated.depth_m / rows, stated.refractive_index
    if geometry.width_mm is not None:
        lateral_m = geometry.width_mm / 1e3 / columns
    if geometry.depth_mm is not None:
        depth_m = geometry.depth_mm / 1e3 / rows
    return lateral_m, depth_m, index if geometry.refractive_index is None else geometry.refractive_index


def _write(path: Path, picture: "Pixels", force: bool) -> None:
    """Write a PNG under a temporary name and rename it; another one that is there stays, unless `force`."""
    import cv2

    data = cv2.imencode(".png", np.ascontiguousarray(picture))[1].tobytes()
    if not force and path.exists() and path.read_bytes() != data:
        raise InputError(f"{path}: exists already and differs; choose another --out, or --force to replace it")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(data, path)


def _line(entry: Mapping[str, Any]) -> str:
    if not entry["usable"]:
        return f"{entry['file']}: not usable: {entry['reason']}"
    if not entry["inner_found"]:
        return f"{entry['file']}: inner boundary not seen; the mask ends 1 mm below the surface"
    return f"{entry['file']}: wall of {entry['thickness_um']:.0f} um"
