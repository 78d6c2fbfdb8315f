"""Figures of slices and of walls computed for them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from scleraforce.mechanics.contact import Section
from scleraforce.report.files import AMBER, BLUE, CLASS_INKS, RED, SCAN_COLOURS, inches, styled
from scleraforce.units import from_si


@dataclass(frozen=True)
class SlicePair:
    """A frame, the slice that the segmentation made of it, and the slice simulated for the same force.

    `frame` has shape (rows, columns) of the scanner and spans `extent_m` (width, depth); `measured` and `simulated`
    are binary slices, 255 where wall is, of pixels of `pixel_m`.
    """

    title: str
    target: int
    frame: NDArray[np.uint16]
    extent_m: tuple[float, float]
    measured: NDArray[np.uint8]
    simulated: NDArray[np.uint8]
    pixel_m: float


def dice(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> float:
    """Return the Dice coefficient of two binary images, twice the common area over the sum of both (1: the same).

    >>> dice(np.eye(2, dtype=np.uint8), np.ones((2, 2), dtype=np.uint8))
    0.6666666666666666
    """
    a, b = first > 0, second > 0
    total = int(a.sum() + b.sum())
    return 2.0 * int((a & b).sum()) / total if total else 1.0


@styled
def draw_slice_pairs(pairs: Sequence[SlicePair]) -> Figure:
    """Draw for each pair, from top to bottom: the raw frame, its slice, the simulated slice, and both overlaid."""
    figure = Figure(figsize=inches(170, 100))
    grid = figure.subplots(4, len(pairs), squeeze=False)
    for column, pair in enumerate(pairs):
        _draw_frame(grid[0, column], pair.frame, pair.extent_m)
        _draw_slice(grid[1, column], pair.measured, pair.pixel_m)
        _draw_slice(grid[2, column], pair.simulated, pair.pixel_m)
        _draw_overlay(grid[3, column], pair)
        grid[0, column].set_title(pair.title, color=CLASS_INKS[pair.target], fontweight="bold")
        grid[3, column].set_xlabel("lateral [mm]")
        for axes in grid[1:3, column]:
            axes.tick_params(labelbottom=False)
    for row, name in enumerate(("raw frame", "its slice", "simulated", "overlay")):
        grid[row, 0].set_ylabel(f"{name}\ndepth [mm]")
    handles = [
        Patch(color=BLUE, label="in the frame only"),
        Patch(color=RED, label="simulated only"),
        Patch(color="#555555", label="both"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


@styled
def draw_montage(
    slices: NDArray[np.uint8], force_n: NDArray[np.float64], target: NDArray[np.intp], thickness_m: NDArray[np.float64]
) -> Figure:
    """Draw simulated slices in a grid of six columns, each with its force, class and wall thickness.

    Args:
        slices: shape (slice, rows, columns), 255 where wall is.
        force_n: shape (slice,).
        target: class, shape (slice,).
        thickness_m: shape (slice,).
    """
    rows = -(-len(slices) // 6)
    figure = Figure(figsize=inches(170, 14.5 * rows))
    grid = figure.subplots(rows, 6, squeeze=False).ravel()
    for axes in grid:
        axes.set_axis_off()
    for axes, image, force, label, thickness in zip(grid, slices, force_n, target, thickness_m, strict=False):
        axes.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
        title = f"{from_si(force, 'mn'):.1f} mN · {from_si(thickness, 'um'):.0f} µm"
        axes.set_title(title, fontsize=6.5, pad=2, color=CLASS_INKS[int(label)])
    return figure


@styled
def draw_segmentation(
    frame: NDArray[np.uint16],
    mask: NDArray[np.uint8],
    outer_row: NDArray[np.float64],
    inner_row: NDArray[np.float64],
    extent_m: tuple[float, float],
) -> Figure:
    """Draw a raw frame with the boundaries that were found, and the mask of the wall.

    Args:
        frame: counts, shape (rows, columns).
        mask: 255 where wall is, same shape.
        outer_row: row of the outer boundary, shape (columns,), NaN where there is none.
        inner_row: row of the inner boundary, likewise.
        extent_m: width and depth of the frame.
    """
    figure = Figure(figsize=inches(170, 68))
    grid = figure.subplots(2, 2, sharex=True, sharey=True)
    width_mm, depth_mm = from_si(extent_m[0], "mm"), from_si(extent_m[1], "mm")
    lateral_mm = (np.arange(frame.shape[1]) + 0.5) * width_mm / frame.shape[1]
    for axes in grid[:, 0]:
        axes.set_ylabel("depth [mm]")
    for axes, title in zip(
        grid.flat, ("(a) raw frame", "(b) boundaries found", "(c) mask of the wall", "(d) frame, masked"), strict=True
    ):
        axes.set_title(title)
    _draw_frame(grid[0, 0], frame, extent_m)
    _draw_frame(grid[0, 1], frame, extent_m)
    for row, colour, name in ((outer_row, "#56B4E9", "outer"), (inner_row, "#E69F00", "inner")):
        grid[0, 1].plot(lateral_mm, (row + 0.5) * depth_mm / frame.shape[0], color=colour, linewidth=0.9, label=name)
    grid[0, 1].legend(loc="lower center", ncols=2, labelcolor="white")
    extent = (0.0, width_mm, depth_mm, 0.0)
    grid[1, 0].imshow(mask, cmap="gray", extent=extent, interpolation="nearest", aspect="equal")
    _draw_frame(grid[1, 1], np.where(mask > 0, frame, 0).astype(np.uint16), extent_m)
    for axes in grid[1]:
        axes.set_xlabel("lateral [mm]")
    return figure


def _draw_frame(axes: Axes, frame: NDArray[np.uint16], extent_m: tuple[float, float]) -> None:
    extent = (0.0, from_si(extent_m[0], "mm"), from_si(extent_m[1], "mm"), 0.0)
    axes.imshow(frame, cmap=SCAN_COLOURS, extent=extent, aspect="equal")


def _draw_slice(axes: Axes, image: NDArray[np.uint8], pixel_m: float) -> None:
    axes.imshow(
        image,
        cmap="gray",
        vmin=0,
        vmax=255,
        extent=_slice_extent(image, pixel_m),
        interpolation="nearest",
        aspect="equal",
    )


def _draw_overlay(axes: Axes, pair: SlicePair) -> None:
    """Draw where the two slices agree (grey) and where only one of them has wall."""
    measured, simulated = pair.measured > 0, pair.simulated > 0
    colours = np.ones((*measured.shape, 3))
    for where, colour in (
        (measured & ~simulated, BLUE),
        (simulated & ~measured, RED),
        (measured & simulated, "#555555"),
    ):
        colours[where] = [int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5)]
    axes.imshow(colours, extent=_slice_extent(pair.measured, pair.pixel_m), interpolation="nearest", aspect="equal")
    axes.set_title(f"Dice {dice(pair.measured, pair.simulated):.3f}", fontsize=7, pad=2)


def _slice_extent(image: NDArray[np.uint8], pixel_m: float) -> tuple[float, float, float, float]:
    rows, columns = image.shape
    return 0.0, from_si(pixel_m, "mm") * columns, from_si(pixel_m, "mm") * rows, 0.0


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
