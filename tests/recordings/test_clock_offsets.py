"""The offset of two clocks, from dents and forces: right, or unsure."""

import numpy as np
import pytest
from scipy.optimize import isotonic_regression

from scleraforce.recordings.clock_offsets import estimate_clocks, relation
from scleraforce.recordings.rising_fit import (
    RAMP,
    SHAPE,
    USUAL_REST,
    rising_rests,
    unexplained,
)

RATE_HZ = 50.0
OFFSET_S = 5.3


class Needle:
    """A needle that pushes again and again, for 4 s each time, with any force."""

    def __init__(self, seed, length_s):
        self.rng = np.random.default_rng(seed)
        starts_s = np.arange(3.0, length_s - 10.0, 9.0)
        starts_s += self.rng.uniform(0.0, 2.0, len(starts_s))
        forces_n = self.rng.uniform(2e-3, 50e-3, len(starts_s))
        self.corners_s = (starts_s[:, None] + [0.0, 0.7, 4.7, 5.4]).ravel()
        self.corners_n = (forces_n[:, None] * [0.0, 1.0, 1.0, 0.0]).ravel()
        self.starts_s = starts_s
        self.log_s = np.arange(0.0, length_s, 1.0 / RATE_HZ)

    def force_n(self, time_s):
        return np.interp(time_s, self.corners_s, self.corners_n)

    def dents(self, time_s):
        """Dents of tissue that stiffens, with 20 um of noise."""
        dent_m = 1.5e-3 * (self.force_n(time_s) / 50e-3) ** 0.7
        return (dent_m + 20e-6 * self.rng.standard_normal(len(time_s)))[None]

    def log_n(self):
        noise_n = 4e-3 * self.rng.standard_normal(len(self.log_s))
        return self.force_n(self.log_s) + noise_n

    def estimate(self, taken_s, stated_s):
        found = estimate_clocks(stated_s, self.dents(taken_s), self.log_s, self.log_n())
        assert found is not None
        return found


@pytest.mark.parametrize("offset_s", [0.0, -3.5, 1.7e9])
def test_the_offset_of_a_film_is_found_from_its_dents(offset_s):
    needle = Needle(5, 60.0)
    frame_s = np.arange(4.0, 55.0)
    found = needle.estimate(frame_s, frame_s - offset_s)
    assert found.sure
    assert found.offset_s == pytest.approx(offset_s, abs=0.15)
    assert found.low_s < offset_s < found.high_s
    assert found.drift_s == 0.0


@pytest.mark.parametrize("seed", range(4))
def test_one_frame_a_push_gives_the_middle_of_the_rest_and_its_ends(seed):
    needle = Needle(seed, 130.0)
    middle_s = needle.starts_s + 2.7
    found = needle.estimate(middle_s, middle_s - OFFSET_S)
    assert found.sure
    assert found.offset_s == pytest.approx(OFFSET_S, abs=0.4)
    assert (found.low_s, found.high_s) == pytest.approx(
        (OFFSET_S - 2.0, OFFSET_S + 2.0), abs=0.6
    )


def test_the_offset_in_a_long_log_is_as_exact():
    needle = Needle(2, 450.0)
    frame_s = np.arange(250.0, 350.0, 2.0)
    found = needle.estimate(frame_s, frame_s - 240.0)
    assert found.sure
    assert found.offset_s == pytest.approx(240.0, abs=0.2)


@pytest.mark.parametrize("dents", [np.arange(5.0), np.ones(8)])
def test_no_offset_comes_from_few_or_equal_dents(dents):
    needle = Needle(5, 60.0)
    stated_s = np.arange(len(dents), dtype=float)
    found = estimate_clocks(stated_s, dents[None], needle.log_s, needle.log_n())
    assert found is None


@pytest.mark.parametrize("seed", range(6))
def test_a_log_of_another_day_is_not_sure_and_not_related(seed):
    needle = Needle(seed, 130.0)
    other = Needle(100 + seed, 130.0)
    middle_s = needle.starts_s + 2.7
    given = middle_s, needle.dents(middle_s), other.log_s, other.log_n()
    found = estimate_clocks(*given)
    assert found is not None
    assert not found.sure
    likely = relation(middle_s, needle.dents(middle_s), needle.log_s, needle.log_n())
    unlikely = relation(*given)
    assert likely > 9.0
    assert unlikely < 4.6


def test_equal_pushes_leave_the_offset_open():
    log_s = np.arange(0.0, 120.0, 0.01)
    force_n = 0.02 * ((log_s % 10.0) > 5.0)
    frame_s = np.arange(30.0, 80.0, 0.5)
    dents = 0.05 * np.interp(frame_s, log_s, force_n)[None]
    found = estimate_clocks(frame_s, dents, log_s, force_n)
    assert found is not None
    assert not found.sure
    apart_s = np.abs(np.subtract(found.rivals_s, found.offset_s))
    assert apart_s % 10.0 == pytest.approx(
        10.0 * np.round(apart_s % 10.0 / 10.0), abs=0.5
    )


