"""The slice that the network reads, from the boundaries of a segmented frame."""

from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.compiling import wall_is_compiled
from scleraforce.study import SliceStudy


class BoundaryRows(Protocol):
    """What is needed of a segmentation: boundaries, (column,), rows of pixel centres, NaN where there is no wall."""

    @property
    def outer_row(self) -> NDArray[np.float64]: ...  # noqa: D102 - described by the class
    @property
    def inner_row(self) -> NDArray[np.float64]: ...  # noqa: D102 - described by the class


def boundary_slice(segmentation: BoundaryRows, scale: PixelScale, slice_study: SliceStudy) -> NDArray[np.uint8]:
    """Draw the wall of a frame into the slice's window: 255 in each pixel whose centre lies in the wall.

    The window is centred on the frame laterally and starts at its top edge. At the centre of each of its columns the
    two boundaries are interpolated between the frame's columns, so the picture is the same as that of `fill_section`
    for the same curves. Optical depth below the surface is divided by the refractive index.

    Args:
        segmentation: boundaries in the frame.
        scale: size of the frame's pixel, with the refractive index.
        slice_study: size of the slice and of its pixel.

    Returns:
        The slice, shape (rows, columns); columns outside the frame or without a wall are 0.
    """
    wall: NDArray[np.uint8] = boundary_slices(segmentation, scale, slice_study, (0.0,))[0]
    return wall


def boundary_slices(
    segmentation: BoundaryRows,
    scale: PixelScale,
    slice_study: SliceStudy,
    shifts: tuple[float, ...],
) -> NDArray[np.uint8]:
    """Draw the wall of a frame several times, into windows that start lower by shares of a slice's pixel.

    Args:
        segmentation: as of `boundary_slice`, like the next two.
        scale: size of the frame's pixel, with the refractive index.
        slice_study: size of the slice and of its pixel.
        shifts: of the windows, in rows of the slice.

    Returns:
        The slices, shape (shift, rows, columns).
    """
    depth_m = _row_depths(slice_study.rows, slice_study.pixel_m, shifts)
    if wall_is_compiled():
        # Imported here: Numba takes longer than a frame does.
        from scleraforce.segmentation.kernels.slices import draw_boundary_slices

        outer_row, inner_row = segmentation.outer_row, segmentation.inner_row
        places = _places(len(outer_row), scale.lateral_m, slice_study.columns, slice_study.pixel_m)
        return draw_boundary_slices(outer_row, inner_row, places, scale.depth_m, scale.refractive_index, depth_m)
    outer_m, inner_m = boundary_depths(segmentation, scale, slice_study)
    inside = depth_m >= outer_m
    inside &= depth_m < inner_m  # NaN compares as False: no wall
    walls: NDArray[np.uint8] = inside.view(np.uint8) * np.uint8(255)
    return walls


def boundary_depths(segmentation: BoundaryRows, scale: PixelScale, slice_study: SliceStudy) -> NDArray[np.float64]:
    """Return the depth of both boundaries below the frame's upper edge at the centres of the slice's columns.

    Args and columns are those of `boundary_slice`.

    Returns:
        Outer and inner boundary, shape (2, columns), m; NaN outside the frame and where there is no wall.
    """
    outer_row, inner_row = segmentation.outer_row, segmentation.inner_row
    at, nearest, inside = _places(len(outer_row), scale.lateral_m, slice_study.columns, slice_study.pixel_m)
    there = np.isfinite(outer_row) & np.isfinite(inner_row)
    known = there[nearest] & inside
    depths = np.full((2, len(at)), np.nan)
    if not np.count_nonzero(known):
        return depths
    columns = np.flatnonzero(there)
    for depth_m, rows in zip(depths, (outer_row, inner_row), strict=True):
        depth_m[:] = np.interp(at, columns, rows[columns])
    depths += 0.5
    depths *= scale.depth_m
    outer_m, inner_m = depths
    inner_m -= outer_m
    inner_m /= scale.refractive_index
    inner_m += outer_m
    depths[:, ~known] = np.nan
    return depths


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
    """Return where the middles of a slice's columns lie in a frame, the nearest columns, and which are in the frame."""
    centre = np.arange(slice_columns, dtype=np.float64) + 0.5 - slice_columns / 2
    at = centre * pixel_m / lateral_m + columns / 2 - 0.5
    nearest: NDArray[np.intp] = np.rint(at).astype(np.intp).clip(0, columns - 1)
    return at, nearest, (at >= -0.5) & (at <= columns - 0.5)
