"""Units, bounds and sampled values of a study's fields."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from scleraforce.errors import StudyError
from scleraforce.study import Choice, LibraryStudy, Range, fixed
from scleraforce.study.fields import Unit
from scleraforce.units import SI_PER_UNIT


@given(st.sampled_from(sorted(SI_PER_UNIT)), st.integers(-99_999, 99_999), st.integers(-3, 3))
def test_a_short_decimal_survives_the_way_to_si_and_back(name: str, digits: int, exponent: int) -> None:
    human = float(f"{digits}e{exponent}")
    unit = Unit(name)
    assert unit.from_si(unit.to_si(human)) == human


def test_samples_follow_their_distribution_and_the_generator() -> None:
    values = Range(min=2.0, max=3.0).sample(np.random.default_rng(1), 1000)
    assert values.shape == (1000,)
    assert 2.0 <= values.min() < 2.01
    assert 2.99 < values.max() <= 3.0
    np.testing.assert_array_equal(values, Range(min=2.0, max=3.0).sample(np.random.default_rng(1), 1000))
    values, counts = np.unique(Choice((1.0, 5.0, 9.0)).sample(np.random.default_rng(0), 3000), return_counts=True)
    assert values.tolist() == [1.0, 5.0, 9.0]
    assert np.all(np.abs(counts - 1000) < 4 * np.sqrt(3000 * 2 / 9))


def test_stiffenings_of_a_library_are_one_or_enough_for_splines_over_a_range() -> None:
    for count in [2, 3]:
        with pytest.raises(StudyError, match=rf"^stiffenings: {count}; give 1, or at least 4$"):
            LibraryStudy(stiffenings=count)
    with pytest.raises(StudyError, match=r"^stiffening: a range has to be given.*stiffenings = 1$"):
        LibraryStudy(stiffening=fixed(5.0))
    held = Range(min=2.0, max=20.0)
    assert LibraryStudy(stiffening=held).stiffening_ends == (2.0, 20.0)
    assert LibraryStudy(stiffening=held, stiffenings=1).stiffening_ends == (2.0, 2.0)
