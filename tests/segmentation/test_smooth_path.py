"""The path whose steps cost is the best one of all: compared with all of them."""

from itertools import product

import numpy as np
import pytest

from scleraforce.segmentation.wall_finder import smooth_path


@pytest.mark.parametrize("seed", range(6))
def test_no_other_path_has_a_larger_sum(seed: int) -> None:
    rng = np.random.default_rng(seed)
    score, cost = rng.normal(size=(5, 4)).astype(np.float32), rng.uniform(0.0, 1.0, 4).astype(np.float32)

    def total(path: tuple[int, ...]) -> float:
        return float(score[np.arange(5), path].sum() - (cost * np.abs(np.diff(path))).sum())

    best = max(product(range(4), repeat=5), key=total)
    assert tuple(smooth_path(score, cost)) == best


def test_steps_that_cost_nothing_leave_the_best_rows() -> None:
    score = np.random.default_rng(0).normal(size=(30, 12)).astype(np.float32)
    assert np.array_equal(smooth_path(score, np.zeros(29, dtype=np.float32)), score.argmax(axis=1))


def test_a_step_is_free_where_its_cost_is_nothing() -> None:
    score = np.zeros((6, 20), dtype=np.float32)
    score[:3, 2], score[3:, 15] = 1.0, 1.0
    cost = np.full(5, 10.0, dtype=np.float32)
    assert len(set(smooth_path(score, cost).tolist())) == 1
    cost[2] = 0.0
    assert smooth_path(score, cost).tolist() == [2, 2, 2, 15, 15, 15]
