"""Rows in a reduced basis: within the largest error, of as few parts as there are functions in them."""

import numpy as np
import pytest

from scleraforce.errors import InputError
from scleraforce.library.stiffened import STEP_TYPES, reduce_rows

PLACES = np.linspace(0.0, 1.0, 70)
WIDTHS = np.linspace(0.1, 1.0, 150)  # two blocks of rows and a rest
BUMPS = 1e-2 * np.exp(-((PLACES / WIDTHS[:, None]) ** 2))


def test_no_value_is_off_by_more_than_the_largest_error():
    for largest_error in (1e-4, 1e-6, 1e-7):
        reduced = reduce_rows(BUMPS, largest_error)
        assert np.abs(reduced.rows() - BUMPS).max() <= largest_error
        assert len(reduced.basis_kv) < 15
    with pytest.raises(InputError, match=r"values up to 10 cannot be stored by such small steps"):
        reduce_rows(1e3 * BUMPS, 1e-9)


def test_rounding_at_many_parts_does_not_add_up():
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(150, 70)) * np.geomspace(1.0, 1e-6, 70) @ np.linalg.qr(rng.normal(size=(70, 70)))[0]
    reduced = reduce_rows(rows, 1e-5)
    assert len(reduced.basis_kv) > 50
    assert np.abs(reduced.rows() - rows).max() <= 1e-5


def test_rows_of_three_functions_have_three_parts():
    functions = np.stack([np.ones(70), PLACES, np.sin(9.0 * PLACES)])
    rows = np.random.default_rng(0).normal(size=(150, 3)) @ functions
    reduced = reduce_rows(rows, 1e-4)
    assert reduced.basis_kv.shape == (3, 70)
    assert reduced.rows() == pytest.approx(rows, abs=1e-4)


def test_numbers_have_the_smallest_type_that_holds_them():
    sizes = np.array([0.3, 3e-4, 3e-6])  # 6e6, 6e3 and 60 steps of 5e-8
    rows = np.linspace(-1.0, 1.0, 150)[:, None] ** [1, 2, 3] * sizes @ np.eye(3, 70)
    reduced = reduce_rows(rows, 1e-7)
    assert [part.dtype.name for part in reduced.steps] == list(STEP_TYPES)
    assert [part.shape for part in reduced.steps] == [(150, 1)] * 3
    assert all(np.abs(part).max() <= np.iinfo(part.dtype).max for part in reduced.steps)
    assert np.abs(reduced.rows() - rows).max() <= 1e-7


def test_a_mix_of_equal_parts_of_the_rows_is_their_sum_by_weights():
    reduced = reduce_rows(BUMPS * np.array([1.0, 0.1, 1e-3]).repeat(50)[:, None], 1e-7)
    assert sum(part.shape[1] > 0 for part in reduced.steps) > 1  # more than one type of steps
    for weights in ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [-0.1, 0.9, 0.2]):
        naive = sum(weight * part for weight, part in zip(weights, reduced.rows().reshape(3, 50, 70), strict=True))
        assert reduced.mixed_rows(np.array(weights)) == pytest.approx(naive, rel=1e-12, abs=1e-15)
