"""What the reader's network is told: values of order one, zeros where nothing is known."""

import numpy as np
import pytest

from scleraforce.known import OPEN, UNKNOWN, known_globe
from scleraforce.library.base import pole_direction
from scleraforce.reader.networks import GIVEN, GivenEyes, given_inputs, given_modulus
from scleraforce.study import ReaderStudy
from scleraforce.units import to_si

STUDY = ReaderStudy()
NOTHING, ZERO = np.array([np.nan]), np.array([0.0])
OPEN_GLOBE, NO_POLE, SOFT = (ZERO, ZERO), (NOTHING, NOTHING), ZERO
KNOWN = ("modulus", "iop", "thickness", "gap", "polar angle", "direction")


def column(values: np.ndarray, name: str) -> float:
    return float(values[0, GIVEN.index(name)])


def test_the_ends_of_a_range_are_minus_one_and_one() -> None:
    for end, wanted in ((0, -1.0), (1, 1.0)):
        e, p = STUDY.youngs_modulus_pa.bounds[end], STUDY.iop_pa.bounds[end]
        ranges = (STUDY.modulus_sd_fraction, STUDY.thickness_m, STUDY.gap_m, STUDY.polar_angle_rad)
        sd, t, g, a = (values.bounds[end] for values in ranges)
        found = given_inputs(
            GivenEyes(*(np.array([value]) for value in (e, sd, p, t, g, 0.0, 0.0, a, 0.0, 0.0))), STUDY
        )
        for name in ("modulus", "log modulus sd", "log iop", "thickness", "gap", "polar angle"):
            assert abs(column(found, name) - wanted) < 1e-6, name
        assert all(column(found, f"{name} known") == 1.0 for name in KNOWN)


def test_the_iop_ratio_spans_its_range_at_opposite_ends_of_modulus_and_iop() -> None:
    (low_e, high_e), (low_p, high_p) = STUDY.youngs_modulus_pa.bounds, STUDY.iop_pa.bounds
    for e, p, wanted in ((high_e, low_p, -1.0), (low_e, high_p, 1.0)):
        told = GivenEyes(np.array([e]), np.array([0.02]), np.array([p]), NOTHING, NOTHING, *OPEN_GLOBE, *NO_POLE, SOFT)
        assert abs(column(given_inputs(told, STUDY), "log iop ratio") - wanted) < 1e-6


def test_of_what_is_unknown_flag_and_value_are_zero() -> None:
    found = given_inputs(GivenEyes(NOTHING, NOTHING, NOTHING, NOTHING, NOTHING, *OPEN_GLOBE, *NO_POLE, SOFT), STUDY)
    assert found.dtype == np.float32
    for name in KNOWN:
        assert column(found, f"{name} known") == 0.0
    for name in ("modulus", "log iop", "log iop ratio", "thickness", "gap", "polar angle", "pole along", "pole across"):
        assert abs(column(found, name)) < 1e-6, name


def test_an_unknown_modulus_is_as_uncertain_as_the_range_is_wide() -> None:
    mean, sd = given_modulus(GivenEyes(NOTHING, NOTHING, NOTHING, NOTHING, NOTHING, *OPEN_GLOBE, *NO_POLE, SOFT), STUDY)
    drawn = STUDY.youngs_modulus_pa.sample(np.random.default_rng(0), 200_000)
    assert abs(drawn.mean() / mean[0] - 1.0) < 0.005
    assert abs(drawn.std() / drawn.mean() / sd[0] - 1.0) < 0.01


def test_the_rigidity_counts_from_an_open_globe_to_the_stiffest() -> None:
    for globe, (low, high) in (
        (OPEN, (-1.0, -1.0)),
        (UNKNOWN, (-0.949, 0.949)),
        (known_globe("sealed", to_si(0.03, "mmhg13_per_ul")), (-0.132, 0.132)),
    ):
        told = GivenEyes(*[NOTHING] * 5, *(np.array([end]) for end in globe.band), *NO_POLE, SOFT)
        found = given_inputs(told, STUDY)
        assert column(found, "rigidity low") == pytest.approx(low, abs=1e-3)
        assert column(found, "rigidity high") == pytest.approx(high, abs=1e-3)


def test_where_the_pole_lies_is_told_along_the_section_and_across_it() -> None:
    farthest = np.sin(STUDY.polar_angle_rad.bounds[1])
    nothing = [NOTHING] * 5
    for polar_rad, direction_rad in ((0.5, 0.0), (0.7, 1.1), (0.4, -2.5), (1.4, 0.3)):
        told = GivenEyes(*nothing, *OPEN_GLOBE, np.array([polar_rad]), np.array([direction_rad]), SOFT)
        found = given_inputs(told, STUDY)
        along, across = pole_direction(min(polar_rad, np.radians(55.0)), direction_rad)  # the library's farthest
        assert column(found, "pole along") == pytest.approx(along / farthest, abs=1e-6)
        assert column(found, "pole across") == pytest.approx(across / farthest, abs=1e-6)


def test_a_direction_without_a_polar_angle_is_that_of_a_contact_in_the_middle_of_the_range() -> None:
    nothing, direction = [NOTHING] * 5, np.array([0.8])
    middle = np.array([0.5 * sum(STUDY.polar_angle_rad.bounds)])
    alone, both = (
        given_inputs(GivenEyes(*nothing, *OPEN_GLOBE, polar, direction, SOFT), STUDY) for polar in (NOTHING, middle)
    )
    for name in ("pole along", "pole across", "polar angle"):
        assert column(alone, name) == pytest.approx(column(both, name), abs=1e-6)
    assert (column(alone, "polar angle known"), column(both, "polar angle known")) == (0.0, 1.0)
    turned = given_inputs(GivenEyes(*nothing, *OPEN_GLOBE, middle, NOTHING, SOFT), STUDY)
    assert (column(turned, "pole along"), column(turned, "pole across")) == (0.0, 0.0)


@pytest.mark.parametrize(("stiffening", "wanted"), [(0.0, 0.0), (30.0, 1.0), (np.sqrt(31.0) - 1.0, 0.5)])
def test_tissue_that_does_not_stiffen_is_0_and_that_of_30_is_1_even_in_the_logarithm(stiffening, wanted) -> None:
    found = given_inputs(GivenEyes(*[NOTHING] * 5, *OPEN_GLOBE, *NO_POLE, np.array([stiffening])), STUDY)
    assert column(found, "stiffening") == pytest.approx(wanted, abs=1e-6)
