"""What a scanner shows beside the wall's light: the surface's reflection, speckle, lines across the frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.optimize import brentq, curve_fit
from scipy.signal import find_peaks
from scipy.special import ndtr, spence
from scipy.stats import ncx2

from scleraforce.fitting.least_squares import robust_spread
from scleraforce.laboratory.light import amplitude_sigma
from scleraforce.scanner.display import MEDIAN_DB, Display
from scleraforce.scanner.imaged_eye import Estimate, ImagedEye, Trace, Unmeasured, fitted
from scleraforce.scanner.tissue import WallLight

LEAST_DB, BELOW_TOP_DB = 6.0, 5.0  # over the noise and below the display's end: pixels whose speckle is whole
LEAST_PIXELS = 2000
FAR = 60  # the longest lag, pixels
LEAST_LAGS = 6
NARROW, WIDE = 0.2, 40.0  # standard deviations of the amplitude, pixels
SURE = 2.0  # standard errors over which a correlation is one


def resolutions(
    eye: ImagedEye, display: Display, tissue: WallLight
) -> tuple[Estimate | Unmeasured, Estimate | Unmeasured]:
    """Return axial and lateral resolution: full widths at half maximum of the intensity, m of the frame."""
    expected_db = 10.0 * np.log10(tissue.expected + 1.0) + np.nan_to_num(tissue.column_db)
    chosen = tissue.inside & tissue.clear & (expected_db > LEAST_DB) & (expected_db < display.highest_db - BELOW_TOP_DB)
    pixels = int(np.count_nonzero(chosen))
    if pixels < LEAST_PIXELS:
        reason = Unmeasured("too little of the wall lies between the noise and the display's end")
        return reason, reason
    speckle = np.where(chosen, tissue.levels - expected_db, 0.0)
    speckle[chosen] -= speckle[chosen].mean()
    light = 10.0 ** (expected_db[chosen] / 10.0)
    share = float(np.mean((1.0 - 1.0 / np.maximum(light, 1.0)) ** 2))
    down, across = _autocorrelation(speckle, chosen)
    steps_m = (eye.scale.depth_m, eye.scale.lateral_m)
    found = [_width(curve, share, pixels) for curve in (down, across)]
    axial, lateral = (
        Estimate(value=width.value * step, error=width.error * step, at_most=width.at_most)
        if isinstance(width, Estimate)
        else width
        for width, step in zip(found, steps_m, strict=True)
    )
    return axial, lateral


def drawn_correlation(sigma: float, lags: int) -> Trace:
    """Return how intensities of drawn speckle correlate at lags of 0, 1, ... pixels.

    Args:
        sigma: standard deviation of the Gaussian amplitude, pixels.
        lags: how many.
    """
    reach = int(np.ceil(3.5 * sigma))
    kernel = np.exp(-((np.arange(-reach, reach + 1) / sigma) ** 2) / 2)
    field = np.correlate(kernel, kernel, "full")[2 * reach :] / (kernel @ kernel)
    padded: Trace = np.square(np.pad(field, (0, lags))[:lags])
    return padded


def _autocorrelation(speckle: NDArray[np.float64], chosen: NDArray[np.bool_]) -> tuple[Trace, Trace]:
    """Return the autocorrelation of the chosen pixels along the columns and along the rows, at lags from 0 on."""
    shape = [next_fast_len(size + FAR, real=True) for size in speckle.shape]
    power, pairs = (irfft2(np.abs(rfft2(values, shape)) ** 2, shape) for values in (speckle, chosen.astype(np.float64)))
    mean = np.divide(power, pairs, out=np.zeros_like(power), where=pairs > LEAST_PIXELS / 2)
    down: Trace = mean[:FAR, 0] / mean[0, 0]
    across: Trace = mean[0, :FAR] / mean[0, 0]
    return down, across


def _width(correlation: Trace, share: float, pixels: int) -> Estimate | Unmeasured:
    """Return the full width of the intensity's spread, in pixels, from the autocorrelation of the speckle in dB."""
    fallen = np.flatnonzero(correlation < 0.15)
    if not len(fallen) or fallen[0] * 3 > FAR:
        return Unmeasured("the wall's texture is coarser than speckle")
    lags = max(LEAST_LAGS, 3 * int(fallen[0]))
    seen = correlation[1:lags]

    def model(_: Trace, sigma: float, offset: float) -> Trace:
        return _of_logarithms(share * drawn_correlation(sigma, lags)[1:]) + offset

    error = float(np.sqrt((1.0 + 2.0 * np.sum(np.maximum(seen, 0.0) ** 2)) / pixels))
    least = _independent(share, SURE * error)
    start = (max(0.5, fallen[0] * 0.6), 0.0)
    value, covariance = curve_fit(
        model, np.arange(1.0, lags), seen, start, sigma=np.full(lags - 1, error), absolute_sigma=True,
        bounds=((NARROW, -0.2), (WIDE, 0.4)), x_scale=(0.1, 0.01),
    )  # fmt: skip
    sigma, per_sigma = float(value[0]), 1.0 / amplitude_sigma(1.0)
    if sigma <= least:
        return Estimate(value=least * per_sigma, error=0.0, at_most=True)
    misfit = float(np.std(seen - model(seen, *value))) / error
    return Estimate(value=sigma * per_sigma, error=float(np.sqrt(covariance[0, 0])) * max(1.0, misfit) * per_sigma)


