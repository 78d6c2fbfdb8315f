"""What is known of a globe: nothing, that it is open, that it is sealed, and with which rigidity."""

from dataclasses import replace

import numpy as np
import pytest

from scleraforce.known import OPEN, SEALED, UNKNOWN, known_globe
from scleraforce.study.eye import RIGIDITY_LAWS
from scleraforce.units import SI_PER_UNIT

PER_UL = SI_PER_UNIT["mmhg13_per_ul"][1]


def test_nothing_told_may_be_open_or_as_stiff_as_any() -> None:
    assert known_globe(None) is UNKNOWN
    assert (UNKNOWN.lowest / PER_UL, UNKNOWN.highest / PER_UL) == pytest.approx((0.0, 0.06))
    assert UNKNOWN.can_be_sealed


def test_an_open_globe_is_certain_whatever_else_is_said() -> None:
    assert known_globe("open", 1e8, "logarithmic") is OPEN
    assert OPEN.band == (0.0, 0.0)
    assert not OPEN.can_be_sealed
    assert not OPEN.globe(OPEN.mean).is_sealed


def test_a_sealed_globe_without_a_value_is_as_broad_as_eyes_are() -> None:
    assert known_globe("sealed") == SEALED
    assert (SEALED.lowest / PER_UL, SEALED.highest / PER_UL) == pytest.approx((0.005, 0.06))


@pytest.mark.parametrize("globe", [UNKNOWN, SEALED], ids=["unknown", "sealed"])
def test_mean_and_spread_are_those_of_an_even_range(globe) -> None:
    even = np.linspace(globe.lowest, globe.highest, 100_001)
    assert (globe.mean, globe.sd) == pytest.approx((even.mean(), even.std()), rel=1e-4)
    inside = (even >= globe.band[0]) & (even <= globe.band[1])
    assert 0.9 <= inside.mean() < 0.96


@pytest.mark.parametrize("law", [None, *RIGIDITY_LAWS])
def test_a_stated_rigidity_is_known_to_some_percent_under_its_law(law: str | None) -> None:
    globe = known_globe("sealed", 0.02 * PER_UL, law)
    assert (globe.kind, globe.law, globe.calibrated) == ("sealed", law or "cube-root", False)
    low, high = globe.band
    assert (low / PER_UL, high / PER_UL) == pytest.approx((0.0174, 0.0226), abs=1e-4)
    assert globe.lowest < low < 0.02 * PER_UL < high < globe.highest
    assert known_globe("sealed", law=law) == replace(SEALED, law=law or "cube-root")


def test_a_band_ends_at_what_may_be() -> None:
    found = replace(UNKNOWN, mean=-0.001 * PER_UL, sd=0.002 * PER_UL, calibrated=True)
    assert found.band == pytest.approx((0.0, (-0.001 + 1.6449 * 0.002) * PER_UL))


@pytest.mark.parametrize("law", RIGIDITY_LAWS)
def test_a_rigidity_makes_the_globe_of_its_law(law: str) -> None:
    globe = known_globe("sealed", law=law).globe(np.array([0.01, 0.03]) * PER_UL)
    assert globe.law == law
    slopes = globe.stiffness(SI_PER_UNIT["mmhg"][1] * 15.0)
    assert slopes[1] == pytest.approx(3.0 * slopes[0])
    assert slopes[1] * 1e-9 == pytest.approx(73.0, abs=0.1)  # Pa a microlitre at 15 mmHg, where all laws agree
