"""The light that a scanner shows: of the wall, the layer below, shadows, the surface's
reflection, speckle.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.ndimage import find_objects, gaussian_filter1d, label, median_filter
from scipy.optimize import brentq, curve_fit
from scipy.special import ndtr, spence
from scipy.stats import theilslopes

from scleraforce.base.arrays import Flags, Floats
from scleraforce.base.errors import FrameError
from scleraforce.base.normal_distribution import robust_spread
from scleraforce.lab.scanner.scanner_display import (
    MEDIAN_DB,
    Display,
    Estimate,
    ImagedEye,
    Measured,
    Unmeasured,
    estimate_or_reason,
    fitted_curve,
    level_db,
)
from scleraforce.lab.tissue_light import Shadow, amplitude_sigma

BIN_M = 15e-6  # of depth
LEAST_BINS = 5
LEAST_IN_BIN = 50
# of a median that tells the light
OVER_NOISE_DB = 1.0
BELOW_TOP_DB = 1.0
# less light than this, and by this number of deviations: a shaded column
SHADED_DB = 0.7
SHADED_SDS = 3.0
SMOOTH_M = 60e-6  # of the columns' light
BASE_M = 2.5e-3  # of its slow changes, wider than a shadow
MOST_ATTENUATION_SHARE = 0.3
FACING_RAD = 0.35  # up to this slope columns tell a roll-off
LEAST_REACH_M = 0.3e-3  # of depths of the surface
MOST_ROLL_OFF_ERROR = 2e3  # dB/m


@dataclass(frozen=True, eq=False)
class WallLight:
    """Light in the wall of a frame."""

    levels: Floats  # (row, column), dB over the mean noise
    # (row, column), mean intensity of the wall over the noise, without the columns' own
    # light
    expected: Floats
    column_db: Floats  # (column,), against the typical one, NaN without a wall
    clear: Flags  # (column,), has an unshaded wall
    snr_db: Estimate
    attenuation_per_m: Measured

    @property
    def expected_db(self) -> Floats:
        """Mean level of the wall and the noise over the noise, (row, column)."""
        return 10.0 * np.log10(self.expected + 1.0) + np.nan_to_num(self.column_db)


def depth_profile(
    levels: Floats, depth_m: Floats, chosen: Flags, bin_m: float
) -> tuple[Floats, Floats, Floats]:
    """Return each bin's mean depth, its mean level in dB (from the median), and its
    number of pixels.
    """
    number = np.floor(depth_m[chosen] / bin_m).astype(np.intp)
    order = np.argsort(number, kind="stable")
    bins, start = np.unique(number[order], return_index=True)
    parts = np.split(np.arange(len(order)), start[1:])
    level = levels[chosen][order]
    depth = depth_m[chosen][order]
    middle = np.array([np.median(level[part]) for part in parts]) - MEDIAN_DB
    at_m = np.array([depth[part].mean() for part in parts])
    count = np.array([len(part) for part in parts], dtype=np.float64)

    return (
        (at_m, middle, count) if len(bins) else (np.empty(0), np.empty(0), np.empty(0))
    )


def light_in_wall(eye: ImagedEye, display: Display) -> WallLight:
    """Fit the light in the wall, in a second pass without shaded columns."""
    levels = display.levels(eye.pixels)
    inside = eye.inside
    clear = eye.walled
    depth_m = eye.below_surface_rows * eye.row_m

    for _ in range(2):
        value, error = _fit_light(eye, levels, depth_m, inside & clear, display)
        fall = np.exp(-2.0 * value[1] * np.maximum(depth_m, 0.0))
        expected = 10.0 ** (value[0] / 10.0) * np.nan_to_num(fall)
        column_db = _column_light(eye, levels - level_db(expected + 1.0), inside)
        dips = _dips(eye, column_db)
        least = max(
            SHADED_DB, SHADED_SDS * robust_spread(np.abs(dips[np.isfinite(dips)]))
        )
        clear = np.nan_to_num(dips, nan=-np.inf) > -least

    snr = Estimate(value=float(value[0]), error=float(error[0]))
    most = max(MOST_ATTENUATION_SHARE * abs(value[1]), 100.0)

    attenuation = estimate_or_reason(
        value[1],
        error[1],
        most,
        "the light does not fall evenly with depth in the wall",
    )
    if isinstance(attenuation, Estimate) and attenuation.value <= 0.0:
        attenuation = Unmeasured("the wall grows brighter with depth")

    return WallLight(levels, expected, column_db, clear, snr, attenuation)


def _fit_light(
    eye: ImagedEye, levels: Floats, depth_m: Floats, chosen: Flags, display: Display
) -> tuple[Floats, Floats]:
    """Return level at the surface, dB, and attenuation, 1/m, with their standard
    errors.
    """
    at_m, found_db, count = depth_profile(
        levels, depth_m, chosen, max(BIN_M, eye.row_m)
    )
    seen = (
        (count >= LEAST_IN_BIN)
        & (found_db > OVER_NOISE_DB)
        & (found_db < display.highest_db - BELOW_TOP_DB)
    )
    if np.count_nonzero(seen) < LEAST_BINS:
        dark = np.median(found_db) < OVER_NOISE_DB if len(found_db) else True
        why = "is hardly brighter than the noise" if dark else "saturates the display"
        raise FrameError(f"{eye.name}: the wall {why}: its light cannot be measured")

    def seen_db(depth_m: Floats, snr_db: float, attenuation_per_m: float) -> Floats:
        return level_db(
            10.0 ** (snr_db / 10.0) * np.exp(-2.0 * attenuation_per_m * depth_m) + 1.0
        )

    found = fitted_curve(
        seen_db,
        at_m[seen],
        found_db[seen],
        (found_db[seen].max(), 500.0),
        sigma=1.0 / np.sqrt(count[seen]),
        method="trf",
        loss="soft_l1",
        x_scale=(10.0, 1000.0),
    )
    if found is None:
        raise FrameError(
            f"{eye.name}: the light in the wall follows no law that could be fitted"
        )

    return found


def _column_light(eye: ImagedEye, residual_db: Floats, inside: Flags) -> Floats:
    """Return the light of each column over the typical one, dB."""
    light = np.full(inside.shape[1], np.nan)
    enough = inside.sum(axis=0) >= LEAST_BINS
    if enough.any():
        own_db = (
            np.nanmedian(np.where(inside, residual_db, np.nan)[:, enough], axis=0)
            - MEDIAN_DB
        )
        light[enough] = gaussian_filter1d(
            own_db, max(SMOOTH_M / eye.scale.lateral_m / 2, 0.5), mode="nearest"
        )

    return light


def _dips(eye: ImagedEye, column_db: Floats) -> Floats:
    """Return the columns' light without its slow changes, a median over more than a
    shadow's width, dB.
    """
    slow = np.full(len(column_db), np.nan)
    columns = np.flatnonzero(np.isfinite(column_db))
    width = max(3, round(BASE_M / eye.scale.lateral_m) | 1)
    slow[columns] = median_filter(
        column_db[columns], min(width, len(columns) | 1), mode="nearest"
    )

    return column_db - slow


def roll_off(eye: ImagedEye, tissue: WallLight) -> Measured:
    """Return the fall of the columns' light with their surface's depth, dB/m: of
    roll-off, focus, and the angle.
    """
    used = tissue.clear & (eye.slope_rad < FACING_RAD)
    depth_m = eye.surface_row[used] * eye.scale.depth_m
    if np.count_nonzero(used) < LEAST_IN_BIN or np.ptp(depth_m) < LEAST_REACH_M:
        return Unmeasured("the surface lies at one depth of the frame")

    step = max(1, len(depth_m) // 400)  # of neighbours that are alike
    slope, _, low, high = theilslopes(
        tissue.column_db[used][::step], depth_m[::step], 0.68
    )

    return estimate_or_reason(
        -slope,
        high - low,
        MOST_ROLL_OFF_ERROR,
        "the columns' light does not follow their depth",
    )


LAYER_BIN_M = 8e-6
# of the inner boundary: what is fitted
ABOVE_M = 60e-6
BELOW_M = 700e-6
LAYER_BINS = 15
LAYER_IN_BIN = 50
LAYER_COLUMNS = 50
STEEPEST_RAD = 0.35  # of the surface: beyond, the light's way through the wall grows
MOST_LEVEL_ERROR_DB = 1.5
MOST_SHARE = 0.3
# over the noise: the layer's end must be brighter than that, to be one
LEAST_SEEN_DB = 1.0
NO_INNER = "the wall's inner boundary is not seen"
BLURRED = "the layer below the wall is uneven or too dark"
NO_END = "the layer below the wall fades into the noise before it ends"


def layer_below(
    eye: ImagedEye, display: Display, tissue: WallLight
) -> tuple[Measured, Measured, Measured]:
    """Return level against the wall, dB, attenuation, 1/m, and thickness along the
    depth, m.
    """
    columns = tissue.clear & (eye.slope_rad < STEEPEST_RAD)
    attenuation = tissue.attenuation_per_m
    few = np.count_nonzero(columns) < LAYER_COLUMNS
    if not eye.wall.inner_found or few or isinstance(attenuation, Unmeasured):
        return (Unmeasured(BLURRED if eye.wall.inner_found else NO_INNER),) * 3

    depth_m = eye.below_inner_rows * eye.row_m
    chosen = (
        (depth_m > -ABOVE_M)
        & (depth_m < BELOW_M)
        & columns
        & (eye.below_surface_rows > eye.edge_rows)
    )
    at_m, found_db, count = depth_profile(
        tissue.levels, depth_m, chosen, max(LAYER_BIN_M, eye.row_m)
    )

    seen = (count >= LAYER_IN_BIN) & (found_db < display.highest_db - LEAST_SEEN_DB)
    if np.count_nonzero(seen) < LAYER_BINS:
        return (Unmeasured("too little is seen below the wall"),) * 3

    wall_m = np.nanmedian((eye.wall.inner_row - eye.surface_row)[columns]) * eye.row_m
    mu = attenuation.value
    at_inner_db = tissue.snr_db.value - 20.0 / np.log(10.0) * mu * wall_m

    def model(
        below_m: Floats,
        level: float,
        per_m: float,
        thick_m: float,
        off_m: float,
        blur_m: float,
    ) -> Floats:
        y = below_m - off_m
        wall = 10.0 ** (at_inner_db / 10.0) * np.exp(-2.0 * mu * y) * ndtr(-y / blur_m)
        inside = ndtr(y / blur_m) * ndtr((thick_m - y) / blur_m)
        layer = (
            10.0 ** ((at_inner_db + level) / 10.0)
            * np.exp(-2.0 * per_m * np.maximum(y, 0.0))
            * inside
        )

        return level_db(wall + layer + 1.0)

    found = fitted_curve(
        model,
        at_m[seen],
        found_db[seen],
        (-8.0, 4000.0, 150e-6, 0.0, 15e-6),
        sigma=1.0 / np.sqrt(count[seen]),
        method="trf",
        loss="soft_l1",
        x_scale=(3.0, 1000.0, 5e-5, 1e-5, 1e-5),
        bounds=((-40.0, 0.0, 30e-6, -50e-6, 3e-6), (3.0, 30e3, 650e-6, 50e-6, 60e-6)),
        max_nfev=300,
    )
    if found is None:
        return (Unmeasured(BLURRED),) * 3

    value, error = found
    level = estimate_or_reason(value[0], error[0], MOST_LEVEL_ERROR_DB, BLURRED)
    if isinstance(level, Unmeasured):
        return (level,) * 3

    end_db = at_inner_db + value[0] - 20.0 / np.log(10.0) * value[1] * value[2]
    thickness = estimate_or_reason(value[2], error[2], MOST_SHARE * value[2], NO_END)

    if level_db(np.array(10.0 ** (end_db / 10.0) + 1.0)) < LEAST_SEEN_DB or value[
        2
    ] > 0.9 * (BELOW_M - 50e-6):
        thickness = Unmeasured(NO_END)

    return (
        level,
        estimate_or_reason(value[1], error[1], MOST_SHARE * value[1], BLURRED),
        thickness,
    )


# by which a shadow's columns are darker, in dB and in the others' deviations
SHADOW_DB = 1.0
SHADOW_SDS = 4.0
MARGIN = 1.5  # widths beside a shadow that are fitted with it
MOST_LOSS_ERROR = 0.15
SHADOW_COLUMNS = 2


def find_shadows(eye: ImagedEye, tissue: WallLight) -> tuple[Shadow, ...]:
    """Return the shadows on a frame's wall, from left to right; none is within a wider
    one, which speckle cuts.
    """
    light_db = _dips(eye, tissue.column_db)
    known = np.isfinite(light_db)
    deviation = robust_spread(np.abs(light_db[known]))
    dark, _ = label(np.nan_to_num(light_db) < -max(SHADOW_DB, SHADOW_SDS * deviation))
    found = [_fitted_shadow(eye, light_db, place[0]) for place in find_objects(dark)]
    kept: list[Shadow] = []

    for shadow in sorted(
        (each for each in found if each is not None), key=lambda each: -each.width_m
    ):
        if all(
            abs(shadow.centre_m - other.centre_m) > other.width_m / 2 for other in kept
        ):
            kept.append(shadow)

    return tuple(sorted(kept, key=lambda each: each.centre_m))


def _fitted_shadow(eye: ImagedEye, light_db: Floats, place: slice) -> Shadow | None:
    """Return the shadow about a run of dark columns; None: no fit."""
    columns = place.stop - place.start
    if columns < SHADOW_COLUMNS:
        return None

    margin = max(4, round(MARGIN * columns))
    near = np.arange(
        max(place.start - margin, 0), min(place.stop + margin, len(light_db))
    )
    near = near[np.isfinite(light_db[near])]
    light = 10.0 ** (light_db[near] / 10.0)

    def shaded(
        column: Floats, middle: float, width: float, loss: float, base: float
    ) -> Floats:
        return base * (
            1.0 - loss * np.exp(-np.log(2.0) * (2.0 * (column - middle) / width) ** 4)
        )

    start = ((place.start + place.stop - 1) / 2, columns, 1.0 - light.min(), 1.0)
    ends = (near[0], 1.0, 0.0, 0.5), (near[-1], 4.0 * columns, 1.0, 2.0)
    found = fitted_curve(shaded, near, light, start, bounds=ends)
    if found is None or not found[1][2] < MOST_LOSS_ERROR:
        return None

    column, width, loss, _ = map(float, found[0])
    lateral_m = eye.scale.lateral_m
    centre_m = (column + 0.5) * lateral_m - lateral_m * len(light_db) / 2
    return Shadow(centre_m=centre_m, width_m=width * lateral_m, loss_fraction=loss)


# over the noise and below the display's end: pixels whose speckle is whole
SPECKLE_DB = 6.0
UNDER_TOP_DB = 5.0
LEAST_PIXELS = 2000
FAR = 60  # the longest lag, pixels
LEAST_LAGS = 6
# standard deviations of the amplitude, pixels
NARROW = 0.2
WIDE = 40.0
SURE = 2.0  # standard errors over which a correlation is one


def resolutions(
    eye: ImagedEye, display: Display, tissue: WallLight
) -> tuple[Measured, Measured]:
    """Return axial and lateral resolution: full widths at half maximum of the
    intensity, m of the frame.
    """
    expected_db = tissue.expected_db
    chosen = (expected_db > SPECKLE_DB) & (
        expected_db < display.highest_db - UNDER_TOP_DB
    )
    chosen &= eye.inside & tissue.clear

    pixels = int(np.count_nonzero(chosen))
    if pixels < LEAST_PIXELS:
        return (
            Unmeasured(
                "too little of the wall lies between the noise and the display's end"
            ),
        ) * 2

    speckle = np.where(chosen, tissue.levels - expected_db, 0.0)
    speckle[chosen] -= speckle[chosen].mean()
    light = 10.0 ** (expected_db[chosen] / 10.0)
    share = float(np.mean((1.0 - 1.0 / np.maximum(light, 1.0)) ** 2))
    down, across = _autocorrelation(speckle, chosen)

    return _width(down, share, pixels, eye.scale.depth_m), _width(
        across, share, pixels, eye.scale.lateral_m
    )


def drawn_correlation(sigma: float, lags: int) -> Floats:
    """Return the correlation of drawn intensities at `lags` lags from 0; `sigma`: of
    the amplitude, pixels.
    """
    reach = int(np.ceil(3.5 * sigma))
    kernel = np.exp(-((np.arange(-reach, reach + 1) / sigma) ** 2) / 2)
    field = np.correlate(kernel, kernel, "full")[2 * reach :] / (kernel @ kernel)
    return np.square(np.pad(field, (0, lags))[:lags])


def _autocorrelation(speckle: Floats, chosen: Flags) -> tuple[Floats, Floats]:
    """Return the autocorrelation of the chosen pixels along columns and along rows,
    from lag 0.
    """
    shape = [next_fast_len(size + FAR, real=True) for size in speckle.shape]
    power, pairs = (
        irfft2(np.abs(rfft2(values, shape)) ** 2, shape)
        for values in (speckle, chosen.astype(np.float64))
    )
    mean = np.divide(
        power, pairs, out=np.zeros_like(power), where=pairs > LEAST_PIXELS / 2
    )

    return mean[:FAR, 0] / mean[0, 0], mean[0, :FAR] / mean[0, 0]


def _width(correlation: Floats, share: float, pixels: int, pixel_m: float) -> Measured:
    """Return the full width of the intensity's spread, m, from the autocorrelation of
    the speckle in dB.
    """
    fallen = np.flatnonzero(correlation < 0.15)
    if not len(fallen) or fallen[0] * 3 > FAR:
        return Unmeasured("the wall's texture is coarser than speckle")

    lags = max(LEAST_LAGS, 3 * int(fallen[0]))
    seen = correlation[1:lags]

    def model(_: Floats, sigma: float, offset: float) -> Floats:
        return _of_logarithms(share * drawn_correlation(sigma, lags)[1:]) + offset

    error = float(np.sqrt((1.0 + 2.0 * np.sum(np.maximum(seen, 0.0) ** 2)) / pixels))

    def over(
        width: float,
    ) -> float:
        # the correlation of neighbours beyond the least that is sure
        return (
            float(_of_logarithms(share * drawn_correlation(width, 2)[1:])[0])
            - SURE * error
        )

    least = (
        float(brentq(over, NARROW, 2.0)) if over(NARROW) < 0.0 < over(2.0) else NARROW
    )
    start = (max(0.5, fallen[0] * 0.6), 0.0)
    value, covariance = curve_fit(
        model,
        np.arange(1.0, lags),
        seen,
        start,
        sigma=np.full(lags - 1, error),
        absolute_sigma=True,
        bounds=((NARROW, -0.2), (WIDE, 0.4)),
        x_scale=(0.1, 0.01),
    )
    sigma = float(value[0])
    per_sigma = 1.0 / amplitude_sigma(1.0)

    if sigma <= least:
        return Estimate(value=least * per_sigma * pixel_m, at_most=True)

    misfit = float(np.std(seen - model(seen, *value))) / error
    sigma_error = float(np.sqrt(covariance[0, 0])) * max(1.0, misfit)
    return Estimate(
        value=sigma * per_sigma * pixel_m, error=sigma_error * per_sigma * pixel_m
    )


def _of_logarithms(rho: Floats) -> Floats:
    """Return the correlation of the logarithms of exponential intensities of
    correlation rho.
    """
    return spence(1.0 - rho) / spence(0.0)


LEAST_SIGMA = 0.4  # pixels: no ridge is drawn narrower
# of the rows about the surface that are looked at
REACH_SIGMAS = 2.5
REACH_ROWS = 2.0
# such slopes have to be seen: for the reflection, and for where the surface is
NORMAL_RAD = 0.05
STEEP_RAD = 0.2
FARTHEST_RAD = 0.4  # beyond, the surface leaves the picture, or is found less well
SURFACE_COLUMNS = 20
# of the columns near the normal may reach the display's largest count
MOST_AT_TOP = 0.05
MOST_ERROR_DB = 1.5
MOST_ANGLE_SHARE = 0.35
SPREAD = 2.0  # of the angle over its fit's standard error: neighbours are alike
START_RAD = 0.1  # angle
START_ROWS = 0.3  # deviation of the surface that was found
# slopes between which the offset of that surface changes evenly
KNOTS_RAD = (
    0.0,
    0.05,
    0.1,
    0.15,
    0.25,
    0.4,
)
WEAK = "the surface hardly reflects over its speckle"


@dataclass(frozen=True, eq=False, kw_only=True)
class SurfaceLight:
    """Pixels about a frame's surface, (pixel,): its slope, rows `below` it, `light`
    over the speckle of the column.
    """

    slope_rad: Floats
    below: Floats
    light: Floats
    sigma_rows: float  # of the amplitude along the depth
    noise: float  # over the speckle
    fault: str = ""  # that makes the reflection unmeasured


def surface_light(
    eye: ImagedEye, display: Display, tissue: WallLight, axial: Measured
) -> SurfaceLight:
    """Return the light about the surface of a frame's unshaded columns."""
    sigma = LEAST_SIGMA
    if isinstance(axial, Estimate):
        sigma = max(amplitude_sigma(axial.value) / eye.scale.depth_m, LEAST_SIGMA)

    columns = np.flatnonzero(tissue.clear & (eye.slope_rad < FARTHEST_RAD))
    reach = round(REACH_SIGMAS * sigma + REACH_ROWS)
    rows = (
        np.rint(eye.surface_row[columns]).astype(np.intp)
        + np.arange(-reach, reach + 1)[:, None]
    )
    rows = np.clip(rows, 0, len(eye.pixels) - 1)
    speckle = 10.0 ** ((tissue.snr_db.value + tissue.column_db[columns]) / 10.0)
    light = (10.0 ** (tissue.levels[rows, columns] / 10.0) - 1.0) / speckle
    slope = eye.slope_rad[columns]
    at_top = (eye.pixels[rows, columns] >= display.top).any(axis=0)[slope < NORMAL_RAD]
    fault = ""

    if (
        len(at_top) < SURFACE_COLUMNS
        or np.count_nonzero(slope > STEEP_RAD) < SURFACE_COLUMNS
    ):
        fault = "the surface is not seen both along the normal and well off it"
    elif at_top.mean() > MOST_AT_TOP:
        fault = "the surface's reflection is brighter than the display's end"

    slopes = np.broadcast_to(slope, rows.shape).ravel()
    below = (rows - eye.surface_row[columns]).ravel()
    noise = float(10.0 ** (-tissue.snr_db.value / 10.0))
    return SurfaceLight(
        slope_rad=slopes,
        below=below,
        light=light.ravel(),
        sigma_rows=sigma,
        noise=noise,
        fault=fault,
    )


