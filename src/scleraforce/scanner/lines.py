"""Horizontal reflection lines above the tissue: their depth, level over the noise, and width.

A line is a mirror, no speckle: its light L adds to the noise of mean 1 as a field, so twice the intensity is noncentral
chi-squared, with two degrees of freedom and noncentrality 2 L. The median over a row's columns tells L.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import curve_fit
from scipy.signal import find_peaks
from scipy.stats import ncx2

from scleraforce.fitting.least_squares import robust_spread
from scleraforce.laboratory.speckle import amplitude_sigma
from scleraforce.scanner.display import MEDIAN_DB, Display
from scleraforce.scanner.imaged_eye import ImagedEye, Trace

LEAST_SHARE = 0.5  # of the imaged columns must show air in a row that is looked at
LEAST_DB, LEAST_SDS = 1.5, 6.0  # over the noise, in dB and in the other rows' deviations
REACH = 8  # rows about a line that are fitted
NARROWEST, WIDEST = 0.4, 4.0  # standard deviation of the amplitude, rows


@dataclass(frozen=True, kw_only=True)
class SeenLine:
    """A line: depth below the frame's top edge and full width of the intensity at half maximum, m; level, dB."""

    depth_m: float
    level_db: float
    thickness_m: float


def find_lines(eye: ImagedEye, display: Display) -> tuple[SeenLine, ...]:
    """Return the lines across a frame, in rows in which some columns show the air above the tissue."""
    air = (eye.below_surface_rows < -2 * eye.edge_rows) & (eye.pixels > 0).any(axis=0)
    imaged = air.shape[1] - sum(eye.bands)
    rows = np.flatnonzero(air.sum(axis=1) >= LEAST_SHARE * imaged)
    if len(rows) < 2 * REACH:
        return ()
    rows = np.arange(rows[0], rows[-1] + 1)
    levels = np.where(air[rows], display.levels(eye.pixels[rows]), np.nan)
    level_db = np.nanmedian(levels, axis=1) - MEDIAN_DB
    level_db = np.nan_to_num(level_db - np.nanmedian(level_db))
    deviation = robust_spread(np.abs(level_db))
    peaks, _ = find_peaks(level_db, height=max(LEAST_DB, LEAST_SDS * deviation), distance=REACH)
    found = [_fitted(eye, rows, _mirrored(level_db), int(peak)) for peak in peaks]
    return tuple(line for line in found if line is not None)


def _fitted(eye: ImagedEye, rows: NDArray[np.intp], light: Trace, peak: int) -> SeenLine | None:
    """Return the line at a peak of the rows' light over the noise; None: it is wider than a line."""
    near = slice(max(peak - REACH, 0), peak + REACH + 1)
    try:
        value, _ = curve_fit(
            _ridge, rows[near], light[near], (float(rows[peak]), light[peak], 1.0),
            bounds=((rows[peak] - 2.0, 0.0, NARROWEST / 2), (rows[peak] + 2.0, np.inf, 2 * WIDEST)),
        )  # fmt: skip
    except RuntimeError:
        return None
    if value[2] > WIDEST:
        return None
    width_m = max(float(value[2]), NARROWEST) / amplitude_sigma(1.0) * eye.scale.depth_m
    return SeenLine(
        depth_m=float((value[0] + 0.5) * eye.scale.depth_m),
        level_db=float(10.0 * np.log10(value[1])),
        thickness_m=width_m,
    )


def _mirrored(level_db: Trace) -> Trace:
    """Return the light of mirrors over the mean noise, by the level of the median over that of the noise."""
    light = np.concatenate([[0.0], np.geomspace(1e-2, 1e5, 400)])
    median_db = 10.0 * np.log10(ncx2.median(2, 2.0 * light) / 2.0) - MEDIAN_DB
    mirrored: Trace = np.interp(level_db, median_db, light)
    return mirrored


def _ridge(row: Trace, middle: float, gain: float, sigma: float) -> Trace:
    light: Trace = gain * np.exp(-(((row - middle) / sigma) ** 2))
    return light
