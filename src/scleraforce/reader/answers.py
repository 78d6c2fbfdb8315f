"""The answer to one raw frame: segment it, cut the slice, ask the network; a frame that cannot be judged is class 2."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.imaging.segmentation import PixelScale, Segmenter, boundary_slice
from scleraforce.reader.model import ForceReader

__all__ = ["Answer", "answer_frame"]

Pixels = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True)
class Answer:
    """What a model says about a frame.

    Where the frame is not `usable`, `predicted` is the highest class (withdraw), `probabilities` is None, for the
    network was never asked, and `reason` says why.
    """

    predicted: int
    probabilities: tuple[float, ...] | None
    usable: bool
    reason: str | None


def answer_frame(
    reader: ForceReader, segmenter: Segmenter, frame: Pixels, scale: PixelScale, refractive_index: float
) -> Answer:
    """Read the force class of one raw frame.

    Args:
        reader: the model.
        segmenter: made for the same refractive index; it keeps its buffers between frames.
        frame: raw B-scan (row, column).
        scale: size of a pixel as stored; depth is optical where `refractive_index` is not 1.
        refractive_index: by which depth is stretched in the frame; 1 where the scanner has corrected it.
    """
    segmentation = segmenter.segment(frame, scale)
    if not segmentation.usable:
        return Answer(reader.classes - 1, None, False, segmentation.reason)
    cut = boundary_slice(segmentation, scale, reader.study.slice, refractive_index)
    if not cut.any():
        return Answer(reader.classes - 1, None, False, "the wall lies outside the window of the slice")
    probabilities = reader.probabilities(cut[np.newaxis])[0]
    return Answer(int(probabilities.argmax()), tuple(probabilities.tolist()), True, None)
