"""Which columns of a drawn frame show where the wall is: a wall that nobody can see is no truth to learn from."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.scenes.window import Curve
from scleraforce.recording.pixels import Pixels

BAND_SHARE, BAND_ROWS = 0.05, 4  # of the frame's rows above and below a boundary that are compared, and at least
ACROSS_SHARE = 0.04  # of the columns whose mean is looked at
LEAST_STEP = 0.5  # in standard deviations of a pixel on the boundary's dark side
LEAST_LEVEL = 0.02  # ... and of the level of bright tissue
BRIGHT_SHARE = 0.99  # of the pixels are darker than bright tissue
GAP_SHARE = 0.15  # of the columns: a narrower gap is bridged by what is seen on both sides
LEAST_RUN = 0.04  # of the columns: fewer side by side are chance
LEAST_SEEN = 0.1  # of the columns: a frame that shows less shows no wall


def judged_columns(
    frame: Pixels, surface: Curve, outer: Curve, inner: Curve
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which columns show wall, and for which it is certain whether they do, both (column,).

    Not certain: the wall is there, but nobody can tell where, or whether it is.

    Args:
        frame: counts, shape (row, column).
        surface: row at which light enters the tissue, (column,), NaN without.
        outer: upper boundary of the wall, NaN without.
        inner: lower boundary.
    """
    there = np.isfinite(outer)
    seen = there & _bridged(seen_columns(frame, surface, inner))
    if np.count_nonzero(seen) < LEAST_SEEN * len(seen):
        return np.zeros(len(seen), dtype=np.bool_), np.ones(len(seen), dtype=np.bool_)
    return seen, seen | ~there


def seen_columns(frame: Pixels, surface: Curve, inner: Curve) -> NDArray[np.bool_]:
    """Return in which columns it is brighter below the tissue's surface than above, or above the wall's end than below.

    Args:
        frame: counts, shape (row, column).
        surface: row at which light enters the tissue, (column,), NaN without.
        inner: lower boundary of the wall.
    """
    rows = max(BAND_ROWS, round(BAND_SHARE * len(frame)))
    least = LEAST_LEVEL * float(np.quantile(frame, BRIGHT_SHARE))
    return _steps(frame, surface, rows, 1, least) | _steps(frame, inner, rows, -1, least)


def _steps(frame: Pixels, boundary: Curve, rows: int, bright_side: int, least: float) -> NDArray[np.bool_]:
    """Return where the frame is brighter on one side of a boundary (1: below it) than on the other, (column,)."""
    start = np.nan_to_num(np.ceil(boundary), nan=-1e6, posinf=-1e6, neginf=-1e6)
    off = np.arange(1, rows + 1)[:, None]
    below, above = start + off, start - 1 - off  # a row on each side of the boundary is left out
    inside = (above[-1] >= 0) & (below[-1] < len(frame))
    column = np.arange(frame.shape[1])
    levels, spreads = [], []
    for band in (below, above)[::bright_side]:
        counts = frame[np.clip(band, 0, len(frame) - 1).astype(np.intp), column].astype(np.float64)
        levels.append(_across(counts.mean(axis=0)))
        spreads.append(np.sqrt(_across(counts.var(axis=0))))
    bright, dark = levels
    seen: NDArray[np.bool_] = inside & (bright - dark > np.maximum(LEAST_STEP * spreads[1], least))
    return seen


def _across(values: Curve) -> Curve:
    """Return the means over neighbouring columns."""
    width = 2 * round(ACROSS_SHARE * len(values) / 2) + 1
    mean: Curve = np.convolve(np.pad(values, width // 2, mode="edge"), np.full(width, 1.0 / width), mode="valid")
    return mean


def _bridged(seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return `seen` without short runs, and with the narrower gaps between the others closed."""
    kept = seen.copy()
    for start, end in _runs(seen):
        kept[start:end] = end - start >= LEAST_RUN * len(seen)
    for start, end in _runs(~kept):
        if start > 0 and end < len(kept) and end - start <= GAP_SHARE * len(kept):
            kept[start:end] = True
    return kept


def _runs(values: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last + 1 of each run of True.

    >>> _runs(np.array([True, False, True, True]))
    [(0, 1), (2, 4)]
    """
    change = np.diff(np.concatenate([[0], values.astype(np.int8), [0]]))
    return list(zip(np.flatnonzero(change == 1).tolist(), np.flatnonzero(change == -1).tolist(), strict=True))
