"""The slice that the network reads, from the boundaries of a segmented frame."""

from typing import Protocol

import numpy as np

from scleraforce.arrays import Bytes, Floats
from scleraforce.compiled import compiled
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.loops import straight_line
from scleraforce.study import SliceStudy


class BoundaryRows(Protocol):
    """Boundaries of a segmentation, (column,), rows of pixel centres, NaN where there is no wall."""

    @property
    def outer_row(self) -> Floats: ...  # noqa: D102 - described by the class
    @property
    def inner_row(self) -> Floats: ...  # noqa: D102 - described by the class


def boundary_slice(segmentation: BoundaryRows, scale: PixelScale, slice_study: SliceStudy) -> Bytes:
    """Draw the wall of a frame into the slice's window, (rows, columns): 255 where a pixel's centre lies in the wall.

    The window is centred on the frame laterally and starts at its top edge. At the centre of each of its columns the
    two boundaries are interpolated between the frame's columns, so the picture is the same as that of `fill_section`
    for the same curves. Optical depth below the surface is divided by the refractive index. Columns outside the frame
    or without a wall are 0.
    """
    return boundary_slices(segmentation, scale, slice_study, (0.0,))[0]


def boundary_slices(
    segmentation: BoundaryRows, scale: PixelScale, slice_study: SliceStudy, shifts: tuple[float, ...]
) -> Bytes:
    """Draw the wall as `boundary_slice`, in windows that start lower by shares of a row (shift, rows, columns)."""
    size = slice_study.rows, slice_study.columns
    return _draw_slices(
        segmentation.outer_row, segmentation.inner_row, size, slice_study.pixel_m, scale.lateral_m, scale.depth_m,
        scale.refractive_index, np.array(shifts),
    )  # fmt: skip


@compiled
def _draw_slices(
    outer_row: Floats, inner_row: Floats, size: tuple[int, int], pixel_m: float, lateral_m: float, depth_m: float,
    refractive_index: float, shifts: Floats,
) -> Bytes:  # fmt: skip
    """Return slices of `size` (rows, columns), shape (shift, row, column); `depth_m` is of a frame's row, optical."""
    rows, columns = size
    depths = _depths(outer_row, inner_row, columns, pixel_m, lateral_m, depth_m, refractive_index)
    outer_m, inner_m = depths[0], depths[1]
    walls = np.empty((len(shifts), rows, columns), np.uint8)
    for shift in range(len(shifts)):
        for row in range(rows):
            middle_m, line = (row + 0.5 + shifts[shift]) * pixel_m, walls[shift, row]
            for column in range(columns):
                line[column] = 255 if outer_m[column] <= middle_m < inner_m[column] else 0
    return walls


@compiled
def _depths(
    outer_row: Floats, inner_row: Floats, columns: int, pixel_m: float, lateral_m: float, depth_m: float,
    refractive_index: float,
) -> Floats:  # fmt: skip
    """Return the depths of both boundaries at a slice's columns, (2, column), m, NaN where there is no wall."""
    width = len(outer_row)
    there = np.empty(width, np.intp)  # the columns with a wall
    number = behind = 0
    for column in range(width):
        if np.isfinite(outer_row[column]) and np.isfinite(inner_row[column]):
            there[number] = column
            number += 1
    depths = np.full((2, columns), np.nan)
    for column in range(columns):
        at = (column + 0.5 - columns / 2) * pixel_m / lateral_m + width / 2 - 0.5
        near = min(max(int(np.rint(at)), 0), width - 1)
        if not (-0.5 <= at <= width - 0.5 and np.isfinite(outer_row[near]) and np.isfinite(inner_row[near])):
            continue
        while behind < number - 1 and there[behind + 1] <= at:
            behind += 1
        left, right = there[behind], there[min(behind + 1, number - 1)]
        outer, inner = outer_row[left], inner_row[left]
        if left < at and right > left:
            outer = straight_line(at, left, right, outer, outer_row[right])
            inner = straight_line(at, left, right, inner, inner_row[right])
        depths[0, column] = (outer + 0.5) * depth_m
        depths[1, column] = depths[0, column] + ((inner + 0.5) * depth_m - depths[0, column]) / refractive_index
    return depths
