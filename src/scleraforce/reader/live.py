"""The reading in the control loop: the answer to a frame within a millisecond or two.

The network alone answers, with every verdict that needs no fit to the response library; that fit takes some times as
long and gives its opinion afterwards, in a process of its own (`answers.answer_frame`, `service.second_opinion`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.known.eye import Known, outside_training
from scleraforce.reader.answers import Answer, Look, class_answer, look, reading_answer, unusable
from scleraforce.reader.model import ForceReader
from scleraforce.reader.verdicts import dent_leaves, too_little_wall
from scleraforce.reader.wall_reader import WallReader
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.observed import surface
from scleraforce.study import OctStudy

__all__ = ["LiveReader", "LiveReading"]

WARMING_FRAMES = 20


@dataclass(frozen=True, eq=False)
class LiveReading:
    """The answer to a frame, and the wall's boundaries in rows of it, (column,), NaN where there is none."""

    answer: Answer
    outer_row: NDArray[np.float64]
    inner_row: NDArray[np.float64]


class LiveReader:
    """Reads the frames of one eye, one after the other.

    What does not change from frame to frame is made at the start, and some frames are read so that the first real one
    takes no longer than the others.

    Args:
        reader: the model. A classifier's answer is its own; of a reader it is that of its network.
        known: of the eye; a classifier takes no notice of it.
        refractive_index: by which depth is stretched in the frames; 1 where the scanner has corrected it.
    """

    def __init__(self, reader: ForceReader | WallReader, known: Known, refractive_index: float) -> None:
        self._reader, self._known, self._refractive_index = reader, known, refractive_index
        self._outside = None if isinstance(reader, ForceReader) else outside_training(known, reader.study.reader)
        frame, scale = _warming_frame(reader.study.oct)
        for _ in range(WARMING_FRAMES):
            self.read(frame, scale)

    def read(self, frame: Pixels, scale: PixelScale) -> LiveReading:
        """Read one raw frame.

        Args:
            frame: raw B-scan (row, column).
            scale: size of a pixel as stored; its refractive index is not looked at, the scanner's counts.

        Returns:
            The reading; `can_calibrate` of its answer is False, as it is not asked in the loop.
        """
        scale = PixelScale(scale.lateral_m, scale.depth_m, self._refractive_index)
        seen = look(frame, scale, self._reader)
        return LiveReading(self._answer(seen, scale), seen.segmentation.outer_row, seen.segmentation.inner_row)

    def _answer(self, seen: Look, scale: PixelScale) -> Answer:
        reader = self._reader
        if seen.reason:
            return unusable(reader, seen.reason)
        if isinstance(reader, ForceReader):
            return class_answer(reader, seen.cut)
        reason = self._outside or too_little_wall(*surface(seen.segmentation, scale), reader.study.slice)
        if reason:
            return unusable(reader, reason)
        return reading_answer(reader, reader.read(seen.cuts, self._known), "network", dent_leaves(seen.cut))


def _warming_frame(scanner: OctStudy) -> tuple[NDArray[np.uint16], PixelScale]:
    """Return a frame of the study's size with a bright layer in noise, and the size of its pixel."""
    scale = PixelScale.of(scanner)
    counts = np.random.default_rng(0).integers(0, 400, (scanner.rows, scanner.columns)).astype(np.uint16)
    counts[scanner.rows // 4 : scanner.rows // 2] += 1500
    return counts, scale
