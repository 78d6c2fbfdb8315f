"""A value that a study samples: one of a list, or anywhere in a range."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Choice:
    """One of `values`, all equally likely.

    >>> Choice((4e-4, 5e-4)).bounds
    (0.0004, 0.0005)
    """

    values: tuple[float, ...]

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return min(self.values), max(self.values)

    def sample(self, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
        """Draw `count` independent values, shape (count,)."""
        return rng.choice(np.asarray(self.values, dtype=np.float64), size=count)


@dataclass(frozen=True, kw_only=True)
class Range:
    """Uniform between `min` and `max`.

    >>> Range(min=0.0, max=1.0).bounds
    (0.0, 1.0)
    """

    min: float
    max: float

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return self.min, self.max

    def sample(self, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
        """Draw `count` independent values, shape (count,)."""
        return rng.uniform(self.min, self.max, size=count)


Sampled = Choice | Range


def fixed(value: float) -> Choice:
    """Return the sampled value that is always `value`."""
    return Choice((value,))


def draw(values: Sampled, rng: np.random.Generator) -> float:
    """Draw one value."""
    return float(values.sample(rng, 1)[0])
