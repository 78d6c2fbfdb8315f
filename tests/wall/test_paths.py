"""The paths against dynamic programming written out and brute force; an opening against
each row's window.
"""

from itertools import product

import numpy as np
import pytest

from scleraforce.wall.shared_loops import best_path, open_rows
from scleraforce.wall.wall_network import smooth_path


def naive_best_path(score: np.ndarray, reach: int) -> np.ndarray:
    """Viterbi's algorithm, state by state."""
    columns, rows = score.shape
    total = score[0].astype(np.float64)
    came_from = np.zeros((columns, rows), dtype=int)

    for column in range(1, columns):
        before = [
            max(
                range(max(0, r - reach), min(rows, r + reach + 1)),
                key=total.__getitem__,
            )
            for r in range(rows)
        ]
        came_from[column] = before
        total = score[column] + total[before]

    path = [int(total.argmax())]
    for column in range(columns - 1, 0, -1):
        path.append(came_from[column, path[-1]])

    return np.array(path[::-1])


@pytest.mark.parametrize("astray", [0, 1, 3, 20])
@pytest.mark.parametrize("reach", [1, 2, 3, 5])
def test_columns_whose_best_rows_lie_astray_do_not_lead_the_path_astray(
    astray: int, reach: int
) -> None:
    assert best_path(np.array([[1, 5, 2]], dtype=np.float32), reach).tolist() == [1]
    for seed in range(12):
        check_path(astray, reach, np.random.default_rng(seed))


def check_path(astray: int, reach: int, rng: np.random.Generator) -> None:
    columns = 32
    rows = 40
    ridge = np.rint(20 + 12 * np.sin(np.arange(columns) / 6)).astype(int)
    score = rng.random((columns, rows)).astype(np.float32)
    score[np.arange(columns), ridge] += 1.0

    for column in rng.choice(columns, astray, replace=False):
        score[column, rng.integers(rows)] += rng.choice([1.5, 3.0])

    np.testing.assert_array_equal(
        best_path(score, reach), naive_best_path(score, reach)
    )


@pytest.mark.parametrize("seed", range(12))
def test_no_other_path_has_a_larger_sum_also_where_steps_are_free(seed: int) -> None:
    rng = np.random.default_rng(seed)
    score = rng.normal(size=(5, 4)).astype(np.float32)
    cost = (rng.uniform(0.0, 1.0, 4) * (rng.random(4) < 0.7)).astype(np.float32)

    def total(path: tuple[int, ...]) -> float:
        return float(
            score[np.arange(5), path].sum() - (cost * np.abs(np.diff(path))).sum()
        )

    best = max(product(range(4), repeat=5), key=total)
    assert tuple(smooth_path(score, cost)) == best


@pytest.mark.parametrize("window", [2, 3, 8, 12, 13, 40])
@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_an_opening_is_the_largest_of_the_smallest_in_each_window(
    window: int, dtype: type
) -> None:
    values: np.ndarray = (
        np.random.default_rng(window).integers(0, 60_000, (25, 7)).astype(dtype)
    )
    spans = [
        slice(max(0, row - window // 2), row - window // 2 + window)
        for row in range(len(values))
    ]
    smallest = np.array([values[span].min(axis=0) for span in spans])
    expected = np.array([smallest[span].max(axis=0) for span in spans])
    open_rows(values, window)
    np.testing.assert_array_equal(values, expected)
