"""The loops of `live.picture_signs` with whole arrays: slow and plain."""

import numpy as np

from scleraforce.base.arrays import Flags, Floats, Integers
from scleraforce.live.picture_signs import (
    COPY,
    GHOST,
    GHOST_SHARE,
    LEAST_PAIRS,
    PAIRS,
    RUN,
    SHIFTS,
    UNMOVED,
    WORTH_A_LOOK,
    Words,
)
from scleraforce.records.frame import Pixels


def read_signs(
    pixels: Pixels,
    row_br: Integers,
    column_bp: Integers,
    rises_sb: Words,
    differs_sb: Words,
    step_p: Integers,
) -> tuple[int, int]:
    """Do what `picture_signs.read_signs` does."""
    values_brp = pixels[row_br[:, :, None], column_bp[:, None]].astype(np.int32)
    left_brp = values_brp[:, :, :-1]
    right_brp = values_brp[:, :, 1:]
    bits_xbrp = np.stack([right_brp > left_brp, right_brp != left_brp])
    whole_xbr = bits_xbrp @ (np.uint64(1) << np.arange(RUN - 1, dtype=np.uint64))
    moved_xbrs = (
        whole_xbr[..., None] >> np.arange(SHIFTS, dtype=np.uint64)
    ) & np.uint64(2**PAIRS - 1)
    shape = 2, SHIFTS**2, len(values_brp)
    rises_sb[:], differs_sb[:] = np.moveaxis(moved_xbrs, 1, -1).reshape(shape)
    step_p[:] = np.diff(values_brp[:, 1, 1:-1]).ravel()
    unequal_b = np.bitwise_count(differs_sb[UNMOVED])
    textured = int(np.count_nonzero(unequal_b >= LEAST_PAIRS))
    return textured, int(np.count_nonzero(step_p))


def alike_pictures(
    rises_mb: Words,
    differs_mb: Words,
    rises_b: Words,
    differs_b: Words,
    part_hb: Flags,
    copies_h: Floats,
    least_h: Floats,
) -> Flags:
    """Do what `picture_signs.alike_pictures` does."""
    both_mb = differs_mb & differs_b
    told_mb = np.bitwise_count(both_mb)
    unlike_mb = np.bitwise_count(both_mb & (rises_mb ^ rises_b))
    told_m = told_mb.sum(axis=1)
    is_looked_at_m = 2.0 * unlike_mb.sum(axis=1) < (1 - WORTH_A_LOOK) * told_m

    counted_mb = told_mb >= LEAST_PAIRS
    agreed_mb = np.where(
        counted_mb, 1.0 - 2.0 * unlike_mb / np.maximum(told_mb, 1), np.inf
    )
    blocks_m = counted_mb.sum(axis=1)
    worst_m = np.maximum(1, (GHOST_SHARE * blocks_m).astype(np.int64))
    summed_mb = np.sort(agreed_mb, axis=1).cumsum(axis=1)
    ghost_m = summed_mb[np.arange(len(worst_m)), worst_m - 1] >= GHOST * worst_m
    part_bh = part_hb.T.astype(np.float64)
    counted_mh = counted_mb @ part_bh
    copied_mh = (counted_mb & (agreed_mb >= COPY)) @ part_bh
    copy_mh = (copied_mh >= copies_h * counted_mh) & (counted_mh >= least_h)
    same_m = (ghost_m & (blocks_m >= least_h[0])) | copy_mh.any(axis=1)
    return np.asarray(is_looked_at_m & same_m)
