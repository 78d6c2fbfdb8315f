"""The static solves: error over time."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from scleraforce.report.style import AMBER, BLUE, GREY, RED, inches, styled
from speed.record import QUOTED, Row

__all__ = ["draw_solves"]

COLOURS = {"ours": BLUE, "CalculiX": AMBER, "plain": RED, "SOFA": GREY}
PLACES = {
    "ours": ("right", (-5, -3)),
    "CalculiX": ("left", (5, -3)),
    "plain": ("center", (0, 6)),
    "SOFA": ("center", (0, 6)),
}
LEAST_PERCENT = 0.05  # smaller errors are drawn here


@styled
def draw_solves(rows: Sequence[Row]) -> Figure:
    """Draw the error of each solve over its time; those that are not of this run are open."""
    figure = Figure(figsize=inches(150, 90))
    axes = figure.add_subplot()
    for row in rows:
        error = row.more.get("error, %")
        if row.value is None or error is None:
            continue
        program = row.what.replace(",", " ").split()[0]
        colour, (side, offset) = COLOURS[program], PLACES[program]
        height = max(abs(error), LEAST_PERCENT)
        axes.plot(row.value, height, "o", color=colour, fillstyle="none" if row.source else "full")
        name = f"{row.what}\n({QUOTED})" if row.source else row.what
        axes.annotate(name, (row.value, height), xytext=offset, textcoords="offset points", color=colour, ha=side)
    axes.set(xscale="log", yscale="log", xlabel="time of a first static solve, s", ylabel="error of the tip, %")
    axes.margins(x=0.3, y=0.15)
    return figure