def drifting(drift_s):
    """The estimate, the stated and the true times of half an hour of frames."""
    needle = Needle(1, 1800.0)
    frame_s = np.arange(10.0, 1780.0, 30.0)
    stated_s = frame_s - OFFSET_S - drift_s * (frame_s / 1800.0 - 0.5)
    return needle.estimate(frame_s, stated_s), stated_s, frame_s


@pytest.mark.parametrize("drift_s", [1.0, -1.0])
def test_a_clock_that_drifts_by_seconds_an_hour_is_followed(drift_s):
    found, stated_s, frame_s = drifting(drift_s)
    assert found.sure
    assert found.drift_s == pytest.approx(drift_s, abs=0.35)
    assert np.abs(found.moved(stated_s) - frame_s).max() < 0.4


def test_a_clock_that_drifts_by_much_is_not_sure_of_one_offset():
    assert not drifting(8.0)[0].sure


def test_frames_that_pause_are_not_sure_and_the_parts_are_named():
    needle = Needle(3, 300.0)
    frame_s = np.arange(6.0, 288.0, 1.3)
    frame_s = np.delete(frame_s, slice(105, 113))
    stated_s = 1.3 * np.arange(len(frame_s))
    found = needle.estimate(frame_s, stated_s)
    assert not found.sure
    (_, first_last, first_s), *_, (last_first, _, last_s) = found.parts
    assert first_last < last_first
    assert (first_s, last_s) == pytest.approx((6.0, 6.0 + 8 * 1.3), abs=0.5)


def test_gaps_of_a_log_are_not_bridged():
    needle = Needle(4, 130.0)
    middle_s = needle.starts_s + 2.7
    log_n = needle.log_n()
    log_n[(needle.log_s > 40.0) & (needle.log_s < 60.0)] = np.nan
    dents = needle.dents(middle_s)
    found = estimate_clocks(middle_s - OFFSET_S, dents, needle.log_s, log_n)
    assert found is not None
    assert found.low_s < OFFSET_S < found.high_s


def explained_by_scipy(force, change, dent):
    """Return q and the count of one offset, by SciPy's isotonic regression and by
    least squares of a parabola and of a line.
    """
    known = np.isfinite(force)
    order = np.argsort(force[known])
    x, y = force[known][order], dent[known][order]
    weight = 1.0 / (1.0 + (change[known][order] / (RAMP * np.ptp(x))) ** 2)
    y = y - np.average(y, weights=weight)
    total = weight @ y**2

    def rest(fitted):
        return weight @ (y - fitted) ** 2 / total

    bent = 1.0
    for degree in (1, 2):
        fit = np.polynomial.Polynomial.fit(x, y, degree, w=np.sqrt(weight))
        if (fit.deriv()(x) >= 0.0).all():
            bent = rest(fit(x))
    rising = rest(isotonic_regression(y, weights=weight).x)
    return rising + SHAPE * max(bent - USUAL_REST, 0.0), weight.sum()


def test_what_a_rising_force_leaves_agrees_with_scipy():
    rng = np.random.default_rng(0)
    dent = np.linspace(0.0, 3.0, 30) + rng.standard_normal(30)
    rise = np.linspace(0.0, 9.0, 30) ** rng.uniform(0.3, 3.0, (40, 1))
    force = rise + rng.uniform(0.0, 20.0, (40, 1)) * rng.standard_normal((40, 30))
    force[::2, [3, 12, 20]] = np.nan
    change = np.abs(rng.standard_normal(force.shape))
    expected = [
        explained_by_scipy(one, its_change, dent)
        for one, its_change in zip(force, change, strict=True)
    ]
    found = np.transpose(unexplained(force, change, dent, 0.0))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("spread", "lost", "judged"),
    [(6.01, 2, True), (5.99, 2, False), (6.01, 3, False)],
)
def test_forces_are_judged_if_enough_are_known_that_differ_by_more_than_the_noise(
    spread, lost, judged
):
    """Of eight frames six, three quarters, have to lie on the log."""
    force = np.linspace(0.0, spread, 8)
    force[1 : 1 + lost] = np.nan
    dent = np.arange(8.0)
    ((q,), _) = unexplained(force[None], np.zeros((1, 8)), dent, 1.0)
    assert np.isfinite(q) == judged


def test_rests_of_shuffled_dents_agree_with_scipy():
    values = np.random.default_rng(0).standard_normal((30, 9))
    expected = [((row - isotonic_regression(row).x) ** 2).sum() for row in values]
    np.testing.assert_allclose(rising_rests(values), expected, rtol=1e-9)
