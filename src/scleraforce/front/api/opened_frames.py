"""Frames as a caller gives them, files and arrays, opened: counts, scale and wall."""

from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from scleraforce.base.errors import FrameError, InputError
from scleraforce.reading.load_model import bundled_finder, load_wall_finder
from scleraforce.reading.recorded_wall import recorded_wall
from scleraforce.recordings.drawn_walls import RecordedWalls, drawn_mask, mask_of
from scleraforce.recordings.formats.picture_streams import find_greys
from scleraforce.recordings.formats.pixels_without_value import NOT_FINITE
from scleraforce.recordings.recording_folder import (
    RecordedFile,
    open_frame,
    recorded_file,
)
from scleraforce.records.frame import (
    NOT_JUDGED,
    Frame,
    FrameSource,
    Moment,
    OpenedFrame,
    Pixels,
)
from scleraforce.records.model_folder import SHIPPED_WALL_FINDER
from scleraforce.records.remark import Remark
from scleraforce.records.scan import Plane, Scan
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall import Segmentation, without_wall
from scleraforce.wall.wall_in_metres import check_mask_size, given_wall
from scleraforce.wall.wall_network import WallFinder

# A frame of a file, with what its recording states, or an array.
Located = RecordedFile | np.ndarray[Any, Any]


def located(source: FrameSource | RecordedFile) -> Located:
    """Return the file of a frame with what its recording states; an array stays."""
    if isinstance(source, str | PathLike):
        return recorded_file(Path(source))
    return source if isinstance(source, RecordedFile) else np.asanyarray(source)


def place_of(frame: Located) -> str:
    """Return the words for a frame in messages."""
    return str(frame.path) if isinstance(frame, RecordedFile) else "frame"


def opened_frame(
    frame: Located, given: Scan, assumed: Scan, assumption: str
) -> OpenedFrame:
    """Return a frame with its scale: given, else the recording's or the file's, else
    the assumed one, whose source is the `assumption`.
    """
    if isinstance(frame, RecordedFile):
        opened = open_frame(frame, given, assumed, assumption)
        _check_declared(opened.pixels, given, place_of(frame))
        return opened

    pixels, notes = as_counts(frame)
    if pixels.ndim != 2 or not pixels.size:
        raise FrameError(
            f"frame: an array of shape {pixels.shape}; give one frame, rows x columns"
        )
    if given.width_m is None or given.depth_m is None:
        raise FrameError(
            "frame: nothing says how large this array is; give width_m and depth_m"
        )

    pixels = np.ma.filled(pixels, 0)
    scan = Scan(
        width_m=given.width_m,
        depth_m=given.depth_m,
        refractive_index=given.refractive_index or assumed.refractive_index or 1.0,
    )
    sources = dict.fromkeys(("width_m", "depth_m", "refractive_index"), "option")
    pixels = pixels.T if given.transposed else pixels
    _check_declared(pixels, given, "frame")
    return OpenedFrame(pixels, scan, sources, None, notes)


def _check_declared(pixels: Pixels, given: Scan, place: str) -> None:
    """Raise a `FrameError` for pixels that a declared scan cannot have."""
    found = {"rows": pixels.shape[0], "columns": pixels.shape[1]}
    for name, count in found.items():
        declared = getattr(given, name)
        if declared not in (None, count):
            raise FrameError(f"{place}: {name}: {count}; the scan declares {declared}")
    if given.bits is not None and int(pixels.max()) >= 2**given.bits:
        raise FrameError(
            f"{place}: bits: a pixel of {int(pixels.max())}; the scan declares"
            f" {given.bits} bits"
        )


def as_counts(frame: Any) -> tuple[Any, tuple[str, ...]]:
    """Return an array, of one frame or a stack, as counts, and a note if they were
    scaled; flags are a mask.

    Masked pixels count as the darkest; a masked array stays one.
    """
    pixels = np.asanyarray(frame)
    if pixels.dtype in (np.uint8, np.uint16):
        return pixels, ()
    if pixels.dtype == bool:  # of a stack each frame is a mask
        return (mask_of(pixels, "frame") if pixels.ndim == 2 else pixels), ()

    known = np.ma.compressed(pixels)
    greys = find_greys([known], None, "frame")
    if missing := greys.without.get(NOT_FINITE, 0):
        raise FrameError(
            f"frame: {missing} pixels are not finite; give"
            " numpy.ma.masked_invalid(frame)"
        )

    counts: Any = greys.counts(np.ma.filled(pixels, greys.low))
    counts = (
        np.ma.masked_array(counts, pixels.mask)
        if isinstance(pixels, np.ma.MaskedArray)
        else counts
    )

    if not greys.scaled and greys.low == 0.0:
        return counts, ()

    return counts, (
        (
            f"frame: pixels of {greys.low:g} to {greys.high:g} were scaled to counts of"
            f" 0 to {counts.max()}"
        ),
        *([f"frame: {greys.words}"] if greys.words else []),
    )


