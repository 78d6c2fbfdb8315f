"""Force against force: what was read, with its 90 % interval, over what was measured."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from scleraforce.reader.evaluate import FrameAnswer
from scleraforce.report.style import BLACK, CLASS_COLOURS, CLASS_MARKERS, GREY, RED, inches, styled
from scleraforce.units import from_si


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
    if frame.predicted_force_n is None or frame.interval_n is None:
        axes.plot(measured_mn, 0.98 * top_mn, "x", color=RED, markersize=4, zorder=4, label="not usable")
        return
    read_mn = from_si(frame.predicted_force_n, "mn")
    low_mn, high_mn = (from_si(end, "mn") for end in frame.interval_n)
    colour, marker = CLASS_COLOURS[frame.predicted], CLASS_MARKERS[frame.predicted]
    axes.vlines(measured_mn, low_mn, high_mn, color=colour, linewidth=0.8, zorder=3)
    axes.plot(measured_mn, read_mn, marker, color=colour, markersize=3.5, zorder=4, label="read")
    if frame.target is not None and frame.predicted != frame.target:
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
