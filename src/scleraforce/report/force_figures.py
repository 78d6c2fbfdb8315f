"""Figures of readings: forces, one reading, the result in one picture, the curves of a training."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.lines import Line2D
from matplotlib.ticker import FormatStrFormatter, LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from scleraforce.reader.evaluate import FrameAnswer
from scleraforce.report.files import (
    BLACK,
    BLUE,
    CLASS_COLOURS,
    CLASS_INKS,
    CLASS_MARKERS,
    GREY,
    RED,
    SCAN_COLOURS,
    inches,
    styled,
)
from scleraforce.report.frames import AnsweredFrame
from scleraforce.units import from_si

POINTS_DRAWN = 6000
MOST_NAMES, NAME_LENGTH = 60, 14  # of trials whose frames are named, and characters of a name


@styled
def draw_force_log(
    time_s: NDArray[np.float64],
    raw_n: NDArray[np.float64],
    filtered_n: NDArray[np.float64],
    imaging_s: Sequence[float],
    labels_n: Sequence[float | None],
    bounds_n: Sequence[float],
) -> Figure:
    """Draw a force log: raw and filtered force over time, the imaging times and the label of each frame.

    Args:
        time_s: times of the samples, shape (sample,).
        raw_n: tared contact force as logged, shape (sample,).
        filtered_n: the same, filtered, shape (sample,).
        imaging_s: times of the frames.
        labels_n: label of each frame (None where there is none).
        bounds_n: the class bounds.
    """
    figure = Figure(figsize=inches(170, 62))
    axes = figure.subplots()
    every = max(1, len(time_s) // POINTS_DRAWN)
    axes.plot(time_s[::every], from_si(raw_n[::every], "mn"), color="#C9CED3", linewidth=0.5, label="as logged")
    axes.plot(time_s[::every], from_si(filtered_n[::every], "mn"), color=BLUE, label="filtered")
    axes.vlines(
        imaging_s, 0, 1, transform=axes.get_xaxis_transform(), color=BLACK, linewidth=0.6, label="imaging times"
    )
    known = [(t, from_si(f, "mn")) for t, f in zip(imaging_s, labels_n, strict=True) if f is not None]
    if known:
        axes.plot(*zip(*known, strict=True), "D", color=RED, markersize=3.5, label="label (mean over 2 s)", zorder=5)
    _mark_bounds(axes, bounds_n)
    axes.set_xlim(float(time_s[0]), float(time_s[-1]))
    axes.set_xlabel("time [s]")
    axes.set_ylabel("contact force [mN]")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4)
    return figure


@styled
def draw_trial_forces(frames: Sequence[FrameAnswer], bounds_n: Sequence[float], max_force_n: float) -> Figure:
    """Draw the measured force of every trial with the class bounds; misread trials are ringed.

    Up to 60 trials carry the names of their frames, more of them only numbers.

    Args:
        frames: the trials that count, in the order of their recordings.
        bounds_n: the class bounds.
        max_force_n: the study's largest force.
    """
    figure = Figure(figsize=inches(170, 84))
    axes = draw_trials(figure, frames, bounds_n, max_force_n)
    if len(frames) <= MOST_NAMES:
        _name_trials(axes, frames)
    return figure


def draw_trials(
    figure: FigureBase, frames: Sequence[FrameAnswer], bounds_n: Sequence[float], max_force_n: float
) -> Axes:
    """Draw the trials on a figure, or on a part of one; return the axes."""
    axes = figure.subplots()
    known = [(x, frame) for x, frame in enumerate(frames, start=1) if frame.measured_force_n is not None]
    for x, frame in known:
        _draw_trial(axes, x, frame)
    _mark_bounds(axes, bounds_n)
    _separate_eyes(axes, frames)
    top = max([from_si(max_force_n, "mn"), *(from_si(frame.measured_force_n or 0.0, "mn") for _, frame in known)])
    axes.set_ylim(-0.04 * top, 1.12 * top)
    axes.set_xlim(0.0, len(frames) + 1.0)
    axes.set_xlabel("trial")
    axes.set_ylabel("measured force [mN]")
    figure.legend(handles=_trial_legend(), loc="outside upper center", ncols=5)
    return axes


def _name_trials(axes: Axes, frames: Sequence[FrameAnswer]) -> None:
    """Put the name of its frame below each trial; of a long name, its end."""
    names = [frame.file if len(frame.file) <= NAME_LENGTH else f"…{frame.file[-NAME_LENGTH:]}" for frame in frames]
    axes.set_xticks(range(1, len(frames) + 1), names, rotation=90, fontsize=5.5)
    axes.set_xlabel("frame")


def _draw_trial(axes: Axes, x: int, frame: FrameAnswer) -> None:
    force_mn = from_si(frame.measured_force_n or 0.0, "mn")
    fill = CLASS_COLOURS[frame.answer.predicted] if frame.answer.usable else "white"
    marker, colour = CLASS_MARKERS[frame.answer.predicted], CLASS_COLOURS[frame.answer.predicted]
    axes.plot(x, force_mn, marker, color=fill, markeredgecolor=colour, markersize=4.5, zorder=4)
    if frame.answer.predicted != frame.target:
        axes.plot(x, force_mn, "o", color="none", markeredgecolor=BLACK, markersize=10, zorder=5, label="misread")


def _mark_bounds(axes: Axes, bounds_n: Sequence[float]) -> None:
    """Draw the class bounds and name the classes at the right edge."""
    for bound in bounds_n:
        axes.axhline(from_si(bound, "mn"), color=GREY, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
    places = [0.5 * bounds_n[0], 0.5 * (bounds_n[0] + bounds_n[1]), bounds_n[1] + 0.25 * (bounds_n[1] - bounds_n[0])]
    for number, place in enumerate(places):
        axes.annotate(
            f"class {number}", (1.0, from_si(place, "mn")), (4, 0), xycoords=("axes fraction", "data"),
            textcoords="offset points", va="center", color=CLASS_INKS[number], annotation_clip=False,
        )  # fmt: skip


def _separate_eyes(axes: Axes, frames: Sequence[FrameAnswer]) -> None:
    """Name the eyes along the top and draw lines between them."""
    names = [frame.eye for frame in frames]
    starts = [n for n in range(len(names)) if n == 0 or names[n] != names[n - 1]]
    for start, end in zip(starts, [*starts[1:], len(names)], strict=True):
        if start:
            axes.axvline(start + 0.5, color="#D9DEE3", linewidth=0.8, zorder=0)
        axes.text(
            0.5 * (start + end) + 0.5, 0.985, names[start], transform=axes.get_xaxis_transform(), ha="center", va="top"
        )


def _trial_legend() -> list[Line2D]:
    read = [
        Line2D([], [], linestyle="", marker=marker, color=colour, markersize=4.5, label=f"read as class {number}")
        for number, (marker, colour) in enumerate(zip(CLASS_MARKERS, CLASS_COLOURS, strict=True))
    ]
    wrong = Line2D([], [], linestyle="", marker="o", color="none", markeredgecolor=BLACK, markersize=9, label="misread")
    unusable = Line2D(
        [], [], linestyle="", marker="^", color="white", markeredgecolor=RED, markersize=4.5, label="not usable"
    )
    return [*read, wrong, unusable]


@styled
def draw_read_forces(frames: Sequence[FrameAnswer], bounds_n: Sequence[float], max_force_n: float) -> Figure:
    """Draw the read force of every usable frame with its interval over the measured one.

    Misread frames are ringed and named.

    Args:
        frames: trials; those without a measured or a read force are left out, unusable ones stand at the upper edge.
        bounds_n: the class bounds.
        max_force_n: the study's largest force.
    """
    figure = Figure(figsize=inches(170, 105))
    axes = figure.subplots()
    draw_force_against_force(axes, frames, bounds_n, max_force_n)
    figure.legend(handles=_legend(len(bounds_n) + 1), loc="outside right upper")
    return figure


def draw_force_against_force(
    axes: Axes, frames: Sequence[FrameAnswer], bounds_n: Sequence[float], max_force_n: float
) -> None:
    """Draw the same on axes that are there."""
    top = from_si(max_force_n, "mn")
    axes.plot([0.0, top], [0.0, top], color=GREY, linewidth=0.8, zorder=1, label="equal")
    for bound in bounds_n:
        for draw in (axes.axhline, axes.axvline):
            draw(from_si(bound, "mn"), color=GREY, linewidth=0.6, linestyle=(0, (4, 3)), zorder=1)
    for frame in frames:
        if frame.measured_force_n is not None:
            _draw_frame(axes, frame, from_si(frame.measured_force_n, "mn"), 1.08 * top)
    axes.set_xlim(-0.05 * top, 1.08 * top)
    axes.set_ylim(-0.05 * top, 1.08 * top)
    axes.set_aspect("equal")
    axes.set_xlabel("measured force [mN]")
    axes.set_ylabel("read force [mN]")


def _draw_frame(axes: Axes, frame: FrameAnswer, measured_mn: float, top_mn: float) -> None:
    if frame.answer.force_n is None or frame.answer.interval_n is None:
        axes.plot(measured_mn, 0.98 * top_mn, "x", color=RED, markersize=4, zorder=4, label="not usable")
        return
    read_mn = from_si(frame.answer.force_n, "mn")
    low_mn, high_mn = (from_si(end, "mn") for end in frame.answer.interval_n)
    colour, marker = CLASS_COLOURS[frame.answer.predicted], CLASS_MARKERS[frame.answer.predicted]
    axes.vlines(measured_mn, low_mn, high_mn, color=colour, linewidth=0.8, zorder=3)
    axes.plot(measured_mn, read_mn, marker, color=colour, markersize=3.5, zorder=4, label="read")
    if frame.misread:
        axes.plot(
            measured_mn, read_mn, "o", color="none", markeredgecolor=BLACK, markersize=9, zorder=5, label="misread"
        )
        axes.annotate(frame.file, (measured_mn, read_mn), (6, -6), textcoords="offset points", fontsize=6, va="top")


def _legend(classes: int) -> list[Line2D]:
    shown = zip(range(classes), CLASS_MARKERS, CLASS_COLOURS, strict=True)
    read = [
        Line2D([], [], linestyle="", color=colour, marker=marker, markersize=4, label=f"read as class {number}")
        for number, marker, colour in shown
    ]
    wrong = Line2D([], [], linestyle="", marker="o", color="none", markeredgecolor=BLACK, markersize=8, label="misread")
    unusable = Line2D([], [], linestyle="", marker="x", color=RED, markersize=4, label="not usable (at the top)")
    interval = Line2D([], [], linestyle="", color=BLACK, marker="|", markersize=8, label="90 % interval")
    return [*read, interval, wrong, unusable]


@styled
def draw_overview(
    read: Sequence[AnsweredFrame], trials: Sequence[FrameAnswer], bounds_n: Sequence[float], max_force_n: float
) -> Figure:
    """Draw frames with the wall that was found and the class that was read, above the forces of all trials.

    Args:
        read: a frame of each class.
        trials: all trials that count.
        bounds_n: the class bounds.
        max_force_n: the study's largest force.
    """
    figure = Figure(figsize=inches(170, 92))
    top, bottom = figure.subfigures(2, 1, squeeze=False, height_ratios=[1.0, 2.1])[:, 0]
    for axes, one in zip(top.subplots(1, len(read), squeeze=False)[0], read, strict=True):
        _draw_read_frame(axes, one)
    draw_trials(bottom, trials, bounds_n, max_force_n)
    return figure


def _draw_read_frame(axes: Axes, one: AnsweredFrame) -> None:
    width_mm, depth_mm = from_si(one.extent_m[0], "mm"), from_si(one.extent_m[1], "mm")
    rows, columns = one.frame.shape
    axes.imshow(one.frame, cmap=SCAN_COLOURS, extent=(0.0, width_mm, depth_mm, 0.0))
    lateral_mm = (np.arange(columns) + 0.5) * width_mm / columns
    for boundary in (one.found.outer_row, one.found.inner_row):
        axes.plot(lateral_mm, (boundary + 0.5) * depth_mm / rows, color="#56B4E9", linewidth=0.9)
    axes.set_xlim(0.0, width_mm)
    axes.set_ylim(depth_mm, 0.0)
    axes.set_axis_off()
    answer, measured_n = one.answer.answer, one.answer.measured_force_n
    sure = "" if answer.probabilities is None else f" (p = {answer.probabilities[answer.predicted]:.2f})"
    axes.set_title(f"read: class {answer.predicted}{sure}", color=CLASS_INKS[answer.predicted], fontweight="bold")
    measured = "" if measured_n is None else f"measured: {from_si(measured_n, 'mn'):.1f} mN"
    axes.text(0.5, -0.04, measured, transform=axes.transAxes, ha="center", va="top")


@styled
def draw_training_curves(
    training_loss: Sequence[float],
    validation_loss: Sequence[float],
    training_accuracy: Sequence[float],
    validation_accuracy: Sequence[float],
) -> Figure:
    """Draw loss (logarithmic) and accuracy over the epochs; each sequence has one value an epoch.

    The training figures are those under dropout, which is why validation lies above training.
    """
    figure = Figure(figsize=inches(170, 60))
    left, right = figure.subplots(1, 2)
    epochs = range(1, len(training_loss) + 1)
    for axes, training, validation, name in (
        (left, training_loss, validation_loss, "cross-entropy"),
        (right, training_accuracy, validation_accuracy, "accuracy"),
    ):
        axes.plot(epochs, training, color=RED, linestyle=(0, (4, 2)), marker="s", markersize=2.5, label="training")
        axes.plot(epochs, validation, color=BLUE, marker="o", markersize=2.5, label="validation")
        axes.set_xlabel("epoch")
        axes.set_ylabel(name)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    left.set_yscale("log")
    left.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    left.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    left.yaxis.set_minor_formatter(NullFormatter())
    right.legend(loc="lower right")
    return figure
