"""Two ways to find the wall, compared: whether they find the same one, and what speaks against a frame.

All comparisons are made at the columns that the network answers for, in rows of the full frame.
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.segmentation.imaged import LEAST_SHAPE
from scleraforce.segmentation.steps import Segmentation
from scleraforce.segmentation.wall_finder import SeenWall

Mask = NDArray[np.bool_]

SAME_SDS = 2.0  # both ways see one boundary: so many standard deviations of the network, at least as many of its rows
SAME_SHARE = 0.8  # ... in so many of the columns that both see, which are so many of those that either sees
SDS, OTHER_ROWS = 4.0, 2.0  # both ways may differ by so many standard deviations; that of `find_wall` in rows
OTHER_INNER_SHARE = 0.08  # ... and of its inner boundary, in thicknesses
DIFFERING_SHARE = 0.2  # of the columns that both see
UNSEEN_SHARE = 0.3  # of the columns that either sees are seen by one alone
UNSURE_THICKNESS, UNSURE_SHARE = 0.25, 0.5  # the wall's end is unsure by so much of it, in so much of the wall
CONFIRMED_THICKNESS = 0.1  # ... unless the other way sees it so near, in thicknesses, or within a row of the network's


def ways_agree(other: Segmentation, seen: SeenWall) -> bool:
    """Return whether `find_wall` found the wall that the network sees, as far as that can tell."""
    if not other.inner_found:
        return False
    both, either = _columns(other, seen)
    at = seen.frame_column
    outer = _within(seen.outer_row - other.outer_row[at], seen.outer_sd, seen.step_rows)
    inner = _within(seen.inner_row - other.inner_row[at], seen.inner_sd, seen.step_rows)
    last = other.rows - 1.0 - seen.step_rows  # of two boundaries below the frame nobody sees which is lower
    inner |= (seen.inner_row > last) & (other.inner_row[at] > last)
    seen_by_both, same = int(np.count_nonzero(both)), int(np.count_nonzero(both & outer & inner))
    return seen_by_both >= SAME_SHARE * int(np.count_nonzero(either)) and same >= SAME_SHARE * seen_by_both


def two_ways_doubt(other: Segmentation, seen: SeenWall) -> str:
    """Return what speaks against the wall of `find_wall` once a network has looked too, '' where nothing does."""
    if not sees_wall(seen):
        return "the network sees no wall where the other way finds one"
    return _network_doubt(other, seen) or _ways_difference(other, seen)


def sees_wall(seen: SeenWall) -> bool:
    """Return whether the network sees a wall at all."""
    return int(np.count_nonzero(seen.there)) >= LEAST_SHAPE // 2


def _network_doubt(other: Segmentation, seen: SeenWall) -> str:
    """Return what makes the network's wall doubtful, '' where it is sure of it, or `find_wall` sees the same end."""
    thickness = seen.inner_row - seen.outer_row
    unsure = seen.there & (seen.inner_row < other.rows - 1.0) & (seen.inner_sd > UNSURE_THICKNESS * thickness)
    if other.inner_found:
        off = np.abs(seen.inner_row - other.inner_row[seen.frame_column])
        unsure &= ~(off <= np.maximum(seen.step_rows, CONFIRMED_THICKNESS * thickness))  # NaN: it sees no wall
    share = np.count_nonzero(unsure) / np.count_nonzero(seen.there)
    if share > UNSURE_SHARE:
        return f"the network does not know where the wall ends, in {share:.0%} of its columns"
    return ""


def _ways_difference(other: Segmentation, seen: SeenWall) -> str:
    """Return by how much both ways differ, '' where they may be that unsure."""
    at = seen.frame_column
    both, either = _columns(other, seen)
    if np.count_nonzero(either & ~both) > UNSEEN_SHARE * np.count_nonzero(either):
        return _sentence("one sees wall where the other does not", either & ~both, either)
    off = np.abs(seen.outer_row - other.outer_row[at])
    differs = both & (off > SDS * np.hypot(seen.outer_sd, OTHER_ROWS))
    if np.count_nonzero(differs) > DIFFERING_SHARE * np.count_nonzero(both):
        return _sentence(f"its surface lies up to {off[differs].max():.0f} rows apart", differs, both)
    if not other.inner_found:
        return ""
    off = np.abs(seen.inner_row - other.inner_row[at])
    unsure = np.hypot(seen.inner_sd, OTHER_INNER_SHARE * (seen.inner_row - seen.outer_row))
    differs = both & (off > SDS * np.maximum(unsure, OTHER_ROWS)) & (other.inner_row[at] < other.rows)
    if np.count_nonzero(differs) > DIFFERING_SHARE * np.count_nonzero(both):
        return _sentence(f"its inner boundary lies up to {off[differs].max():.0f} rows apart", differs, both)
    return ""


def _columns(other: Segmentation, seen: SeenWall) -> tuple[Mask, Mask]:
    """Return in which of the network's columns both ways see wall, and in which either does.

    What a needle hides counts for neither: `find_wall` has no boundaries there, the network may guess them.
    """
    there = np.isfinite(other.outer_row[seen.frame_column])
    either = seen.there | there
    if other.needle is not None:
        first, after = other.needle.hidden
        either &= (seen.frame_column < first) | (seen.frame_column >= after)
    return seen.there & there, either


def _within(off: NDArray[np.float64], sd: NDArray[np.float64], step_rows: float) -> Mask:
    within: Mask = np.abs(off) <= SAME_SDS * np.maximum(sd, step_rows)
    return within


def _sentence(what: str, where: Mask, among: Mask) -> str:
    share = np.count_nonzero(where) / np.count_nonzero(among)
    return f"two ways to find the wall differ: {what}, in {share:.0%} of its columns"
