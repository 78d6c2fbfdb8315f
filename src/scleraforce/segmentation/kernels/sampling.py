"""Light between the pixels of a frame, as `cv2.remap` takes it, and sums over neighbours."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.segmentation.grid import Float
from scleraforce.segmentation.kernels.multiply_add import multiply_add

Counts = NDArray[np.uint16]
Indices = NDArray[np.uintp]


@compiled
def sample_row(
    frame: Counts, first: int, near: Indices, far: Indices, across: Float, row: Float, upper: Indices, lower: Indices,
    down: Float, light: Float,
) -> None:  # fmt: skip
    """Write the counts at some points, interpolated and rounded; the frame goes on beyond its edges as it is there.

    Args:
        frame: counts, shape (row, column).
        first: column that the points' ones count from.
        near: column before each point, (point,).
        far: column after it.
        across: by how much it lies beyond the one before.
        row: of the points.
        upper: scratch, (point,).
        lower: the same.
        down: the same.
        light: the result.
    """
    last, origin = frame.shape[0] - 1, np.uintp(first)
    for at in range(len(row)):
        above = np.floor(row[at])
        down[at] = row[at] - above
        place = int(above)
        upper[at], lower[at] = min(max(place, 0), last), min(max(place + 1, 0), last)
    for at in range(len(row)):
        left, right = origin + near[at], origin + far[at]
        p00, p01 = np.float32(frame[upper[at], left]), np.float32(frame[upper[at], right])
        p10, p11 = np.float32(frame[lower[at], left]), np.float32(frame[lower[at], right])
        above = multiply_add(across[at], p01 - p00, p00)
        below = multiply_add(across[at], p11 - p10, p10)
        light[at] = np.rint(multiply_add(down[at], below - above, above))


@compiled
def mirrored(place: int, length: int) -> int:
    """Return the place inside of a row of this length that stands for one beyond its ends: mirrored in its ends."""
    if length == 1:
        return 0
    while place < 0 or place >= length:
        place = -place if place < 0 else 2 * (length - 1) - place
    return place


@compiled
def mean_of_neighbours(values: Float, reach: int, means: Float) -> None:
    """Write the mean over so many values on each side, mirrored at the ends, as `cv2.blur` does."""
    length, share = len(values), 1.0 / (2 * reach + 1)
    total = 0.0
    for place in range(-reach, reach + 1):
        total += np.float64(values[mirrored(place, length)])
    for at in range(length):
        means[at] = np.float32(total * share)
        total += np.float64(values[mirrored(at + reach + 1, length)]) - np.float64(values[mirrored(at - reach, length)])