def _of_logarithms(rho: Trace) -> Trace:
    """Return how logarithms of exponential intensities correlate that correlate by rho themselves."""
    correlated: Trace = spence(1.0 - rho) / spence(0.0)
    return correlated


def _independent(share: float, correlation: float) -> float:
    """Return the standard deviation of the amplitude, in pixels, below which neighbours correlate by less than that."""

    def over(sigma: float) -> float:
        rho = share * drawn_correlation(sigma, 2)[1:]
        return float(_of_logarithms(rho)[0]) - correlation

    return float(brentq(over, NARROW, 2.0)) if over(NARROW) < 0.0 < over(2.0) else NARROW


LEAST_SIGMA = 0.4  # pixels: no ridge is drawn narrower
REACH_SIGMAS, REACH_ROWS = 2.5, 2.0  # of the rows about the surface that are looked at
NORMAL_RAD, STEEP_RAD = 0.05, 0.2  # such slopes have to be seen: for the reflection, and for where the surface is
STEEPEST_RAD = 0.4  # beyond, the surface leaves the picture, or is found less well
LEAST_COLUMNS = 20
MOST_AT_TOP = 0.05  # of the columns near the normal may reach the display's largest count
MOST_ERROR_DB, MOST_ANGLE_SHARE = 1.5, 0.35
SPREAD = 2.0  # of the angle over its fit's standard error: neighbours are alike
START_RAD, START_ROWS = 0.1, 0.3  # angle; deviation of the surface that was found
KNOTS_RAD = (0.0, 0.05, 0.1, 0.15, 0.25, 0.4)  # slopes between which the offset of that surface changes evenly
WEAK = "the surface hardly reflects over its speckle"


@dataclass(frozen=True, eq=False, kw_only=True)
class SurfaceLight:
    """Pixels about a frame's surface, (pixel,).

    `slope_rad` of the surface, rows `below` it, and the `light` over the speckle of the column. `sigma_rows`: of the
    amplitude along the depth; `noise`: over the speckle; `fault`: why the reflection cannot be told.
    """

    slope_rad: Trace
    below: Trace
    light: Trace
    sigma_rows: float
    noise: float
    fault: str = ""


def surface_light(eye: ImagedEye, display: Display, tissue: WallLight, axial: Estimate | Unmeasured) -> SurfaceLight:
    """Return the light about the surface of a frame's unshaded columns."""
    sigma = LEAST_SIGMA
    if isinstance(axial, Estimate):
        sigma = max(amplitude_sigma(axial.value) / eye.scale.depth_m, LEAST_SIGMA)
    columns = np.flatnonzero(tissue.clear & np.isfinite(tissue.column_db) & (eye.slope_rad < STEEPEST_RAD))
    reach = round(REACH_SIGMAS * sigma + REACH_ROWS)
    rows = np.rint(eye.surface_row[columns]).astype(np.intp) + np.arange(-reach, reach + 1)[:, None]
    rows = np.clip(rows, 0, len(eye.pixels) - 1)
    speckle = 10.0 ** ((tissue.snr_db.value + tissue.column_db[columns]) / 10.0)
    light = (10.0 ** (tissue.levels[rows, columns] / 10.0) - 1.0) / speckle
    slope = eye.slope_rad[columns]
    at_top = (eye.pixels[rows, columns] >= display.top).any(axis=0)[slope < NORMAL_RAD]
    fault = ""
    if len(at_top) < LEAST_COLUMNS or np.count_nonzero(slope > STEEP_RAD) < LEAST_COLUMNS:
        fault = "the surface is not seen both along the normal and well off it"
    elif at_top.mean() > MOST_AT_TOP:
        fault = "the surface's reflection is brighter than the display's end"
    return SurfaceLight(
        slope_rad=np.broadcast_to(slope, rows.shape).ravel(),
        below=(rows - eye.surface_row[columns]).ravel(),
        light=light.ravel(),
        sigma_rows=sigma,
        noise=float(10.0 ** (-tissue.snr_db.value / 10.0)),
        fault=fault,
    )


