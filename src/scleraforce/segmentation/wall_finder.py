"""The wall as a network sees it that learned from drawn scenes: both boundaries with their uncertainty, or none.

It looks at the reduced frame, without its scale. Its answers are distributions over rows; the boundary is the path of
the likeliest rows, moved to the mean of the rows near it, and its uncertainty the spread of all of them.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import onnxruntime  # type: ignore[import-untyped]  # it ships no types
from numpy.typing import NDArray

from scleraforce.models.session import check_interface, run_network
from scleraforce.recording.pixels import Pixels
from scleraforce.segmentation.path import best_path
from scleraforce.segmentation.reduced import reduced_columns, reduced_frame
from scleraforce.study import WallFinderStudy

__all__ = ["FINDER_FRAMES", "FINDER_ROWS", "FINDER_WALL", "SeenWall", "WallFinder"]

FINDER_FRAMES, FINDER_ROWS, FINDER_WALL = "frames", "rows", "wall"  # input and outputs of the network

Curve = NDArray[np.float64]

REACH_ROWS = 16  # largest step of a boundary between answers, in rows of the reduced frame
NEAR_ROWS = 3  # of the likeliest row: these are averaged
LEAST_PROBABILITY = 1e-6  # of a row: no path is ruled out by less
LEAST_SPREAD_ROWS = 0.3  # of a boundary: a row of the reduced frame is no finer
EDGE_ROWS = 0.6  # a boundary so near the first or the last row lies beyond the frame: its truth was put there
SURE_WALL = 0.5  # probability from which on a column has wall


@dataclass(frozen=True)
class SeenWall:
    """The wall in a frame, at evenly spaced columns (point,); rows are those of pixel centres.

    `column`; `outer_row`, `inner_row`; `outer_sd`, `inner_sd`: their uncertainty, rows; `there`: whether there is wall.
    Where there is none the rows say nothing.
    """

    column: Curve
    outer_row: Curve
    inner_row: Curve
    outer_sd: Curve
    inner_sd: Curve
    there: NDArray[np.bool_]

    def there_at(self, column: NDArray[Any]) -> NDArray[np.bool_]:
        """Return whether the nearest point to each column has wall."""
        there: NDArray[np.bool_] = self.there[np.abs(self.column[None] - column[:, None]).argmin(axis=1)]
        return there


class WallFinder:
    """A network that ONNX Runtime runs: `frames` float32 (n, row, column) in, `rows` and `wall` out.

    `rows` float32 (n, 2, row, column / 2) are probabilities over the rows, of the upper and the lower boundary; `wall`
    float32 (n, column / 2) is the probability that a column has wall.

    Raises:
        ModelError: the network has other inputs or outputs than its study asks for; names `place`.
    """

    def __init__(self, session: onnxruntime.InferenceSession, study: WallFinderStudy, place: str) -> None:
        self.session = session
        self._study, self._place = study, place
        self._check()

    def find(self, frame: Pixels) -> SeenWall:
        """Return the wall that the network sees in a frame of counts (row, column).

        Raises:
            ModelError: the network cannot be run, or its answers are not finite.
        """
        rows, columns = self._study.rows, self._study.columns
        small = reduced_frame(frame, rows, columns)[None]
        probability, wall = run_network(self.session, [FINDER_ROWS, FINDER_WALL], {FINDER_FRAMES: small}, self._place)
        there = wall[0] >= SURE_WALL
        (outer, outer_sd), (inner, inner_sd) = (_boundary(probability[0, n], wall[0]) for n in (0, 1))
        outer, inner = _beyond(outer, outer < EDGE_ROWS, -1.0), _beyond(inner, inner > rows - 1.0 - EDGE_ROWS, rows)
        stretch = frame.shape[0] / rows
        return SeenWall(
            reduced_columns(frame.shape[1], columns // 2),
            (outer + 0.5) * stretch - 0.5,
            (inner + 0.5) * stretch - 0.5,
            outer_sd * stretch,
            inner_sd * stretch,
            there & (inner > outer),
        )

    def _check(self) -> None:
        rows, columns = self._study.rows, self._study.columns
        outputs = {
            FINDER_ROWS: ("tensor(float)", [2, rows, columns // 2]),
            FINDER_WALL: ("tensor(float)", [columns // 2]),
        }
        check_interface(self.session, {FINDER_FRAMES: ("tensor(float)", [rows, columns])}, outputs, self._place)


def _beyond(boundary: Curve, outside: NDArray[np.bool_], row: float) -> Curve:
    """Return a boundary that has a row beyond the frame where it lies outside."""
    moved: Curve = np.where(outside, row, boundary)
    return moved


def _boundary(probability: NDArray[np.float32], wall: NDArray[np.float32]) -> tuple[Curve, Curve]:
    """Return a boundary's rows and their standard deviations, (column,), from its rows' probabilities (row, column).

    Columns without wall do not hold the path.
    """
    score = np.log(np.maximum(probability.T, np.float32(LEAST_PROBABILITY))) * wall[:, None]
    path = best_path(np.ascontiguousarray(score, dtype=np.float32), REACH_ROWS)
    off = np.arange(-NEAR_ROWS, NEAR_ROWS + 1)[:, None]
    near = np.clip(path + off, 0, len(probability) - 1)
    weight = probability[near, np.arange(len(path))].astype(np.float64)
    weight += LEAST_PROBABILITY  # where nothing speaks for these rows, the path's own
    mean: Curve = (weight * near).sum(axis=0) / weight.sum(axis=0)
    row = np.arange(len(probability), dtype=np.float32)
    first, second = row @ probability, np.square(row) @ probability  # moments of all rows
    spread = np.sqrt(np.maximum(second - 2.0 * mean * first + mean**2, 0.0))
    return mean, np.maximum(spread, LEAST_SPREAD_ROWS)
