"""A recording at a glance: its first frames to scale, with scale bars, and its force log under them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from scleraforce.recording.folder import Recording
from scleraforce.recording.labels import contact_force
from scleraforce.recording.pixels import Pixels
from scleraforce.report.style import AMBER, BLACK, BLUE, SCAN_COLOURS, inches, styled
from scleraforce.units import from_si

SHOWN_FRAMES = 3
WIDTH_MM, FORCE_MM, WORDS_MM, TALLEST_MM = 170.0, 46.0, 12.0, 110.0
BARS_MM = (5.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02)
BAR_SHARE = 0.4  # of the frame's extent, at most
POINTS_DRAWN = 6000
OUTLIERS = 0.1  # per cent of the pixels that may lie off the grey scale


@dataclass(frozen=True, eq=False)
class FirstFrame:
    """One of the first frames: its file, time and pixels."""

    file: str
    time_s: float
    pixels: Pixels


@styled
def draw_preview(recording: Recording, frames: Sequence[FirstFrame]) -> Figure:
    """Draw the frames side by side, each as wide and deep as it is, and the contact force with the frames' times.

    Args:
        recording: what was imported.
        frames: its first ones.
    """
    oct_info = recording.info.oct
    width_mm, depth_mm = (float(from_si(length, "mm")) for length in (oct_info.width_m, oct_info.depth_m))
    frame_mm = min(TALLEST_MM, (WIDTH_MM - 12.0) / len(frames) * depth_mm / width_mm)
    has_log = recording.forces is not None
    heights = [frame_mm + WORDS_MM, FORCE_MM] if has_log else [frame_mm + WORDS_MM]
    figure = Figure(figsize=inches(WIDTH_MM, sum(heights)))
    grid = figure.add_gridspec(len(heights), len(frames), height_ratios=heights)
    low, high = np.percentile(np.stack([frame.pixels for frame in frames]), [OUTLIERS, 100.0 - OUTLIERS])
    for nth, frame in enumerate(frames):
        axes = figure.add_subplot(grid[0, nth])
        extent = (0.0, width_mm, depth_mm, 0.0)
        axes.imshow(frame.pixels, cmap=SCAN_COLOURS, vmin=low, vmax=max(high, low + 1), extent=extent)
        axes.set_title(f"{frame.file}, {frame.time_s:.3f} s")
        axes.set_axis_off()
        _scale_bars(axes, width_mm, depth_mm)
    if has_log:
        _force_curve(figure.add_subplot(grid[1, :]), recording)
    return figure


def _scale_bars(axes: Axes, width_mm: float, depth_mm: float) -> None:
    """Draw a bar along each direction from the lower left corner."""
    across, down = (
        next((bar for bar in BARS_MM if bar <= BAR_SHARE * size), size / 2) for size in (width_mm, depth_mm)
    )
    left, bottom = 0.04 * width_mm, 0.94 * depth_mm
    line: dict[str, Any] = {"color": AMBER, "linewidth": 1.6, "solid_capstyle": "butt"}
    axes.plot([left, left + across], [bottom, bottom], **line)
    axes.plot([left, left], [bottom, bottom - down], **line)
    edge = [withStroke(linewidth=2.0, foreground=BLACK)]  # letters stand on bright tissue as well
    words: dict[str, Any] = {"color": AMBER, "fontsize": 7.0, "path_effects": edge}
    axes.text(left + across + 0.015 * width_mm, bottom, f"{across:g} mm", va="center", **words)
    axes.text(left, bottom - down - 0.02 * depth_mm, f"{down:g} mm deep", va="bottom", **words)


def _force_curve(axes: Axes, recording: Recording) -> None:
    log, info = recording.forces, recording.info.force
    assert log is not None
    assert info is not None
    every = max(1, len(log.time_s) // POINTS_DRAWN)
    raw_mn = from_si(info.contact_sign * log.force_n(info.axis), "mn")
    axes.plot(log.time_s[::every], raw_mn[::every], color="#C9CED3", linewidth=0.5, label="as logged")
    axes.plot(log.time_s[::every], from_si(contact_force(log, info), "mn")[::every], color=BLUE, label="filtered")
    missing_s = log.time_s[np.isnan(raw_mn)]
    if len(missing_s):
        every = max(1, len(missing_s) // POINTS_DRAWN)
        axes.plot(missing_s[::every], np.zeros_like(missing_s[::every]), "|", color=AMBER, label="no force")
    times_s = [frame.time_s for frame in recording.frames]
    axes.vlines(times_s, 0, 1, transform=axes.get_xaxis_transform(), color=BLACK, linewidth=0.5, label="frames")
    low_s, high_s = min(times_s[0], float(log.time_s[0])), max(times_s[-1], float(log.time_s[-1]))
    axes.set(xlabel="time [s]", ylabel="contact force [mN]", xlim=(low_s, high_s))
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4)
