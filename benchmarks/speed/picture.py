"""The static solves: error over time."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from scleraforce.front.report.figure_files import AMBER, BLUE, GREY, RED, inches, styled
from speed.record import QUOTED, Row

COLOURS = {"ours": BLUE, "CalculiX": AMBER, "plain": RED, "SOFA": GREY}
MARKERS = "osv^D"
LEAST_PERCENT = 0.05  # smaller errors are drawn here


@styled
def draw_solves(rows: Sequence[Row]) -> Figure:
    """Draw the error of each solve over its time, a colour for each program; quoted
    ones have open markers.
    """
    figure = Figure(figsize=inches(150, 110), layout="constrained")
    axes = figure.add_subplot()
    drawn: list[str] = []
    for row in rows:
        error = row.more.get("error, %")
        if row.value is None or error is None:
            continue

        program = row.what.replace(",", " ").split()[0]
        axes.plot(
            row.value,
            max(abs(error), LEAST_PERCENT),
            MARKERS[drawn.count(program)],
            color=COLOURS[program],
            fillstyle="none" if row.source else "full",
            label=f"{row.what} ({QUOTED})" if row.source else row.what,
        )
        drawn.append(program)

    axes.set(
        xscale="log",
        yscale="log",
        xlabel="time of a first static solve, s",
        ylabel="error of the tip, %",
    )
    axes.xaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_major_formatter("{x:g}")
    figure.legend(loc="outside upper left", ncols=3, fontsize="x-small")
    return figure
