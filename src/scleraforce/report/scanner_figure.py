"""A measured scanner: a real frame, a drawn one, and the histograms of both."""

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, NullFormatter

from scleraforce.recording.pixels import Pixels
from scleraforce.report.style import AMBER, BLACK, SCAN_COLOURS, inches, styled
from scleraforce.units import from_si

BINS = 128
WIDTH_MM, HISTOGRAM_MM, MOST_MM = 170.0, 42.0, 90.0  # of the page, of the histograms, of the frames' height


@dataclass(frozen=True, eq=False)
class FramePair:
    """A real frame and one that was drawn like it, (row, column), of `extent_m` (width, depth), counts up to `top`."""

    real: Pixels
    drawn: Pixels
    extent_m: tuple[float, float]
    top: int


@styled
def draw_scanner(pair: FramePair) -> Figure:
    """Draw both frames on one grey scale, side by side, and below them their histograms."""
    width_mm, depth_mm = (float(from_si(length, "mm")) for length in pair.extent_m)
    frame_mm = min(MOST_MM, (WIDTH_MM / 2 - 8.0) * depth_mm / width_mm)
    figure = Figure(figsize=inches(WIDTH_MM, frame_mm + 14.0 + HISTOGRAM_MM))
    grid = figure.add_gridspec(2, 2, height_ratios=[frame_mm + 10.0, HISTOGRAM_MM])
    for column, (title, frame) in enumerate((("Real", pair.real), ("Drawn", pair.drawn))):
        axes = figure.add_subplot(grid[0, column])
        axes.imshow(frame, cmap=SCAN_COLOURS, vmin=0, vmax=pair.top, extent=(0.0, width_mm, depth_mm, 0.0))
        axes.set(title=title, xlabel="lateral, mm", ylabel="depth, mm" if not column else "")
    axes = figure.add_subplot(grid[1, :])
    edges = np.linspace(0, pair.top + 1, min(BINS, pair.top + 1) + 1)
    for name, frame, colour, line in (("real", pair.real, BLACK, "-"), ("drawn", pair.drawn, AMBER, "--")):
        share = np.histogram(frame, edges)[0] / frame.size
        axes.plot((edges[1:] + edges[:-1]) / 2, from_si(share, "percent"), color=colour, linestyle=line, label=name)
    axes.set(xlabel="count", ylabel="share of the pixels, %", title="Histograms", xlim=(0, pair.top))
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.legend()
    return figure
