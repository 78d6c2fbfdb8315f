"""One frame of an eye at rest, as it is measured: its pixels, their scale, and the wall that was found in it."""

from dataclasses import dataclass
from functools import cached_property
from math import isfinite

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from scleraforce.errors import FrameError
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.light import imaged_columns
from scleraforce.segmentation.slice import BoundaryRows


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A value in SI and its standard error; `at_most`: it is an upper bound."""

    value: float
    error: float
    at_most: bool = False


@dataclass(frozen=True)
class Unmeasured:
    """Why a value could not be measured."""

    reason: str


def fitted(value: float, error: float, most: float, reason: str) -> Estimate | Unmeasured:
    """Return what a fit found, where its standard error is at most so large; else why that is no measurement."""
    if isfinite(value) and isfinite(error) and error <= most:
        return Estimate(value=float(value), error=float(error))
    return Unmeasured(reason)


def level_db(intensity: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return intensities in dB."""
    levels: NDArray[np.float64] = 10.0 * np.log10(np.maximum(intensity, 1e-12))
    return levels


Trace = NDArray[np.float64]

SMOOTH_M = 0.6e-3  # of the surface, laterally: an eye at rest is smoother than its speckle
EDGE_ROWS, EDGE_M = 4, 20e-6  # what a boundary's own light and its error reach
UNSEEN_M = 0.4e-3  # below the surface there is wall, where the inner boundary is not seen


@dataclass(frozen=True, eq=False)
class ImagedEye:
    """A frame, `pixels` (row, column), of so many `bits`; `wall`: its boundaries; `inner_found`: the inner one is seen.

    Rows are those of pixel centres, as of the boundaries.
    """

    name: str
    pixels: Pixels
    scale: PixelScale
    bits: int
    wall: BoundaryRows
    inner_found: bool

    @property
    def top(self) -> int:
        """The largest count that the display has."""
        return int(2**self.bits - 1)

    @property
    def edge_rows(self) -> int:
        """Rows on both sides of a boundary that are left out of what is measured beside it."""
        return EDGE_ROWS + round(EDGE_M / self.scale.depth_m)

    @property
    def row_m(self) -> float:
        """Depth in tissue, m, of one row: geometric, not optical."""
        return self.scale.depth_m / self.scale.refractive_index

    @cached_property
    def bands(self) -> tuple[int, int]:
        """Columns that are black at the left and at the right side."""
        imaged = imaged_columns(self.pixels)
        if imaged is None:
            raise FrameError(f"{self.name}: the frame is empty: all pixels are alike")
        return imaged[0], self.pixels.shape[1] - imaged[1]

    @cached_property
    def walled(self) -> NDArray[np.bool_]:
        """Which columns show the wall, (column,)."""
        there: NDArray[np.bool_] = np.isfinite(self.wall.outer_row) & np.isfinite(self.wall.inner_row)
        return there

    @cached_property
    def surface_row(self) -> Trace:
        """The smoothed surface, (column,), NaN where there is no wall."""
        columns = np.flatnonzero(self.walled)
        every = np.arange(columns[0], columns[-1] + 1)
        window = max(5, round(SMOOTH_M / self.scale.lateral_m) | 1)
        row = np.interp(every, columns, self.wall.outer_row[columns])
        smooth = np.full(len(self.walled), np.nan)
        smooth[every] = savgol_filter(row, window, 2, mode="interp") if len(row) > window else row
        smooth[~self.walled] = np.nan
        return smooth

    @cached_property
    def slope_rad(self) -> Trace:
        """Angle between the surface and the frame's rows, (column,)."""
        ratio = self.scale.depth_m / self.scale.lateral_m
        slope: Trace = np.abs(np.arctan(np.gradient(self.surface_row) * ratio))
        return slope

    @cached_property
    def below_surface_rows(self) -> Trace:
        """Rows of each pixel below the surface, (row, column)."""
        rows: Trace = np.arange(len(self.pixels), dtype=np.float64)[:, None] - self.surface_row
        return rows

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """Which pixels are wall, away from its boundaries, (row, column)."""
        inside: NDArray[np.bool_] = (self.below_surface_rows >= self.edge_rows) & (
            self.below_inner_rows < -self.edge_rows
        )
        if not self.inner_found:
            inside &= self.below_surface_rows * self.row_m < UNSEEN_M
        return inside & (self.pixels > 0).any(axis=0)

    @cached_property
    def below_inner_rows(self) -> Trace:
        """Rows of each pixel below the inner boundary, (row, column)."""
        rows: Trace = np.arange(len(self.pixels), dtype=np.float64)[:, None] - self.wall.inner_row
        return rows
