"""What the reader's network is told: values of order one, zeros where nothing is known."""

import numpy as np

from scleraforce.reader.given import GIVEN, Told, given_inputs, told_modulus
from scleraforce.study import ReaderStudy

STUDY = ReaderStudy()
NOTHING = np.array([np.nan])


def column(values: np.ndarray, name: str) -> float:
    return float(values[0, GIVEN.index(name)])


def test_the_ends_of_a_range_are_minus_one_and_one() -> None:
    for end, wanted in ((0, -1.0), (1, 1.0)):
        e, p = STUDY.youngs_modulus_pa.bounds[end], STUDY.iop_pa.bounds[end]
        sd, t, g = (s.bounds[end] for s in (STUDY.modulus_sd_fraction, STUDY.thickness_m, STUDY.gap_m))
        found = given_inputs(Told(*(np.array([value]) for value in (e, sd, p, t, g))), STUDY)
        for name in ("modulus", "log modulus sd", "log iop", "thickness", "gap"):
            assert abs(column(found, name) - wanted) < 1e-6, name
        assert all(column(found, f"{name} known") == 1.0 for name in ("modulus", "iop", "thickness", "gap"))


def test_the_iop_ratio_spans_its_range_at_opposite_ends_of_modulus_and_iop() -> None:
    (low_e, high_e), (low_p, high_p) = STUDY.youngs_modulus_pa.bounds, STUDY.iop_pa.bounds
    for e, p, wanted in ((high_e, low_p, -1.0), (low_e, high_p, 1.0)):
        told = Told(np.array([e]), np.array([0.02]), np.array([p]), NOTHING, NOTHING)
        assert abs(column(given_inputs(told, STUDY), "log iop ratio") - wanted) < 1e-6


def test_of_what_is_unknown_flag_and_value_are_zero() -> None:
    found = given_inputs(Told(NOTHING, NOTHING, NOTHING, NOTHING, NOTHING), STUDY)
    assert found.dtype == np.float32
    for name in ("modulus", "iop", "thickness", "gap"):
        assert column(found, f"{name} known") == 0.0
    for name in ("modulus", "log iop", "log iop ratio", "thickness", "gap"):
        assert abs(column(found, name)) < 1e-6, name


def test_an_unknown_modulus_is_as_uncertain_as_the_range_is_wide() -> None:
    mean, sd = told_modulus(Told(NOTHING, NOTHING, NOTHING, NOTHING, NOTHING), STUDY)
    drawn = STUDY.youngs_modulus_pa.sample(np.random.default_rng(0), 200_000)
    assert abs(drawn.mean() / mean[0] - 1.0) < 0.005
    assert abs(drawn.std() / drawn.mean() / sd[0] - 1.0) < 0.01
