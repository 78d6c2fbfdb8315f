"""How much the brightest pairs of a frame's counts differ: `display.pair_contrast` as compiled loops."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.segmentation.kernels.ranks import BINS, nth, nth_count


@compiled
def find_contrast(rows: NDArray[np.uint16], pair_columns: int, dimmer_share: float, least_pairs: int) -> float:
    """Return the contrast.

    Args:
        rows: counts of the rows that are looked at, shape (row, column).
        pair_columns: from one count of a pair to the other.
        dimmer_share: of the lit pairs is not looked at.
        least_pairs: of lit ones: the contrast of fewer is 0.
    """
    columns = rows.shape[1]
    mean, number = np.empty(rows.size, np.uint16), 0
    for line in rows:
        for column in range(pair_columns, columns):
            one, other = np.int64(line[column]), np.int64(line[column - pair_columns])
            mean[number] = (one + other) >> 1
            number += (one > 0) & (other > 0)  # no branch: half of them would be taken by chance
    if number < least_pairs:
        return 0.0
    least = nth_count(mean, number, int(dimmer_share * number), np.empty(BINS, np.int64))
    share, chosen = np.empty(number, np.float32), 0
    for line in rows:
        for column in range(pair_columns, columns):
            one, other = np.int64(line[column]), np.int64(line[column - pair_columns])
            if (one + other) >> 1 >= least and one > 0 and other > 0:
                share[chosen] = np.float32(abs(one - other)) / np.float32(one + other)
                chosen += 1
    upper = nth(share, chosen, chosen // 2)
    lower = upper if chosen % 2 else nth(share, chosen, chosen // 2 - 1)
    return float(np.float32(0.5) * (lower + upper))
