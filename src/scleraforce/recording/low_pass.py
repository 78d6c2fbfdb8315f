"""The low-pass of a force log: Butterworth's of order 2, run forward and backward."""

from math import pi, sqrt, tan

import numpy as np

from scleraforce.arrays import Floats
from scleraforce.compiled import compiled


def smoothed(values: Floats, cutoff: float, reach: int) -> Floats:
    """Return evenly sampled values without delay; `cutoff`: the frequency of half the amplitude, over the sampling's.

    The values are continued by their mirror image for `reach` samples, fewer than there are.
    """
    whole = np.pad(values, reach, mode="reflect")
    k = tan(pi * cutoff)  # bilinear transform, with the cutoff at its place
    over = 1.0 + sqrt(2.0) * k + k * k
    run_to_and_fro(whole, k * k / over, 2.0 * (k * k - 1.0) / over, (1.0 - sqrt(2.0) * k + k * k) / over)
    return whole[reach : reach + len(values)]


@compiled
def run_to_and_fro(values: Floats, b: float, a_1: float, a_2: float) -> None:
    """Filter values by b (1 + z)^2 / (1 + a_1 z + a_2 z^2), z the delay, from the first and from the last on.

    Before its first value a run is at rest at that value.
    """
    last = len(values) - 1
    for first in (0, last):
        of_two = (b - a_2) * values[first]
        of_one = (2.0 * b - a_1) * values[first] + of_two
        for place in range(last + 1):
            at = abs(first - place)
            value = values[at]
            found = b * value + of_one
            of_one = 2.0 * b * value - a_1 * found + of_two
            of_two = b * value - a_2 * found
            values[at] = found
