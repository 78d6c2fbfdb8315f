"""Values at a place in order, beside sorting."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from scleraforce.wall.shared_loops import count_at, size_at


@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 2, 300, 2**16]))
def test_a_count_at_a_place_is_that_of_sorted_ones(seed: int, levels: int):
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, levels, rng.integers(1, 2000)).astype(np.uint16)
    place = int(rng.integers(len(counts)))
    assert count_at(counts, place) == np.sort(counts)[place]


@given(st.integers(0, 2**32 - 1), st.integers(-30, 30))
def test_a_size_at_a_place_is_that_of_sorted_ones(seed: int, power: int):
    """Of any magnitude, zeros and equal ones among them."""
    rng = np.random.default_rng(seed)
    sizes = (rng.exponential(1.0, rng.integers(1, 2000)) * 10.0**power).astype(
        np.float32
    )
    sizes[rng.random(len(sizes)) < 0.2] = rng.choice(sizes)
    sizes[rng.random(len(sizes)) < 0.2] = 0.0
    place = int(rng.integers(len(sizes)))
    assert size_at(sizes, place) == np.sort(sizes)[place]


@pytest.mark.parametrize("place", [0, 2])
def test_the_ends_are_smallest_and_largest(place: int):
    counts = np.array([7, 65535, 0], np.uint16)
    assert count_at(counts, place) == np.sort(counts)[place]
    sizes = np.array([3.5, np.inf, 0.0], np.float32)
    assert size_at(sizes, place) == np.sort(sizes)[place]
