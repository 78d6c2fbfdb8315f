"""Pixels without a value: not finite, fill values, single hot pixels."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Floats

HUGE = 1e30  # no grey level: FLT_MAX, and fill values of NetCDF
NOT_FINITE = "not finite"
TOO_LARGE = f"beyond {HUGE:g}"
FILLS = (-999.0, -9999.0, -99999.0, -32768.0, 9999.0, 99999.0, -1e20, 1e20)
FILL_APART = 0.5  # of its size, by which a fill value lies outside of all others
LOW_FILL = 10.0  # times the largest other size: any repeated negative value is a fill
TAIL_SHARE = 1e-3  # of a picture's pixels at either end, that are looked at one by one
HOT_APART = 3.0  # times the range of all others, by which a hot pixel lies beyond it
HOT_SHARE = 1e-4  # of all pixels, which more hot ones are not
FEWEST = 500  # pixels, without which none is called hot


@dataclass(frozen=True)
class ValueLimits:
    """The smallest and the largest value, and the counts of pixels without a value by
    their kinds.
    """

    low: float
    high: float
    lost: dict[str, int]


@dataclass
class PictureValues:
    """Values of pictures, of which the ends are looked at."""

    size: int = 0
    not_finite: int = 0
    huge: int = 0
    fills: Counter[float] = field(default_factory=Counter)
    low: float = np.inf  # without the tails
    high: float = -np.inf
    tails: list[Floats] = field(default_factory=list)

    def add(self, picture: NDArray[Any]) -> None:
        """Add a picture of floats or wide numbers."""
        values = picture.astype(np.float64, copy=False).ravel()
        finite = values[np.isfinite(values)]
        known = finite[np.abs(finite) < HUGE]
        self.size += values.size
        self.not_finite += values.size - finite.size
        self.huge += finite.size - known.size
        exact = picture.dtype if picture.dtype.kind == "f" else np.dtype(np.float64)
        known = self._without_fills(known, exact)
        if not known.size:
            return

        count = int(TAIL_SHARE * known.size) + 1
        ends = [min(count, known.size - 1), max(known.size - 1 - count, 0)]
        parted = np.partition(known, sorted(set(ends)))
        self.low = min(self.low, float(parted[ends[0]]), float(parted[ends[1]]))
        self.high = max(self.high, float(parted[ends[0]]), float(parted[ends[1]]))
        self.tails += [parted[: ends[0]], parted[ends[1] + 1 :]]

    def _without_fills(self, known: Floats, exact: np.dtype[Any]) -> Floats:
        """Count values that may be fills, and return the others."""
        if not known.size:
            return known

        least = float(known.min())
        repeated = int(np.count_nonzero(known == least))
        candidates = set(FILLS)
        if least < 0.0 and repeated > TAIL_SHARE * known.size + 1:
            candidates.add(least)

        for value in candidates:
            # as the picture's type rounds it
            stored = float(exact.type(value)) if abs(value) < HUGE else value
            if known.size and least <= stored <= float(known.max()):
                count = int(np.count_nonzero(known == stored))
                self.fills[value] += count
                known = known[known != stored] if count else known

        return known

    def limits(self) -> ValueLimits:
        """Return the range of values that are ones, and what the others are."""
        tails = np.sort(np.concatenate(self.tails or [np.empty(0)]))
        low, high = self._cool(tails)
        hot = int((tails < low).sum() + (tails > high).sum())
        fills: Counter[float] = Counter()

        for value, count in self.fills.items():
            if count and self._is_fill(value, low, high):
                fills[value] = count
            elif count:
                low = min(low, value)
                high = max(high, value)

        kinds = {
            NOT_FINITE: self.not_finite,
            TOO_LARGE: self.huge,
            **{f"of {value:g}": count for value, count in sorted(fills.items())},
            f"single ones outside {low:.6g} to {high:.6g}": hot,
        }
        return ValueLimits(low, high, {kind: n for kind, n in kinds.items() if n})

    def _is_fill(self, value: float, low: float, high: float) -> bool:
        if not low < high:
            return False

        apart = max(low - value, value - high)
        size = max(abs(low), abs(high))
        if value in FILLS:
            return apart >= FILL_APART * abs(value)
        return value < 0.0 and abs(value) > LOW_FILL * size

    def _cool(self, tails: Floats) -> tuple[float, float]:
        """Return the smallest and the largest value without single hot pixels."""
        low = self.low
        high = self.high
        for value in tails[tails > self.high].tolist():
            if value - high > HOT_APART * (high - low):
                break
            high = value

        for value in tails[tails < self.low][::-1].tolist():
            if low - value > HOT_APART * (high - low):
                break
            low = value

        hot = int((tails < low).sum() + (tails > high).sum())
        few = hot <= max(HOT_SHARE * self.size, 1.0) and self.size >= FEWEST
        if hot and not (few and low < high):
            ends = [low, high, *tails[[0, -1]].tolist()]
            return min(ends), max(ends)

        return low, high
