"""What a scanner shows of tissue: the wall's light and its fall, the layer below the wall, shadows."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects, gaussian_filter1d, label, median_filter
from scipy.optimize import curve_fit
from scipy.special import ndtr
from scipy.stats import theilslopes

from scleraforce.errors import FrameError
from scleraforce.fitting.least_squares import robust_spread
from scleraforce.scanner.display import MEDIAN_DB, Display
from scleraforce.scanner.imaged_eye import Estimate, ImagedEye, Trace, Unmeasured, fitted, level_db

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


LayerBelow = tuple[Estimate | Unmeasured, Estimate | Unmeasured, Estimate | Unmeasured]

LAYER_BIN_M = 8e-6
ABOVE_M, BELOW_M = 60e-6, 700e-6  # of the inner boundary: what is fitted
LAYER_BINS, LAYER_IN_BIN, LAYER_COLUMNS = 15, 50, 50
STEEPEST_RAD = 0.35  # of the surface: beyond, the light's way through the wall grows
MOST_LEVEL_ERROR_DB, MOST_SHARE = 1.5, 0.3
LEAST_SEEN_DB = 1.0  # over the noise: the layer's end must be brighter than that, to be one
NO_INNER = "the wall's inner boundary is not seen"
BLURRED = "what lies below the wall is no even layer, or too dark"
NO_END = "the layer below the wall fades into the noise before it ends"


def layer_below(eye: ImagedEye, display: Display, tissue: WallLight) -> LayerBelow:
    """Return level against the wall, dB, attenuation, 1/m, and thickness along the depth, m."""
    columns = tissue.clear & np.isfinite(tissue.column_db) & (eye.slope_rad < STEEPEST_RAD)
    if (
        not eye.inner_found
        or np.count_nonzero(columns) < LAYER_COLUMNS
        or isinstance(tissue.attenuation_per_m, Unmeasured)
    ):
        reason = Unmeasured(BLURRED if eye.inner_found else NO_INNER)
        return reason, reason, reason
    depth_m = eye.below_inner_rows * eye.row_m
    chosen = (depth_m > -ABOVE_M) & (depth_m < BELOW_M) & columns & (eye.below_surface_rows > eye.edge_rows)
    at_m, found_db, count = depth_profile(tissue.levels, depth_m, chosen, max(LAYER_BIN_M, eye.row_m))
    seen = (count >= LAYER_IN_BIN) & (found_db < display.highest_db - LEAST_SEEN_DB)
    if np.count_nonzero(seen) < LAYER_BINS:
        reason = Unmeasured("too little is seen below the wall")
        return reason, reason, reason
    wall_m = np.nanmedian((eye.wall.inner_row - eye.surface_row)[columns]) * eye.row_m
    mu = tissue.attenuation_per_m.value
    at_inner_db = tissue.snr_db.value - 20.0 / np.log(10.0) * mu * wall_m

    def model(below_m: Trace, level: float, per_m: float, thick_m: float, off_m: float, blur_m: float) -> Trace:
        y = below_m - off_m
        wall = 10.0 ** (at_inner_db / 10.0) * np.exp(-2.0 * mu * y) * ndtr(-y / blur_m)
        inside = ndtr(y / blur_m) * ndtr((thick_m - y) / blur_m)
        layer = 10.0 ** ((at_inner_db + level) / 10.0) * np.exp(-2.0 * per_m * np.maximum(y, 0.0)) * inside
        return level_db(wall + layer + 1.0)

    try:
        value, covariance = curve_fit(
            model, at_m[seen], found_db[seen], (-8.0, 4000.0, 150e-6, 0.0, 15e-6), sigma=1.0 / np.sqrt(count[seen]),
            method="trf", loss="soft_l1", x_scale=(3.0, 1000.0, 5e-5, 1e-5, 1e-5),
            bounds=((-40.0, 0.0, 30e-6, -50e-6, 3e-6), (3.0, 30e3, 650e-6, 50e-6, 60e-6)), max_nfev=300,
        )  # fmt: skip
    except RuntimeError:
        reason = Unmeasured(BLURRED)
        return reason, reason, reason
    error = np.sqrt(np.diag(covariance))
    level = fitted(value[0], error[0], MOST_LEVEL_ERROR_DB, BLURRED)
    if isinstance(level, Unmeasured):
        return level, level, level
    end_db = at_inner_db + value[0] - 20.0 / np.log(10.0) * value[1] * value[2]
    thickness = fitted(value[2], error[2], MOST_SHARE * value[2], NO_END)
    if level_db(np.array(10.0 ** (end_db / 10.0) + 1.0)) < LEAST_SEEN_DB or value[2] > 0.9 * (BELOW_M - 50e-6):
        thickness = Unmeasured(NO_END)
    return level, fitted(value[1], error[1], MOST_SHARE * value[1], BLURRED), thickness


LEAST_DB, LEAST_SDS = 1.0, 4.0  # by which a shadow's columns are darker, in dB and in the others' deviations
MARGIN = 1.5  # widths beside a shadow that are fitted with it
MOST_LOSS_ERROR = 0.15
LEAST_COLUMNS = 2


@dataclass(frozen=True, kw_only=True)
class SeenShadow:
    """A shadow: the column of its middle, its full width at half loss, m, and the share of the light that it takes."""

    column: float
    width_m: float
    loss_fraction: float


def find_shadows(eye: ImagedEye, tissue: WallLight) -> tuple[SeenShadow, ...]:
    """Return the shadows on a frame's wall."""
    light_db = typical(eye, tissue.column_db)
    known = np.isfinite(light_db)
    deviation = robust_spread(np.abs(light_db[known]))
    dark, _ = label(np.nan_to_num(light_db) < -max(LEAST_DB, LEAST_SDS * deviation))
    found = [_fitted(eye, light_db, place[0]) for place in find_objects(dark)]
    return _distinct([shadow for shadow in found if shadow is not None], eye.scale.lateral_m)


