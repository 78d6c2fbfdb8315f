"""Units, bounds and sampled values of a study's fields."""

from dataclasses import fields

import numpy as np
from hypothesis import given, strategies as st

from scleraforce.study import Choice, EyeStudy, NeedleStudy, Range, Study, fixed
from scleraforce.study.fields import Unit, field_key, field_unit
from scleraforce.units import SI_PER_UNIT


def test_a_key_carries_the_human_unit_and_a_field_the_si_unit() -> None:
    keys = {item.name: field_key(item) for item in fields(EyeStudy)}
    assert keys["radius_m"] == "radius_mm"
    assert keys["thickness_m"] == "thickness_um"
    assert keys["youngs_modulus_pa"] == "youngs_modulus_mpa"
    assert keys["poisson_ratio"] == "poisson_ratio"


def test_every_field_with_a_unit_is_named_after_its_si_unit() -> None:
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


def test_samples_lie_in_the_range_and_follow_the_generator() -> None:
    values = Range(min=2.0, max=3.0).sample(np.random.default_rng(1), 1000)
    assert values.shape == (1000,)
    assert 2.0 <= values.min() < 2.01
    assert 2.99 < values.max() <= 3.0
    np.testing.assert_array_equal(values, Range(min=2.0, max=3.0).sample(np.random.default_rng(1), 1000))


def test_a_choice_takes_each_value_about_equally_often() -> None:
    values, counts = np.unique(Choice((1.0, 5.0, 9.0)).sample(np.random.default_rng(0), 3000), return_counts=True)
    assert values.tolist() == [1.0, 5.0, 9.0]
    assert np.all(np.abs(counts - 1000) < 4 * np.sqrt(3000 * 2 / 9))


def test_a_fixed_value_is_always_the_same() -> None:
    assert np.all(fixed(0.25).sample(np.random.default_rng(0), 5) == 0.25)
