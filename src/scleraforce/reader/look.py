"""What is seen in a raw frame before a model reads it: the wall, and slices of it."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scleraforce.reader.answers import Answer
from scleraforce.reader.verdicts import allows_calibration, dent_leaves
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.needle import SeenNeedle
from scleraforce.segmentation.observations import Boundaries
from scleraforce.segmentation.sclera import find_sclera
from scleraforce.segmentation.slice import boundary_slices
from scleraforce.segmentation.steps import Segmentation
from scleraforce.segmentation.wall_finder import WallFinder
from scleraforce.study import SliceStudy

NEEDLE_SEEN = "a needle hides a part of the wall, and the network was not trained on such slices"

_NOTHING = np.zeros((1, 0, 0), dtype=np.uint8)  # no slice


@dataclass(frozen=True, eq=False)
class Look:
    """What was seen in a frame: its segmentation, and slices of it where there is a wall to read.

    `cuts` (slice, row, column): the slice, and the same shifted in depth where the model reads several. `reason` says
    why it cannot be read, None where it can.
    """

    segmentation: Segmentation
    cuts: NDArray[np.uint8]
    reason: str | None

    @property
    def cut(self) -> NDArray[np.uint8]:
        """The slice that is not shifted."""
        first: NDArray[np.uint8] = self.cuts[0]
        return first

    @property
    def needle(self) -> SeenNeedle | None:
        """The needle that crosses the frame."""
        return self.segmentation.needle

    def told(self, answer: Answer) -> Answer:
        """Return an answer to the frame with what else is seen in it."""
        return replace(answer, needle=self.segmentation.needle, conjunctiva_m=self.segmentation.conjunctiva_m)


def look(
    frame: Pixels,
    scale: PixelScale,
    slice_study: SliceStudy,
    shifts: tuple[float, ...] = (0.0,),
    thickness_m: float | None = None,
    finder: WallFinder | None = None,
) -> Look:
    """Segment a frame and draw the slices that a model reads.

    Args:
        frame: raw B-scan (row, column).
        scale: size of a pixel as stored, with the refractive index.
        slice_study: of the model.
        shifts: of the slices in depth, in rows of a slice; the first is 0.
        thickness_m: of the wall, as told; and
        finder: a network that checks the wall: see `find_sclera`.
    """
    found = find_sclera(frame, scale, thickness_m, finder)
    if not found.usable:
        return Look(found, _NOTHING, found.reason)
    cuts = boundary_slices(found, scale, slice_study, shifts)
    return Look(found, cuts, None if cuts[0].any() else "the wall lies outside the window of the slice")


def can_calibrate(seen: Look, boundaries: Boundaries, contact_m: float = 0.0) -> bool:
    """Return whether enough of the wall is in view about a contact to calibrate on a frame.

    Args:
        seen: of the frame.
        boundaries: of its segmentation.
        contact_m: lateral place of the contact from the frame's middle.
    """
    return not dent_leaves(seen.cut) and allows_calibration(
        seen.segmentation, boundaries.lateral_m, boundaries.depth_m, contact_m
    )
