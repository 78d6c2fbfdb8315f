"""Resolution along both axes, from the autocorrelation of the wall's speckle.

Two pixels of fully developed speckle whose fields correlate by g have intensities that correlate by rho = |g|^2; their
logarithms, which the display shows and cuts off gently, correlate by Li2(rho)/Li2(1), Li2 being the dilogarithm. Light
S over noise 1 takes rho down by (S/(S + 1))^2. The grain of a width is that of the drawing: a Gaussian amplitude,
sampled in pixels. Below about 0.7 pixels neighbours are independent, and only an upper bound is known.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.optimize import brentq, curve_fit
from scipy.special import spence

from scleraforce.laboratory.speckle import amplitude_sigma
from scleraforce.scanner.display import Display
from scleraforce.scanner.estimate import Estimate, Unmeasured
from scleraforce.scanner.imaged_eye import ImagedEye, Trace
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
