"""Light in the wall: its level at the surface, its fall with depth, what each column gets of it.

The mean intensity in the wall over the mean noise is S exp(-2 mu z) + 1, z the geometric depth below the surface along
the column. Medians over pixels of one depth, in dB, stand in for means: the display cuts off neither.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, median_filter
from scipy.optimize import curve_fit
from scipy.stats import theilslopes

from scleraforce.errors import FrameError
from scleraforce.fitting.least_squares import robust_spread
from scleraforce.scanner.display import MEDIAN_DB, Display
from scleraforce.scanner.estimate import Estimate, Unmeasured, fitted, level_db
from scleraforce.scanner.imaged_eye import ImagedEye, Trace

BIN_M = 15e-6  # of depth
LEAST_BINS, LEAST_IN_BIN = 5, 50
OVER_NOISE_DB, BELOW_TOP_DB = 1.0, 1.0  # of a median that tells the light
SHADED_DB, SHADED_SDS = 0.7, 3.0  # a column that gets so much less, and by so many of its deviations, is left out
SMOOTH_M = 60e-6  # of the columns' light
BASE_M = 2.5e-3  # of what its slow changes are: they are none of a shadow
MOST_ATTENUATION_SHARE = 0.3
FACING_RAD = 0.35  # up to this slope columns tell a roll-off
LEAST_REACH_M = 0.3e-3  # of depths of the surface
MOST_ROLL_OFF_ERROR = 2e3  # dB/m


@dataclass(frozen=True, eq=False)
class WallLight:
    """Light in the wall of a frame.

    `levels` (row, column): the frame in dB over the mean noise; `inside`: what of it is wall, away from its boundaries.
    `expected` (row, column): mean intensity of the wall over the noise, the columns' own light left out.
    `column_db` (column,): light of a column against the typical one, NaN without a wall; `clear`: no shadow is on it.
    """

    levels: NDArray[np.float64]
    inside: NDArray[np.bool_]
    expected: NDArray[np.float64]
    column_db: Trace
    clear: NDArray[np.bool_]
    snr_db: Estimate
    attenuation_per_m: Estimate | Unmeasured


def depth_profile(
    levels: NDArray[np.float64], depth_m: NDArray[np.float64], chosen: NDArray[np.bool_], bin_m: float
) -> tuple[Trace, Trace, Trace]:
    """Return each bin's mean depth, the mean level in dB there as its median tells it, and how many pixels it has."""
    number = np.floor(depth_m[chosen] / bin_m).astype(np.intp)
    order = np.argsort(number, kind="stable")
    bins, start = np.unique(number[order], return_index=True)
    parts = np.split(np.arange(len(order)), start[1:])
    level, depth = levels[chosen][order], depth_m[chosen][order]
    middle = np.array([np.median(level[part]) for part in parts]) - MEDIAN_DB
    at_m = np.array([depth[part].mean() for part in parts])
    count = np.array([len(part) for part in parts], dtype=np.float64)
    return (at_m, middle, count) if len(bins) else (np.empty(0), np.empty(0), np.empty(0))


def light_in_wall(eye: ImagedEye, display: Display) -> WallLight:
    """Fit the light in the wall; columns in a shadow are left out, in a second pass.

    Raises:
        FrameError: too little of the wall can be seen to tell its light.
    """
    levels = display.levels(eye.pixels)
    depth_m = eye.below_surface_rows * eye.row_m
    inside = eye.inside
    clear = eye.walled.copy()
    for _ in range(2):
        value, error = _fit(eye, levels, depth_m, inside & clear, display)
        fall = np.exp(-2.0 * value[1] * np.maximum(depth_m, 0.0))
        expected = 10.0 ** (value[0] / 10.0) * np.nan_to_num(fall)
        column_db = _column_light(eye, levels - level_db(expected + 1.0), inside)
        dips = column_db - _slow(eye, column_db)
        least = max(SHADED_DB, SHADED_SDS * robust_spread(np.abs(dips[np.isfinite(dips)])))
        clear = np.nan_to_num(dips, nan=-np.inf) > -least
    snr = Estimate(value=float(value[0]), error=float(error[0]))
    attenuation = fitted(
        value[1],
        error[1],
        max(MOST_ATTENUATION_SHARE * abs(value[1]), 100.0),
        "the light does not fall evenly with depth in the wall",
    )
    if isinstance(attenuation, Estimate) and attenuation.value <= 0.0:
        attenuation = Unmeasured("the wall grows brighter with depth")
    return WallLight(levels, inside, expected, column_db, clear, snr, attenuation)


