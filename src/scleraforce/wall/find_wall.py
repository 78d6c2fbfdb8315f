"""The wall of the eye in a raw frame, and a verdict whether it can be judged.

`docs/segmentation.md` explains the steps. Frames are taken one by one, each by one
thread; the same frame gives the same wall, to the last bit, whatever the frames before
it show.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from scleraforce.base.arrays import Counts
from scleraforce.records.frame import Pixels
from scleraforce.records.scan import PixelScale
from scleraforce.wall.conjunctiva import below_conjunctiva
from scleraforce.wall.frame_light import (
    LEAST_SHAPE,
    NOT_LOGARITHMIC,
    Lit,
    as_logarithmic,
    counts_of,
    find_lit,
    grid_size,
    without_page,
)
from scleraforce.wall.lit_part import COUNTED, part_beside, part_of_frame
from scleraforce.wall.needle_in_frame import find_needle
from scleraforce.wall.wall import (
    EMPTY_SHARE,
    SATURATED_SHARE,
    Segmentation,
    without_wall,
)

if TYPE_CHECKING:
    from scleraforce.wall.wall_network import WallFinder

EMPTY = "the frame is empty: all pixels are alike"
SATURATED = (
    f"the detector is saturated: more than {SATURATED_SHARE:.0%} of the pixels have the"
    " largest count"
)


def find_wall(
    frame: Pixels,
    scale: PixelScale,
    thickness_m: float | None = None,
    finder: "WallFinder | None" = None,
) -> Segmentation:
    """Find the wall in a frame: the one that forces are read from.

    `frame`: counts, uint8 or uint16, shape (row, column); rows go down into the eye.
    With a known thickness the surface is looked for below a conjunctiva, too, and an
    inner boundary at that depth needs no confirmation. A network (`finder`) checks
    the wall, which is then the one that both methods give (see
    `two_methods.checked_by`); the control loop has no time for its 7 ms. A frame
    without a wall has NaN boundaries and an empty mask.

    Raises:
        ValueError: not such an array, or smaller than 16 x 16.
        ModelError: as of `WallFinder.find`.
    """
    if frame.ndim != 2 or frame.dtype not in COUNTED:
        raise ValueError(
            f"a frame of {frame.ndim} dimensions and type {frame.dtype}: give rows x"
            " columns of counts"
        )
    if min(frame.shape) < LEAST_SHAPE or max(frame.shape) > 2**15:
        raise ValueError(
            f"a frame of {frame.shape[0]} x {frame.shape[1]} pixels: give at least 16"
            " x 16"
        )

    frame = without_page(frame)
    counts = counts_of(frame)

    lit = find_lit(counts)
    if lit[-1] > NOT_LOGARITHMIC:
        frame = as_logarithmic(frame)
        counts = counts_of(frame)
        lit = find_lit(counts)

    first = _first_wall(counts, frame.itemsize == 1, scale, lit)
    found = (
        first
        if thickness_m is None
        else below_conjunctiva(frame, scale, first, thickness_m)
    )

    if finder is None:
        return found

    # 57 ms: ONNX Runtime and the models, not without a finder
    from scleraforce.wall.two_methods import checked_by

    return checked_by(finder, frame, scale, first, found, thickness_m)


def _first_wall(
    frame: Counts, is_bytes: bool, scale: PixelScale, lit: Lit
) -> Segmentation:
    """Return the wall below the first surface that light meets."""
    left, after, columns, brightest, dark, _ = lit
    if columns < LEAST_SHAPE:
        return without_wall(frame.shape, EMPTY)

    part = part_of_frame(frame, is_bytes, scale, left, dark[left:after])
    (cells, floor, saturated, begin), found = part.segment(brightest)
    if brightest - floor < EMPTY_SHARE * brightest:
        return without_wall(frame.shape, EMPTY)
    if saturated:
        return without_wall(frame.shape, SATURATED)
    if not len(begin):
        return found

    shown = part.frame[:, part.first : part.first + len(part.missing)]
    needle = find_needle(
        shown,
        cells,
        grid_size(len(frame), len(part.missing), scale),
        begin,
        left,
        part.columns,
    )
    if needle is None:
        return part.segment(0)[1]

    beside = part_beside(
        frame, part, (needle.hidden[0] - left, needle.hidden[1] - left)
    )
    if beside is None:
        return without_wall(
            frame.shape, "the needle and its shadow hide the wall", needle
        )

    found = replace(beside.segment(0)[1], needle=needle)
    for boundary in (found.outer_row, found.inner_row):
        boundary[slice(*needle.hidden)] = np.nan

    return found
