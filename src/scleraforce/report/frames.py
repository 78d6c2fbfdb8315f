"""Frames in reports: an answered frame looked at again, its picture, and the preview of a recording."""

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from scleraforce.reader.evaluate import Evaluation, FrameAnswer
from scleraforce.recording.folder import Recording, read_recording
from scleraforce.recording.labels import contact_force
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.report.files import AMBER, BLACK, BLUE, SCAN_COLOURS, inches, styled
from scleraforce.report.html import Html, gallery, paragraph, section
from scleraforce.segmentation.found import Segmentation
from scleraforce.segmentation.overlay import draw_overlay
from scleraforce.segmentation.slice import boundary_slice
from scleraforce.study import SliceStudy
from scleraforce.units import from_si


@dataclass(frozen=True)
class AnsweredFrame:
    """A raw frame (rows, columns) with its answer, its recording and the wall that was read in it."""

    answer: FrameAnswer
    recording: Recording
    frame: NDArray[np.uint16]
    found: Segmentation

    @property
    def extent_m(self) -> tuple[float, float]:
        """Width and depth of the frame."""
        return self.recording.info.oct.width_m, self.recording.info.oct.depth_m

    def slice(self, study: SliceStudy) -> NDArray[np.uint8]:
        """Return the slice that a network reads."""
        return boundary_slice(self.found, PixelScale.of(self.recording.info.oct), study)


def look_at(answer: FrameAnswer) -> AnsweredFrame:
    """Read the pixels of an answer's frame; the wall is the one that was read.

    Raises:
        RecordingError: its recording is gone.
        FrameError: its file cannot be read.
        ValueError: the answer has no segmentation.
    """
    return _looked_at(answer, read_recording(answer.recording))


def look_at_all(answers: Iterable[FrameAnswer]) -> tuple[AnsweredFrame, ...]:
    """Do the same with many answers; each recording is read once."""
    answers = tuple(answers)
    recordings = {name: read_recording(name) for name in dict.fromkeys(answer.recording for answer in answers)}
    return tuple(_looked_at(answer, recordings[answer.recording]) for answer in answers)


def _looked_at(answer: FrameAnswer, recording: Recording) -> AnsweredFrame:
    wall = answer.answer.segmentation
    if wall is None:
        raise ValueError(f"{answer.recording}: {answer.file}: the answer has no segmentation")
    entry = next(entry for entry in recording.frames if entry.file == answer.file)
    frame = np.asarray(recording.frame(entry), dtype=np.uint16)
    return AnsweredFrame(answer, recording, frame, wall)


MOST_PICTURES = 48  # of 20 KB each: a page of 1 MB, which a mail carries
WIDTH = 480  # pixels: 3 side by side on a wide screen, one on a telephone, both sharp
QUALITY = 75
DEEPEST = 2.0  # times as deep as wide, at most

WALL_COLOURS = (
    "Red: the tissue's surface. Green: the wall's inner boundary; blue where it is not seen, 1 mm below the surface. "
    "Depth and width are to scale."
)


def shown_frames(frames: Sequence[FrameAnswer], most: int = MOST_PICTURES) -> tuple[FrameAnswer, ...]:
    """Return the frames that a page has pictures of, in their order.

    Those that were misread or could not be read come first, the others in even steps.
    """
    telling = [n for n, frame in enumerate(frames) if not frame.answer.usable or frame.misread]
    others = sorted(set(range(len(frames))) - set(telling))
    chosen = _evenly(telling, most)
    return tuple(frames[n] for n in sorted(chosen + _evenly(others, most - len(chosen))))


def _evenly(numbers: list[int], most: int) -> list[int]:
    if len(numbers) <= most:
        return numbers
    return [numbers[n] for n in np.linspace(0, len(numbers) - 1, most).round().astype(int)] if most else []


def frame_pictures(evaluation: Evaluation, looks: Sequence[AnsweredFrame]) -> Html:
    """Return the section with the pictures; it says which frames are left out.

    Args:
        evaluation: the answers.
        looks: the frames to show, as `shown_frames` chooses them.
    """
    several = len({frame.recording for frame in evaluation.frames}) > 1
    pictures = [
        (wall_picture(look.frame, look.found, look.extent_m), _title(look.answer, several), _words(look.answer))
        for look in looks
    ]
    marked = {n for n, look in enumerate(looks) if look.answer.misread}
    words = paragraph(f"{WALL_COLOURS} {_left_out(evaluation, looks)}")
    return section("The wall in the frames", words, gallery(pictures, marked))


def _left_out(evaluation: Evaluation, looks: Sequence[AnsweredFrame]) -> str:
    total = len(evaluation.frames)
    if len(looks) == total:
        return f"All {total} frames are shown."
    return (
        f"{len(looks)} of the {total} frames are shown: first those that were misread or could not be read, then "
        "others in even steps; the table below lists all."
    )


def wall_picture(frame: Pixels, found: Segmentation, extent_m: tuple[float, float], width: int = WIDTH) -> str:
    """Return a frame with its wall as text that stands in a page's `src`.

    Args:
        frame: counts (row, column).
        found: the wall in it.
        extent_m: its width and depth.
        width: of the picture, in pixels; its height follows from the frame's depth.
    """
    width_m, depth_m = extent_m
    rows = max(1, round(width * min(depth_m / width_m, DEEPEST)))
    picture = draw_overlay(frame, found, (rows, width))
    # Thin coloured lines need their colour at full resolution.
    full_colour = (cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444)
    content = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY, *full_colour])[1].tobytes()
    return f"data:image/jpeg;base64,{base64.b64encode(content).decode('ascii')}"


def _title(answer: FrameAnswer, several: bool) -> str:
    return f"{answer.eye}/{answer.file}" if several else answer.file


def _words(frame: FrameAnswer) -> str:
    """Return what was measured and what was read, one beside the other."""
    if frame.measured_force_n is None:
        measured = "not measured"
    else:
        sd_n = frame.measured_force_sd_n
        sure = "" if sd_n is None else f" ± {from_si(sd_n, 'mn'):.1f}"
        measured = f"measured {from_si(frame.measured_force_n, 'mn'):.1f}{sure} mN (class {frame.target})"
    answer = frame.answer
    if not answer.usable:
        return f"{measured}; not usable: {answer.reason}" if answer.reason else f"{measured}; not usable"
    if answer.force_n is None or answer.interval_n is None:
        return f"{measured}; read class {answer.predicted}"
    low_mn, high_mn = (from_si(end, "mn") for end in answer.interval_n)
    read_mn = from_si(answer.force_n, "mn")
    read = f"read {read_mn:.1f} mN ({low_mn:.1f} to {high_mn:.1f}; class {answer.predicted})"
    return f"{measured}; {read}"


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
