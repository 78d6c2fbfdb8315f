"""Answered frames in pages: their pixels read again, and their pictures with the wall that was read."""

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from scleraforce.arrays import Bytes
from scleraforce.reader.evaluate import Evaluation, FrameAnswer
from scleraforce.recording.folder import Recording, read_recording
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.report.html import Html, gallery, paragraph, section
from scleraforce.segmentation.found import Segmentation, draw_overlay
from scleraforce.segmentation.observations import boundary_slice
from scleraforce.study import SliceStudy
from scleraforce.units import from_si


@dataclass(frozen=True)
class AnsweredFrame:
    """A raw frame (row, column) with its answer and its recording."""

    answer: FrameAnswer
    recording: Recording
    frame: Pixels

    @property
    def found(self) -> Segmentation:
        """The wall that was read."""
        if self.answer.answer.segmentation is None:
            raise ValueError(f"{self.answer.recording}: {self.answer.file}: the answer has no segmentation")
        return self.answer.answer.segmentation

    @property
    def extent_m(self) -> tuple[float, float]:
        """Width and depth of the frame."""
        return self.recording.info.oct.width_m, self.recording.info.oct.depth_m

    def slice(self, study: SliceStudy) -> Bytes:
        """Return the slice that a network reads."""
        return boundary_slice(self.found, PixelScale.of(self.recording.info.oct), study)


def look_at_all(answers: Iterable[FrameAnswer]) -> tuple[AnsweredFrame, ...]:
    """Read the pixels of answers' frames, each recording once; raises `RecordingError` or `FrameError`."""
    opened, looks = cache(read_recording), []
    for answer in answers:
        recording = opened(answer.recording)
        entry = next(entry for entry in recording.frames if entry.file == answer.file)
        looks.append(AnsweredFrame(answer, recording, recording.frame(entry)))
    return tuple(looks)


MOST_PICTURES = 48  # of 20 KB each: a page of 1 MB, which a mail carries
WIDTH = 480  # pixels: 3 side by side on a wide screen, one on a telephone, both sharp
QUALITY = 75
DEEPEST = 2.0  # times as deep as wide, at most

WALL_COLOURS = (
    "Red: the tissue's surface. Green: the wall's inner boundary; blue where it is not seen, 1 mm below the surface. "
    "Depth and width are to scale."
)


def shown_frames(frames: Sequence[FrameAnswer]) -> tuple[FrameAnswer, ...]:
    """Return the frames that a page pictures, in their order: misread and unusable ones, then others in even steps."""
    first = [n for n, frame in enumerate(frames) if not frame.answer.usable or frame.misread]
    others = sorted(set(range(len(frames))) - set(first))
    chosen = evenly(first, MOST_PICTURES)
    return tuple(frames[n] for n in sorted(chosen + evenly(others, MOST_PICTURES - len(chosen))))


def evenly(numbers: list[int], most: int) -> list[int]:
    """Return at most `most` of some numbers, in even steps."""
    if len(numbers) <= most:
        return numbers
    return [numbers[n] for n in np.linspace(0, len(numbers) - 1, most).round().astype(int)] if most else []


def frame_pictures(evaluation: Evaluation, looks: Sequence[AnsweredFrame]) -> Html:
    """Return the section with the pictures of `shown_frames`, and how many frames it leaves out."""
    several, total = len({frame.recording for frame in evaluation.frames}) > 1, len(evaluation.frames)
    pictures = [
        (
            wall_picture(look.frame, look.found, look.extent_m),
            f"{look.answer.eye}/{look.answer.file}" if several else look.answer.file,
            _words(look.answer),
        )
        for look in looks
    ]
    marked = {n for n, look in enumerate(looks) if look.answer.misread}
    left_out = f"All {total} frames are shown."
    if len(looks) < total:
        left_out = (
            f"{len(looks)} of the {total} frames are shown: first the frames that were misread or could not be read, "
            "then others in even steps; the table below lists all."
        )
    words = paragraph(f"{WALL_COLOURS} {left_out}")
    return section("The wall in the frames", words, gallery(pictures, marked))


def wall_picture(frame: Pixels, found: Segmentation, extent_m: tuple[float, float]) -> str:
    """Return a frame (row, column) with its wall as the `src` of an image in a page."""
    width_m, depth_m = extent_m
    rows = max(1, round(WIDTH * min(depth_m / width_m, DEEPEST)))
    picture = draw_overlay(frame, found, (rows, WIDTH))
    # Thin coloured lines need their colour at full resolution.
    full_colour = (cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444)
    content = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY, *full_colour])[1].tobytes()
    return f"data:image/jpeg;base64,{base64.b64encode(content).decode('ascii')}"


def _words(answer: FrameAnswer) -> str:
    if answer.measured_force_n is None:
        measured = "not measured"
    else:
        sd_n = answer.measured_force_sd_n
        sure = "" if sd_n is None else f" ± {from_si(sd_n, 'mn'):.1f}"
        measured = f"measured {from_si(answer.measured_force_n, 'mn'):.1f}{sure} mN (class {answer.target})"
    if not answer.answer.usable:
        return f"{measured}; not usable: {answer.answer.reason}" if answer.answer.reason else f"{measured}; not usable"
    if answer.answer.force_n is None or answer.answer.interval_n is None:
        return f"{measured}; read class {answer.answer.predicted}"
    low_mn, high_mn = (from_si(end, "mn") for end in answer.answer.interval_n)
    read_mn = from_si(answer.answer.force_n, "mn")
    read = f"read {read_mn:.1f} mN ({low_mn:.1f} to {high_mn:.1f}; class {answer.answer.predicted})"
    return f"{measured}; {read}"
