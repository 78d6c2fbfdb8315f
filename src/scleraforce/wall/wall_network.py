"""The wall as a network sees it that learned from drawn scenes: both boundaries with
their uncertainty, or none.

It looks at the reduced frame, without its scale, and a second time at the rows about
the wall, which then are larger. Its answers are distributions over rows. The upper
boundary is the path of the likeliest rows, the lower one that of the likeliest
thicknesses below it, whose changes cost; both are moved to the mean of the rows near
them, and their uncertainty is the spread of all rows.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, cast

import cv2
import numpy as np
import onnxruntime  # type: ignore[import-untyped]  # it ships no types
from numpy.typing import NDArray

from scleraforce.base.arrays import Flags, Floats, Places, Reals, Singles
from scleraforce.base.onnx_network import check_interface, run_network
from scleraforce.records.frame import Pixels
from scleraforce.records.model_folder import Origin
from scleraforce.records.scan import PixelScale
from scleraforce.records.study import RawReaderStudy, WallFinderStudy
from scleraforce.wall.frame_light import LEAST_SHAPE
from scleraforce.wall.shared_loops import best_path
from scleraforce.wall.wall import SeenWall

BLACK_SHARE = 2e-3  # of the brightest pixel: what is darker is not imaged
# share of the pixels that are not black: noise, and what lies below bright tissue
FLOOR_SHARE = 0.2
BRIGHT_SHARE = 0.99
LEAST_LEVEL = -0.5
LARGEST_LEVEL = 1.5
LEAST_CONTRAST = 1e-6  # of the counts of bright tissue


def reduced_frame(frame: Pixels | Singles, rows: int, columns: int) -> Singles:
    """Return the means of a frame with the noise at 0 and bright tissue at 1, (rows,
    columns); 0 without contrast.
    """
    while (
        frame.shape[0] >= 2 * rows
        and frame.shape[1] >= columns
        and not frame.shape[0] % 2
    ):
        # halves: quicker
        frame = cast(
            Pixels,
            cv2.resize(
                frame,
                (frame.shape[1], frame.shape[0] // 2),
                interpolation=cv2.INTER_LINEAR,
            ),
        )

    while (
        frame.shape[1] >= 2 * columns
        and frame.shape[0] >= rows
        and not frame.shape[1] % 2
    ):
        frame = cast(
            Pixels,
            cv2.resize(
                frame,
                (frame.shape[1] // 2, frame.shape[0]),
                interpolation=cv2.INTER_LINEAR,
            ),
        )

    smaller = frame.shape[0] >= rows and frame.shape[1] >= columns
    method = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
    small: Singles = cv2.resize(frame, (columns, rows), interpolation=method).astype(
        np.float32
    )

    lit = small[small > float(small.max()) * np.float32(BLACK_SHARE)]
    if not len(lit):
        return np.zeros((rows, columns), dtype=np.float32)

    low_nth, high_nth = (
        int(share * (len(lit) - 1)) for share in (FLOOR_SHARE, BRIGHT_SHARE)
    )
    ordered = np.partition(lit, (low_nth, high_nth))
    low = float(ordered[low_nth])

    high = float(ordered[high_nth])
    if high - low <= LEAST_CONTRAST * max(high, 1.0):
        return np.zeros((rows, columns), dtype=np.float32)

    return np.clip(
        (small - np.float32(low)) / np.float32(high - low), LEAST_LEVEL, LARGEST_LEVEL
    )


def reduced_columns(columns: int, answers: int) -> Floats:
    """Return the columns of a frame, as fractions, of `answers` evenly spaced columns,
    shape (answers,).

    >>> reduced_columns(8, 4)
    array([0.5, 2.5, 4.5, 6.5])
    """
    return (np.arange(answers) + 0.5) * columns / answers - 0.5


@dataclass(frozen=True, kw_only=True)
class FrameWindow:
    """Cells of `row_m` x `column_m` about the frame's middle column, from its upper
    edge downwards.
    """

    rows: int
    columns: int
    row_m: float
    column_m: float

    @classmethod
    def of(cls, study: RawReaderStudy) -> "FrameWindow":
        """Return the window of a raw reader."""
        return cls(
            rows=study.rows,
            columns=study.columns,
            row_m=study.row_m,
            column_m=study.column_m,
        )

    @property
    def laterals_m(self) -> Floats:
        """Centres of the columns, m from the middle, (column,)."""
        return np.asarray(
            (np.arange(self.columns) + 0.5 - 0.5 * self.columns) * self.column_m
        )

    def means(self, frame: Pixels, scale: PixelScale) -> Singles:
        """Return the mean count of each cell, (row, column); 0 where the frame does not
        reach.

        >>> window = FrameWindow(rows=2, columns=2, row_m=2e-6, column_m=1e-6)
        >>> frame = np.array([[1, 2, 3], [3, 4, 5]], dtype=np.uint16)
        >>> window.means(frame, PixelScale(lateral_m=1e-6, depth_m=1e-6))
        array([[2.5, 3.5],
               [0. , 0. ]], dtype=float32)
        """
        rows_at = np.arange(self.rows + 1) * (self.row_m / scale.depth_m)
        columns_at = 0.5 * frame.shape[1] + (
            np.arange(self.columns + 1) - 0.5 * self.columns
        ) * (self.column_m / scale.lateral_m)
        return _means_between(columns_at, _means_between(rows_at, frame).T).T

    def reduced(self, frame: Pixels, scale: PixelScale) -> Singles:
        """Return the cells of a frame as a network sees them, (row, column)."""
        return reduced_frame(self.means(frame, scale), self.rows, self.columns)


def _means_between(edges: Reals, values: NDArray[Any]) -> Singles:
    """Return the means (cell, column) of rows (row, column) between increasing edges
    (cell + 1,), 0 beyond the rows.
    """
    inside = np.clip(edges, 0.0, len(values))
    whole = inside.astype(np.intp)
    padded = np.concatenate(
        [values, np.zeros((1, values.shape[1]), dtype=values.dtype)]
    ).astype(np.float32)
    sums = np.add.reduceat(padded, whole, axis=0)[:-1]
    sums[np.diff(whole) == 0] = 0.0
    part = (inside - whole).astype(np.float32)[:, None] * padded[whole]
    width = np.maximum(np.diff(inside), 1e-9).astype(np.float32)

    return ((sums + np.diff(part, axis=0)) / width[:, None]).astype(
        np.float32, copy=False
    )


# input and outputs of the network
FINDER_FRAMES = "frames"
FINDER_ROWS = "rows"
FINDER_WALL = "wall"

# largest step of a boundary between answers, in rows of the reduced frame
REACH_ROWS = 16
# cost of a row's change of thickness between answers, in logarithms of probability
THICKNESS_COST = 0.6
THIN_BONUS = 0.05  # in the same: what makes the path unique where nothing is seen
NEAR_ROWS = 3  # of the likeliest row: these are averaged
SPIKE = 5  # neighbouring answers of a boundary that a median is taken of
MEANS = 2  # times, about the mean before: the path may lie beside the likeliest row
LEAST_PROBABILITY = 1e-6  # of a row: no path is ruled out by less
LEAST_THICKNESS_ROWS = 0.5  # of a wall, in rows of the reduced frame
LEAST_SPREAD_ROWS = 0.3  # of a boundary: no finer than a row of the reduced frame
# a boundary so near the first or the last row lies beyond the frame: its truth was put
# there
EDGE_ROWS = 0.6
SURE_WALL = 0.5  # probability from which on a column has wall
FILLED_SHARE = 0.85  # of the rows: no second look
BEYOND_SHARE = 0.15  # of the wall's rows, shown beyond it
# what a second look may change: the least share of columns in common, and the largest
# shift in thicknesses
SAME_COLUMNS_SHARE = 0.8
MOVED_THICKNESS = 0.3


class WallFinder:
    """A network that ONNX Runtime runs: `frames` float32 (n, row, column) in, `rows`
    and `wall` out.

    `rows` (n, 2, row, column / 2): probabilities of either boundary; `wall` (n, column
    / 2): that a column has wall. `origin`: its folder; None: it was not loaded.
    """

    origin: Origin | None = None

    def __init__(
        self, session: onnxruntime.InferenceSession, study: WallFinderStudy, place: str
    ) -> None:
        self.session = session
        self._study = study
        self._place = place
        frames = [study.rows, study.columns]
        walls = [study.columns // 2]
        outputs = {
            FINDER_ROWS: ("tensor(float)", [2, study.rows, *walls]),
            FINDER_WALL: ("tensor(float)", walls),
        }
        check_interface(
            session, {FINDER_FRAMES: ("tensor(float)", frames)}, outputs, place
        )

    def find(self, frame: Pixels) -> SeenWall:
        """Return the wall that the network sees in a frame of counts (row, column);
        raises `ModelError`.
        """
        first = self._look(frame, 0, len(frame))
        if not first.there.any():
            return first

        rows = rows_about(
            first.outer_row[first.there], first.inner_row[first.there], len(frame)
        )
        if rows is None:
            return first

        second = self._look(frame, *rows)
        both = first.there & second.there

        either = first.there | second.there
        if (
            np.count_nonzero(both) < SAME_COLUMNS_SHARE * np.count_nonzero(either)
            or not both.any()
        ):
            return first

        moved = np.median(np.abs(second.outer_row - first.outer_row)[both])
        same = moved < MOVED_THICKNESS * np.median(
            (first.inner_row - first.outer_row)[both]
        )

        return second if same else first

    def _look(self, frame: Pixels, top: int, bottom: int) -> SeenWall:
        """Return the wall that the network sees between two rows of a frame."""
        rows = self._study.rows
        columns = self._study.columns
        small = reduced_frame(frame[top:bottom], rows, columns)[None]
        probability, wall = run_network(
            self.session,
            [FINDER_ROWS, FINDER_WALL],
            {FINDER_FRAMES: small},
            self._place,
        )
        there = wall[0] >= SURE_WALL
        paths = _paths(probability[0], wall[0])
        (outer, outer_sd), (inner, inner_sd) = map(_moved, probability[0], paths)
        outer = _without_spikes(outer, there)
        inner = _without_spikes(inner, there)

        if top == 0:
            outer = np.where(outer < EDGE_ROWS, -1.0, outer)
        if bottom == len(frame):
            inner = np.where(inner > rows - 1.0 - EDGE_ROWS, rows, inner)

        stretch = (bottom - top) / rows
        there = there & (inner - outer > LEAST_THICKNESS_ROWS)
        at = reduced_columns(frame.shape[1], columns // 2)
        rows_sd = (outer_sd * stretch, inner_sd * stretch)
        outer_row, inner_row = (
            top + (row + 0.5) * stretch - 0.5 for row in (outer, inner)
        )

        return SeenWall(at, outer_row, inner_row, *rows_sd, there, stretch)


def rows_about(
    outer_row: Floats, inner_row: Floats, rows: int, share: float = BEYOND_SHARE
) -> tuple[int, int] | None:
    """Return the rows about a wall, and a share of them beyond, for a second look;
    None: it fills the frame.
    """
    first = max(float(outer_row.min()), 0.0)
    last = min(float(inner_row.max()), rows - 1.0)
    beyond = share * (last - first)
    top = max(int(first - beyond), 0)
    bottom = min(int(last + beyond) + 2, rows)
    return (top, bottom) if LEAST_SHAPE <= bottom - top < FILLED_SHARE * rows else None


def _paths(probability: Singles, wall: Singles) -> tuple[Places, Places]:
    """Return the paths of both boundaries, (column,), from their rows' probabilities
    (2, row, column).

    Columns without wall do not constrain them; where the upper boundary is above the
    frame the thickness is free.
    """
    score = (
        np.log(np.maximum(probability, np.float32(LEAST_PROBABILITY))).transpose(
            0, 2, 1
        )
        * wall[:, None]
    )
    outer = best_path(np.ascontiguousarray(score[0]), REACH_ROWS)
    rows = np.minimum(outer[:, None] + np.arange(score.shape[2]), score.shape[2] - 1)
    inside = (outer > 0).astype(np.float32)
    cost = np.float32(THICKNESS_COST) * np.minimum(inside[1:], inside[:-1])
    of_thickness = np.take_along_axis(score[1], rows, axis=1)
    of_thickness -= np.linspace(
        0.0, THIN_BONUS, of_thickness.shape[1], dtype=np.float32
    )
    thickness = smooth_path(of_thickness, cost)

    return outer, np.minimum(outer + thickness, score.shape[2] - 1)


def _moved(probability: Singles, path: Places) -> tuple[Floats, Floats]:
    """Return a boundary's rows near a path and their standard deviations, (column,), of
    probabilities (row, column).
    """
    off = np.arange(-NEAR_ROWS, NEAR_ROWS + 1)[:, None]
    mean: Floats = path.astype(np.float64)

    for _ in range(MEANS):
        near = np.clip(np.rint(mean).astype(np.intp) + off, 0, len(probability) - 1)
        weight = probability[near, np.arange(len(path))].astype(np.float64)
        # where nothing speaks for these rows, the path's own
        weight += LEAST_PROBABILITY
        mean = (weight * near).sum(axis=0) / weight.sum(axis=0)

    row = np.arange(len(probability), dtype=np.float32)
    # moments of all rows
    first = row @ probability
    second = np.square(row) @ probability
    spread = np.sqrt(np.maximum(second - 2.0 * mean * first + mean**2, 0.0))

    return mean, np.maximum(spread, LEAST_SPREAD_ROWS)


def _without_spikes(row: Floats, there: Flags) -> Floats:
    """Return the running median of a boundary where there is wall: nothing narrower
    than half of `SPIKE` stays.
    """
    if not there.any():
        return row
    at = np.arange(len(row))
    padded = np.pad(np.interp(at, at[there], row[there]), SPIKE // 2, mode="edge")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, SPIKE), axis=1)


def smooth_path(score_cr: Singles, cost: Singles) -> Places:
    """Return the rows (column,) of the path with the largest sum of scores (column,
    row) less the cost of its steps.

    `cost` (column - 1,), not negative, is of a row's step between neighbouring columns.
    Both directions are run at once, as in `best_path`. A step's best beginning is the
    upper envelope of lines that fall by its cost a row (Felzenszwalb and Huttenlocher
    2012, Distance Transforms of Sampled Functions).

    >>> scores = np.array([[0, 9, 0, 0], [0, 1, 0, 5], [0, 4, 0, 0]], dtype=np.float32)
    >>> smooth_path(scores, np.full(2, 3.0))
    array([1, 1, 1])
    """
    columns, rows = score_cr.shape
    total = np.empty((columns, 2, rows), dtype=np.float32)
    total[:, 0] = score_cr
    total[:, 1] = score_cr[::-1]
    fall = np.stack([cost, cost[::-1]], axis=1)[:, :, None].astype(
        np.float32
    ) * np.arange(rows, dtype=np.float32)

    for (before, after), down in zip(pairwise(total), fall, strict=True):
        from_above = np.maximum.accumulate(before + down, axis=1)
        from_above -= down
        from_below = np.maximum.accumulate((before - down)[:, ::-1], axis=1)[:, ::-1]
        from_below += down
        after += np.maximum(from_above, from_below)  # a view of `total`

    through: Singles = total[:, 0] + total[::-1, 1] - score_cr
    path: Places = through.argmax(axis=1)
    return path
