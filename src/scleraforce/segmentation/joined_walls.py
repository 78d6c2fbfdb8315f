"""One wall of two that are nearly the same: the finer one, and the other where that is better for a stretch.

Where the inner boundaries part, light falls at the true one: the mean of what lies above it, less that of what lies
below. Each stretch is decided as a whole, so that noise in single columns decides nothing.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels
from scleraforce.segmentation.steps import Segmentation

Curve = NDArray[np.float64]
Mask = NDArray[np.bool_]

SIDE_SHARE, LEAST_SIDE_ROWS = 0.1, 3.0  # of the thickness are looked at above and below a boundary
SAMPLES = 8  # rows that are looked at on a side


def joined_walls(frame: Pixels, finer: Segmentation, other: Segmentation, apart_rows: float) -> Segmentation:
    """Return the finer wall, with the other one's inner boundary in stretches where light falls more there.

    Where only the other wall is, it is taken, but for what a needle hides.

    Args:
        frame: counts on a logarithmic scale (row, column).
        finer: a wall in it.
        other: another one.
        apart_rows: by how many rows the inner boundaries have to part.
    """
    seen, added = np.isfinite(finer.outer_row), np.isfinite(other.outer_row)
    both, only = seen & added, added & ~seen
    if finer.needle is not None:
        only[slice(*finer.needle.hidden)] = False
    outer, inner = np.where(only, other.outer_row, finer.outer_row), np.where(only, other.inner_row, finer.inner_row)
    parted = both.copy()
    parted[both] = np.abs(finer.inner_row[both] - other.inner_row[both]) > apart_rows
    at = np.flatnonzero(parted)
    if len(at):
        stretch = np.cumsum(np.diff(at, prepend=at[0]) > 1)
        gain = np.bincount(stretch, _falls(frame, other, finer, at) - _falls(frame, finer, other, at))
        better = at[gain[stretch] > 0.0]
        inner[better] = other.inner_row[better]
    return replace(finer, outer_row=outer, inner_row=inner)


def _falls(frame: Pixels, wall: Segmentation, against: Segmentation, at: NDArray[np.intp]) -> Curve:
    """Return by how many counts the light falls at a wall's inner boundary, at some columns; 0 beyond the frame.

    As many rows are looked at as against the other wall, so that both are seen alike.
    """
    inner = wall.inner_row[at]
    thickness = np.maximum(inner - wall.outer_row[at], against.inner_row[at] - against.outer_row[at])
    side = np.maximum(SIDE_SHARE * thickness, LEAST_SIDE_ROWS)
    off = (np.arange(SAMPLES)[:, None] + 0.5) / SAMPLES * side
    inside = (inner - side > -0.5) & (inner + side < len(frame) - 0.5)
    above, below = (
        frame[np.clip(np.rint(inner + sign * off).astype(np.intp), 0, len(frame) - 1), at].mean(axis=0)
        for sign in (-1.0, 1.0)
    )
    falls: Curve = np.where(inside, above - below, 0.0)
    return falls
