"""The slice that the network reads, from the boundaries of a segmented frame."""

from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.loops import straight_line
from scleraforce.study import SliceStudy

Floats = NDArray[np.float64]
Places = tuple[Floats, NDArray[np.intp], NDArray[np.bool_]]


class BoundaryRows(Protocol):
    """Boundaries of a segmentation, (column,), rows of pixel centres, NaN where there is no wall."""

    @property
    def outer_row(self) -> NDArray[np.float64]: ...  # noqa: D102 - described by the class
    @property
    def inner_row(self) -> NDArray[np.float64]: ...  # noqa: D102 - described by the class


def boundary_slice(segmentation: BoundaryRows, scale: PixelScale, slice_study: SliceStudy) -> NDArray[np.uint8]:
    """Draw the wall of a frame into the slice's window, (rows, columns): 255 where a pixel's centre lies in the wall.

    The window is centred on the frame laterally and starts at its top edge. At the centre of each of its columns the
    two boundaries are interpolated between the frame's columns, so the picture is the same as that of `fill_section`
    for the same curves. Optical depth below the surface is divided by the refractive index. Columns outside the frame
    or without a wall are 0.
    """
    wall: NDArray[np.uint8] = boundary_slices(segmentation, scale, slice_study, (0.0,))[0]
    return wall


def boundary_slices(
    segmentation: BoundaryRows,
    scale: PixelScale,
    slice_study: SliceStudy,
    shifts: tuple[float, ...],
) -> NDArray[np.uint8]:
    """Draw the wall as `boundary_slice`, in windows that start lower by shares of a row (shift, rows, columns)."""
    depth_m = _row_depths(slice_study.rows, slice_study.pixel_m, shifts)
    outer_row, inner_row = segmentation.outer_row, segmentation.inner_row
    places = _places(len(outer_row), scale.lateral_m, slice_study.columns, slice_study.pixel_m)
    return _draw_slices(outer_row, inner_row, places, scale.depth_m, scale.refractive_index, depth_m)


@lru_cache(maxsize=8)
def _row_depths(rows: int, pixel_m: float, shifts: tuple[float, ...]) -> NDArray[np.float64]:
    """Return the depth of the middles of shifted slices' rows, (shift, row, 1), m."""
    middles = np.arange(rows, dtype=np.float64) + 0.5
    depths: NDArray[np.float64] = (middles[None, :, None] + np.array(shifts)[:, None, None]) * pixel_m
    return depths


@lru_cache(maxsize=8)
def _places(
    columns: int, lateral_m: float, slice_columns: int, pixel_m: float
) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.bool_]]:
    """Return the places of a slice's columns in a frame, the nearest columns, and which are in the frame."""
    centre = np.arange(slice_columns, dtype=np.float64) + 0.5 - slice_columns / 2
    at = centre * pixel_m / lateral_m + columns / 2 - 0.5
    nearest: NDArray[np.intp] = np.rint(at).astype(np.intp).clip(0, columns - 1)
    return at, nearest, (at >= -0.5) & (at <= columns - 0.5)


@compiled
def _draw_slices(
    outer_row: Floats, inner_row: Floats, places: Places, depth_m: float, refractive_index: float, row_depths_m: Floats
) -> NDArray[np.uint8]:
    """Return the slices, shape (shift, row, column); `row_depths_m`: depth of their rows, (shift, row, 1)."""
    depths = _depths(outer_row, inner_row, places, depth_m, refractive_index)
    outer_m, inner_m = depths[0], depths[1]
    shifts, rows, _ = row_depths_m.shape
    walls = np.empty((shifts, rows, len(outer_m)), np.uint8)
    for shift in range(shifts):
        for row in range(rows):
            middle_m, line = row_depths_m[shift, row, 0], walls[shift, row]
            for column in range(len(outer_m)):
                line[column] = 255 if outer_m[column] <= middle_m < inner_m[column] else 0
    return walls


@compiled
def _depths(outer_row: Floats, inner_row: Floats, places: Places, depth_m: float, refractive_index: float) -> Floats:
    """Return the depths of both boundaries at a slice's columns, (2, column), m, NaN where there is no wall.

    `places` of the slice's columns are those of `_places`; `depth_m` is of a row of the frame, optical.
    """
    at, nearest, inside = places
    there = np.empty(len(outer_row), np.intp)  # the columns with a wall
    number = 0
    for column in range(len(outer_row)):
        if np.isfinite(outer_row[column]) and np.isfinite(inner_row[column]):
            there[number] = column
            number += 1
    depths = np.full((2, len(at)), np.nan)
    behind = 0
    for column in range(len(at)):
        here, near = at[column], nearest[column]
        if not (inside[column] and np.isfinite(outer_row[near]) and np.isfinite(inner_row[near])):
            continue
        while behind < number - 1 and there[behind + 1] <= here:
            behind += 1
        left, right = there[behind], there[min(behind + 1, number - 1)]
        outer, inner = outer_row[left], inner_row[left]
        if left < here and right > left:
            outer = straight_line(here, left, right, outer, outer_row[right])
            inner = straight_line(here, left, right, inner, inner_row[right])
        depths[0, column] = (outer + 0.5) * depth_m
        depths[1, column] = depths[0, column] + ((inner + 0.5) * depth_m - depths[0, column]) / refractive_index
    return depths
