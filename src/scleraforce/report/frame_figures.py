"""Figures of frames and slices: beside simulated ones, with walls, before a scanner's copy, and as a preview."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from scleraforce.mechanics.contact import Section
from scleraforce.recording.pixels import Pixels
from scleraforce.report.files import AMBER, BLACK, BLUE, CLASS_INKS, RED, inches, log_scale, show_image, styled
from scleraforce.report.frames import AnsweredFrame
from scleraforce.units import from_si

BOTH_COLOUR = "#555555"
SHIFTS_M = np.linspace(-0.6e-3, 0.6e-3, 49)  # lateral, to either side of the frame's middle
WALLS: tuple[tuple[str, Literal["-", "--"]], ...] = (
    ("#56B4E9", "-"),
    (AMBER, "--"),
)  # colours that are bright enough on a B-scan
SLICE: dict[str, Any] = {"vmin": 0, "vmax": 255, "interpolation": "nearest"}


@dataclass(frozen=True)
class SlicePair:
    """A frame, its slice, and the slice simulated for the same force: 255 is wall, pixels of `pixel_m`."""

    look: AnsweredFrame
    measured: NDArray[np.uint8]
    simulated: NDArray[np.uint8]
    pixel_m: float

    @property
    def extent_m(self) -> tuple[float, float]:
        """Width and depth of the slices."""
        rows, columns = self.measured.shape
        return columns * self.pixel_m, rows * self.pixel_m


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
        answer = pair.look.answer
        force_mn = from_si(max(answer.measured_force_n or 0.0, 0.0), "mn")
        show_image(grid[0, column], pair.look.frame, pair.look.extent_m)
        show_image(grid[1, column], pair.measured, pair.extent_m, **SLICE)
        show_image(grid[2, column], pair.simulated, pair.extent_m, **SLICE)
        _draw_overlay(grid[3, column], pair)
        title = f"class {answer.target}: {answer.eye}, {force_mn:.0f} mN"
        grid[0, column].set_title(title, color=CLASS_INKS[answer.target or 0], fontweight="bold")
        grid[3, column].set_xlabel("lateral [mm]")
        for axes in grid[1:3, column]:
            axes.tick_params(labelbottom=False)
    for row, name in enumerate(("raw frame", "its slice", "simulated", "overlay")):
        grid[row, 0].set_ylabel(f"{name}\ndepth [mm]")
    labels = {"in the frame only": BLUE, "simulated only": RED, "both": BOTH_COLOUR}
    handles = [Patch(color=colour, label=label) for label, colour in labels.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


def _draw_overlay(axes: Axes, pair: SlicePair) -> None:
    """Draw where the two slices agree (grey) and where only one of them has wall."""
    measured, simulated = pair.measured > 0, pair.simulated > 0
    colours = np.ones((*measured.shape, 3))
    parts = {BLUE: measured & ~simulated, RED: simulated & ~measured, BOTH_COLOUR: measured & simulated}
    for colour, where in parts.items():
        colours[where] = [int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5)]
    show_image(axes, colours, pair.extent_m, interpolation="nearest")
    axes.set_title(f"Dice {dice(pair.measured, pair.simulated):.3f}", fontsize=7, pad=2)


@styled
def draw_montage(
    slices: NDArray[np.uint8], force_n: NDArray[np.float64], target: NDArray[np.intp], thickness_m: NDArray[np.float64]
) -> Figure:
    """Draw simulated slices (slice, row, column) in six columns, each with its force, class and wall thickness."""
    rows = -(-len(slices) // 6)
    figure = Figure(figsize=inches(170, 14.5 * rows))
    grid = figure.subplots(rows, 6, squeeze=False).ravel()
    for axes in grid:
        axes.set_axis_off()
    for axes, image, force, label, thickness in zip(grid, slices, force_n, target, thickness_m, strict=False):
        axes.imshow(image, cmap="gray", **SLICE)
        title = f"{from_si(force, 'mn'):.1f} mN · {from_si(thickness, 'um'):.0f} µm"
        axes.set_title(title, fontsize=6.5, pad=2, color=CLASS_INKS[int(label)])
    return figure


def draw_wall(axes: Axes, look: AnsweredFrame, colours: tuple[str, str] = ("#56B4E9", "#56B4E9")) -> None:
    """Draw a frame and, over it, the outer and the inner boundary that were found."""
    width_mm, depth_mm = (from_si(extent_m, "mm") for extent_m in look.extent_m)
    rows, columns = look.frame.shape
    show_image(axes, look.frame, look.extent_m)
    lateral_mm = (np.arange(columns) + 0.5) * width_mm / columns
    boundaries = {"outer": look.found.outer_row, "inner": look.found.inner_row}
    for (name, row), colour in zip(boundaries.items(), colours, strict=True):
        axes.plot(lateral_mm, (row + 0.5) * depth_mm / rows, color=colour, linewidth=0.9, label=name)
    axes.set(xlim=(0.0, width_mm), ylim=(depth_mm, 0.0))


@styled
def draw_segmentation(look: AnsweredFrame) -> Figure:
    """Draw a raw frame, the boundaries that were found, the mask of the wall, and the frame under the mask."""
    figure = Figure(figsize=inches(170, 68))
    raw, found, mask, masked = figure.subplots(2, 2, sharex=True, sharey=True).flat
    titles = {
        raw: "(a) raw frame",
        found: "(b) boundaries found",
        mask: "(c) mask of the wall",
        masked: "(d) frame, masked",
    }
    for axes, title in titles.items():
        axes.set_title(title)
    show_image(raw, look.frame, look.extent_m)
    draw_wall(found, look, ("#56B4E9", AMBER))
    found.legend(loc="lower center", ncols=2, labelcolor="white")
    show_image(mask, look.found.mask, look.extent_m, interpolation="nearest")
    show_image(masked, np.where(look.found.mask > 0, look.frame, 0), look.extent_m)
    for axes in (raw, mask):
        axes.set_ylabel("depth [mm]")
    for axes in (mask, masked):
        axes.set_xlabel("lateral [mm]")
    return figure


def laid_on_surface(
    section: Section, surface_m: NDArray[np.float64], width_m: float, shifts_m: NDArray[np.float64] = SHIFTS_M
) -> Section:
    """Return a section moved to where its outer curve covers the surface of a frame best.

    Only the place is fitted: for each lateral shift the depth is the one of the median distance, and the shift of the
    smallest mean distance wins.

    Args:
        section: the wall in the plane's frame.
        surface_m: depth of the surface at the centre of each column of the frame, shape (column,), NaN where unseen.
        width_m: width of the frame.
        shifts_m: lateral shifts of the plane's origin from the frame's middle.

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
def draw_computed_walls(looks: Sequence[AnsweredFrame], computed: Mapping[str, Sequence[Section]]) -> Figure:
    """Draw each frame bare and, below, with the sections that each mechanics computed for it, laid on its surface."""
    figure = Figure(figsize=inches(170, 52))
    grid = figure.subplots(2, len(looks), squeeze=False, sharex="col", sharey="col")
    for column, look in enumerate(looks):
        width_m, depth_m = look.extent_m
        for axes in grid[:, column]:
            show_image(axes, look.frame, look.extent_m)
            axes.set(xlim=(0.0, from_si(width_m, "mm")), ylim=(from_si(depth_m, "mm"), 0.0))
        surface_m = (look.found.outer_row + 0.5) * depth_m / len(look.frame)
        for sections, (colour, line) in zip(computed.values(), WALLS, strict=False):
            laid = laid_on_surface(sections[column], surface_m, width_m)
            for curve in (laid.outer, laid.inner):
                grid[1, column].plot(*from_si(curve.T, "mm"), color=colour, linestyle=line, linewidth=0.9)
        force_mn = from_si(max(look.answer.measured_force_n or 0.0, 0.0), "mn")
        grid[0, column].set_title(f"{look.answer.file}, {force_mn:.0f} mN")
        grid[1, column].set_xlabel("lateral [mm]")
    for axes in grid[:, 0]:
        axes.set_ylabel("depth [mm]")
    handles = [
        Line2D([], [], color=colour, linestyle=line, label=name)
        for name, (colour, line) in zip(computed, WALLS, strict=False)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


BINS = 128
WIDTH_MM, HISTOGRAM_MM, MOST_MM = 170.0, 42.0, 90.0  # of the page, of the histograms, of the frames' height


@styled
def draw_scanner(real: Pixels, drawn: Pixels, extent_m: tuple[float, float], top: int) -> Figure:
    """Draw a real frame and a simulated one (row, column) on one grey scale, up to `top`, and their histograms."""
    width_mm, depth_mm = (float(from_si(length, "mm")) for length in extent_m)
    frame_mm = min(MOST_MM, (WIDTH_MM / 2 - 8.0) * depth_mm / width_mm)
    figure = Figure(figsize=inches(WIDTH_MM, frame_mm + 14.0 + HISTOGRAM_MM))
    grid = figure.add_gridspec(2, 2, height_ratios=[frame_mm + 10.0, HISTOGRAM_MM])
    counts = figure.add_subplot(grid[1, :])
    edges = np.linspace(0, top + 1, min(BINS, top + 1) + 1)
    looks = (("Real", real, BLACK, "-"), ("Drawn", drawn, AMBER, "--"))
    for column, (title, frame, colour, line) in enumerate(looks):
        axes = figure.add_subplot(grid[0, column])
        show_image(axes, frame, extent_m, vmin=0, vmax=top)
        axes.set(title=title, xlabel="lateral, mm", ylabel="" if column else "depth, mm")
        share = from_si(np.histogram(frame, edges)[0] / frame.size, "percent")
        counts.plot((edges[1:] + edges[:-1]) / 2, share, color=colour, linestyle=line, label=title.lower())
    counts.set(xlabel="count", ylabel="share of the pixels, %", title="Histograms", xlim=(0, top))
    log_scale(counts)
    counts.legend()
    return figure
