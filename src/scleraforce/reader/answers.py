"""The answer to one raw frame: segment it, cut the slice, ask the network; a frame that cannot be judged is class 2."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.imaging.segmentation import PixelScale, Segmenter, boundary_slice
from scleraforce.reader.model import ForceReader

__all__ = ["Answer", "answer_frame", "dent_leaves"]

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
    if dent_leaves(cut):
        return Answer(reader.classes - 1, None, False, "the dent leaves the window of the slice")
    probabilities = reader.probabilities(cut[np.newaxis])[0]
    return Answer(int(probabilities.argmax()), tuple(probabilities.tolist()), True, None)


def dent_leaves(cut: NDArray[np.uint8]) -> bool:
    """Return whether the wall of a slice (row, column) goes out through the bottom and comes in again.

    That is so where columns without a wall lie between two walls that reach into the lowest quarter of the window. How
    deep such a dent is cannot be seen, and a network that met few of them takes what is left for a wall without force:
    the most dangerous frames would be read as the least. They are withdrawn from instead.

    >>> dent = np.array([[255, 0, 255], [255, 0, 255], [255, 0, 255], [255, 0, 255]], dtype=np.uint8)
    >>> shadow = np.array([[255, 0, 255], [0, 0, 0], [0, 0, 0], [0, 0, 0]], dtype=np.uint8)
    >>> dent_leaves(dent), dent_leaves(shadow)
    (True, False)
    """
    columns = np.flatnonzero(cut.any(axis=0))
    deep: NDArray[np.bool_] = np.any(cut[-(len(cut) // 4) :], axis=0)
    before, after = columns[:-1], columns[1:]
    return bool(np.any((after - before > 1) & deep[before] & deep[after]))
