"""Force against force: what each way of reading says of every frame, beside the force that was put in."""

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from figures.scores import AnsweredFrame
from scleraforce.report.style import BLACK, BLUE, GREY, RED, inches, styled

__all__ = ["draw_forces"]

LARGEST_MN = 70.0


@styled
def draw_forces(answers: Mapping[tuple[str, str], Sequence[AnsweredFrame]], bounds_mn: Sequence[float]) -> Figure:
    """Draw one panel for each group of eyes and way of reading that reads forces.

    Args:
        answers: frames by (title of the reading, group).
        bounds_mn: the class bounds.
    """
    titles = list(dict.fromkeys(title for title, _ in answers))
    groups = list(dict.fromkeys(group for _, group in answers))
    figure = Figure(figsize=inches(85 * len(groups), 75 * len(titles) + 8))
    grid = figure.subplots(len(titles), len(groups), squeeze=False, sharex=True, sharey=True)
    for row, title in enumerate(titles):
        for column, group in enumerate(groups):
            axes = grid[row, column]
            _draw(axes, answers[title, group], bounds_mn)
            axes.set_title(f"{title}: {group} eyes")
    for axes in grid[-1]:
        axes.set_xlabel("true force [mN]")
    for axes in grid[:, 0]:
        axes.set_ylabel("force read, with its 90 % interval [mN]")
    figure.legend(handles=_legend(), loc="outside lower center", ncols=3)
    return figure


def _draw(axes: Axes, frames: Sequence[AnsweredFrame], bounds_mn: Sequence[float]) -> None:
    for bound in bounds_mn:
        axes.axhline(bound, color=GREY, linewidth=0.6, linestyle=(0, (4, 3)))
        axes.axvline(bound, color=GREY, linewidth=0.6, linestyle=(0, (4, 3)))
    axes.plot([0, LARGEST_MN], [0, LARGEST_MN], color=BLACK, linewidth=0.6)
    for frame in frames:
        colour = (BLUE if frame.right else RED) if frame.usable else GREY
        if frame.read_mn is None or frame.interval_mn is None:
            axes.plot(frame.true_mn, -2.0, "|", color=GREY, markersize=4)
            continue
        low, high = frame.interval_mn
        axes.plot([frame.true_mn] * 2, [low, high], color=colour, linewidth=0.6, alpha=0.6)
        axes.plot(frame.true_mn, frame.read_mn, "o", color=colour, markersize=2.0)
    axes.set_xlim(0.0, 62.0)
    axes.set_ylim(-4.0, LARGEST_MN)


def _legend() -> list[Line2D]:
    words = ((BLUE, "class right"), (RED, "class wrong"), (GREY, "not usable (bars below: no force read)"))
    return [Line2D([], [], linestyle="", marker="o", color=colour, markersize=3, label=text) for colour, text in words]
