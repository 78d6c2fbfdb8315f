"""Figures of a recording and of a calibration: frames and forces; E over frames and
forces, points (Figs. 3 to 5).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from scleraforce.base.units import from_si
from scleraforce.calibration.calibration import (
    Calibration,
    EyeCalibration,
    found_remarks,
)
from scleraforce.calibration.filter.eye_filter import (
    EyeFilter,
    FrameStep,
    predicted_points,
)
from scleraforce.calibration.filter.eye_parameters import stated_wall
from scleraforce.calibration.filter.section_registration import BY_POLAR, place_section
from scleraforce.front.report import figure_files
from scleraforce.recordings.forces_under_frames import Trial, contact_force
from scleraforce.recordings.recording_folder import Recording
from scleraforce.records.frame import Pixels

POINTS_DRAWN = 6000
DASHED = (0, (4, 3))
SHOWN_FRAMES = 3
WIDTH_MM = 170.0
FORCE_MM = 46.0
TIMES_MM = 20.0
WORDS_MM = 12.0
TALLEST_MM = 110.0
BARS_MM = (5.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02)
BAR_SHARE = 0.4  # of the frame's extent, at most
OUTLIERS = 0.1  # per cent of the pixels that may be off the grey scale
NAME_LETTERS = 24


@figure_files.styled
def draw_recording(
    recording: Recording, trials: Sequence[Trial] = (), bounds_n: Sequence[float] = ()
) -> Figure:
    """Draw frames side by side, to scale, above the contact force with the times of all
    frames.

    With `trials`, labels of all frames, it shows the least, the middle and the largest
    force; else the first frames.
    """
    forces_n = [trial.measured_force_n for trial in trials] or [None] * len(
        recording.frames
    )
    order = sorted(range(len(forces_n)), key=lambda n: forces_n[n] or 0.0)
    shown = figure_files.evenly(order, SHOWN_FRAMES) if trials else order[:SHOWN_FRAMES]
    frames = [recording.frame(recording.frames[n]) for n in shown]
    extent_m = recording.info.scan.extent_m
    width_mm, depth_mm = (float(from_si(length, "mm")) for length in extent_m)
    frame_mm = min(TALLEST_MM, (WIDTH_MM - 12.0) / len(frames) * depth_mm / width_mm)
    heights = [frame_mm + WORDS_MM, TIMES_MM if recording.forces is None else FORCE_MM]
    figure = Figure(figsize=figure_files.inches(WIDTH_MM, sum(heights)))
    grid = figure.add_gridspec(len(heights), len(frames), height_ratios=heights)
    low, high = np.percentile(np.stack(frames), [OUTLIERS, 100.0 - OUTLIERS])

    for place, (nth, frame) in enumerate(zip(shown, frames, strict=True)):
        axes = figure.add_subplot(grid[0, place])
        entry = recording.frames[nth]
        force_n = forces_n[nth]
        figure_files.show_image(
            axes, frame, extent_m, vmin=low, vmax=max(high, low + 1)
        )
        said = (
            f"{entry.time_s:.3f} s"
            if force_n is None
            else f"{from_si(force_n, 'mn'):.1f} mN"
        )
        axes.set_title(f"{figure_files.last_letters(entry.file, NAME_LETTERS)}, {said}")
        axes.set_axis_off()
        _scale_bars(axes, width_mm, depth_mm)

    draw_log(figure.add_subplot(grid[1, :]), recording, trials, bounds_n)
    return figure


def _scale_bars(axes: Axes, width_mm: float, depth_mm: float) -> None:
    across, down = (
        next((bar for bar in BARS_MM if bar <= BAR_SHARE * size), size / 2)
        for size in (width_mm, depth_mm)
    )
    left = 0.04 * width_mm
    bottom = 0.94 * depth_mm
    line: dict[str, Any] = {
        "color": figure_files.AMBER,
        "linewidth": 1.6,
        "solid_capstyle": "butt",
    }
    axes.plot([left, left + across], [bottom, bottom], **line)
    axes.plot([left, left], [bottom, bottom - down], **line)
    # letters are readable on bright tissue, too
    edge = [withStroke(linewidth=2.0, foreground=figure_files.SHADE)]
    words: dict[str, Any] = {
        "color": figure_files.AMBER,
        "fontsize": 7.0,
        "path_effects": edge,
    }
    axes.text(
        left + across + 0.015 * width_mm, bottom, f"{across:g} mm", va="center", **words
    )
    axes.text(
        left, bottom - down - 0.02 * depth_mm, f"{down:g} mm deep", va="bottom", **words
    )


@figure_files.styled
def draw_force_log(
    recording: Recording,
    trials: Sequence[Trial],
    bounds_n: Sequence[float],
    until_s: float,
) -> Figure:
    """Draw the beginning of a force log with the labels of its frames and the class
    bounds.
    """
    figure = Figure(figsize=figure_files.inches(170, 62))
    axes = figure.subplots()
    draw_log(axes, recording, trials, bounds_n)
    axes.set_xlim(right=until_s)
    return figure


def draw_log(
    axes: Axes,
    recording: Recording,
    trials: Sequence[Trial] = (),
    bounds_n: Sequence[float] = (),
) -> None:
    """Draw a force log, as logged (shifted to the filtered zero) and filtered, with the
    frames' times and labels.

    Without a log, draw the times alone.
    """
    log = recording.forces
    info = recording.info.force
    times_s = [frame.time_s for frame in recording.frames]
    axes.set_xlabel("time [s]")

    if log is None or info is None:
        axes.plot(times_s, np.zeros(len(times_s)), "|", color=figure_files.BLACK)
        axes.set(title="frames; their forces were not logged", yticks=[])
        return

    filtered_mn = from_si(contact_force(log, info), "mn")
    raw_mn = from_si(info.contact_sign * log.force_n(info.axis), "mn")
    raw_mn = raw_mn - np.nanmean(raw_mn - filtered_mn)
    every = slice(None, None, max(1, len(log.time_s) // POINTS_DRAWN))
    axes.plot(
        log.time_s[every],
        raw_mn[every],
        color=figure_files.FAINT,
        linewidth=0.5,
        label="as logged",
    )
    axes.plot(
        log.time_s[every],
        filtered_mn[every],
        color=figure_files.BLACK,
        linewidth=0.8,
        label="filtered",
    )

    missing_s = log.time_s[np.isnan(raw_mn)]
    if len(missing_s):
        missing_s = missing_s[:: max(1, len(missing_s) // POINTS_DRAWN)]
        axes.plot(
            missing_s,
            np.zeros_like(missing_s),
            "|",
            color=figure_files.RED,
            label="no force",
        )

    ends = 0.0, 0.06  # of the axes' height
    axes.vlines(
        times_s,
        *ends,
        transform=axes.get_xaxis_transform(),
        color=figure_files.BLACK,
        linewidth=0.5,
        label="frames",
    )

    for target, (colour, marker) in enumerate(
        zip(figure_files.CLASS_COLOURS, figure_files.CLASS_MARKERS, strict=True)
    ):
        labels = [
            (t.time_s, from_si(t.measured_force_n, "mn"))
            for t in trials
            if t.target == target
        ]
        if labels:
            label = f"label: class {target}"
            axes.plot(
                *zip(*labels, strict=True),
                marker,
                color=colour,
                markersize=4,
                label=label,
                zorder=5,
            )

    axes.set_xlim(
        min(times_s[0], float(log.time_s[0])), max(times_s[-1], float(log.time_s[-1]))
    )
    axes.set_ylabel("contact force [mN]")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=7)

    if bounds_n:
        mark_bounds(axes, bounds_n)


def mark_bounds(axes: Axes, bounds_n: Sequence[float]) -> None:
    """Draw the class bounds and name the classes at the right edge."""
    low_mn, high_mn = (from_si(bound, "mn") for bound in bounds_n)
    for bound_mn in (low_mn, high_mn):
        axes.axhline(
            bound_mn, color=figure_files.GREY, linewidth=0.8, linestyle=DASHED, zorder=1
        )

    for number, place in enumerate(
        (0.5 * low_mn, 0.5 * (low_mn + high_mn), high_mn + 0.25 * (high_mn - low_mn))
    ):
        axes.annotate(
            f"class {number}",
            (1.0, place),
            (4, 0),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            va="center",
            color=figure_files.CLASS_INKS[number],
            annotation_clip=False,
        )


EYES_IN_A_ROW = 3


@figure_files.styled
def draw_modulus_over_frames(
    eye: EyeCalibration, truth_pa: float | None = None
) -> Figure:
    """Draw mean and band (one and two standard deviations) of E over the frames (Fig.
    5), and a virtual eye's E.
    """
    figure = Figure(figsize=figure_files.inches(WIDTH_MM, 62))
    axes = figure.subplots()
    _draw_over_frames(axes, eye, truth_pa)
    figure.legend(loc="outside right upper")
    return figure


@figure_files.styled
def draw_observed_points(
    eye: EyeCalibration, frame: Pixels, index: int, width_m: float, depth_m: float
) -> Figure:
    """Draw the points of one of an eye's steps over its raw frame, at the prior's and
    at the final modulus (Fig. 4).
    """
    figure = Figure(figsize=figure_files.inches(170, 52))
    if eye.filter is None or not eye.steps:
        raise ValueError(f"{eye.id}: no points are kept; calibrate it in this run")

    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    moduli = {"first": eye.filter.study.prior_mean_pa, "final": eye.mean_pa}
    extent = (
        from_si(-width_m / 2, "mm"),
        from_si(width_m / 2, "mm"),
        from_si(depth_m, "mm"),
        0.0,
    )

    for axes, (title, modulus_pa) in zip(panels, moduli.items(), strict=True):
        axes.imshow(frame, cmap=figure_files.SCAN_COLOURS, aspect="auto", extent=extent)
        _draw_points(axes, eye.filter, eye.steps[index], modulus_pa)
        axes.set_title(f"{title}: E = {from_si(modulus_pa, 'mpa'):.2f} MPa")
        axes.set(xlabel="lateral [mm]", xlim=extent[:2], ylim=extent[2:])

    panels[0].set_ylabel("depth [mm]")
    panels[0].legend(loc="upper right", labelcolor=figure_files.LIGHT)
    return figure


@figure_files.styled
def draw_calibration(calibration: Calibration) -> Figure:
    """Draw every eye: E over its frames above, what each frame alone says over its
    force below.
    """
    eyes = list(calibration.eyes.values())
    columns = min(len(eyes), EYES_IN_A_ROW)
    rows = -(-len(eyes) // columns)
    figure = Figure(figsize=figure_files.inches(max(85 * columns, 110), 100 * rows))
    grid = figure.add_gridspec(2 * rows, columns)

    for place, eye in enumerate(eyes):
        row, column = divmod(place, columns)
        above, below = (
            figure.add_subplot(grid[2 * row + line, column]) for line in (0, 1)
        )
        _draw_over_frames(above, eye, None)
        modulus = (
            f"{eye.id}: {from_si(eye.mean_pa, 'mpa'):.3f} MPa, sd"
            f" {from_si(eye.sd_pa, 'mpa'):.4f} MPa"
        )
        found = (remark.words for remark in found_remarks(eye))
        above.set_title("\n".join((modulus, *found)))
        _draw_by_force(below, eye)

    drawn = {
        label: each
        for axes in figure.axes
        for each, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(drawn.values(), drawn.keys(), loc="outside lower left", ncols=2)

    return figure


def _draw_over_frames(axes: Axes, eye: EyeCalibration, truth_pa: float | None) -> None:
    """Draw E over the frames; the axis shows the frames' bands, and the prior's, at no
    frames, reaches beyond it.
    """
    moments = [(frame.mean_pa, frame.sd_pa) for frame in eye.used]
    if eye.prior is not None:
        moments.insert(0, (eye.prior.mean_pa, eye.prior.sd_pa))

    mean, sd = from_si(np.array(moments).T, "mpa")
    first = 1 if eye.prior is None else 0
    count = np.arange(first, first + len(mean))
    axes.fill_between(
        count,
        mean - 2 * sd,
        mean + 2 * sd,
        color=figure_files.BLUE,
        alpha=0.15,
        linewidth=0,
    )
    axes.fill_between(
        count,
        mean - sd,
        mean + sd,
        color=figure_files.BLUE,
        alpha=0.3,
        linewidth=0,
        label="one and two sd",
    )
    axes.plot(count, mean, "o-", color=figure_files.BLUE, markersize=2.5, label="mean")

    if truth_pa is not None:
        axes.axhline(
            from_si(truth_pa, "mpa"),
            color=figure_files.RED,
            linestyle="--",
            linewidth=0.8,
            label="true",
        )

    ends = np.concatenate([mean - 3 * sd, mean + 3 * sd]).reshape(2, -1)[:, 1 - first :]
    axes.set(xlabel="frames", ylabel="E [MPa]", ylim=(ends.min(), ends.max()))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _draw_by_force(axes: Axes, eye: EyeCalibration) -> None:
    alone = [frame for frame in eye.used if frame.own_modulus_pa is not None]
    moduli = [from_si(frame.own_modulus_pa or 0.0, "mpa") for frame in alone]

    if alone:
        forces_mn = [from_si(frame.force_n, "mn") for frame in alone]
        axes.plot(
            forces_mn,
            moduli,
            "o",
            color=figure_files.AMBER,
            markersize=3.5,
            label="a frame alone",
        )

    axes.axhline(
        from_si(eye.mean_pa, "mpa"),
        color=figure_files.RED,
        linewidth=0.8,
        label="mean after all frames",
    )
    axes.set(xlabel="force [mN]", ylabel="E [MPa]")
    axes.set_xlim(left=0.0)
    axes.set_ylim(0.0, max(1.15 * max(moduli, default=1.0), axes.get_ylim()[1]))


def _draw_points(
    axes: Axes, eye: EyeFilter, step: FrameStep, modulus_pa: float
) -> None:
    depth_m = predicted_points(eye, step, modulus_pa)
    model = eye.model
    polar_rad = float(step.registered.nuisance[BY_POLAR])
    curves = model.curves(
        [stated_wall(model.setup, modulus_pa, step.force_n, polar_rad)]
    )[0]

    for curve in place_section(curves, step.registered.nuisance):
        axes.plot(
            *from_si(curve, "mm").T,
            color=figure_files.RED,
            linewidth=0.5,
            scalex=False,
            scaley=False,
        )

    lateral_mm, observed_mm = (
        from_si(m, "mm") for m in (step.observation.lateral_m, step.observation.depth_m)
    )
    axes.plot(
        lateral_mm, observed_mm, "o", color="#F0E442", markersize=4.5, label="observed"
    )
    axes.plot(
        lateral_mm,
        from_si(depth_m, "mm"),
        "o",
        color=figure_files.RED,
        markersize=2.5,
        label="predicted",
    )
