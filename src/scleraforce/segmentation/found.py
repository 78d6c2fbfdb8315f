"""The result of a segmentation: the wall with a verdict, or the reason why there is none."""

from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from scleraforce.arrays import Bytes, Floats
from scleraforce.segmentation.needle import SeenNeedle

if TYPE_CHECKING:
    from scleraforce.segmentation.checked_wall import BothWalls

WALL = 255
LEAST_CONTRAST = 0.6  # of the surface, in standard deviations of a pixel's noise
LEAST_COVER = 0.4  # of the imaged width must show the wall
SATURATED_SHARE, SATURATED_LEVEL = 0.4, 0.99  # share of the frame at (nearly) the largest count: saturated
EMPTY_SHARE = 1e-3  # of the brightest count: a frame that stands out of its noise by less is empty
UNSEEN_DEPTH_M = 1e-3  # below the surface: the mask ends here where the inner boundary cannot be seen


@dataclass(frozen=True)
class Segmentation:
    """The wall in one frame.

    `outer_row`, `inner_row` (column,): boundaries in rows of pixel centres (the wall covers rows r with outer_row <= r
    < inner_row), NaN where there is no wall; they may lie beyond the last of the frame's `rows`. `usable`: a wall was
    found that can be judged; otherwise `reason` says why not. `inner_found`: if False, the inner boundary cannot be
    seen and the mask ends 1 mm below the surface. `thickness_m`: median thickness along the surface's normal, NaN if
    the inner boundary was not found. `needle`: the needle that crosses the frame, or None; the columns that it hides
    have no boundaries. `conjunctiva_m`: median thickness of a layer over the wall, along its normal, None if none is
    looked for or seen. `methods`: the wall by each method, and their `disagreement`, if a network looked as well.
    """

    outer_row: Floats
    inner_row: Floats
    rows: int
    usable: bool
    reason: str
    inner_found: bool
    _: KW_ONLY
    thickness_m: float
    needle: SeenNeedle | None = None
    conjunctiva_m: float | None = None
    methods: "BothWalls | None" = None

    @cached_property
    def mask(self) -> Bytes:
        """255 in the rows whose centre lies in the wall, else 0, shape (row, column); computed lazily."""
        row = np.arange(self.rows, dtype=np.float32)[:, None]
        inside = (row >= self.outer_row) & (row < self.inner_row)  # NaN compares as False: no wall
        return inside.view(np.uint8) * np.uint8(WALL)


def without_wall(shape: tuple[int, ...], reason: str, needle: SeenNeedle | None = None) -> Segmentation:
    """Return the result for a frame that shows no wall."""
    nowhere = np.full(shape[1], np.nan)
    return Segmentation(
        nowhere, nowhere.copy(), shape[0], False, reason, False, thickness_m=float("nan"), needle=needle
    )


def blank_fault(floor: float, brightest: int, saturated: bool) -> str:
    """Return why a frame cannot be searched, or ''.

    `floor`: count of the noise; `saturated`: more than SATURATED_SHARE of the cells have (nearly) the largest count.
    """
    if brightest - floor < EMPTY_SHARE * max(brightest, 1):
        return "the frame is empty: all pixels are alike"
    if saturated:
        return f"the detector is saturated: more than {SATURATED_SHARE:.0%} of the pixels have the largest count"
    return ""


def surface_fault(seen: int, points: int, contrast: float, noise: float) -> str:
    """Return why a surface cannot be judged, or ''.

    `seen` of `points` points show it, with this median contrast; `noise` is of a pixel.
    """
    if not seen:
        return "no wall was found"
    if contrast < LEAST_CONTRAST * noise:
        return (
            f"the signal is too weak: the surface stands out by {contrast / noise:.1f} times the noise, "
            f"not {LEAST_CONTRAST}"
        )
    cover = seen / points
    if cover < LEAST_COVER:
        return f"the wall covers {cover:.0%} of the imaged width, not {LEAST_COVER:.0%}"
    return ""
