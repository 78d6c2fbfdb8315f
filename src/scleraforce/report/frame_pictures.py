"""Frames of an evaluation as small pictures, with the wall that was found drawn in and what was read below."""

import base64
from collections.abc import Sequence

import cv2
import numpy as np

from scleraforce.reader.evaluate import Evaluation, FrameAnswer
from scleraforce.recording.pixels import Pixels
from scleraforce.report.answered_frame import AnsweredFrame
from scleraforce.report.html import Html, gallery, paragraph, section
from scleraforce.segmentation.overlay import draw_overlay
from scleraforce.segmentation.steps import Segmentation
from scleraforce.units import from_si

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
    telling = [n for n, frame in enumerate(frames) if not frame.usable or _misread(frame)]
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
    marked = {n for n, look in enumerate(looks) if _misread(look.answer)}
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


def _words(answer: FrameAnswer) -> str:
    """Return what was measured and what was read, one beside the other."""
    if answer.measured_force_n is None:
        measured = "not measured"
    else:
        sd_n = answer.measured_force_sd_n
        sure = "" if sd_n is None else f" ± {from_si(sd_n, 'mn'):.1f}"
        measured = f"measured {from_si(answer.measured_force_n, 'mn'):.1f}{sure} mN (class {answer.target})"
    if not answer.usable:
        return f"{measured}; not usable: {answer.reason}" if answer.reason else f"{measured}; not usable"
    if answer.predicted_force_n is None or answer.interval_n is None:
        return f"{measured}; read class {answer.predicted}"
    low_mn, high_mn = (from_si(end, "mn") for end in answer.interval_n)
    read_mn = from_si(answer.predicted_force_n, "mn")
    read = f"read {read_mn:.1f} mN ({low_mn:.1f} to {high_mn:.1f}; class {answer.predicted})"
    return f"{measured}; {read}"


def _misread(answer: FrameAnswer) -> bool:
    return answer.target is not None and answer.predicted != answer.target
