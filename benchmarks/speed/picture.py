"""The static solves: error over time."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from scleraforce.front.report.figure_files import AMBER, BLUE, GREY, RED, inches, styled
from speed.record import QUOTED, Row

COLOURS = {"ours": BLUE, "CalculiX": AMBER, "plain": RED, "SOFA": GREY}
LEFT = ("right", "center", (-6, 0))
RIGHT = ("left", "center", (6, 0))
ABOVE = ("center", "bottom", (0, 6))
BELOW = ("center", "top", (0, -6))
LEAST_PERCENT = 0.05  # smaller errors are drawn here


@styled
def draw_solves(rows: Sequence[Row]) -> Figure:
    """Draw the error of each solve over its time; quoted ones have open markers."""
    figure = Figure(figsize=inches(150, 90))
    axes = figure.add_subplot()
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="time of a first static solve, s",
        ylabel="error of the tip, %",
    )
    axes.margins(x=0.3, y=0.15)
    drawn = dict[str, tuple[float, float]]()

    for row in rows:
        error = row.more.get("error, %")
        if row.value is None or error is None:
            continue

        name = f"{row.what}\n({QUOTED})" if row.source else row.what
        drawn[name] = row.value, max(abs(error), LEAST_PERCENT)
        axes.plot(
            *drawn[name],
            "o",
            color=_colour(name),
            fillstyle="none" if row.source else "full",
        )

    figure.draw_without_rendering()  # from here on places are in the picture
    taken = [
        Bbox.from_bounds(x - 4, y - 4, 8, 8)
        for x, y in axes.transData.transform(list(drawn.values()))
    ]

    for name, place in drawn.items():
        taken.append(_name(axes, name, place, taken))

    return figure


def _name(
    axes: Axes, name: str, place: tuple[float, float], taken: Sequence[Bbox]
) -> Bbox:
    """Write a name beside a place, on free ground if there is room; return its
    place.
    """
    sides = (
        (LEFT, BELOW, ABOVE, RIGHT)
        if name.startswith("ours")
        else (RIGHT, BELOW, ABOVE, LEFT)
    )
    texts = [
        axes.annotate(
            name,
            place,
            xytext=offset,
            textcoords="offset points",
            color=_colour(name),
            ha=across,
            va=along,
        )
        for across, along, offset in sides
    ]
    boxes: list[Bbox] = [text.get_window_extent() for text in texts]
    free = [
        side
        for side, box in enumerate(boxes)
        if not any(box.overlaps(other) for other in taken)
    ]
    kept = free[0] if free else 0

    for side, text in enumerate(texts):
        if side != kept:
            text.remove()

    return boxes[kept]


def _colour(name: str) -> str:
    """Return the colour of a program."""
    return COLOURS[name.replace(",", " ").split()[0]]
