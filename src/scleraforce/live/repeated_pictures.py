"""Detects a picture that was shown before: the noise of a live scanner never
repeats.
"""

import fastcrc
import numpy as np

from scleraforce.live.picture_signs import (
    GRID,
    PAIRS,
    RUN,
    SHIFTS,
    UNMOVED,
    alike_pictures,
    read_signs,
)
from scleraforce.records.frame import Pixels

LEAST_BLOCKS = 16  # with texture
LEAST_SHARE = 2 / 3  # with fewer, only equal differences count
# unequal pairs; with fewer, only pictures equal to the last bit count as the same
LEAST_TOLD = 32
SAME_SHARE = 0.75  # of the unequal pairs with equal differences
COPIES = 0.6  # of blocks that agree as in a copy, in the whole picture
COPIES_OF_A_PART = 0.8  # in its left, right, upper, lower or middle half


class ShownPictures:
    """Remembers the last `most` pictures of one size by the signs of a few differences
    between neighbouring pixels.

    Offset, gain, contrast and the number of bits leave the signs alone. In the noise
    above and below the tissue they agree by chance from one live frame to the next,
    even if the tissue is still and its speckle stays. So a picture is old if some
    blocks of every part of it agree: the worst third is better than chance (also with
    80 % of an old picture and 20 % of the live one), or nearly all of one half agrees.
    A shift of one pixel from the frame before is detected, too. Where less than two
    thirds of the picture have texture, so that all of it may be tissue, equal
    differences count instead, and in a picture of one grey every bit.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._shape: tuple[int, ...] = ()

    def back(self, pixels: Pixels) -> int:
        """Take a picture (row, column); return the number of pictures since it was last
        shown, 0 if it is new.
        """
        if self._shape != pixels.shape:
            self._begin(pixels.shape)

        shown = pixels.view()
        shown.flags.writeable = False  # one type for the loops
        textured, told = read_signs(
            shown,
            self._row_br,
            self._column_bp,
            self._rises_sb,
            self._differs_sb,
            self._step_p,
        )
        rises_b = self._rises_sb[UNMOVED]
        differs_b = self._differs_sb[UNMOVED]
        last = self._slot(1)
        parts = self._part_hb, self._copies_h, self._least_h
        checksum: int | None = None

        if textured >= self._least_h[0]:
            found_m = alike_pictures(
                self._rises_mb, self._differs_mb, rises_b, differs_b, *parts
            )
            if not found_m[last]:
                # it may be the one before, moved by a row or a column or both
                found_m[last] = alike_pictures(
                    self._rises_sb,
                    self._differs_sb,
                    self._rises_mb[last],
                    self._differs_mb[last],
                    *parts,
                ).any()
        elif told >= LEAST_TOLD:
            found_m = ((self._steps_mp == self._step_p) & (self._step_p != 0)).sum(
                axis=1
            ) >= SAME_SHARE * told
        else:
            checksum = fastcrc.crc64.ecma_182(np.ascontiguousarray(pixels).data)
            found_m = np.array([before == checksum for before in self._checksums])

        slot = self._slot(0)
        back = min(
            (
                (slot - one - 1) % self._most + 1
                for one in np.flatnonzero(found_m).tolist()
            ),
            default=0,
        )
        self._rises_mb[slot] = rises_b
        self._differs_mb[slot] = differs_b
        self._steps_mp[slot] = self._step_p
        self._checksums[slot] = checksum
        self._count += 1

        return back

    def _slot(self, back: int) -> int:
        return (self._count - back) % self._most

    def _begin(self, shape: tuple[int, ...]) -> None:
        """Forget all pictures, and draw the place of each block in its cell of the
        grid.
        """
        rows, columns = shape
        down = min(GRID, rows)
        across = max(1, min(GRID, columns // RUN))
        row_b, column_b = (place.ravel() for place in np.mgrid[:down, :across])
        rng = np.random.default_rng(0)
        top_b = ((row_b + rng.uniform(0.1, 0.9, len(row_b))) * rows / down).astype(
            np.int64
        )
        spare = max(0.0, columns / across - RUN)
        left_b = (
            column_b * columns / across + rng.uniform(0.0, 1.0, len(row_b)) * spare
        ).astype(np.int64)
        self._row_br = np.clip(top_b[:, None] + np.arange(-1, 2), 0, rows - 1)
        self._column_bp = np.clip(left_b[:, None] + np.arange(RUN), 0, columns - 1)
        middle_b = abs(column_b + 0.5 - across / 2) < across / 4
        halves = (
            row_b < down // 2,
            row_b >= down // 2,
            column_b < across // 2,
            column_b >= across // 2,
            middle_b,
        )
        whole = np.ones(len(row_b), dtype=np.bool_)
        self._part_hb = np.stack([whole, *halves])
        self._copies_h = np.array([COPIES] + [COPIES_OF_A_PART] * len(halves))
        self._least_h = np.maximum(
            LEAST_BLOCKS, LEAST_SHARE * self._part_hb.sum(axis=1)
        )
        self._rises_mb = np.zeros((self._most, len(row_b)), np.uint64)
        self._differs_mb = np.zeros_like(self._rises_mb)
        self._steps_mp = np.zeros((self._most, len(row_b) * PAIRS), np.int64)
        self._rises_sb = np.zeros((SHIFTS**2, len(row_b)), np.uint64)
        self._differs_sb = np.zeros_like(self._rises_sb)
        self._step_p = np.zeros(len(row_b) * PAIRS, np.int64)
        self._checksums: list[int | None] = [None] * self._most
        self._shape = shape
        self._count = 0


def warm_pictures() -> None:
    """Take pictures of each type, so that the first real one takes no longer than the
    others.
    """
    rng = np.random.default_rng(0)
    for kind in (np.uint8, np.uint16):
        # with texture, by which it is compared
        ShownPictures(1).back(rng.integers(0, 256, (GRID, GRID * RUN), kind))
