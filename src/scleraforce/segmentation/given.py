"""The wall of a mask that a user, another network or the app gave (docs/segmentation.md)."""

from dataclasses import replace

import numpy as np

from scleraforce.arrays import Bytes
from scleraforce.errors import FrameError
from scleraforce.recording.pixels import PixelScale
from scleraforce.recording.walls import NOT_JUDGED, WALL, RecordedWalls
from scleraforce.segmentation.found import Segmentation, surface_fault, without_wall
from scleraforce.segmentation.light import LEAST_SHAPE
from scleraforce.segmentation.observations import stretch_of, surface

GIVEN_SD_ROWS = 2.0


def given_wall(mask: Bytes, scale: PixelScale, sd_rows: float = GIVEN_SD_ROWS, source: str = "mask") -> Segmentation:
    """Return the wall of a mask (row, column) of NO_WALL, NOT_JUDGED and WALL (`recording.walls`).

    A boundary lies in the middle between a row with wall and one without. A column is left out if a pixel of it is not
    judged, if its wall touches the frame's first row, or is interrupted. `sd_rows`: of the boundaries, rows.
    """
    rows, is_wall = len(mask), mask == WALL
    first, last, count = is_wall.argmax(axis=0), rows - is_wall[::-1].argmax(axis=0), is_wall.sum(axis=0)
    judged = ~(mask == NOT_JUDGED).any(axis=0)
    whole = judged & (count > 0) & (last - first == count) & (first > 0)
    outer_row, inner_row = np.where(whole, first - 0.5, np.nan), np.where(whole, last - 0.5, np.nan)
    fault = surface_fault(int(whole.sum()), max(int(judged.sum()), 1), 1.0, 1.0)
    if whole.sum() < LEAST_SHAPE:
        return without_wall(mask.shape, fault or "no wall was found")
    wall = Segmentation(
        outer_row, inner_row, rows, not fault, fault, True, thickness_m=0.0, source=source, sd_rows=sd_rows
    )
    lateral_m, outer_m = surface(wall, scale)
    along_m = (inner_row - outer_row) * scale.depth_m / scale.refractive_index / stretch_of(lateral_m, outer_m)
    inside = (last < rows) & np.isfinite(along_m)
    thickness_m = float(np.median(along_m[inside])) if inside.any() else float("nan")
    return replace(wall, inner_found=bool(inside.any()), thickness_m=thickness_m)


def check_size(mask: Bytes, shape: tuple[int, ...], place: str) -> None:
    """Raise a `FrameError` naming `place` unless a mask has the shape of its frame."""
    if mask.shape != shape:
        size, of_frame = (f"{rows} x {columns}" for rows, columns in (mask.shape, shape))
        raise FrameError(f"{place}: {size} pixels, the frame has {of_frame}")


def recorded_wall(walls: RecordedWalls, file: str, shape: tuple[int, ...], scale: PixelScale) -> Segmentation | None:
    """Return the wall that a recording has for a frame (row, column), None without one."""
    mask = walls.wall(file)
    if mask is None:
        return None
    check_size(mask, shape, str(walls.path(file)))
    return given_wall(mask, scale, source="corrected")
