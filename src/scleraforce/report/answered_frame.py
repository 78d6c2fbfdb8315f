"""A frame that was answered: raw pixels, the wall that was read in it, its slice."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.reader.evaluate import FrameAnswer
from scleraforce.recording.folder import Recording, read_recording
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.slice import boundary_slice
from scleraforce.segmentation.steps import Segmentation
from scleraforce.study import SliceStudy


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
    if answer.segmentation is None:
        raise ValueError(f"{answer.recording}: {answer.file}: the answer has no segmentation")
    entry = next(entry for entry in recording.frames if entry.file == answer.file)
    frame = np.asarray(recording.frame(entry), dtype=np.uint16)
    return AnsweredFrame(answer, recording, frame, answer.segmentation)
