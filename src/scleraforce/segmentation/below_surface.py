"""What lies below a surface: the wall unrolled on evenly spread columns, and its inner boundary looked for there."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.columns import fine_columns, interpolation, repeated
from scleraforce.segmentation.grid import Float
from scleraforce.segmentation.inner import CELLS, GROUP, InnerBoundary, find_inner, surface_stretch

INNER_COLUMNS = 128


def in_tissue(scale: PixelScale) -> PixelScale:
    """Return the size of a frame's pixel in tissue, the depth geometric."""
    return PixelScale(lateral_m=scale.lateral_m, depth_m=scale.depth_m / scale.refractive_index)


def rows_per_metre(columns: int, row: Float, tissue: PixelScale) -> Float:
    """Return the rows along a column for 1 m of thickness along a surface's normal, shape (point,).

    Args:
        columns: of the frame.
        row: of the surface at `fine_columns`, no NaN.
        tissue: size of the frame's pixel in tissue.
    """
    along_rows = surface_stretch(fine_columns(columns), row, tissue)
    along_rows /= np.float32(tissue.depth_m)
    return along_rows


def search_below(
    frame: Pixels,
    floor: float,
    row: Float,
    present: NDArray[np.bool_],
    along_rows: Float,
    prior: Float | None = None,
) -> InnerBoundary:
    """Look for the inner boundary below a surface, at groups of points.

    Args:
        frame: counts, shape (row, column).
        floor: count of its noise floor.
        row: of the surface at `fine_columns`, no NaN, shape (point,).
        present: whether there is a surface.
        along_rows: `rows_per_metre` of it.
        prior: as of `find_inner`.
    """
    points = grouping(len(row))[0]
    column, seen = repeated(frame.shape[1], CELLS), (row, present, along_rows)
    if len(row) != INNER_COLUMNS:
        column, seen = column[:, points], (row[points], present[points], along_rows[points])
    return find_inner(frame, floor, column, *seen, prior)


def grouping(points: int) -> tuple[NDArray[np.intp], Float]:
    """Return which of so many points are looked at, and the matrix that takes values of their groups to all of them."""
    return interpolation(points, INNER_COLUMNS, GROUP)


def grouped(values: Float) -> Float:
    """Return the means over the groups of points that are looked at, (group,)."""
    mean: Float = values[grouping(len(values))[0]].reshape(-1, GROUP).mean(axis=1)
    return mean