def reflections(frames: Sequence[SurfaceLight]) -> tuple[list[Measured], Measured]:
    """Return each frame's reflection at normal incidence over its speckle, dB, and the
    angle of a fall to 1/e, rad.
    """
    usable = [frame for frame in frames if not frame.fault]
    if not usable:
        return [Unmeasured(frame.fault) for frame in frames], Unmeasured(
            frames[0].fault
        )

    pooled = _fit_reflection(
        usable, np.array([1.0, START_RAD, START_ROWS, *[0.0] * len(KNOTS_RAD)])
    )
    if pooled is not None and pooled[0][1] <= NEAR_END * HIGH[1]:
        (_, angle_rad, *_), (_, error_rad, *_) = pooled
        angle = estimate_or_reason(
            angle_rad, SPREAD * error_rad, MOST_ANGLE_SHARE * angle_rad, WEAK
        )
        if isinstance(angle, Estimate):
            strengths = [_strength(frame, pooled[0]) for frame in frames]
            return strengths, (
                angle
                if any(isinstance(each, Estimate) for each in strengths)
                else Unmeasured(WEAK)
            )

    return [Unmeasured(frame.fault or WEAK) for frame in frames], Unmeasured(WEAK)


def _strength(frame: SurfaceLight, pooled: Floats) -> Measured:
    """Return a frame's reflection, at the angle and the surface's deviation of all
    frames.
    """
    if frame.fault:
        return Unmeasured(frame.fault)

    found = _fit_reflection([frame], pooled, slice(1))
    if found is None:
        return Unmeasured(WEAK)

    gain = max(float(found[0][0]), 1e-9)
    return estimate_or_reason(
        10.0 * np.log10(gain),
        10.0 / np.log(10.0) * float(found[1][0]) / gain,
        MOST_ERROR_DB,
        WEAK,
    )


