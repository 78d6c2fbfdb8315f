"""The result in one picture: a raw frame of each class with the wall found in it, and all trials with what was read."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scleraforce.reader.evaluate import FrameAnswer
from scleraforce.report.answered_frame import AnsweredFrame
from scleraforce.report.force_figures import draw_trials
from scleraforce.report.style import CLASS_INKS, SCAN_COLOURS, inches, styled
from scleraforce.units import from_si


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
    answer = one.answer
    sure = "" if answer.probabilities is None else f" (p = {answer.probabilities[answer.predicted]:.2f})"
    axes.set_title(f"read: class {answer.predicted}{sure}", color=CLASS_INKS[answer.predicted], fontweight="bold")
    measured = "" if answer.measured_force_n is None else f"measured: {from_si(answer.measured_force_n, 'mn'):.1f} mN"
    axes.text(0.5, -0.04, measured, transform=axes.transAxes, ha="center", va="top")
