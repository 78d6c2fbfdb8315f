"""Figures of a recording: its first frames to scale, frames of different force, and its force log."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from scleraforce.recording.folder import Recording
from scleraforce.recording.labels import Trial, contact_force
from scleraforce.report import files as style
from scleraforce.units import from_si

POINTS_DRAWN = 6000
DASHED = (0, (4, 3))
SHOWN_FRAMES = 3
WIDTH_MM, FORCE_MM, WORDS_MM, TALLEST_MM = 170.0, 46.0, 12.0, 110.0
BARS_MM = (5.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02)
BAR_SHARE = 0.4  # of the frame's extent, at most
OUTLIERS = 0.1  # per cent of the pixels that may be off the grey scale
OF_DIFFERENT_FORCE = 3


@style.styled
def draw_preview(recording: Recording) -> Figure:
    """Draw a recording's first frames side by side, to scale, and the contact force with the times of all frames."""
    entries = recording.frames[:SHOWN_FRAMES]
    frames = [recording.frame(entry) for entry in entries]
    extent_m = recording.info.oct.width_m, recording.info.oct.depth_m
    width_mm, depth_mm = (float(from_si(length, "mm")) for length in extent_m)
    frame_mm = min(TALLEST_MM, (WIDTH_MM - 12.0) / len(frames) * depth_mm / width_mm)
    heights = [frame_mm + WORDS_MM, *([] if recording.forces is None else [FORCE_MM])]
    figure = Figure(figsize=style.inches(WIDTH_MM, sum(heights)))
    grid = figure.add_gridspec(len(heights), len(frames), height_ratios=heights)
    low, high = np.percentile(np.stack(frames), [OUTLIERS, 100.0 - OUTLIERS])
    for nth, (entry, frame) in enumerate(zip(entries, frames, strict=True)):
        axes = figure.add_subplot(grid[0, nth])
        style.show_image(axes, frame, extent_m, vmin=low, vmax=max(high, low + 1))
        axes.set_title(f"{entry.file}, {entry.time_s:.3f} s")
        axes.set_axis_off()
        _scale_bars(axes, width_mm, depth_mm)
    if recording.forces is not None:
        draw_log(figure.add_subplot(grid[1, :]), recording)
    return figure


def _scale_bars(axes: Axes, width_mm: float, depth_mm: float) -> None:
    across, down = (
        next((bar for bar in BARS_MM if bar <= BAR_SHARE * size), size / 2) for size in (width_mm, depth_mm)
    )
    left, bottom = 0.04 * width_mm, 0.94 * depth_mm
    line: dict[str, Any] = {"color": style.AMBER, "linewidth": 1.6, "solid_capstyle": "butt"}
    axes.plot([left, left + across], [bottom, bottom], **line)
    axes.plot([left, left], [bottom, bottom - down], **line)
    edge = [withStroke(linewidth=2.0, foreground=style.BLACK)]  # letters are readable on bright tissue, too
    words: dict[str, Any] = {"color": style.AMBER, "fontsize": 7.0, "path_effects": edge}
    axes.text(left + across + 0.015 * width_mm, bottom, f"{across:g} mm", va="center", **words)
    axes.text(left, bottom - down - 0.02 * depth_mm, f"{down:g} mm deep", va="bottom", **words)


