"""Figures of a calibration: E over the frames (the paper's Fig. 5), points before and after (4), E over the force."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from scleraforce.calibration.assimilation import FrameStep, predicted_points, rigidity_after
from scleraforce.calibration.eye_model import stated_wall
from scleraforce.calibration.registration import BY_POLAR, place_section
from scleraforce.calibration.result import Calibration, EyeCalibration, found_words
from scleraforce.report.files import BLUE, RED, SCAN_COLOURS, inches, styled
from scleraforce.units import from_si

EYES_IN_A_ROW = 3


@styled
def draw_modulus_over_frames(eye: EyeCalibration, truth_pa: float | None = None) -> Figure:
    """Draw mean and band (one and two standard deviations) of E over the frames, from the prior on (Fig. 5).

    Args:
        eye: with its frames.
        truth_pa: the modulus of a virtual eye, drawn as a line.
    """
    figure = Figure(figsize=inches(170, 62))
    whole, close = figure.subplots(1, 2)
    _draw_over_frames(whole, eye, truth_pa)
    whole.set_title("from the prior on")
    _draw_over_frames(close, eye, truth_pa)
    close.set_title("the same, from the first frame on")
    ends = [from_si(f.mean_pa + sign * 3 * f.sd_pa, "mpa") for f in eye.used for sign in (-1, 1)]
    close.set_xlim(1, max(len(eye.used), 2))
    close.set_ylim(min(ends), max(ends))
    close.get_legend().remove()
    return figure


@styled
def draw_observed_points(
    eye: EyeCalibration, frame: NDArray[np.uint16], index: int, width_m: float, depth_m: float
) -> Figure:
    """Draw observed and predicted points over a raw frame, at the prior's modulus and at the final one (Fig. 4 b, c).

    Args:
        eye: just calibrated (a file keeps no points).
        frame: the raw frame (row, column).
        index: which of the eye's steps it belongs to.
        width_m: of the frame.
        depth_m: of the frame.
    """
    figure = Figure(figsize=inches(170, 52))
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    extent = (from_si(-width_m / 2, "mm"), from_si(width_m / 2, "mm"), from_si(depth_m, "mm"), 0.0)
    for axes, (title, modulus_pa) in zip(panels, _first_and_last(eye), strict=True):
        axes.imshow(frame, cmap=SCAN_COLOURS, aspect="auto", extent=extent)
        _draw_points(axes, eye, eye.steps[index], modulus_pa)
        axes.set_title(f"{title}: E = {from_si(modulus_pa, 'mpa'):.2f} MPa")
        axes.set_xlabel("lateral [mm]")
        axes.set_xlim(extent[:2])
        axes.set_ylim(extent[2:])
    panels[0].set_ylabel("depth [mm]")
    panels[0].legend(loc="upper right", labelcolor="white")
    return figure


@styled
def draw_calibration(calibration: Calibration) -> Figure:
    """Draw every eye: E over its frames above, what each frame alone says over its force below."""
    eyes = list(calibration.eyes.values())
    columns = min(len(eyes), EYES_IN_A_ROW)
    rows = -(-len(eyes) // columns)
    figure = Figure(figsize=inches(max(85 * columns, 110), 100 * rows))
    panels = figure.subplots(2 * rows, columns, squeeze=False)
    for spare in panels.ravel():
        spare.set_visible(False)
    for place, eye in enumerate(eyes):
        row, column = divmod(place, columns)
        above, below = panels[2 * row, column], panels[2 * row + 1, column]
        above.set_visible(True)
        below.set_visible(True)
        _draw_over_frames(above, eye, None)
        modulus = f"{eye.id}: {from_si(eye.mean_pa, 'mpa'):.3f} MPa, sd {from_si(eye.sd_pa, 'mpa'):.4f} MPa"
        above.set_title("\n".join((modulus, *found_words(eye))))
        _draw_by_force(below, eye, BLUE, "o")
        below.axhline(from_si(eye.mean_pa, "mpa"), color=RED, linewidth=0.8)
    return figure


def _draw_over_frames(axes: Axes, eye: EyeCalibration, truth_pa: float | None) -> None:
    mean = from_si(np.array([frame.mean_pa for frame in eye.used]), "mpa")
    sd = from_si(np.array([frame.sd_pa for frame in eye.used]), "mpa")
    if eye.filter is not None:
        study = eye.filter.study
        mean = np.append(from_si(study.prior_mean_pa, "mpa"), mean)
        sd = np.append(from_si(study.prior_sd_pa, "mpa"), sd)
    first = 0 if eye.filter is not None else 1
    count = np.arange(first, first + len(mean))
    axes.fill_between(count, mean - 2 * sd, mean + 2 * sd, color=BLUE, alpha=0.15, linewidth=0)
    axes.fill_between(count, mean - sd, mean + sd, color=BLUE, alpha=0.3, linewidth=0, label="one and two sd")
    axes.plot(count, mean, "o-", color=BLUE, markersize=2.5, label="mean")
    if truth_pa is not None:
        axes.axhline(from_si(truth_pa, "mpa"), color=RED, linestyle="--", linewidth=0.8, label="true")
    axes.set_ylim(0.0, 1.05 * float((mean + 2 * sd).max()))
    axes.set_xlabel("frames")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylabel("E [MPa]")
    axes.legend(loc="best")


def _draw_by_force(axes: Axes, eye: EyeCalibration, colour: str, marker: str) -> None:
    alone = [
        (from_si(f.force_n, "mn"), from_si(f.own_modulus_pa, "mpa")) for f in eye.used if f.own_modulus_pa is not None
    ]
    if alone:
        axes.plot(*zip(*alone, strict=True), marker, color=colour, markersize=3.5, label=f"{eye.id}, each frame alone")
    axes.set_xlabel("force [mN]")
    axes.set_ylabel("E [MPa]")
    axes.set_xlim(left=0.0)
    top = max((modulus for _, modulus in alone), default=1.0)
    axes.set_ylim(0.0, max(1.15 * top, axes.get_ylim()[1]))


def _first_and_last(eye: EyeCalibration) -> tuple[tuple[str, float], tuple[str, float]]:
    if eye.filter is None or not eye.steps:
        raise ValueError(f"{eye.id}: no points are kept; calibrate it in this run")
    return ("first", eye.filter.study.prior_mean_pa), ("final", eye.mean_pa)


def _draw_points(axes: Axes, eye: EyeCalibration, step: FrameStep, modulus_pa: float) -> None:
    assert eye.filter is not None  # checked by _first_and_last
    depth_m = predicted_points(eye.filter, step, modulus_pa)
    model, polar_rad = eye.filter.model, float(step.registered.nuisance[BY_POLAR])
    rigidity = rigidity_after(eye.filter, step.state)
    curves = model.curves([stated_wall(model.constants, modulus_pa, step.force_n, polar_rad, rigidity)])[0]
    for curve in place_section(curves, step.registered.nuisance):
        axes.plot(*from_si(curve, "mm").T, color=RED, linewidth=0.5, scalex=False, scaley=False)
    lateral_mm, observed_mm = (from_si(m, "mm") for m in (step.observation.lateral_m, step.observation.depth_m))
    axes.plot(lateral_mm, observed_mm, "o", color="#F0E442", markersize=4.5, label="observed")
    axes.plot(lateral_mm, from_si(depth_m, "mm"), "o", color=RED, markersize=2.5, label="predicted")