def planes_of(
    moment: Moment, frames: Sequence[Located], planes: tuple[Plane, ...]
) -> tuple[Plane, ...]:
    """Return the plane of each frame: of the scan's `planes` the one of its name, or of
    its place in their order, else as its recording states; () of a single frame.

    Raises:
        InputError: frames of several times or of unknown planes, or as many planes as
            frames are not known.
    """
    if planes:
        return _named_planes(moment, planes)

    files = [one for one in frames if isinstance(one, RecordedFile)]
    stated = [one for one in files if one.plane is not None]
    if len({(one.recording, one.time_s) for one in stated}) > 1:
        raise InputError(
            "frame: of several times; only frames of one time_s are read together"
        )

    for frame, source in zip(moment.frames, frames, strict=True):
        plane = source.plane if isinstance(source, RecordedFile) else None
        if frame.plane is not None and (plane is None or plane.name != frame.plane):
            raise InputError(
                f"frame: plane {frame.plane!r} is not one of a scan; give the scan's"
                " `planes`"
            )

    found = tuple(one.plane for one in stated if one.plane is not None)
    if len(found) != len(frames) and (found or len(frames) != 1):
        raise InputError(
            f"planes: {len(found)} of {len(frames)} frames; give one for each"
        )
    return _different(found)


def _named_planes(moment: Moment, planes: tuple[Plane, ...]) -> tuple[Plane, ...]:
    names = [frame.plane for frame in moment.frames]
    if None in names:
        if count := len(names) - names.count(None):
            raise InputError(
                f"frame: {count} of {len(names)} name a plane; name that of each, or"
                " give the frames in the order of the planes"
            )
        if len(planes) != len(names):
            raise InputError(
                f"planes: {len(planes)} of {len(names)} frames; give one for each"
            )
        return planes

    by_name = {plane.name: plane for plane in planes}
    if unknown := [name for name in names if name not in by_name]:
        raise InputError(
            f"frame: plane {unknown[0]!r} is not one of {', '.join(by_name)}"
        )
    return _different(tuple(by_name[name] for name in names if name is not None))


def _different(planes: tuple[Plane, ...]) -> tuple[Plane, ...]:
    if len({plane.name for plane in planes}) < len(planes):
        raise InputError("planes: two frames of one; give one frame of each")
    return planes


def finder_of(model: str | PathLike[str] | None) -> WallFinder | None:
    """Load a wall finder, the bundled one once; None stays None."""
    if model is None:
        return None
    return bundled_finder() if model == SHIPPED_WALL_FINDER else load_wall_finder(model)


def found_wall(
    opened: OpenedFrame,
    frame: Located,
    scan: Scan,
    thickness_m: float | None,
    finder: WallFinder | None,
) -> Segmentation:
    """Return the wall of a frame, without the columns of which a masked array masks a
    pixel: they count as black. `scan`: as given.
    """
    if not np.ma.is_masked(frame):
        return find_wall(opened.pixels, opened.scale, thickness_m, finder)

    hidden: Any = np.ma.getmaskarray(np.ma.asarray(frame))
    judged: Any = ~hidden.any(axis=int(scan.transposed))
    if not judged.any():
        return without_wall(opened.pixels.shape, "all columns are masked")

    lit: Any = opened.pixels * judged.astype(opened.pixels.dtype)
    found = find_wall(lit, opened.scale, thickness_m, finder)
    outer_row, inner_row = (
        np.where(judged, row, np.nan) for row in (found.outer_row, found.inner_row)
    )

    return replace(found, outer_row=outer_row, inner_row=inner_row)


def stated_wall(
    opened: OpenedFrame,
    frame: Located,
    given: Frame,
    scan: Scan,
    thickness_m: float | None,
    finder: WallFinder | None,
) -> tuple[Segmentation | None, tuple[Remark, ...]]:
    """Return the wall that is given for a frame, or that its recording has, and remarks
    on one that is not used; None: it is to be found.
    """
    mask = given.mask
    if mask is None and isinstance(frame, RecordedFile):
        if frame.recording is None:
            return None, ()
        walls = RecordedWalls(frame.recording)
        found = recorded_wall(walls, frame.path.name, opened.pixels.shape, opened.scale)
        return found, walls.remarks

    if mask is None and not isinstance(frame, RecordedFile):
        if frame.dtype == bool:
            mask = frame
        elif np.ma.is_masked(frame):
            return found_wall(opened, frame, scan, thickness_m, finder), ()

    if mask is None:
        return None, ()

    drawn = drawn_mask(mask)
    drawn = drawn.T if scan.transposed else drawn
    check_mask_size(drawn, opened.pixels.shape, "mask")

    if np.ma.is_masked(frame):
        hidden = np.ma.getmaskarray(np.ma.asarray(frame))
        unseen = hidden.T if scan.transposed else hidden
        drawn = np.where(unseen, np.uint8(NOT_JUDGED), drawn)

    return given_wall(drawn, opened.scale, given.mask_sd_rows), ()
