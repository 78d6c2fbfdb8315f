"""A wall finder whose network is told what to answer: boundaries in rows of the reduced frame."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from scleraforce.segmentation.wall_finder import FINDER_FRAMES, FINDER_ROWS, FINDER_WALL, WallFinder
from scleraforce.study import WallFinderStudy

__all__ = ["STUDY", "distributions", "told_finder"]

STUDY = WallFinderStudy()


class ToldSession:
    """What `WallFinder` uses of a session of ONNX Runtime."""

    def __init__(self, rows: np.ndarray, wall: np.ndarray) -> None:
        self._answers = [rows[None].astype(np.float32), wall[None].astype(np.float32)]

    def get_inputs(self) -> list[Any]:
        return [SimpleNamespace(name=FINDER_FRAMES, type="tensor(float)", shape=["n", STUDY.rows, STUDY.columns])]

    def get_outputs(self) -> list[Any]:
        half = STUDY.columns // 2
        return [
            SimpleNamespace(name=FINDER_ROWS, type="tensor(float)", shape=["n", 2, STUDY.rows, half]),
            SimpleNamespace(name=FINDER_WALL, type="tensor(float)", shape=["n", half]),
        ]

    def run(self, _outputs: list[str], _inputs: dict[str, np.ndarray]) -> list[np.ndarray]:
        return self._answers


def distributions(boundary: np.ndarray, sd: float = 0.6) -> np.ndarray:
    """Distributions over rows (row, column) about a boundary (column,); NaN: even."""
    row = np.arange(STUDY.rows)[:, None]
    mean = np.nan_to_num(boundary, nan=-1e6)
    log = -np.minimum((row - mean) ** 2 / (2 * sd**2), 80.0)
    weight = np.exp(log - log.max(axis=0))
    return weight / weight.sum(axis=0)


def told_finder(outer: np.ndarray, inner: np.ndarray, sd: float = 0.6) -> WallFinder:
    """A wall finder that answers with boundaries, (column / 2,), in rows of the reduced frame; NaN: no wall."""
    rows = np.stack([distributions(outer, sd), distributions(inner, sd)])
    return WallFinder(ToldSession(rows, np.isfinite(outer).astype(float)), STUDY, "told")
