"""A needle: its gauge, its lean, its file."""

from math import nan

import pytest

from scleraforce.base.errors import StudyError
from scleraforce.records.needle import (
    Needle,
    gauge_diameter_m,
)


@pytest.mark.parametrize("gauge", range(10, 35))
def test_each_gauge_has_a_diameter_and_comes_back(gauge):
    assert Needle(diameter_m=gauge_diameter_m(gauge)).gauge == gauge


@pytest.mark.parametrize("gauge", [9, 37, -1])
def test_a_gauge_without_a_needle_is_refused(gauge):
    with pytest.raises(StudyError, match=f"^gauge: {gauge}; give 10 to 36$"):
        gauge_diameter_m(gauge)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"diameter_m": 0.0}, "diameter_m: 0; give the outer diameter in metres"),
        ({"diameter_m": 0.7}, "diameter_m: 0.7; give the outer diameter in metres"),
        ({"diameter_m": nan}, "diameter_m: nan is not a finite number"),
        ({"gap_m": 0.5}, "gap_m: 0.5 is above .*; did you mean 0.0005 m"),
        ({"polar_rad": 35.0}, "polar_rad: 35 is above .*; did you mean 0.61"),
        ({"lean_rad": (0.0, 2.0)}, "lean_rad: 2 is above"),
        ({"lean_rad": (-0.1, 0.0)}, "lean_rad: -0.1 is below"),
        ({"lean_azimuth_rad": 0.1}, "lean_azimuth_rad: of a needle that leans"),
        (
            {"lean_rad": (0.1, 0.1), "lean_azimuth_rad": 7.0},
            "lean_azimuth_rad: 7 is above",
        ),
    ],
)
def test_a_value_of_a_needle_that_cannot_be_is_refused(values, said):
    with pytest.raises(StudyError, match=f"^{said}"):
        Needle(**values)
