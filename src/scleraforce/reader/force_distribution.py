"""From the network's histogram to the force: classes, median and interval, all of one distribution.

The network answers with the probability of bins of x = F/E, E the modulus that it was told. Within a bin the density is
even, so the distribution function is piecewise linear, and what is said of the force agrees: the probability of a class
is that of its forces, and the median lies in the class that has more than half of it.

Training judges many frames at once, with arrays; the control loop reads one, and `single_force` does so in plain
Python: a third of the time.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from math import inf, nan

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

INTERVAL = (0.05, 0.95)  # the shares of the distribution below the 90 % interval's ends


@dataclass(frozen=True)
class ForceDistribution:
    """Distributions of a force: `share_sk` of it lies below `edge_n_sk` (sample, edge), N; linear in between.

    Shares rise from 0 to 1, edges increase.
    """

    edge_n_sk: Floats
    share_sk: Floats

    @property
    def median_n(self) -> Floats:
        """Median force (sample,), N."""
        return quantile(self, 0.5)[:, 0]

    @property
    def interval_n(self) -> Floats:
        """Ends of the 90 % interval (sample, 2), N: a twentieth lies on either side of it."""
        return quantile(self, *INTERVAL)


@dataclass(frozen=True)
class SingleForce:
    """Median force, the ends of its 90 % interval, N, and the probability of each class."""

    median_n: float
    interval_n: tuple[float, float]
    probabilities: tuple[float, ...]


def ratio_edges(bins: int, max_force_ratio: float) -> Floats:
    """Return the edges of the bins of x = F/E (bins + 1,), m^2, with widths that grow linearly from 0.

    So a bin is narrow where forces are small and eyes stiff.

    >>> ratio_edges(4, 16.0)
    array([ 0.,  1.,  4.,  9., 16.])
    """
    edges: Floats = max_force_ratio * (np.arange(bins + 1) / bins) ** 2
    return edges


def force_distribution(probabilities: NDArray[np.floating], edges_m2: Floats, modulus_pa: Floats) -> ForceDistribution:
    """Return the distribution of the force.

    Args:
        probabilities: of the bins (sample, bin), of any positive sum.
        edges_m2: of the bins (bin + 1,).
        modulus_pa: that the network was told (sample,).
    """
    shares = np.zeros((len(probabilities), len(edges_m2)))
    probabilities.cumsum(axis=1, dtype=np.float64, out=shares[:, 1:])
    shares /= shares[:, -1:]
    return ForceDistribution(np.asarray(modulus_pa, dtype=np.float64)[:, None] * edges_m2, shares)


def quantile(distribution: ForceDistribution, *shares: float) -> Floats:
    """Return the forces that these shares (between 0 and 1) of each distribution lie below (sample, share), N."""
    edges, below = distribution.edge_n_sk, distribution.share_sk
    wanted = np.array(shares)
    last = (below[:, None, :] < wanted[:, None]).sum(axis=2)
    last = np.minimum(np.maximum(last, 1), below.shape[1] - 1)
    sample = np.arange(len(below))[:, None]
    low, high = below[sample, last - 1], below[sample, last]
    part = (wanted - low) / np.where(high > low, high - low, 1.0)
    start = edges[sample, last - 1]
    forces: Floats = start + part * (edges[sample, last] - start)
    return forces


def class_probabilities(distribution: ForceDistribution, bounds_n: tuple[float, ...]) -> Floats:
    """Return the probability of each class, shape (sample, len(bounds_n) + 1); rows sum to 1.

    Args:
        distribution: of the force.
        bounds_n: increasing bounds between the classes, N.
    """
    below = np.empty((len(distribution.share_sk), len(bounds_n) + 2))
    below[:, 0], below[:, -1] = 0.0, 1.0
    for row, edges, shares in zip(below, distribution.edge_n_sk, distribution.share_sk, strict=True):
        row[1:-1] = np.interp(bounds_n, edges, shares)
    probabilities: Floats = below[:, 1:] - below[:, :-1]
    return probabilities


def single_force(
    histogram: Sequence[float],
    edges_m2: Sequence[float],
    modulus_pa: float,
    bounds_n: tuple[float, ...],
    factor_of: Callable[[float], float] = lambda _: 1.0,
) -> SingleForce:
    """Return what one histogram says of the force: the same as the arrays' functions, for one sample.

    Args:
        histogram: probabilities of the bins, of any positive sum; one that is no number makes every answer none.
        edges_m2: of the bins, one more.
        modulus_pa: that the network was told.
        bounds_n: increasing bounds between the classes, N.
        factor_of: what the distribution is stretched by about its median, of that median (`interval_factors`); no
            force is below 0.

    >>> single_force([1.0, 1.0], [0.0, 1e-8, 3e-8], 1e6, (5e-3, 20e-3)).probabilities
    (0.25, 0.5, 0.25)
    """
    sums = list(accumulate(histogram, initial=0.0))
    total = sums[-1] if 0.0 < sums[-1] < inf else nan
    low_n, median_n, high_n = (
        modulus_pa * _crossing(sums, edges_m2, share * total) for share in (INTERVAL[0], 0.5, INTERVAL[1])
    )
    factor = factor_of(median_n)
    low_n, high_n = stretched_interval(median_n, (low_n, high_n), factor)
    asked_n = unstretched(median_n, bounds_n, factor)
    below = [0.0, *(_sum_below(sums, edges_m2, force_n / modulus_pa) / total for force_n in asked_n), 1.0]
    return SingleForce(median_n, (low_n, high_n), tuple(after - before for before, after in pairwise(below)))


def stretched_interval(median_n: float, interval_n: tuple[float, float], factor: float) -> tuple[float, float]:
    """Return an interval whose distribution is stretched about its median by a factor; no force is below 0."""
    low_n, high_n = (max(median_n + factor * (end_n - median_n), 0.0) for end_n in interval_n)
    return low_n, high_n


def unstretched(median_n: float, forces_n: tuple[float, ...], factor: float) -> tuple[float, ...]:
    """Return the forces of which a distribution says what the one that is stretched by a factor says of `forces_n`.

    >>> unstretched(10.0, (16.0, 1.0), 2.0)
    (13.0, 5.5)
    """
    return tuple(max(median_n + (force_n - median_n) / factor, 0.0) for force_n in forces_n)


def _crossing(sums: Sequence[float], edges_m2: Sequence[float], wanted: float) -> float:
    """Return where the sums reach what is wanted."""
    last = min(max(bisect_left(sums, wanted), 1), len(sums) - 1)
    low, high = sums[last - 1], sums[last]
    part = (wanted - low) / (high - low if high > low else 1.0)
    return edges_m2[last - 1] + part * (edges_m2[last] - edges_m2[last - 1])


def _sum_below(sums: Sequence[float], edges_m2: Sequence[float], ratio_m2: float) -> float:
    """Return the sum of what lies below a ratio."""
    last = bisect_right(edges_m2, ratio_m2)
    if last >= len(edges_m2):
        return sums[-1]
    part = (ratio_m2 - edges_m2[last - 1]) / (edges_m2[last] - edges_m2[last - 1])
    return sums[last - 1] + part * (sums[last] - sums[last - 1])
