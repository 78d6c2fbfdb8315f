from itertools import product

import numpy as np
import pytest

from scleraforce.imaging.segmentation_path import best_path


@pytest.mark.parametrize("reach", [1, 2, 5])
def test_the_path_is_the_best_of_all_paths(reach: int) -> None:
    score = np.random.default_rng(reach).random((6, 5)).astype(np.float32)
    allowed = (path for path in product(range(5), repeat=6) if np.abs(np.diff(path)).max() <= reach)
    best = max(allowed, key=lambda path: score[np.arange(6), list(path)].sum())
    np.testing.assert_array_equal(best_path(score, reach), best)


def test_one_column_has_its_best_row() -> None:
    assert best_path(np.array([[1, 5, 2]], dtype=np.float32), 1).tolist() == [1]
