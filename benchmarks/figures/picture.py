"""Force against force: what is read of every frame, beside the force that was put in; a
panel for each group.
"""

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from figures.scores import AnsweredFrame
from scleraforce.front.report.figure_files import BLACK, BLUE, GREY, RED, inches, styled

LARGEST_MN = 70.0
# panels in a row
PANEL_MM = 58
ACROSS = 4


@styled
def draw_forces(
    answers: Mapping[str, Sequence[AnsweredFrame]], bounds_mn: Sequence[float]
) -> Figure:
    """Draw one panel for each group of eyes.

    Args:
        answers: frames as one way of reading answers them, by group.
        bounds_mn: the class bounds.
    """
    across = min(len(answers), ACROSS)
    down = -(-len(answers) // across)
    figure = Figure(figsize=inches(PANEL_MM * across + 8, PANEL_MM * down + 12))
    panels = figure.subplots(
        down, across, squeeze=False, sharex=True, sharey=True
    ).ravel()

    for axes, (group, frames) in zip(panels, answers.items(), strict=False):
        _draw(axes, frames, bounds_mn)
        axes.set_title(group)

    for axes in panels[len(answers) :]:
        axes.set_visible(False)

    for axes in panels[max(len(answers) - across, 0) : len(answers)]:
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("true force [mN]")

    for axes in panels[::across]:
        axes.set_ylabel("force read, 90 % interval [mN]")

    figure.legend(handles=_legend(), loc="outside lower center", ncols=3)
    return figure


def _draw(
    axes: Axes, frames: Sequence[AnsweredFrame], bounds_mn: Sequence[float]
) -> None:
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
        axes.plot(
            [frame.true_mn] * 2, [low, high], color=colour, linewidth=0.6, alpha=0.6
        )
        axes.plot(frame.true_mn, frame.read_mn, "o", color=colour, markersize=1.5)

    axes.set_xlim(0.0, 62.0)
    axes.set_ylim(-4.0, LARGEST_MN)


def _legend() -> list[Line2D]:
    words = (
        (BLUE, "class right"),
        (RED, "class wrong"),
        (GREY, "not usable (bars below: no force read)"),
    )
    return [
        Line2D([], [], linestyle="", marker="o", color=colour, markersize=3, label=text)
        for colour, text in words
    ]
