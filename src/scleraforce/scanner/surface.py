"""The surface's mirror reflection, over the wall's speckle, against the angle of incidence.

The light of each pixel about the surface, over the speckle of its column, is fitted by a step, the wall, and a ridge,
the reflection, which falls with the slope. The surface that was found follows the ridge: how far it lies off the true
one is fitted too, by the slope. One frame says little, speckle being what it is: the angle is that of all frames
together, and then each frame has a reflection of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import curve_fit
from scipy.special import ndtr

from scleraforce.laboratory.speckle import amplitude_sigma
from scleraforce.scanner.display import Display
from scleraforce.scanner.estimate import Estimate, Unmeasured, fitted
from scleraforce.scanner.imaged_eye import ImagedEye, Trace
from scleraforce.scanner.tissue import WallLight

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
