"""The slice that the network reads, from the boundaries of a segmented frame."""

from typing import Protocol

import numpy as np

from scleraforce.arrays import Bytes, Floats
from scleraforce.compiled import compiled
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.found import Segmentation
from scleraforce.segmentation.loops import straight_line
from scleraforce.segmentation.observations import BOTTOM_M
from scleraforce.study import SliceStudy


class BoundaryRows(Protocol):
    """Boundaries of a segmentation, (column,), rows of pixel centres, NaN where there is no wall."""

    @property
    def outer_row(self) -> Floats: ...  # noqa: D102 - described by the class
    @property
    def inner_row(self) -> Floats: ...  # noqa: D102 - described by the class


def boundary_slice(segmentation: Segmentation, scale: PixelScale, slice_study: SliceStudy) -> Bytes:
    """Draw the wall of a frame into the slice's window, (rows, columns): 255 where a pixel's centre lies in the wall.

    The window is centred on the frame laterally and starts at its top edge. At the centre of each of its columns the
    two boundaries are interpolated between the frame's columns, so the picture is the same as that of `fill_section`
    for the same curves. Optical depth below the surface is divided by the refractive index. Columns outside the frame
    or without a wall are 0.
    """
    wall: Bytes = boundary_slices(segmentation, scale, slice_study, (0.0,))[0][0]
    return wall


def boundary_slices(
    segmentation: Segmentation, scale: PixelScale, slice_study: SliceStudy, shifts: tuple[float, ...]
) -> tuple[Bytes, bool, float]:
    """Draw the wall as `boundary_slice`, in windows that start lower by shares of a row (shift, rows, columns).

    Then follow what `dent_leaves` says of the first one, and how far it is between the ends of the surface that is
    seen in the window's columns, m (as `observations.surface` sees it).
    """
    size = slice_study.rows, slice_study.columns
    return _draw_slices(
        segmentation.outer_row, segmentation.inner_row, size, slice_study.pixel_m, scale.lateral_m, scale.depth_m,
        scale.refractive_index, np.array(shifts), segmentation.rows * scale.depth_m - BOTTOM_M,
    )  # fmt: skip


@compiled
def dent_leaves(cut: Bytes) -> bool:
    """Return True if the wall of a slice (row, column) leaves through the bottom and comes in again.

    Most columns between two that reach into the lowest quarter of the window then have no wall; the others hold
    fragments that a network takes for wall. The depth of such a dent cannot be seen.

    >>> dent = np.array([[255, 0, 255], [255, 0, 255], [255, 0, 255], [255, 0, 255]], dtype=np.uint8)
    >>> shadow = np.array([[255, 0, 255], [255, 0, 0], [255, 0, 0], [255, 0, 0]], dtype=np.uint8)
    >>> dent_leaves(dent), dent_leaves(shadow)
    (True, False)
    """
    (rows, columns), last, missing, leaves = cut.shape, -1, 0, False
    for column in range(columns):
        unseen = deep = 0
        for row in range(rows):
            unseen += cut[row, column] > 0
            deep += cut[row, column] > 0 and row >= rows - rows // 4
        missing += unseen == 0
        if deep > 0:
            leaves = leaves or (last >= 0 and 2 * missing > column - last - 1)
            last, missing = column, 0
    return leaves


@compiled
def _draw_slices(
    outer_row: Floats, inner_row: Floats, size: tuple[int, int], pixel_m: float, lateral_m: float, depth_m: float,
    refractive_index: float, shifts: Floats, bottom_m: float,
) -> tuple[Bytes, bool, float]:  # fmt: skip
    """Return slices of `size` (rows, columns), shape (shift, row, column); `depth_m` is of a frame's row, optical."""
    rows, columns = size
    first, last = np.inf, -np.inf
    for column in range(len(outer_row)):
        place_m = (column + (0.5 - len(outer_row) / 2)) * lateral_m
        if abs(place_m) <= columns * pixel_m / 2 and (outer_row[column] + 0.5) * depth_m < bottom_m:
            first, last = min(first, place_m), place_m
    depths = _depths(outer_row, inner_row, columns, pixel_m, lateral_m, depth_m, refractive_index)
    outer_m, inner_m = depths[0], depths[1]
    walls = np.empty((len(shifts), rows, columns), np.uint8)
    for shift in range(len(shifts)):
        for row in range(rows):
            middle_m, line = (row + 0.5 + shifts[shift]) * pixel_m, walls[shift, row]
            for column in range(columns):
                line[column] = 255 if outer_m[column] <= middle_m < inner_m[column] else 0
    return walls, dent_leaves(walls[0]), max(last - first, 0.0)


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
