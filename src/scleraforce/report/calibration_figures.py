"""Figures of a calibration: E over the frames (the paper's Fig. 5), points before and after (4), E over the force."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from scleraforce.calibration.assimilation import EyeFilter, FrameStep, predicted_points, rigidity_after
from scleraforce.calibration.eye_model import stated_wall
from scleraforce.calibration.registration import BY_POLAR, place_section
from scleraforce.calibration.result import Calibration, EyeCalibration, found_words
from scleraforce.recording.pixels import Pixels
from scleraforce.report.files import BLUE, RED, SCAN_COLOURS, inches, styled
from scleraforce.units import from_si

EYES_IN_A_ROW = 3


@styled
def draw_modulus_over_frames(eye: EyeCalibration, truth_pa: float | None = None) -> Figure:
    """Draw mean and band (one and two standard deviations) of E over the frames (Fig. 5), and a virtual eye's E."""
    figure = Figure(figsize=inches(170, 62))
    whole, close = figure.subplots(1, 2)
    _draw_over_frames(whole, eye, truth_pa)
    whole.set_title("from the prior on")
    _draw_over_frames(close, eye, truth_pa)
    close.set_title("the same, from the first frame on")
    ends = [from_si(f.mean_pa + sign * 3 * f.sd_pa, "mpa") for f in eye.used for sign in (-1, 1)]
    close.set(xlim=(1, max(len(eye.used), 2)), ylim=(min(ends), max(ends)))
    close.get_legend().remove()
    return figure


@styled
def draw_observed_points(eye: EyeCalibration, frame: Pixels, index: int, width_m: float, depth_m: float) -> Figure:
    """Draw the points of one of an eye's steps over its raw frame, at the prior's and at the final modulus (Fig. 4)."""
    figure = Figure(figsize=inches(170, 52))
    if eye.filter is None or not eye.steps:
        raise ValueError(f"{eye.id}: no points are kept; calibrate it in this run")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    moduli = {"first": eye.filter.study.prior_mean_pa, "final": eye.mean_pa}
    extent = (from_si(-width_m / 2, "mm"), from_si(width_m / 2, "mm"), from_si(depth_m, "mm"), 0.0)
    for axes, (title, modulus_pa) in zip(panels, moduli.items(), strict=True):
        axes.imshow(frame, cmap=SCAN_COLOURS, aspect="auto", extent=extent)
        _draw_points(axes, eye.filter, eye.steps[index], modulus_pa)
        axes.set_title(f"{title}: E = {from_si(modulus_pa, 'mpa'):.2f} MPa")
        axes.set(xlabel="lateral [mm]", xlim=extent[:2], ylim=extent[2:])
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
    grid = figure.add_gridspec(2 * rows, columns)
    for place, eye in enumerate(eyes):
        row, column = divmod(place, columns)
        above, below = (figure.add_subplot(grid[2 * row + line, column]) for line in (0, 1))
        _draw_over_frames(above, eye, None)
        modulus = f"{eye.id}: {from_si(eye.mean_pa, 'mpa'):.3f} MPa, sd {from_si(eye.sd_pa, 'mpa'):.4f} MPa"
        above.set_title("\n".join((modulus, *found_words(eye))))
        _draw_by_force(below, eye)
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
    axes.set(xlabel="frames", ylabel="E [MPa]", ylim=(0.0, 1.05 * float((mean + 2 * sd).max())))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(loc="best")


def _draw_by_force(axes: Axes, eye: EyeCalibration) -> None:
    alone = [
        (from_si(f.force_n, "mn"), from_si(f.own_modulus_pa, "mpa")) for f in eye.used if f.own_modulus_pa is not None
    ]
    if alone:
        axes.plot(*zip(*alone, strict=True), "o", color=BLUE, markersize=3.5)
    axes.set(xlabel="force [mN]", ylabel="E [MPa]")
    axes.set_xlim(left=0.0)
    top = max((modulus for _, modulus in alone), default=1.0)
    axes.set_ylim(0.0, max(1.15 * top, axes.get_ylim()[1]))


def _draw_points(axes: Axes, eye: EyeFilter, step: FrameStep, modulus_pa: float) -> None:
    depth_m = predicted_points(eye, step, modulus_pa)
    model, polar_rad = eye.model, float(step.registered.nuisance[BY_POLAR])
    rigidity = rigidity_after(eye, step.state)
    curves = model.curves([stated_wall(model.constants, modulus_pa, step.force_n, polar_rad, rigidity)])[0]
    for curve in place_section(curves, step.registered.nuisance):
        axes.plot(*from_si(curve, "mm").T, color=RED, linewidth=0.5, scalex=False, scaley=False)
    lateral_mm, observed_mm = (from_si(m, "mm") for m in (step.observation.lateral_m, step.observation.depth_m))
    axes.plot(lateral_mm, observed_mm, "o", color="#F0E442", markersize=4.5, label="observed")
    axes.plot(lateral_mm, from_si(depth_m, "mm"), "o", color=RED, markersize=2.5, label="predicted")
