"""From the network's histogram to the force: classes, median and interval, all of one distribution (NumPy only).

The network answers with the probability of bins of x = F/E, E the modulus that it was told. Within a bin the density is
even, so the distribution function is piecewise linear, and what is said of the force agrees: the probability of a class
is that of its forces, and the median lies in the class that has more than half of it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["INTERVAL", "ForceDistribution", "class_probabilities", "force_distribution", "quantile", "ratio_edges"]

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