def _fit(
    eye: ImagedEye,
    levels: NDArray[np.float64],
    depth_m: NDArray[np.float64],
    chosen: NDArray[np.bool_],
    display: Display,
) -> tuple[Trace, Trace]:
    """Return level at the surface, dB, and attenuation, 1/m, with their standard errors."""
    at_m, found_db, count = depth_profile(levels, depth_m, chosen, max(BIN_M, eye.row_m))
    seen = (count >= LEAST_IN_BIN) & (found_db > OVER_NOISE_DB) & (found_db < display.highest_db - BELOW_TOP_DB)
    if np.count_nonzero(seen) < LEAST_BINS:
        dark = np.median(found_db) < OVER_NOISE_DB if len(found_db) else True
        why = "is hardly brighter than the noise" if dark else "saturates the display"
        raise FrameError(f"{eye.name}: the wall {why}: its light cannot be measured")
    try:
        value, covariance = curve_fit(
            _seen_db, at_m[seen], found_db[seen], (found_db[seen].max(), 500.0), sigma=1.0 / np.sqrt(count[seen]),
            method="trf", loss="soft_l1", x_scale=(10.0, 1000.0),
        )  # fmt: skip
    except RuntimeError as fault:
        raise FrameError(f"{eye.name}: the light in the wall follows no law that could be fitted") from fault
    return value, np.sqrt(np.diag(covariance))


def _seen_db(depth_m: Trace, snr_db: float, attenuation_per_m: float) -> Trace:
    """Return the mean level at depths in the wall, over the mean noise."""
    return level_db(10.0 ** (snr_db / 10.0) * np.exp(-2.0 * attenuation_per_m * depth_m) + 1.0)


def _column_light(eye: ImagedEye, residual_db: NDArray[np.float64], inside: NDArray[np.bool_]) -> Trace:
    """Return how much more light each column gets than the typical one, dB."""
    light = np.full(inside.shape[1], np.nan)
    enough = inside.sum(axis=0) >= LEAST_BINS
    if enough.any():
        light[enough] = np.nanmedian(np.where(inside, residual_db, np.nan)[:, enough], axis=0) - MEDIAN_DB
        columns = np.flatnonzero(enough)
        sigma = max(SMOOTH_M / eye.scale.lateral_m / 2, 0.5)
        light[columns] = gaussian_filter1d(light[columns], sigma, mode="nearest")
    return light


def _slow(eye: ImagedEye, column_db: Trace) -> Trace:
    """Return the slow changes of the columns' light: a median over what is wider than shadows are."""
    slow, columns = np.full(len(column_db), np.nan), np.flatnonzero(np.isfinite(column_db))
    width = max(3, round(BASE_M / eye.scale.lateral_m) | 1)
    slow[columns] = median_filter(column_db[columns], min(width, len(columns) | 1), mode="nearest")
    return slow


def typical(eye: ImagedEye, column_db: Trace) -> Trace:
    """Return the columns' light without its slow changes: what shadows do, dB."""
    dips: Trace = column_db - _slow(eye, column_db)
    return dips


def roll_off(eye: ImagedEye, tissue: WallLight) -> Estimate | Unmeasured:
    """Return how fast the light of the wall's columns falls with the depth of their surface in the frame, dB/m.

    This is the scanner's roll-off, its focus, and the tissue's own fall with the angle: one frame does not tell them
    apart. Steep columns are left out.
    """
    used = tissue.clear & np.isfinite(tissue.column_db) & (eye.slope_rad < FACING_RAD)
    depth_m = eye.surface_row[used] * eye.scale.depth_m
    if np.count_nonzero(used) < LEAST_IN_BIN or np.ptp(depth_m) < LEAST_REACH_M:
        return Unmeasured("the surface lies at one depth of the frame")
    step = max(1, len(depth_m) // 400)  # of neighbours that are alike
    slope, _, low, high = theilslopes(tissue.column_db[used][::step], depth_m[::step], 0.68)
    return fitted(-slope, (high - low) / 2 * 2.0, MOST_ROLL_OFF_ERROR, "the columns' light does not follow their depth")