def _distinct(shadows: list[SeenShadow], lateral_m: float) -> tuple[SeenShadow, ...]:
    """Return shadows without those that lie in another one: parts of it that speckle has cut off."""
    kept: list[SeenShadow] = []
    for shadow in sorted(shadows, key=lambda each: -each.width_m):
        if all(abs(shadow.column - other.column) * lateral_m > other.width_m / 2 for other in kept):
            kept.append(shadow)
    return tuple(sorted(kept, key=lambda each: each.column))


def _fitted(eye: ImagedEye, light_db: Trace, place: slice) -> SeenShadow | None:
    """Return the shadow that lies about a run of dark columns; None: none fits."""
    columns = place.stop - place.start
    if columns < LEAST_COLUMNS:
        return None
    margin = max(4, round(MARGIN * columns))
    near = np.arange(max(place.start - margin, 0), min(place.stop + margin, len(light_db)))
    near = near[np.isfinite(light_db[near])]
    light = 10.0 ** (light_db[near] / 10.0)
    start = ((place.start + place.stop - 1) / 2, columns, 1.0 - light.min(), 1.0)
    try:
        value, covariance = curve_fit(
            _light, near, light, start, bounds=((near[0], 1.0, 0.0, 0.5), (near[-1], 4.0 * columns, 1.0, 2.0))
        )
    except (RuntimeError, ValueError):
        return None
    if not np.sqrt(covariance[2, 2]) < MOST_LOSS_ERROR:
        return None
    return SeenShadow(
        column=float(value[0]), width_m=float(value[1] * eye.scale.lateral_m), loss_fraction=float(value[2])
    )


def _light(column: Trace, middle: float, width: float, loss: float, base: float) -> Trace:
    light: Trace = base * (1.0 - loss * np.exp(-np.log(2.0) * (2.0 * (column - middle) / width) ** 4))
    return light
