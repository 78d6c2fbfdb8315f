"""The smallest and the largest of neighbouring rows, in windows that end at the edges: `cv2.erode`, `cv2.dilate`.

The rows stand one after the other in one array, so that one long loop takes all of them.
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled


@compiled
def smallest_of_rows(
    values: NDArray[np.number], number: int, columns: int, window: int, smallest: NDArray[np.number]
) -> None:
    """Write the smallest of `window` rows about each row; of an even number one more lies above it.

    Args:
        values: (row * column,).
        number: of values that count.
        columns: of a row.
        window: rows.
        smallest: the result.
    """
    for at in range(number):
        smallest[at] = values[at]
    for row in range(1, window // 2 + 1):
        away = row * columns
        for at in range(number - away):
            smallest[at + away] = min(smallest[at + away], values[at])
    for row in range(1, window - window // 2):
        away = row * columns
        for at in range(number - away):
            smallest[at] = min(smallest[at], values[at + away])


@compiled
def largest_of_rows(
    values: NDArray[np.number], number: int, columns: int, window: int, largest: NDArray[np.number]
) -> None:
    """Write the largest of `window` rows about each row; arguments are those of `smallest_of_rows`."""
    for at in range(number):
        largest[at] = values[at]
    for row in range(1, window // 2 + 1):
        away = row * columns
        for at in range(number - away):
            largest[at + away] = max(largest[at + away], values[at])
    for row in range(1, window - window // 2):
        away = row * columns
        for at in range(number - away):
            largest[at] = max(largest[at], values[at + away])
