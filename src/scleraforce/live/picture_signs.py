"""The signs of a picture by which `repeated_pictures` knows it again, as compiled
loops.

A block is a run of pixels in a row. A word has a bit for each pair of neighbouring
pixels, the first one the lowest.
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Flags, Floats, Integers
from scleraforce.base.compiled_loops import compiled, compiled_in_place
from scleraforce.records.frame import Pixels

GRID = 8  # rows and columns of blocks
PAIRS = 32  # of neighbouring pixels in a row, in each block: one bit each
RUN = PAIRS + 3  # pixels in a row that give them, also one pixel to the left or right
SHIFTS = 3  # rows and columns that a picture may have moved by
UNMOVED = 4  # of their pairs, the one without a move
LEAST_PAIRS = 8  # of unequal pixels, in a block that counts
# Agreement of two pictures: 1 if all pairs rise and fall alike, 0 by chance
# (`python -m monitor old-pictures`).
WORTH_A_LOOK = 0.2  # of all pairs
# the mean of the worst third of the blocks
GHOST_SHARE = 1 / 3
GHOST = 0.25
COPY = 0.85  # a block that agrees as in a copy

Words = NDArray[np.uint64]
ONE = np.uint64(1)
PAIRS_MASK = np.uint64(2**PAIRS - 1)


@compiled
def read_signs(
    pixels: Pixels,
    row_br: Integers,
    column_bp: Integers,
    rises_sb: Words,
    differs_sb: Words,
    step_p: Integers,
) -> tuple[int, int]:
    """Write the words of each block, moved by a row and a column (shift, block): which
    pairs rise, and which differ; and the differences of its pairs (block pair,).

    `row_br`: the rows of a block, above it, its own and the one below; `column_bp` the
    columns of its pixels. Return the number of blocks with texture, and of unequal
    pairs.
    """
    textured = told = 0
    for block in range(len(row_br)):
        for down in range(SHIFTS):
            row = row_br[block, down]
            rises = differs = np.uint64(0)
            before = np.int64(pixels[row, column_bp[block, 0]])
            for pair in range(RUN - 1):
                after = np.int64(pixels[row, column_bp[block, pair + 1]])
                step = after - before
                # no branch: half of them would be taken by chance
                rises |= np.uint64(step > 0) << np.uint64(pair)
                differs |= np.uint64(step != 0) << np.uint64(pair)
                if down == 1 and 0 < pair <= PAIRS:
                    step_p[block * PAIRS + pair - 1] = step
                before = after

            for across in range(SHIFTS):
                shift = np.uint64(across)
                place = SHIFTS * down + across
                rises_sb[place, block] = (rises >> shift) & PAIRS_MASK
                differs_sb[place, block] = (differs >> shift) & PAIRS_MASK

        unequal = _bits(differs_sb[UNMOVED, block])
        told += int(unequal)
        textured += int(unequal >= LEAST_PAIRS)

    return textured, told


@compiled
def alike_pictures(
    rises_mb: Words,
    differs_mb: Words,
    rises_b: Words,
    differs_b: Words,
    part_hb: Flags,
    copies_h: Floats,
    least_h: Floats,
) -> Flags:
    """Return for several pictures (picture, block) whether they are the same as one
    (block,): enough blocks agree.

    `part_hb`: the blocks of each part of a picture, the first part all of it;
    `copies_h`: the share of copies from which a part is one; `least_h`: the blocks with
    texture that a part has to have.
    """
    count, blocks = rises_mb.shape
    alike_m = np.zeros(count, dtype=np.bool_)
    told_b = np.empty(blocks, dtype=np.int64)
    unlike_b = np.empty(blocks, dtype=np.int64)
    agreed = np.empty(blocks)

    for picture in range(count):
        told = unlike = 0
        for block in range(blocks):
            both = differs_mb[picture, block] & differs_b[block]
            other = both & (rises_mb[picture, block] ^ rises_b[block])
            told_b[block] = _bits(both)
            unlike_b[block] = _bits(other)
            told += told_b[block]
            unlike += unlike_b[block]

        if 2.0 * unlike < (1.0 - WORTH_A_LOOK) * told:
            alike_m[picture] = _is_ghost(
                told_b, unlike_b, agreed, least_h[0]
            ) or _is_copy(told_b, unlike_b, part_hb, copies_h, least_h)

    return alike_m


@compiled_in_place
def _is_ghost(
    told_b: Integers, unlike_b: Integers, agreed: Floats, least: float
) -> bool:
    """Return whether the worst third of the blocks is better than chance."""
    count = 0
    for block in range(len(told_b)):
        if told_b[block] < LEAST_PAIRS:
            continue

        # the lowest first
        value = _agreement(told_b[block], unlike_b[block])
        place = count
        while place > 0 and agreed[place - 1] > value:
            agreed[place] = agreed[place - 1]
            place -= 1
        agreed[place] = value
        count += 1

    worst = max(1, int(GHOST_SHARE * count))
    summed = 0.0
    for place in range(worst):
        summed += agreed[place]
    return count >= least and summed >= GHOST * worst


@compiled_in_place
def _is_copy(
    told_b: Integers,
    unlike_b: Integers,
    part_hb: Flags,
    copies_h: Floats,
    least_h: Floats,
) -> bool:
    """Return whether most blocks of one part agree as in a copy."""
    for part in range(len(part_hb)):
        counted = copied = 0
        for block in range(len(told_b)):
            if part_hb[part, block] and told_b[block] >= LEAST_PAIRS:
                counted += 1
                copied += _agreement(told_b[block], unlike_b[block]) >= COPY

        if copied >= copies_h[part] * counted and counted >= least_h[part]:
            return True

    return False


@compiled_in_place
def _agreement(told: int, unlike: int) -> float:
    """Return by how much a block agrees: 1, all pairs; 0, by chance."""
    return 1.0 - 2.0 * unlike / told


@compiled_in_place
def _bits(word: np.uint64) -> np.int64:
    """Return the number of bits that are set in a word (Warren, Hacker's Delight, 2nd
    ed., section 5-1).
    """
    pairs = word - ((word >> ONE) & np.uint64(0x5555555555555555))
    fours = (pairs & np.uint64(0x3333333333333333)) + (
        (pairs >> np.uint64(2)) & np.uint64(0x3333333333333333)
    )
    eights = (fours + (fours >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((eights * np.uint64(0x0101010101010101)) >> np.uint64(56))
