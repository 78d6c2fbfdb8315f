"""Units, bounds and sampled values of a study's fields."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, strategies as st

from scleraforce.errors import StudyError
from scleraforce.study import Choice, EyeStudy, LibraryStudy, NeedleStudy, Range, Study, fixed
from scleraforce.study.fields import Unit, field_key, field_unit
from scleraforce.units import SI_PER_UNIT


def test_a_key_carries_the_human_unit_and_a_field_the_si_unit() -> None:
    keys = {item.name: field_key(item) for item in fields(EyeStudy)}
    assert (keys["radius_m"], keys["thickness_m"], keys["poisson_ratio"]) == (
        "radius_mm", "thickness_um", "poisson_ratio",
    )  # fmt: skip
    for section in fields(Study):
        for item in fields(getattr(Study(), section.name)):
            unit = field_unit(item).name
            if unit is not None:
                assert item.name.endswith("_" + SI_PER_UNIT[unit][0]), f"{section.name}.{item.name} is in {unit}"


@given(st.sampled_from(sorted(SI_PER_UNIT)), st.integers(-99_999, 99_999), st.integers(-3, 3))
def test_a_short_decimal_survives_the_way_to_si_and_back(name: str, digits: int, exponent: int) -> None:
    human = float(f"{digits}e{exponent}")
    unit = Unit(name)
    assert unit.from_si(unit.to_si(human)) == human


def test_a_value_on_its_bound_is_allowed() -> None:
    assert NeedleStudy(max_force_n=1e-3).max_force_n == 1e-3


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