# Reflection over the speckle; its angle, rad; deviation of the found surface, rows;
# depth of the true one below it.
LOW = np.array([0.0, 0.01, 0.05] + [-3.0] * len(KNOTS_RAD))
HIGH = np.array([1e4, 1.0, 3.0] + [3.0] * len(KNOTS_RAD))
NEAR_END = 0.95  # of the largest angle: a fit that runs there has not found one


def _fit_reflection(
    frames: Sequence[SurfaceLight], start: Floats, free: slice = slice(None)
) -> tuple[Floats, Floats] | None:
    """Fit the light of frames' pixels; return values (see LOW) and errors, or None;
    those not free keep their start.
    """
    slope, below, light, sigma, noise = (
        np.concatenate(
            [
                np.broadcast_to(getattr(frame, name), frame.light.shape)
                for frame in frames
            ]
        )
        for name in ("slope_rad", "below", "light", "sigma_rows", "noise")
    )
    value = start.copy()
    errors = np.zeros(len(start))

    def model(_: Floats, *parameters: float) -> Floats:
        whole = start.copy()
        whole[free] = parameters
        return _seen(slope, below, sigma, whole)

    weight = np.ones(len(light))
    for _ in range(3):  # the spread of speckle is its light
        found = fitted_curve(
            model,
            below,
            light,
            np.clip(value[free], LOW[free], HIGH[free]),
            sigma=weight,
            bounds=(LOW[free], HIGH[free]),
            max_nfev=300,
        )
        if found is None:
            return None

        value[free], errors[free] = found
        weight = _seen(slope, below, sigma, value) + noise

    return value, errors


def _seen(slope: Floats, below: Floats, sigma: Floats, parameters: Floats) -> Floats:
    """Return the mean light of pixels about the surface, over the speckle: the step of
    the wall, and the ridge.
    """
    gain, angle, deviation = parameters[:3]
    share = np.exp(-((slope / angle) ** 2))
    rows = below - np.interp(slope, KNOTS_RAD, parameters[3:])
    wide = np.sqrt(sigma**2 + 2.0 * deviation**2)
    step = ndtr(rows / np.sqrt(1.0 / 12.0 + wide**2 / 2.0))
    return step + gain * share * sigma / wide * np.exp(-((rows / wide) ** 2))
