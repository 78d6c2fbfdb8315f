"""The slice that the network reads, from the boundaries of a segmented frame."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from scleraforce.imaging.segmentation_grid import PixelScale
from scleraforce.study import SliceStudy

__all__ = ["Boundaries", "boundary_depths", "boundary_slice"]


class Boundaries(Protocol):
    """What is needed of a segmentation: boundaries, (column,), rows of pixel centres, NaN where there is no wall."""

    @property
    def outer_row(self) -> NDArray[np.float64]: ...  # noqa: D102 - described by the class
    @property
    def inner_row(self) -> NDArray[np.float64]: ...  # noqa: D102 - described by the class


def boundary_slice(
    segmentation: Boundaries, scale: PixelScale, slice_study: SliceStudy, refractive_index: float = 1.0
) -> NDArray[np.uint8]:
    """Draw the wall of a frame into the slice's window: 255 in each pixel whose centre lies in the wall.

    The window is centred on the frame laterally and starts at its top edge. At the centre of each of its columns the
    two boundaries are interpolated between the frame's columns, so the picture is the same as that of `fill_section`
    for the same curves. Optical depth below the surface is divided by the refractive index.

    Args:
        segmentation: boundaries in the frame.
        scale: size of the frame's pixel.
        slice_study: size of the slice and of its pixel.
        refractive_index: optical over geometric depth below the surface; 1 where the scanner has corrected it.

    Returns:
        The slice, shape (rows, columns); columns outside the frame or without a wall are 0.
    """
    outer_m, inner_m = boundary_depths(segmentation, scale, slice_study, refractive_index)
    depth_m = ((np.arange(slice_study.rows) + 0.5) * slice_study.pixel_m)[:, None]
    inside = (depth_m >= outer_m) & (depth_m < inner_m)  # NaN compares as False: no wall
    wall: NDArray[np.uint8] = inside.astype(np.uint8) * np.uint8(255)
    return wall


def boundary_depths(
    segmentation: Boundaries, scale: PixelScale, slice_study: SliceStudy, refractive_index: float = 1.0
) -> NDArray[np.float64]:
    """Return the depth of both boundaries below the frame's upper edge at the centres of the slice's columns.

    Args and columns are those of `boundary_slice`.

    Returns:
        Outer and inner boundary, shape (2, columns), m; NaN outside the frame and where there is no wall.
    """
    columns = len(segmentation.outer_row)
    centre = np.arange(slice_study.columns) + 0.5 - slice_study.columns / 2
    at = centre * slice_study.pixel_m / scale.lateral_m + columns / 2 - 0.5
    outer_m = (_at(at, segmentation.outer_row) + 0.5) * scale.depth_m
    inner_m = (_at(at, segmentation.inner_row) + 0.5) * scale.depth_m
    return np.stack([outer_m, outer_m + (inner_m - outer_m) / refractive_index])


def _at(at: NDArray[np.floating], rows: NDArray[np.floating]) -> NDArray[np.float64]:
    """Interpolate a boundary; NaN outside the frame, and where the nearest column has none."""
    there = np.isfinite(rows)
    nearest = np.rint(at).astype(np.intp).clip(0, len(rows) - 1)
    known = there[nearest] & (at >= -0.5) & (at <= len(rows) - 0.5)
    if not known.any():
        return np.full(len(at), np.nan)
    return np.where(known, np.interp(at, np.flatnonzero(there), rows[there]), np.nan)