@style.styled
def draw_recording(recording: Recording, trials: Sequence[Trial], bounds_n: Sequence[float]) -> Figure:
    """Draw the force log with the frames' labels and, above it, the frames of least, middle and largest force."""
    figure = Figure(figsize=style.inches(170, 80))
    grid = figure.add_gridspec(2, 1, height_ratios=(0.7, 1.0))
    pictures, curve = figure.add_subfigure(grid[0]), figure.add_subfigure(grid[1])
    order = sorted(range(len(trials)), key=lambda n: trials[n].measured_force_n or 0.0)
    places = np.linspace(0, len(order) - 1, min(OF_DIFFERENT_FORCE, len(order))).round().astype(int)
    extent_m = recording.info.oct.width_m, recording.info.oct.depth_m
    for axes, place in zip(pictures.subplots(1, len(places), squeeze=False)[0], places, strict=True):
        trial = trials[order[place]]
        style.show_image(axes, recording.frame(recording.frames[order[place]]), extent_m)
        force_n = trial.measured_force_n
        axes.set_title(trial.file if force_n is None else f"{trial.file}: {from_si(force_n, 'mn'):.1f} mN")
        axes.set_xlabel("mm")
    axes = curve.subplots()
    if recording.forces is None or recording.info.force is None:
        axes.plot([trial.time_s for trial in trials], [0.0] * len(trials), "|", color=style.BLACK)
        axes.set_yticks([])
        axes.set(title="frames; their forces were not logged", xlabel="time [s]")
    else:
        draw_log(axes, recording, trials)
        mark_bounds(axes, bounds_n)
    return figure


@style.styled
def draw_force_log(recording: Recording, trials: Sequence[Trial], bounds_n: Sequence[float], until_s: float) -> Figure:
    """Draw the beginning of a force log with the labels of its frames and the class bounds."""
    figure = Figure(figsize=style.inches(170, 62))
    axes = figure.subplots()
    draw_log(axes, recording, trials)
    mark_bounds(axes, bounds_n)
    axes.set_xlim(right=until_s)
    return figure


def draw_log(axes: Axes, recording: Recording, trials: Sequence[Trial] = ()) -> None:
    """Draw a force log, as logged (shifted to the filtered zero) and filtered, with the frames' times and labels."""
    log, info = recording.forces, recording.info.force
    assert log is not None
    assert info is not None
    filtered_mn, raw_mn = (
        from_si(contact_force(log, info), "mn"),
        from_si(info.contact_sign * log.force_n(info.axis), "mn"),
    )
    raw_mn = raw_mn - np.nanmean(raw_mn - filtered_mn)
    every = slice(None, None, max(1, len(log.time_s) // POINTS_DRAWN))
    axes.plot(log.time_s[every], raw_mn[every], color="#C9CED3", linewidth=0.5, label="as logged")
    axes.plot(log.time_s[every], filtered_mn[every], color=style.BLUE, label="filtered")
    missing_s = log.time_s[np.isnan(raw_mn)]
    if len(missing_s):
        missing_s = missing_s[:: max(1, len(missing_s) // POINTS_DRAWN)]
        axes.plot(missing_s, np.zeros_like(missing_s), "|", color=style.RED, label="no force")
    times_s = [frame.time_s for frame in recording.frames]
    axes.vlines(times_s, 0, 1, transform=axes.get_xaxis_transform(), color=style.BLACK, linewidth=0.5, label="frames")
    for target, (colour, marker) in enumerate(zip(style.CLASS_COLOURS, style.CLASS_MARKERS, strict=True)):
        labels = [(t.time_s, from_si(t.measured_force_n, "mn")) for t in trials if t.target == target]
        if labels:
            label = f"label: class {target}"
            axes.plot(*zip(*labels, strict=True), marker, color=colour, markersize=4, label=label, zorder=5)
    axes.set_xlim(min(times_s[0], float(log.time_s[0])), max(times_s[-1], float(log.time_s[-1])))
    axes.set(xlabel="time [s]", ylabel="contact force [mN]")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=7)


def mark_bounds(axes: Axes, bounds_n: Sequence[float]) -> None:
    """Draw the class bounds and name the classes at the right edge."""
    low_mn, high_mn = (from_si(bound, "mn") for bound in bounds_n)
    for bound_mn in (low_mn, high_mn):
        axes.axhline(bound_mn, color=style.GREY, linewidth=0.8, linestyle=DASHED, zorder=1)
    for number, place in enumerate((0.5 * low_mn, 0.5 * (low_mn + high_mn), high_mn + 0.25 * (high_mn - low_mn))):
        axes.annotate(
            f"class {number}", (1.0, place), (4, 0), xycoords=("axes fraction", "data"),
            textcoords="offset points", va="center", color=style.CLASS_INKS[number], annotation_clip=False,
        )  # fmt: skip
