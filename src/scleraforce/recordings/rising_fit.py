"""The compiled loops of `clock_offsets`: what no rising function of the force explains
of the frames' dents.

A rising function that is nearest by least squares is found by pooling neighbours that
fall (isotonic regression; Barlow et al., Statistical Inference under Order
Restrictions, 1972).
"""

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.compiled_loops import compiled, compiled_part
from scleraforce.recordings.clock_offsets import LEAST_FRAMES

LEAST_SHARE = 0.75  # of the frames that must lie on the log under an offset
NOISE_SPAN = 6.0  # standard deviations of the log's noise, by which forces must differ
RAMP = 0.2  # of the forces' span: a frame with such a change counts half
# Share of the rest of a rising parabola in q, and the rest that is still usual: 0.13 in
# a virtual eye of tissue that stiffens, 0.05 at most in 20 others
SHAPE = 0.1
USUAL_REST = 0.15


@compiled_part
def _rising_rest(values: Floats, weights: Floats) -> float:
    """Return the weighted sum of squares that the nearest rising sequence leaves."""
    count = len(values)
    means = np.empty(count)
    sizes = np.empty(count)
    lengths = np.empty(count, np.int64)
    pools = 0

    for n in range(count):
        means[pools] = values[n]
        sizes[pools] = weights[n]
        lengths[pools] = 1
        pools += 1

        while pools > 1 and means[pools - 2] > means[pools - 1]:
            size = sizes[pools - 2] + sizes[pools - 1]
            means[pools - 2] = (
                means[pools - 2] * sizes[pools - 2]
                + means[pools - 1] * sizes[pools - 1]
            ) / size
            sizes[pools - 2] = size
            lengths[pools - 2] += lengths[pools - 1]
            pools -= 1

    rest = 0.0
    n = 0
    for pool in range(pools):
        for _ in range(lengths[pool]):
            rest += weights[n] * (values[n] - means[pool]) ** 2
            n += 1

    return rest


@compiled_part
def _parabolic_rest(
    force: Floats, there: Floats, weights: Floats, total: float
) -> float:
    """Return the sum of squares that a rising parabola leaves; a line if the parabola
    falls somewhere, nothing if the line falls.
    """
    size = weights.sum()
    x = force - (weights * force).sum() / size
    variance = (weights * x**2).sum() / size
    x /= np.sqrt(variance) if variance > 0.0 else 1.0
    skew = (weights * x**3).sum() / size
    bow = x**2 - 1.0 - skew * x
    bow_size = max((weights * bow**2).sum(), 1e-12)
    line = (weights * x * there).sum() / size
    bend = (weights * bow * there).sum() / bow_size
    low = line - skew * bend + 2.0 * bend * min(x.min(), 0.0)
    high = line - skew * bend + 2.0 * bend * max(x.max(), 0.0)
    by_line = max(line, 0.0) ** 2 * size
    by_bend = bend**2 * bow_size if low >= 0.0 and high >= 0.0 else 0.0

    return float(max(total - by_line - by_bend, 0.0))


@compiled
def unexplained(
    force_on: Floats, change_on: Floats, dent: Floats, noise_n: float
) -> tuple[Floats, Floats]:
    """Return q of the dents (frame,) at forces (offset, frame), and the number of
    frames that count, each (offset,).

    A force that is not known is NaN. `change_on` is how much it changes about a frame,
    N. q is NaN with too few known forces, or if they differ by less than the noise.
    """
    offsets, frames = force_on.shape
    q = np.full(offsets, np.nan)
    counted = np.zeros(offsets)

    for offset in range(offsets):
        known = np.flatnonzero(np.isfinite(force_on[offset]))
        if len(known) < max(LEAST_FRAMES, LEAST_SHARE * frames):
            continue

        forces = force_on[offset][known]
        span_n = forces.max() - forces.min()
        if not span_n > NOISE_SPAN * noise_n:
            continue

        order = np.argsort(forces, kind="mergesort")
        forces = forces[order]
        ramps = change_on[offset][known][order] / (RAMP * span_n)
        weights = 1.0 / (1.0 + ramps**2)
        there = dent[known][order]
        there = there - (weights * there).sum() / weights.sum()
        total = (weights * there**2).sum()
        if not total > 0.0:
            continue

        bent = _parabolic_rest(forces, there, weights, total) / total
        rest = _rising_rest(there, weights) / total
        q[offset] = rest + SHAPE * max(bent - USUAL_REST, 0.0)
        counted[offset] = weights.sum()

    return q, counted


@compiled
def rising_rests(values_on: Floats) -> Floats:
    """Return the sum of squares that rising sequences leave of each row, (row,)."""
    rests = np.empty(len(values_on))
    weights = np.ones(values_on.shape[1])
    for row in range(len(values_on)):
        rests[row] = _rising_rest(values_on[row], weights)

    return rests
