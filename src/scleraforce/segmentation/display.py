"""Frames of a linear display, made like those of a logarithmic one: all ways to find a wall expect that.

Two intensities of fully developed speckle, of the same mean and far enough apart, are exponential and independent
(Goodman, Speckle Phenomena in Optics, ch. 3): the share that one has in their sum is uniform, whatever the mean and the
sum. So the median of |a - b| / (a + b), over the brightest pairs of counts, is 1/2 where counts grow with the
intensity, and (sqrt(3) - 1)/(sqrt(3) + 1) = 0.27 where they grow with its root, whatever the gain. On a logarithmic
display it is 2.4 dB over the level of bright tissue above black, 0.04 to 0.12 on drawn ones.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels
from scleraforce.segmentation.compiling import wall_is_compiled

NOT_LOGARITHMIC = 0.38  # contrast of pairs: midway between the root and the intensity itself
PAIR_COLUMNS, LOOKED_AT_ROWS = 8, 24  # of a pair, from one count to the other; of a frame, spread over it
DIMMER = 0.9  # of the pairs are left out: noise about the tissue
LEAST_PAIRS = 200


def as_logarithmic(frame: Pixels) -> Pixels:
    """Return a frame as a logarithmic display would show it, as 16 bits: itself, where it comes from one.

    Args:
        frame: counts, uint8 or uint16, shape (row, column).
    """
    if pair_contrast(frame) <= NOT_LOGARITHMIC:
        return frame
    return _logarithms(int(np.iinfo(frame.dtype).max))[frame]


def pair_contrast(frame: Pixels) -> float:
    """Return how much the brightest pairs of a frame differ, as a share of their sums (median): 0 where few are lit.

    Pairs as bright as the dimmest of the brightest tenth count as well.
    """
    looked_at = frame[:: max(1, len(frame) // LOOKED_AT_ROWS)]
    if wall_is_compiled():
        # Imported here: Numba takes longer than a frame does.
        from scleraforce.segmentation.kernels.contrast import find_contrast

        return find_contrast(looked_at.astype(np.uint16), PAIR_COLUMNS, DIMMER, LEAST_PAIRS)
    rows = looked_at.astype(np.int32)
    one, other = rows[:, PAIR_COLUMNS:], rows[:, :-PAIR_COLUMNS]
    lit = (one > 0) & (other > 0)
    one, other = one[lit], other[lit]
    if len(one) < LEAST_PAIRS:
        return 0.0
    total = one + other
    place, mean = int(DIMMER * len(total)), total >> 1
    brightest = mean >= np.partition(mean, place)[place]
    shares = np.abs(one - other)[brightest].astype(np.float32) / total[brightest].astype(np.float32)
    return float(np.median(shares))


@cache
def _logarithms(largest: int) -> NDArray[np.uint16]:
    """Return what each count up to the largest becomes: its logarithm, black being 0 and the largest 65,535."""
    shares = np.log1p(np.arange(largest + 1.0)) / np.log1p(largest)
    table: NDArray[np.uint16] = np.rint(65535.0 * shares).astype(np.uint16)
    table.flags.writeable = False
    return table
