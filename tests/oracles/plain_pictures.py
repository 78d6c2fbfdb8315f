"""`live.repeated_pictures` with whole arrays in place of loops."""

import fastcrc
import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Bytes, Flags, Integers
from scleraforce.records.frame import Pixels

GRID = 8  # rows and columns of blocks
PAIRS = 32  # of neighbouring pixels in a row, in each block: one bit each
RUN = PAIRS + 3  # pixels in a row that give them, also one pixel to the left or right
LEAST_BLOCKS = 16  # with texture
LEAST_SHARE = 2 / 3  # with fewer, only equal differences count
LEAST_PAIRS = 8  # of unequal pixels, in a block that counts
# unequal pairs; with fewer, only pictures equal to the last bit count as the same
LEAST_TOLD = 32
SAME_SHARE = 0.75  # of the unequal pairs with equal differences
# Agreement of two pictures: 1 if all pairs rise and fall alike, 0 by chance
# (`python -m monitor old-pictures`).
WORTH_A_LOOK = 0.2  # of all pairs
# the mean of the worst third of the blocks
GHOST_SHARE = 1 / 3
GHOST = 0.25
COPY = 0.85  # a block that agrees as in a copy, and the share of them
COPIES = 0.6  # in the whole picture
COPIES_OF_A_PART = 0.8  # in its left, right, upper, lower or middle half

SHIFTS = 3  # rows and columns that a picture may have moved by
UNMOVED = 4  # of their pairs, the one without a move

Words = NDArray[np.uint64]


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

        values_brp = pixels[self._places].astype(np.int32)
        rises_sb, differs_sb = _read_signs(values_brp)
        rises_b = rises_sb[UNMOVED]
        differs_b = differs_sb[UNMOVED]
        last = self._slot(1)
        steps_p = np.diff(values_brp[:, 1, 1:-1]).ravel()
        blocks = np.count_nonzero(np.bitwise_count(differs_b) >= LEAST_PAIRS)
        checksum: int | None = None

        if blocks >= self._least_h[0]:
            found_m = self._alike(self._rises_mb, self._differs_mb, rises_b, differs_b)
            if not found_m[
                last
            ]:  # it may be the one before, moved by a row or a column or both
                found_m[last] = self._alike(
                    rises_sb, differs_sb, self._rises_mb[last], self._differs_mb[last]
                ).any()
        elif (told := np.count_nonzero(steps_p)) >= LEAST_TOLD:
            found_m = ((self._steps_mp == steps_p) & (steps_p != 0)).sum(
                axis=1
            ) >= SAME_SHARE * told
        else:
            checksum = fastcrc.crc64.ecma_182(np.ascontiguousarray(pixels).data)
            found_m = np.array([shown == checksum for shown in self._checksums])

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
        self._steps_mp[slot] = steps_p
        self._checksums[slot] = checksum
        self._count += 1

        return back

    def _slot(self, back: int) -> int:
        return (self._count - back) % self._most

    def _alike(
        self, rises_mb: Words, differs_mb: Words, rises_b: Words, differs_b: Words
    ) -> Flags:
        """Return for several pictures whether they are the same as one."""
        both_mb = differs_mb & differs_b
        told_mb = np.bitwise_count(both_mb)
        unlike_mb = np.bitwise_count(both_mb & (rises_mb ^ rises_b))

        alike_m: Flags = 2.0 * unlike_mb.sum(axis=1) < (1 - WORTH_A_LOOK) * told_mb.sum(
            axis=1
        )
        if alike_m.any():
            alike_m[alike_m] = self._same(told_mb[alike_m], unlike_mb[alike_m])

        return alike_m

    def _same(self, told_mb: Bytes, unlike_mb: Bytes) -> Flags:
        """Return for several pictures whether enough blocks agree, from pairs that
        differ in both and those unlike.
        """
        counted_mb = told_mb >= LEAST_PAIRS
        agreed_mb = np.where(
            counted_mb, 1.0 - 2.0 * unlike_mb / np.maximum(told_mb, 1), np.inf
        )
        blocks_m = counted_mb.sum(axis=1)
        worst_m = np.maximum(1, (GHOST_SHARE * blocks_m).astype(np.int64))
        summed_mb = np.sort(agreed_mb, axis=1).cumsum(axis=1)
        ghost_m = summed_mb[np.arange(len(worst_m)), worst_m - 1] >= GHOST * worst_m
        counted_mh = counted_mb @ self._parts_bh
        copied_mh = (counted_mb & (agreed_mb >= COPY)) @ self._parts_bh
        copy_mh = (copied_mh >= self._copies_h * counted_mh) & (
            counted_mh >= self._least_h
        )
        same_m: Flags = (ghost_m & (blocks_m >= self._least_h[0])) | copy_mh.any(axis=1)

        return same_m

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
        rows_br = np.clip(top_b[:, None] + np.arange(-1, 2), 0, rows - 1)
        columns_bp = np.clip(left_b[:, None] + np.arange(RUN), 0, columns - 1)
        self._places = rows_br[:, :, None], columns_bp[:, None]
        middle_b = abs(column_b + 0.5 - across / 2) < across / 4
        halves = (
            row_b < down // 2,
            row_b >= down // 2,
            column_b < across // 2,
            column_b >= across // 2,
            middle_b,
        )
        self._parts_bh = np.stack([np.ones(len(row_b)), *halves], axis=1).astype(
            np.float64
        )
        self._copies_h = np.array([COPIES] + [COPIES_OF_A_PART] * len(halves))
        self._least_h = np.maximum(
            LEAST_BLOCKS, LEAST_SHARE * self._parts_bh.sum(axis=0)
        )
        self._rises_mb = np.zeros((self._most, len(row_b)), np.uint64)
        self._differs_mb = np.zeros_like(self._rises_mb)
        self._steps_mp = np.zeros((self._most, len(row_b) * PAIRS), np.int32)
        self._checksums: list[int | None] = [None] * self._most
        self._shape = shape
        self._count = 0


def _read_signs(values_brp: Integers) -> tuple[Words, Words]:
    """Return the words of each block, moved by a row and a column: which pairs rise,
    and which differ.

    `values_brp`: the pixels of a block in the row above it, its own and the one below.
    A pair is a bit, the first one the lowest.
    """
    left_brp = values_brp[:, :, :-1]
    right_brp = values_brp[:, :, 1:]
    bits_xbrp = np.stack([right_brp > left_brp, right_brp != left_brp])
    whole_xbr = bits_xbrp @ (np.uint64(1) << np.arange(RUN - 1, dtype=np.uint64))
    moved_xbrs = (
        whole_xbr[..., None] >> np.arange(SHIFTS, dtype=np.uint64)
    ) & np.uint64(2**PAIRS - 1)
    rises_sb, differs_sb = np.moveaxis(moved_xbrs, 1, -1).reshape(
        2, SHIFTS**2, len(values_brp)
    )

    return rises_sb, differs_sb
