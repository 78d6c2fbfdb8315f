"""The pressure of a sealed globe: closed forms, measured values, and what scales."""

import numpy as np
import pytest

from scleraforce.errors import InputError
from scleraforce.mechanics.globe import OPEN_GLOBE, Globe, sealed_globe
from scleraforce.study.eye import RIGIDITY_LAWS
from scleraforce.units import SI_PER_UNIT, to_si

PER_UL = SI_PER_UNIT["mmhg13_per_ul"][1]
UL = 1e-9


def test_the_cube_root_of_the_pressure_rises_by_003_a_microlitre_in_enucleated_human_eyes() -> None:
    globe = sealed_globe(0.03 * PER_UL)  # van der Werff 1981
    assert globe.pressure(to_si(2.0, "mmhg"), 32.0 * UL) == pytest.approx(to_si((2.0 ** (1 / 3) + 0.96) ** 3, "mmhg"))
    # 19 Pa a microlitre at 2 mmHg, 73 at 15.
    assert globe.stiffness(to_si(2.0, "mmhg")) * UL == pytest.approx(19.0, abs=0.1)
    assert globe.stiffness(to_si(15.0, "mmhg")) * UL == pytest.approx(73.0, abs=0.1)


def test_the_logarithmic_law_is_friedenwalds_and_has_the_slope_of_its_rigidity_at_15_mmhg() -> None:
    globe = sealed_globe(0.0407 * PER_UL, "logarithmic")
    ten_ul = globe.pressure(to_si(15.0, "mmhg"), 10.0 * UL) / to_si(15.0, "mmhg")
    assert np.log10(ten_ul) == pytest.approx(10.0 * 0.0215, rel=2e-3)  # Friedenwald's mean
    cube_root = sealed_globe(0.0407 * PER_UL)
    assert globe.stiffness(to_si(15.0, "mmhg")) == pytest.approx(cube_root.stiffness(to_si(15.0, "mmhg")))


@pytest.mark.parametrize("law", RIGIDITY_LAWS)
def test_volume_and_pressure_are_inverse_and_the_stiffness_is_the_slope(law: str) -> None:
    globe = sealed_globe(0.02 * PER_UL, law)
    resting, volumes = np.full(5, 300.0), np.linspace(0.0, 40.0, 5) * UL
    pressures = globe.pressure(resting, volumes)
    assert (np.diff(pressures) > 0.0).all()
    assert pressures[0] == pytest.approx(300.0)
    np.testing.assert_allclose(globe.displaced_m3(resting, pressures), volumes, atol=1e-20)
    step = 1e-4 * UL
    slopes = (globe.pressure(resting, volumes + step) - globe.pressure(resting, volumes - step)) / (2.0 * step)
    np.testing.assert_allclose(globe.stiffness(pressures), slopes, rtol=1e-6)


@pytest.mark.parametrize("law", RIGIDITY_LAWS)
def test_a_pressure_over_a_modulus_follows_the_globe_over_it(law: str) -> None:
    globe, modulus = sealed_globe(0.03 * PER_UL, law), 0.45e6
    assert globe.over(modulus).pressure(266.0 / modulus, 2e-8) * modulus == pytest.approx(globe.pressure(266.0, 2e-8))


def test_an_open_globe_keeps_its_pressure() -> None:
    assert not OPEN_GLOBE.is_sealed
    assert sealed_globe(0.0) == OPEN_GLOBE
    assert OPEN_GLOBE.pressure(266.0, 1e-7) == pytest.approx(266.0)
    assert OPEN_GLOBE.stiffness(266.0) == 0.0


def test_a_dent_outwards_takes_the_pressure_to_nothing_and_not_below() -> None:
    assert sealed_globe(0.03 * PER_UL).pressure(266.0, -1e-6) == 0.0


@pytest.mark.parametrize("law", RIGIDITY_LAWS)
def test_below_no_rigidity_the_law_continues_smoothly_for_a_search_that_needs_both_sides(law: str) -> None:
    rigidities = PER_UL * np.array([-2e-4, -1e-4, 0.0, 1e-4, 2e-4])
    pressures = sealed_globe(rigidities, law).pressure(np.full(5, 300.0), 20.0 * UL)
    assert pressures[2] == pytest.approx(300.0)
    assert (np.diff(pressures) > 0.0).all()
    np.testing.assert_allclose(np.diff(pressures), np.diff(pressures).mean(), rtol=0.01)
    assert sealed_globe(-PER_UL, law).is_sealed


def test_no_such_law_and_no_rigidity_that_is_not_finite() -> None:
    with pytest.raises(InputError, match="'linear' is not one of cube-root, logarithmic"):
        Globe("linear", 1.0)
    for rigidity in (np.inf, np.nan):
        with pytest.raises(InputError, match=r"rigidity: (inf|nan); must be a finite number"):
            sealed_globe(rigidity)


@pytest.mark.parametrize("law", RIGIDITY_LAWS)
def test_a_leaking_globe_loses_the_displaced_volume_with_its_time_constant(law: str) -> None:
    globe, time_s = sealed_globe(0.02 * PER_UL, law), 0.5 * np.arange(200)
    pushed = np.where(time_s < 40.0, 1.0, 0.0)

    def pressed(push: float, leaked_m3: float) -> float:
        return float(globe.pressure(300.0, 20.0 * UL * push - leaked_m3))

    leaked = globe.leaked_m3(300.0, 60.0, pushed, pressed)
    full = 1.0 - np.exp(-np.minimum(time_s, 40.0) / 30.0)
    expected = 20.0 * full * np.exp(-np.maximum(time_s - 40.0, 0.0) / 30.0)
    np.testing.assert_allclose(leaked / UL, expected, rtol=1e-9)
