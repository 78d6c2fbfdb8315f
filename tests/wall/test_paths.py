"""Compiled loops against slow and obvious ones: paths against dynamic programming
written out and brute force, an opening against each row's window, the contrast of
pairs against arrays.
"""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, strategies as st

from scleraforce.wall import frame_light
from scleraforce.wall.shared_loops import best_path, open_rows
from scleraforce.wall.wall_network import smooth_path


def naive_best_path(score: np.ndarray, reach: int) -> np.ndarray:
    """Viterbi's algorithm, state by state."""
    columns, rows = score.shape
    total = score[0].astype(np.float64)
    came_from = np.zeros((columns, rows), dtype=int)
    for column in range(1, columns):
        for row in range(rows):
            near = range(max(0, row - reach), min(rows, row + reach + 1))
            came_from[column, row] = max(near, key=total.__getitem__)
        total = score[column] + total[came_from[column]]

    path = [int(total.argmax())]
    for column in range(columns - 1, 0, -1):
        path.append(came_from[column, path[-1]])
    return np.array(path[::-1])


@pytest.mark.parametrize("astray", [0, 1, 3, 20])
@pytest.mark.parametrize("reach", [1, 2, 3, 5])
def test_columns_whose_best_rows_lie_astray_do_not_lead_the_path_astray(astray, reach):
    columns, rows = 32, 40
    ridge = np.rint(20 + 12 * np.sin(np.arange(columns) / 6)).astype(int)
    for seed in range(12):
        rng = np.random.default_rng(seed)
        score = rng.random((columns, rows)).astype(np.float32)
        score[np.arange(columns), ridge] += 1.0
        for column in rng.choice(columns, astray, replace=False):
            score[column, rng.integers(rows)] += rng.choice([1.5, 3.0])
        expected = naive_best_path(score, reach)
        np.testing.assert_array_equal(best_path(score, reach), expected)


@pytest.mark.parametrize("seed", range(12))
def test_no_other_path_has_a_larger_sum_also_where_steps_are_free(seed):
    rng = np.random.default_rng(seed)
    score = rng.normal(size=(5, 4)).astype(np.float32)
    cost = (rng.uniform(0.0, 1.0, 4) * (rng.random(4) < 0.7)).astype(np.float32)

    def total(path: tuple[int, ...]) -> float:
        steps = (cost * np.abs(np.diff(path))).sum()
        return float(score[np.arange(5), path].sum() - steps)

    best = max(product(range(4), repeat=5), key=total)
    assert tuple(smooth_path(score, cost)) == best


@pytest.mark.parametrize("window", [2, 3, 8, 12, 13, 40])
@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_an_opening_is_the_largest_of_the_smallest_in_each_window(window, dtype):
    rng = np.random.default_rng(window)
    values = rng.integers(0, 60_000, (25, 7)).astype(dtype)
    begin = np.arange(25) - window // 2
    spans = [slice(max(0, row), row + window) for row in begin]
    smallest = np.array([values[span].min(axis=0) for span in spans])
    expected = np.array([smallest[span].max(axis=0) for span in spans])
    open_rows(values, window)
    np.testing.assert_array_equal(values, expected)


def contrast_by_arrays(frame: np.ndarray) -> float:
    """Return the median share of a pair's difference in its sum, over its brightest
    tenth, of pixels below the largest count.
    """
    rows = frame[:: max(1, len(frame) // 24)].astype(np.int32)
    counted = (rows > 0) & (rows < frame[::4].max())
    lit = counted[:, 8:] & counted[:, :-8]
    one, other = rows[:, 8:][lit], rows[:, :-8][lit]
    if len(one) < 200:
        return 0.0

    mean = (one + other) >> 1
    brightest = mean >= np.sort(mean)[int(0.9 * len(mean))]
    off = np.abs(one - other)[brightest].astype(np.float32)
    return float(np.median(off / (one + other)[brightest].astype(np.float32)))


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([3, 255, 4095, 65535]),
    st.sampled_from([0.0, 0.3, 0.99]),
)
def test_the_contrast_agrees_with_arrays(seed: int, largest: int, black: float):
    """To the last bit, in frames of any size and light."""
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(16, 300, 2).tolist())
    dtype = np.uint8 if largest < 256 else np.uint16
    frame = rng.integers(0, largest + 1, shape).astype(dtype)
    frame[rng.random(shape) < black] = 0
    assert frame_light.pair_contrast(frame) == contrast_by_arrays(frame)
