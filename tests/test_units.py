"""Conversions between human units and SI: rounded once, the same for numbers and arrays."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from scleraforce.units import SI_PER_UNIT, HumanUnit, from_si, to_si

UNITS = sorted(SI_PER_UNIT)
POWERS_OF_TEN = {"mm": -3, "um": -6, "mpa": 6, "percent": -2, "mm2": -6, "gb": 9}


@given(st.sampled_from(sorted(POWERS_OF_TEN)), st.integers(-(2**53), 2**53))
def test_a_whole_number_comes_to_si_as_if_it_were_written_there(unit: HumanUnit, number: int) -> None:
    """So 400 um are 4e-4 m; a product with 1e-6 has a last digit of its own."""
    assert to_si(float(number), unit) == float(f"{number}e{POWERS_OF_TEN[unit]}")


@given(st.sampled_from(UNITS), st.floats(-1e9, 1e9))
def test_the_way_back_from_si_returns_the_number(unit: HumanUnit, number: float) -> None:
    assert from_si(to_si(number, unit), unit) == pytest.approx(number, rel=1e-15, abs=1e-300)


def test_an_array_converts_as_its_numbers_do() -> None:
    for unit in UNITS:
        values = np.random.default_rng(0).normal(size=(3, 100))
        for convert in (to_si, from_si):
            one_by_one = [[convert(float(value), unit) for value in row] for row in values]
            np.testing.assert_array_equal(convert(values, unit), one_by_one)
            assert convert(values.astype(np.float32), unit).dtype == np.float32
            assert convert(None, unit) is None
