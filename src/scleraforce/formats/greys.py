"""Pixels of any type as the counts of a recording: whole numbers from 0, of at most 16 bits."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError, InputError

MOST_BITS = 16
TOP = 2**MOST_BITS - 1


@dataclass(frozen=True, kw_only=True)
class Greys:
    """How pixels become counts: count = (pixel - `low`) * TOP / (`high` - `low`) where `scaled`, else pixel - `low`.

    `lost`: pixels that are NaN or infinite; they become 0.
    """

    low: float
    high: float
    scaled: bool
    lost: int = 0

    def fit(self, bits: int) -> bool:
        """Return whether so many bits hold the counts."""
        return (TOP if self.scaled else self.high - self.low) < 1 << bits

    def counts(self, picture: NDArray[Any]) -> NDArray[np.uint16]:
        """Return a picture (row, column) as counts, row after row in memory."""
        picture = np.ascontiguousarray(picture)
        if not self.scaled:
            return np.asarray(picture.astype(np.int64) - int(self.low), dtype=np.uint16)
        scaled = np.clip((picture.astype(np.float64) - self.low) * (TOP / (self.high - self.low)), 0.0, TOP)
        return np.asarray(np.nan_to_num(np.rint(scaled), nan=0.0), dtype=np.uint16)


def find_greys(pictures: Iterable[NDArray[Any]], told: tuple[float, float] | None, name: str) -> Greys:
    """Look at all pictures and return how they become counts.

    Whole numbers stay as they are, or are shifted so that the smallest is 0, where 16 bits hold them. Others, and all
    where a range is `told`, are scaled from that range, or from their smallest and largest value, to 16 bits.

    Raises:
        FrameError: pixels of another type, or all of one value.
        InputError: the range that was told is none.
    """
    if told is not None and not told[0] < told[1]:
        raise InputError(f"--grey-range: {told[0]:g} {told[1]:g}; give the darkest value before a larger one")
    low, high, lost, whole = np.inf, -np.inf, 0, True
    for picture in pictures:
        if picture.dtype.kind not in "uif":
            raise FrameError(f"{name}: pixels of type {picture.dtype}; give whole numbers or floats")
        if picture.dtype.kind == "f":
            known = picture[np.isfinite(picture)]
            whole, lost = False, lost + picture.size - known.size
        else:
            known = picture
        if known.size:
            low, high = min(low, float(known.min())), max(high, float(known.max()))
    if told is not None:
        return Greys(low=told[0], high=told[1], scaled=True, lost=lost)
    if whole and high - min(low, 0.0) <= TOP:
        return Greys(low=min(low, 0.0), high=high, scaled=False)
    if not low < high:
        raise FrameError(f"{name}: all pixels have one value or none; there is nothing to see in them")
    return Greys(low=low, high=high, scaled=True, lost=lost)