def reflections(frames: Sequence[SurfaceLight]) -> tuple[list[Estimate | Unmeasured], Estimate | Unmeasured]:
    """Return each frame's reflection at normal incidence over its speckle, dB, and the angle of all, rad.

    The angle is the slope at which the reflection has fallen to 1/e.
    """
    usable = [frame for frame in frames if not frame.fault]
    if not usable:
        return [Unmeasured(frame.fault) for frame in frames], Unmeasured(frames[0].fault)
    pooled = _fit(usable, (1.0, START_RAD, START_ROWS, *[0.0] * len(KNOTS_RAD)))
    reason = Unmeasured(WEAK)
    angle: Estimate | Unmeasured = reason
    if pooled is not None:
        angle = fitted(pooled[0][1], SPREAD * pooled[1][1], MOST_ANGLE_SHARE * pooled[0][1], WEAK)
    if pooled is None or isinstance(angle, Unmeasured) or pooled[0][1] > NEAR_END * HIGH[1]:
        return [Unmeasured(frame.fault or WEAK) for frame in frames], reason
    strengths = [_strength(frame, pooled[0]) for frame in frames]
    return strengths, angle if any(isinstance(each, Estimate) for each in strengths) else reason


def _strength(frame: SurfaceLight, pooled: Trace) -> Estimate | Unmeasured:
    """Return a frame's reflection, at the angle and the surface's deviation of all frames."""
    if frame.fault:
        return Unmeasured(frame.fault)
    found = _fit([frame], tuple(pooled), held=tuple(range(1, len(LOW))))
    if found is None:
        return Unmeasured(WEAK)
    gain = max(float(found[0][0]), 1e-9)
    return fitted(10.0 * np.log10(gain), 10.0 / np.log(10.0) * float(found[1][0]) / gain, MOST_ERROR_DB, WEAK)


# Gain, angle, deviation, and the offsets at KNOTS_RAD.
LOW = np.array([0.0, 0.01, 0.05] + [-3.0] * len(KNOTS_RAD))
HIGH = np.array([1e4, 1.0, 3.0] + [3.0] * len(KNOTS_RAD))
NEAR_END = 0.95  # of the largest angle that is looked for: a fit that runs there has found none


def _fit(
    frames: Sequence[SurfaceLight], start: tuple[float, ...], held: tuple[int, ...] = ()
) -> tuple[Trace, Trace] | None:
    """Fit the light of frames' pixels; return the values and standard errors, None where none fit.

    Values: the reflection over the speckle; its angle, rad; the deviation of the surface that was found, rows, and how
    many rows the true one lies below it, at KNOTS_RAD. Those `held` are the start.
    """
    slope, below, light = (
        np.concatenate([getattr(frame, name) for frame in frames]) for name in ("slope_rad", "below", "light")
    )
    sigma, noise = (
        np.concatenate([np.full(len(frame.light), getattr(frame, name)) for frame in frames])
        for name in ("sigma_rows", "noise")
    )
    free = np.array([number for number in range(len(start)) if number not in held])
    value, errors = np.array(start), np.zeros(len(start))

    def model(_: Trace, *parameters: float) -> Trace:
        whole = np.array(start)
        whole[free] = parameters
        return _seen(slope, below, sigma, whole)

    weight = np.ones(len(light))
    try:
        for _ in range(3):  # the spread of speckle is its light
            value[free], covariance = curve_fit(
                model, below, light, np.clip(value[free], LOW[free], HIGH[free]), sigma=weight,
                bounds=(LOW[free], HIGH[free]), max_nfev=300,
            )  # fmt: skip
            errors[free] = np.sqrt(np.diag(covariance))
            weight = _seen(slope, below, sigma, value) + noise
    except RuntimeError:
        return None
    return value, errors


def _seen(slope: Trace, below: Trace, sigma: Trace, parameters: Trace) -> Trace:
    """Return the mean light of pixels about the surface, over the speckle: the step of the wall, and the ridge."""
    gain, angle, deviation = parameters[:3]
    share = np.exp(-((slope / angle) ** 2))
    rows = below - np.interp(slope, KNOTS_RAD, parameters[3:])
    wide = np.sqrt(sigma**2 + 2.0 * deviation**2)
    step = ndtr(rows / np.sqrt(1.0 / 12.0 + wide**2 / 2.0))
    light: Trace = step + gain * share * sigma / wide * np.exp(-((rows / wide) ** 2))
    return light


LEAST_SHARE = 0.5  # of the imaged columns must show air in a row that is looked at
LINE_DB, LEAST_SDS = 1.5, 6.0  # over the noise, in dB and in the other rows' deviations
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
    peaks, _ = find_peaks(level_db, height=max(LINE_DB, LEAST_SDS * deviation), distance=REACH)
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
