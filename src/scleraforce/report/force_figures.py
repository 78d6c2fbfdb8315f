"""Forces: a log with its imaging times (the paper's Fig. 3), and the trials against the class bounds (Fig. 10)."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from scleraforce.reader.evaluate import FrameAnswer
from scleraforce.report.style import BLACK, BLUE, CLASS_COLOURS, CLASS_INKS, CLASS_MARKERS, GREY, RED, inches, styled
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
    fill = CLASS_COLOURS[frame.predicted] if frame.usable else "white"
    marker, colour = CLASS_MARKERS[frame.predicted], CLASS_COLOURS[frame.predicted]
    axes.plot(x, force_mn, marker, color=fill, markeredgecolor=colour, markersize=4.5, zorder=4)
    if frame.predicted != frame.target:
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
