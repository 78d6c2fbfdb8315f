"""Computed walls over the raw frame that they were computed for: what each mechanics says that the force does."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from scleraforce.report.style import AMBER, SCAN_COLOURS, inches, styled
from scleraforce.section.plane import Section
from scleraforce.units import from_si

SHIFTS_M = np.linspace(-0.6e-3, 0.6e-3, 49)  # lateral, to either side of the frame's middle
WALL_COLOURS = ("#56B4E9", AMBER)  # bright enough on a B-scan
WALL_LINES: tuple[Literal["-", "--"], ...] = ("-", "--")


@dataclass(frozen=True)
class ComputedWall:
    """A section in the frame, m from its upper left corner, and the name of the mechanics that computed it."""

    name: str
    section: Section


@dataclass(frozen=True)
class FrameWithWalls:
    """A raw frame (rows, columns) that spans `extent_m` (width, depth), and the walls to draw over it."""

    title: str
    frame: NDArray[np.uint16]
    extent_m: tuple[float, float]
    walls: tuple[ComputedWall, ...]


def laid_on_surface(
    section: Section, surface_m: NDArray[np.float64], width_m: float, shifts_m: NDArray[np.float64] = SHIFTS_M
) -> Section:
    """Return a section moved to where its outer curve covers the surface of a frame best.

    Nothing but the place is fitted: for each lateral shift the depth is the one of the median distance, and the shift
    of the smallest mean distance wins.

    Args:
        section: the wall in the plane's frame.
        surface_m: depth of the surface at the centre of each column of the frame, shape (column,), NaN where unseen.
        width_m: width of the frame.
        shifts_m: lateral shifts of the plane's origin from the frame's middle that are tried.

    Returns:
        The section, in m from the frame's upper left corner; in the frame's middle where the surface is not seen.
    """
    columns = len(surface_m)
    lateral_m = (np.arange(columns) + 0.5) * width_m / columns
    ahead = np.concatenate([[True], section.outer[1:, 0] > np.maximum.accumulate(section.outer[:, 0])[:-1]])
    curve = section.outer[ahead]
    best, place = np.inf, (width_m / 2, 0.0)
    for shift_m in shifts_m:
        middle_m = width_m / 2 + shift_m
        depth_m = np.interp(lateral_m, curve[:, 0] + middle_m, curve[:, 1], left=np.nan, right=np.nan)
        away = (surface_m - depth_m)[np.isfinite(surface_m - depth_m)]
        if not len(away):
            continue
        down_m = float(np.median(away))
        distance = float(np.mean(np.abs(away - down_m)))
        if distance < best:
            best, place = distance, (middle_m, down_m)
    return section.shifted(*place)


@styled
def plot_walls(frames: Sequence[FrameWithWalls]) -> Figure:
    """Draw each frame bare and, below, with the computed walls; the walls have the same names in all frames."""
    figure = Figure(figsize=inches(170, 52))
    grid = figure.subplots(2, len(frames), squeeze=False, sharex="col", sharey="col")
    for column, shown in enumerate(frames):
        width_mm, depth_mm = from_si(shown.extent_m[0], "mm"), from_si(shown.extent_m[1], "mm")
        for axes in grid[:, column]:
            extent = (0.0, width_mm, depth_mm, 0.0)
            axes.imshow(shown.frame, cmap=SCAN_COLOURS, extent=extent, aspect="equal")
            axes.set_xlim(0.0, width_mm)
            axes.set_ylim(depth_mm, 0.0)
        for wall, colour, line in zip(shown.walls, WALL_COLOURS, WALL_LINES, strict=False):
            for curve in (wall.section.outer, wall.section.inner):
                grid[1, column].plot(*from_si(curve.T, "mm"), color=colour, linestyle=line, linewidth=0.9)
        grid[0, column].set_title(shown.title)
        grid[1, column].set_xlabel("lateral [mm]")
    for axes in grid[:, 0]:
        axes.set_ylabel("depth [mm]")
    handles = [
        Line2D([], [], color=colour, linestyle=line, label=wall.name)
        for wall, colour, line in zip(frames[0].walls, WALL_COLOURS, WALL_LINES, strict=False)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure
