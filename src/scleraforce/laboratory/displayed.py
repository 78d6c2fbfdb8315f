"""Counts of speckle on a scanner's display: mean and variance by the level of the light (NumPy only).

Speckle and noise are complex Gaussian, so their intensity is exponential (Goodman, Speckle Phenomena in Optics, ch. 3).
The display shows its logarithm, its root, or itself, cut off below and above (`BscanOptics.counts`).
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.optics import BscanOptics
from scleraforce.segmentation.grid import Float

NO_LIGHT_DB, TOP_DB, STEP_DB = -15.0, 60.0, 0.25  # levels over the mean noise; the lowest stands for none
LEVELS = round((TOP_DB - NO_LIGHT_DB) / STEP_DB) + 1
QUANTILES = 64


class Displayed:
    """Counts of many scanners' displays, over their largest one, by the mean level of what is displayed.

    Built from the optics of some frames; `mean` and `variance` take levels over the mean noise, dB, (frame, row,
    column), to which the noise is added.
    """

    def __init__(self, optics: Sequence[BscanOptics]) -> None:
        """Tabulate the counts of frames of these optics."""
        counts = np.stack([each.counts(_intensities(), 1.0) for each in optics])
        self._mean, self._variance = counts.mean(axis=2), counts.var(axis=2)
        self._first = (np.arange(len(optics), dtype=np.int32) * LEVELS)[:, None, None]

    def mean(self, level_db: Float) -> Float:
        """Return the mean count."""
        means: Float = self._mean.take(self._place(level_db))
        return means

    def moments(self, level_db: Float) -> tuple[Float, Float]:
        """Return the mean count and its variance over speckle."""
        place = self._place(level_db)
        return self._mean.take(place), self._variance.take(place)

    def _place(self, level_db: Float) -> NDArray[np.int32]:
        nearest = ((level_db - np.float32(NO_LIGHT_DB)) * np.float32(1.0 / STEP_DB) + np.float32(0.5)).astype(np.int32)
        place: NDArray[np.int32] = np.clip(nearest, 0, LEVELS - 1) + self._first
        return place


@lru_cache(maxsize=1)
def _intensities() -> Float:
    """Return quantiles of intensities over the mean noise, (level, quantile); the first level is no light."""
    light = 10.0 ** (0.1 * (NO_LIGHT_DB + STEP_DB * np.arange(LEVELS)))
    light[0] = 0.0
    quantiles = -np.log1p(-(np.arange(QUANTILES) + 0.5) / QUANTILES)  # of an exponential distribution of mean 1
    intensities: Float = ((1.0 + light)[:, None] * quantiles).astype(np.float32)
    return intensities
