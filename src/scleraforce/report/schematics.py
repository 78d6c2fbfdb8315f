"""Sketches of the method: the model of the sclera with its loads (the paper's Fig. 1a) and the network (Fig. 2)."""

from collections.abc import Sequence
from math import cos, degrees, radians, sin

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Polygon
from numpy.typing import NDArray

from scleraforce.report.style import AMBER, BLACK, BLUE, CLASS_INKS, GREY, RED, inches, styled
from scleraforce.study import Study
from scleraforce.units import from_si

Floats = NDArray[np.float64]
Point = tuple[float, float]

THICKNESS_DRAWN_MM = 1.3  # about twice a sclera: a true one is a line at this size
ARROW = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, "mutation_scale": 8}
BOX_MM, ROW_MM = 24.0, 14.0


@styled
def draw_model(study: Study) -> Figure:
    """Draw the meridian of the needle: the wall, its clamped base, pressure, weight, needle and the B-scan plane."""
    radius = from_si(study.eye.radius_m, "mm")
    polar_deg = degrees(sum(study.needle.polar_angle_rad.bounds) / 2)
    figure = Figure(figsize=inches(120, 62))
    axes = figure.add_subplot()
    angles = np.linspace(-np.pi / 2, np.pi / 2, 181)
    wall = np.concatenate([_arc(radius, angles), _arc(radius - THICKNESS_DRAWN_MM, angles[::-1])])
    axes.add_patch(Polygon(wall, facecolor="#E9EDF2", edgecolor=BLACK, linewidth=0.8))
    _draw_base(axes, radius)
    _draw_pressure(axes, radius - THICKNESS_DRAWN_MM)
    _draw_needle(axes, radius, polar_deg)
    _arrow(axes, (-0.1 * radius, 0.52 * radius), (-0.1 * radius, 0.28 * radius), BLACK)
    axes.text(-0.07 * radius, 0.36 * radius, "gravity, $f_g$", color=BLACK, parse_math=True)
    of_eye = f"E, $\\nu$ = {study.eye.poisson_ratio:g}, R = {radius:g} mm"
    axes.text(0.0, 0.08 * radius, of_eye, ha="center", parse_math=True)
    axes.set(xlim=(-1.15 * radius, 2.0 * radius), ylim=(-0.2 * radius, 1.3 * radius), aspect="equal")
    axes.set_axis_off()
    return figure


@styled
def draw_network(pixels: tuple[int, int], hidden: Sequence[int], classes: Sequence[str], dropout: float) -> Figure:
    """Draw the layers from the slice to the classes.

    Args:
        pixels: of a slice, (columns, rows).
        hidden: neurons of each hidden layer.
        classes: names of the outputs.
        dropout: fraction of the hidden neurons that is left out while training.
    """
    columns, rows = pixels
    layers = [
        (f"slice\n{columns} x {rows}\npixels", BLACK),
        (f"input\n{columns * rows}", GREY),
        *((f"{size}\nReLU\ndropout {dropout:g}", BLUE) for size in hidden),
        (f"{len(classes)}\nsoftmax", RED),
    ]
    step = 1.3 * BOX_MM
    figure = Figure(figsize=inches(170, 28))
    axes = figure.add_subplot()
    for place, (text, colour) in enumerate(layers):
        left = place * step
        box = FancyBboxPatch((left, -ROW_MM / 2), BOX_MM, ROW_MM, boxstyle="round,pad=0,rounding_size=1.5")
        box.set(facecolor="white", edgecolor=colour, linewidth=1.1)
        axes.add_patch(box)
        axes.text(left + BOX_MM / 2, 0.0, text, ha="center", va="center")
        if place:
            _arrow(axes, (left - step + BOX_MM, 0.0), (left, 0.0), GREY)
    end = (len(layers) - 1) * step + BOX_MM
    for place, name in enumerate(classes):
        height = ROW_MM * (0.55 - 0.55 * place)
        _arrow(axes, (end, 0.5 * height), (end + 7.0, height), GREY)
        axes.text(end + 8.5, height, name, va="center")
    axes.set(xlim=(-2.0, end + 38.0), ylim=(-0.7 * ROW_MM, 0.7 * ROW_MM), aspect="equal")
    axes.set_axis_off()
    return figure


def _arc(distance: float, polar_rad: Floats) -> Floats:
    """Points of a meridian at a distance from the centre, (point, 2); the pole is up, the needle to the right."""
    return distance * np.stack([np.sin(polar_rad), np.cos(polar_rad)], axis=-1)


def _point(distance: float, polar_deg: float, along: float = 0.0) -> Point:
    """One point, moved `along` the tangent, away from the pole."""
    polar_rad = radians(polar_deg)
    across, up = sin(polar_rad), cos(polar_rad)
    return distance * across + along * up, distance * up - along * across


def _arrow(axes: Axes, start: Point, end: Point, colour: str) -> None:
    axes.annotate("", xy=end, xytext=start, arrowprops={**ARROW, "color": colour, "lw": 1.0})


def _draw_base(axes: Axes, radius: float) -> None:
    """Hatch what holds the base."""
    for side in (-1.0, 1.0):
        ends = np.sort(side * np.array([radius - 1.4 * THICKNESS_DRAWN_MM, radius + 0.4 * THICKNESS_DRAWN_MM]))
        axes.plot(ends, [0.0, 0.0], color=BLACK, linewidth=1.4)
        for start in np.linspace(ends[0], ends[1], 6):
            axes.plot([start, start - 0.5], [0.0, -0.8], color=BLACK, linewidth=0.6)
    axes.text(0.0, -0.14 * radius, "the base is clamped", ha="center")


def _draw_pressure(axes: Axes, inner: float) -> None:
    """Draw the pressure on the inner surface."""
    for polar_deg in (-75, -55, -35, -15, 5, 60, 78):
        _arrow(axes, _point(0.84 * inner, polar_deg), _point(inner, polar_deg), BLUE)
    across, up = _point(0.74 * inner, -45)
    axes.text(across, up, "IOP, $f_p$", color=BLUE, ha="center", va="center", parse_math=True)


def _draw_needle(axes: Axes, radius: float, polar_deg: float) -> None:
    """Draw the needle along the normal of its contact, and the outline of the B-scan in front of it."""
    ends = np.array([_point(radius, polar_deg), _point(1.42 * radius, polar_deg)])
    axes.plot(*ends.T, color=RED, linewidth=2.6, solid_capstyle="butt")
    _arrow(axes, _point(0.98 * radius, polar_deg), _point(0.72 * radius, polar_deg), RED)
    across, up = _point(0.64 * radius, polar_deg)
    axes.text(across, up, "needle, $f_n$", color=RED, ha="center", va="center", parse_math=True)
    half = 0.38 * radius
    corners = [(1.22, -half), (1.22, half), (0.86, half), (0.86, -half)]
    outline = np.array([_point(share * radius, polar_deg, along) for share, along in corners])
    axes.add_patch(Polygon(outline, fill=False, edgecolor=AMBER, linewidth=1.1, linestyle=(0, (4, 2))))
    across, up = _point(1.2 * radius, polar_deg, 0.42 * radius)
    axes.text(across, up, "B-scan, parallel to this\nplane, beside the needle", color=CLASS_INKS[1], va="bottom")
