"""Figures of an evaluation: its measured forces, read over measured forces, and the result in one picture."""

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.lines import Line2D

from scleraforce.reader.evaluate import Evaluation, FrameAnswer
from scleraforce.report.files import (
    BLACK,
    CLASS_COLOURS,
    CLASS_INKS,
    CLASS_MARKERS,
    GREY,
    RED,
    inches,
    styled,
)
from scleraforce.report.frame_figures import draw_wall
from scleraforce.report.frames import AnsweredFrame
from scleraforce.report.recording_figures import DASHED, mark_bounds
from scleraforce.units import from_si

MOST_NAMES, NAME_LENGTH = 60, 14  # trials that carry their frame's name, and characters of a name
RING: dict[str, Any] = {"marker": "o", "linestyle": "", "color": "none", "markeredgecolor": BLACK, "label": "misread"}


@styled
def draw_trial_forces(evaluation: Evaluation) -> Figure:
    """Draw the measured force of every trial that counts with the class bounds; misread trials are ringed.

    Up to 60 trials carry the names of their frames, of long names their ends; more trials carry numbers.
    """
    figure, frames = Figure(figsize=inches(170, 84)), evaluation.scored
    axes = _draw_trials(figure, evaluation)
    if len(frames) <= MOST_NAMES:
        names = [frame.file if len(frame.file) <= NAME_LENGTH else f"…{frame.file[-NAME_LENGTH:]}" for frame in frames]
        axes.set_xticks(range(1, len(frames) + 1), names, rotation=90, fontsize=5.5)
        axes.set_xlabel("frame")
    return figure


def _draw_trials(figure: FigureBase, evaluation: Evaluation) -> Axes:
    axes, frames = figure.subplots(), evaluation.scored
    top_mn = from_si(evaluation.max_force_n, "mn")
    for x, frame in enumerate(frames, start=1):
        if frame.measured_force_n is not None:
            force_mn = from_si(frame.measured_force_n, "mn")
            top_mn = max(top_mn, force_mn)
            marker, colour = CLASS_MARKERS[frame.answer.predicted], CLASS_COLOURS[frame.answer.predicted]
            fill = colour if frame.answer.usable else "white"
            axes.plot(x, force_mn, marker, color=fill, markeredgecolor=colour, markersize=4.5, zorder=4)
            if frame.misread:
                axes.plot(x, force_mn, markersize=10, zorder=5, **RING)
    mark_bounds(axes, evaluation.bounds_n)
    _separate_eyes(axes, frames)
    axes.set(xlabel="trial", ylabel="measured force [mN]", xlim=(0.0, len(frames) + 1.0))
    axes.set_ylim(-0.04 * top_mn, 1.12 * top_mn)
    unusable = Line2D([], [], linestyle="", marker="^", color="white", markeredgecolor=RED, label="not usable")
    figure.legend(handles=_legend(unusable), loc="outside upper center", ncols=5)
    return axes


def _separate_eyes(axes: Axes, frames: Sequence[FrameAnswer]) -> None:
    """Name the eyes along the top and draw lines between them."""
    names = [frame.eye for frame in frames]
    starts = [n for n in range(len(names)) if n == 0 or names[n] != names[n - 1]]
    for start, end in zip(starts, [*starts[1:], len(names)], strict=True):
        if start:
            axes.axvline(start + 0.5, color="#D9DEE3", linewidth=0.8, zorder=0)
        middle = 0.5 * (start + end) + 0.5
        axes.text(middle, 0.985, names[start], transform=axes.get_xaxis_transform(), ha="center", va="top")


def _legend(*more: Line2D) -> list[Line2D]:
    read = [
        Line2D([], [], linestyle="", marker=marker, color=colour, markersize=4.5, label=f"read as class {number}")
        for number, (marker, colour) in enumerate(zip(CLASS_MARKERS, CLASS_COLOURS, strict=True))
    ]
    return [*read, Line2D([], [], markersize=9, **RING), *more]


@styled
def draw_read_forces(evaluation: Evaluation) -> Figure:
    """Draw the read force of every trial that counts with its interval over the measured one.

    Misread frames are ringed and named; unusable ones are at the upper edge.
    """
    figure = Figure(figsize=inches(170, 105))
    axes = figure.subplots()
    top = from_si(evaluation.max_force_n, "mn")
    axes.plot([0.0, top], [0.0, top], color=GREY, linewidth=0.8, zorder=1, label="equal")
    for bound in evaluation.bounds_n:
        for draw in (axes.axhline, axes.axvline):
            draw(from_si(bound, "mn"), color=GREY, linewidth=0.6, linestyle=DASHED, zorder=1)
    for frame in evaluation.scored:
        if frame.measured_force_n is not None:
            _draw_read_force(axes, frame, from_si(frame.measured_force_n, "mn"), 1.08 * top)
    axes.set(xlim=(-0.05 * top, 1.08 * top), ylim=(-0.05 * top, 1.08 * top), aspect="equal")
    axes.set(xlabel="measured force [mN]", ylabel="read force [mN]")
    unusable = Line2D([], [], linestyle="", marker="x", color=RED, markersize=4, label="not usable (at the top)")
    interval = Line2D([], [], linestyle="", color=BLACK, marker="|", markersize=8, label="90 % interval")
    figure.legend(handles=_legend(interval, unusable), loc="outside right upper")
    return figure


def _draw_read_force(axes: Axes, frame: FrameAnswer, measured_mn: float, top_mn: float) -> None:
    if frame.answer.force_n is None or frame.answer.interval_n is None:
        axes.plot(measured_mn, 0.98 * top_mn, "x", color=RED, markersize=4, zorder=4, label="not usable")
        return
    read_mn, low_mn, high_mn = (from_si(force, "mn") for force in (frame.answer.force_n, *frame.answer.interval_n))
    colour, marker = CLASS_COLOURS[frame.answer.predicted], CLASS_MARKERS[frame.answer.predicted]
    axes.vlines(measured_mn, low_mn, high_mn, color=colour, linewidth=0.8, zorder=3)
    axes.plot(measured_mn, read_mn, marker, color=colour, markersize=3.5, zorder=4, label="read")
    if frame.misread:
        axes.plot(measured_mn, read_mn, markersize=9, zorder=5, **RING)
        axes.annotate(frame.file, (measured_mn, read_mn), (6, -6), textcoords="offset points", fontsize=6, va="top")


@styled
def draw_overview(read: Sequence[AnsweredFrame], evaluation: Evaluation) -> Figure:
    """Draw frames, one of each class, with their walls and the classes read, above the forces of all trials."""
    figure = Figure(figsize=inches(170, 92))
    top, bottom = figure.subfigures(2, 1, squeeze=False, height_ratios=[1.0, 2.1])[:, 0]
    for axes, one in zip(top.subplots(1, len(read), squeeze=False)[0], read, strict=True):
        draw_wall(axes, one)
        axes.set_axis_off()
        answer = one.answer
        sure = (
            ""
            if answer.answer.probabilities is None
            else f" (p = {answer.answer.probabilities[answer.answer.predicted]:.2f})"
        )
        axes.set_title(
            f"read: class {answer.answer.predicted}{sure}", color=CLASS_INKS[answer.answer.predicted], fontweight="bold"
        )
        if answer.measured_force_n is not None:
            measured = f"measured: {from_si(answer.measured_force_n, 'mn'):.1f} mN"
            axes.text(0.5, -0.04, measured, transform=axes.transAxes, ha="center", va="top")
    _draw_trials(bottom, evaluation)
    return figure
