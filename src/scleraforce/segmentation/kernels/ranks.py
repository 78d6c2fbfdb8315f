"""The value that so many others lie below, without sorting them all."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.segmentation.grid import Float

BINS = 256  # bins: of the high byte of a count, then of the low one


@compiled
def nth_count(counts: NDArray[np.uint16], number: int, place: int, bins: NDArray[np.int64]) -> int:
    """Return the count that stands at a place of the first `number` ones, if they were in order; `bins` is scratch."""
    for value in range(BINS):
        bins[value] = 0
    for i in range(number):
        bins[np.int64(counts[i]) >> 8] += 1
    high, below = 0, 0
    while below + bins[high] <= place:
        below += bins[high]
        high += 1
    for value in range(BINS):
        bins[value] = 0
    for i in range(number):
        if np.int64(counts[i]) >> 8 == high:
            bins[np.int64(counts[i]) & 255] += 1
    low = 0
    while below + bins[low] <= place:
        below += bins[low]
        low += 1
    return high * BINS + low


@compiled
def nth(values: Float, number: int, place: int) -> np.float32:
    """Return the value that stands at a place of the first `number` ones, if they were in order; they are moved.

    Hoare's FIND (1961): parts are exchanged about a middle one until the place alone is left.
    """
    first, last = 0, number - 1
    while first < last:
        middle, low, high = values[(first + last) // 2], first, last
        while low <= high:
            while values[low] < middle:
                low += 1
            while values[high] > middle:
                high -= 1
            if low <= high:
                values[low], values[high] = values[high], values[low]
                low += 1
                high -= 1
        if place <= high:
            last = high
        elif place >= low:
            first = low
        else:
            return values[place]
    return values[place]
