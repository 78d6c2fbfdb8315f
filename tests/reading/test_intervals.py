"""Intervals that hold: scores, factors of traits, and what a factor does to a
reading.
"""

from dataclasses import replace
from itertools import pairwise
from math import nan

import numpy as np
import pytest

from scleraforce.base.units import to_si
from scleraforce.fit.one_frame import BoundaryFit
from scleraforce.fit.prior_of_an_eye import prior_of
from scleraforce.fit.unknowns import FORM, FORMS
from scleraforce.reading.answer import fit_reading
from scleraforce.reading.force_network import histogram_reading, ratio_edges
from scleraforce.reading.frame_checks import no_wall_of_an_eye
from scleraforce.reading.interval_widths import (
    NO_FACTORS,
    IntervalFactors,
    IntervalScore,
    IntervalStretch,
    find_stretches,
    score_reading,
)
from scleraforce.records.eye import NO_DISCREPANCY, Eye, Modulus
from scleraforce.records.globe import OPEN, SEALED, Globe
from scleraforce.records.setup import Setup
from scleraforce.records.study import ReaderStudy

BOUNDS_N = (5e-3, 30e-3)
OWN_OPEN = ("own E", "open")


def of_eyes(score_of_eye: dict[str, float], times: int = 1) -> list[IntervalScore]:
    return [
        IntervalScore("fit", OWN_OPEN, eye, value)
        for eye, value in score_of_eye.items()
        for _ in range(times)
    ]


def factor_of(scores: list[IntervalScore]) -> float:
    (stretch,) = find_stretches(scores)
    return stretch.factor


def test_the_quantile_of_some_eyes_holds_on_others():
    """Eyes differ: each has an error of its own, larger than its frames'."""
    rng = np.random.default_rng(3)

    def scores() -> list[IntervalScore]:
        own = np.abs(rng.standard_normal(60))
        off = np.abs(own + 0.2 * rng.standard_normal((5, 60)))
        return [s for row in off for s in of_eyes(dict(enumerate(row.tolist())))]

    held = []
    for _ in range(200):
        factor = factor_of(scores())
        held.append(np.mean([entry.score <= factor for entry in scores()]))

    # 0.9 (n + 1)/n of the eyes' readings
    assert np.mean(held) == pytest.approx(0.905, abs=0.012)


FEW = {str(eye): 0.5 for eye in range(99)}
LONG = of_eyes({"long": 9.0}, 10_000)


@pytest.mark.parametrize(
    ("scores", "factor"),
    [
        ([*of_eyes(FEW), *LONG], 0.5),
        ([*of_eyes(FEW)[:4], *LONG], 9.0),
        (of_eyes({str(eye): 1.0 + eye for eye in range(5)}), 5.0),
        # 0.9 (10 + 1)/10 of them, not 0.9
        (of_eyes({str(eye): 1.0 + eye for eye in range(10)}), 10.0),
        # few eyes widen intervals and never narrow them
        (of_eyes({str(eye): 0.5 for eye in range(8)}), 1.0),
        (of_eyes({str(eye): 0.5 for eye in range(9)}), 0.5),
        (of_eyes({str(eye): 3.0 for eye in range(8)}), 3.0),
    ],
)
def test_the_quantile_weighs_eyes_alike_and_counts_a_new_one(
    scores: list[IntervalScore], factor: float
):
    assert factor_of(scores) == pytest.approx(factor)


def test_stretches_count_what_held_before_and_are_of_all_readings_with_one_kind_of_modulus():
    did = ((0.5, "open"), (1.0, "open"), (1.5, "taut"), (3.0, "taut"))
    scores = [
        IntervalScore("fit", ("own E", kind, "light"), str(eye % 3), value)
        for eye, (value, kind) in enumerate(did)
    ]
    other = IntervalScore("fit", ("other E", "sealed"), "x", 2.0)
    network = IntervalScore("network", OWN_OPEN, "x", 4.0)
    assert find_stretches([*scores, other, network]) == (
        IntervalStretch("fit", "other E", ("sealed",), 1, 1, 0.0, 2.0),
        IntervalStretch("fit", "own E", ("open", "taut"), 3, 4, 0.5, 3.0),
        IntervalStretch("network", "own E", ("open",), 1, 1, 0.0, 4.0),
    )


MEAN = prior_of(Setup(), ReaderStudy()).mean


def drawn_fit(draws_n: np.ndarray) -> BoundaryFit:
    low_n, median_n, high_n = np.quantile(draws_n, [0.05, 0.5, 0.95])
    return BoundaryFit(
        force_n=float(median_n),
        interval_n=(float(low_n), float(high_n)),
        draws_n=draws_n,
        contact_m=0.0,
        tip_m=1e-3,
        misfit_m=3e-6,
        outliers=0.0,
        wall_bmc=np.zeros((2, 2, 2)),
        iop_pa=300.0,
        tension=0.02,
        loss=0.0,
        unknown=0.0 * MEAN,
        spread=np.zeros((len(MEAN), len(MEAN))),
    )


@pytest.mark.parametrize("factor", [0.5, 1.0, 3.0])
def test_a_stretched_fit_has_the_quantiles_of_stretched_draws(factor: float):
    draws_n = 28e-3 + 3e-3 * np.random.default_rng(0).standard_normal(4001)
    fit = drawn_fit(draws_n)
    found = fit_reading(fit, BOUNDS_N, factor)
    wanted = drawn_fit(fit.force_n + factor * (draws_n - fit.force_n))
    assert found.interval_n == pytest.approx(wanted.interval_n, rel=1e-9)
    shares = wanted.probabilities(BOUNDS_N)
    assert found.probabilities == pytest.approx(shares, abs=1e-3)
    assert found.force_n == fit.force_n
    ends_n = *found.interval_n, found.force_n
    scores = [score_reading("fit", found, Setup(), "an eye", n).score for n in ends_n]
    assert scores == pytest.approx([1.0, 1.0, 0.0])


def test_a_stretched_interval_begins_at_zero_and_what_is_no_number_stays_none():
    noise = np.random.default_rng(0).standard_normal(501)
    light = drawn_fit(np.abs(1e-3 + 1e-3 * noise))
    assert fit_reading(light, BOUNDS_N, 5.0).interval_n[0] == 0.0
    broken = replace(light, force_n=nan, interval_n=(nan, nan))
    assert not fit_reading(broken, BOUNDS_N, 5.0).finite


def ordered(shares: tuple[float, ...], force_n: float) -> bool:
    """Return True if no class is likelier than the one between it and the force's."""
    own = int(np.searchsorted(BOUNDS_N, force_n))
    upwards = all(a >= b for a, b in pairwise(shares[own:]))
    return upwards and all(a <= b for a, b in pairwise(shares[: own + 1]))


FORCES = {
    "narrow": lambda rng, force_n: rng.normal(force_n, 0.2e-3, 512),
    "normal": lambda rng, force_n: rng.normal(force_n, 0.06 * force_n + 0.5e-3, 512),
    "wide": lambda rng, force_n: rng.normal(force_n, 0.15 * force_n, 512),
    "skewed": lambda rng, force_n: force_n * np.exp(rng.normal(0.0, 0.2, 512)),
    "few": lambda rng, force_n: rng.normal(force_n, 1e-3, 11),
    "equal": lambda _, force_n: np.full(512, force_n),
}


@pytest.mark.parametrize("force_mn", [0.5, 4, 15, 28, 32, 38, 58])
@pytest.mark.parametrize("kind", FORCES)
def test_a_class_farther_from_the_force_is_never_likelier(kind: str, force_mn: float):
    """Of single-peaked forces; shares were 0.001, 0.000 and 0.999 at 38 mN."""
    for seed in range(20):
        drawn_n = FORCES[kind](np.random.default_rng(seed), to_si(force_mn, "mn"))
        fit = drawn_fit(np.maximum(drawn_n, 0.0))
        for factor in (0.43, 1.0, 2.6):
            found = fit_reading(fit, BOUNDS_N, factor)
            assert sum(found.probabilities) == pytest.approx(1.0, abs=1e-12)
            assert min(found.probabilities) >= 0.0
            assert ordered(found.probabilities, found.force_n), found.probabilities


def histogram(
    shares: np.ndarray, factor: float = 1.0
) -> tuple[tuple[float, ...], float, tuple[float, float]]:
    """Return the class probabilities, force and interval of a histogram at 0.3 MPa."""
    edges_m2 = ratio_edges(len(shares), 0.2e-6).tolist()
    found = histogram_reading(
        shares.tolist(), edges_m2, 0.3e6, BOUNDS_N, 0.0, lambda _: factor
    )
    return found.probabilities, found.force_n, found.interval_n


@pytest.mark.parametrize("peak_mn", [0.5, 4, 15, 32, 38, 58])
@pytest.mark.parametrize("floor", [0.0, 1e-6, 1e-4])
def test_a_farther_class_of_a_histogram_with_one_peak_is_never_likelier(
    floor: float, peak_mn: float
):
    """`floor` of each bin: a network never says 0. Stretched, it makes the highest
    class wider than the one below.
    """
    edges_m2 = ratio_edges(64, 0.2e-6)
    middles_mn = (edges_m2[1:] + edges_m2[:-1]) / 2 * 0.3e9
    density = np.exp(-0.5 * ((middles_mn - peak_mn) / (0.5 + 0.1 * peak_mn)) ** 2)
    shares = density * np.diff(edges_m2)
    for factor in (0.66, 1.0, 1.35, 2.35)[: None if peak_mn >= 15 else 2]:
        found, force_n, _ = histogram(shares / shares.sum() + floor, factor)
        assert ordered(found, force_n), found


def test_the_tail_beyond_the_draws_is_no_lighter_than_a_normal_one():
    """Shares that 512 draws cannot show, beside those of many more."""
    rng = np.random.default_rng(4)
    few = drawn_fit(rng.normal(38e-3, 2e-3, 512))
    many_n = rng.normal(38e-3, 2e-3, 2_000_000)
    for bound_n in (30e-3, 31e-3, 46e-3):
        shares = few.probabilities((bound_n,))
        true = float((many_n < bound_n).mean())
        assert 0.3 * min(true, 1.0 - true) < min(shares) < 2e-3
    assert fit_reading(few, BOUNDS_N).probabilities[0] < 1e-5


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.5])
def test_a_stretched_histogram_has_the_quantiles_of_stretched_forces(
    factor: float,
):
    shares = np.exp(-0.5 * ((np.arange(64) - 40.0) / 4.0) ** 2)
    median_n = histogram(shares)[1]
    found, force_n, interval_n = histogram(shares, factor)
    assert force_n == median_n
    share = np.random.default_rng(1).random(400_000)
    below = np.append(0.0, shares.cumsum() / shares.sum())
    drawn_n = np.interp(share, below, ratio_edges(64, 0.2e-6)) * 0.3e6
    drawn_n = median_n + factor * (drawn_n - median_n)
    ends_n = tuple(np.quantile(drawn_n, [0.05, 0.95]))
    assert interval_n == pytest.approx(ends_n, rel=5e-3)

    lower_n = drawn_n[(drawn_n >= 0.0) & (drawn_n < median_n)]  # half of all
    low = 0.5 * np.mean(lower_n < BOUNDS_N[0])
    high = np.mean(drawn_n >= BOUNDS_N[1])
    assert found == pytest.approx((low, 1.0 - low - high, high), abs=4e-3)


OWN = Modulus(mean_pa=3e5, sd_pa=1e4, source="own")
FIT = drawn_fit(np.linspace(0.0, 3e-2, 11))
UNEVEN = replace(FIT, misfit_m=20e-6)
BULGING = replace(FIT, unknown=FIT.unknown.copy())
BULGING.unknown[FORM.start + 1] = -0.1
TAUT = replace(FIT, tension=0.1)


def eye(source: str = "own", globe: Globe | None = None, **calibrated: float) -> Setup:
    """An eye whose frames of known force reach to a force, with a widest gap."""
    found = replace(NO_DISCREPANCY, **calibrated) if calibrated else None
    modulus = replace(OWN, source=source)
    return Setup(eye=Eye(modulus=modulus, globe=globe, discrepancy=found))


GENTLE = {"largest_n": 20e-3, "widest_gap": 0.5}


@pytest.mark.parametrize(
    ("setup", "force_n", "fit", "traits"),
    [
        (eye(globe=OPEN), 15e-3, UNEVEN, "own E, open, uneven"),
        (eye(globe=OPEN), 15e-3, TAUT, "own E, open"),
        (eye(globe=SEALED), 15e-3, TAUT, "own E, taut"),
        (eye("population", SEALED), 15e-3, BULGING, "other E, sealed, uneven"),
        (
            eye("population", SEALED),
            9.9e-3,
            replace(TAUT, misfit_m=20e-6),
            "other E, taut, uneven, light",
        ),
        (eye(), 15e-3, None, "own E, unknown"),
        (eye("shape"), 15e-3, None, "other E, unknown"),
        (eye(**GENTLE), 23.9e-3, None, "own E, unknown, sparse"),
        (eye(**GENTLE), 24.1e-3, TAUT, "own E, taut, beyond"),
        (eye(**GENTLE), 40.1e-3, None, "own E, unknown, far beyond"),
        (eye(largest_n=4e-3), 9.9e-3, TAUT, "own E, taut, light, far beyond"),
        # its discrepancy is another eye's
        (eye("population", **GENTLE), 60e-3, None, "other E, unknown"),
        (eye(scatter=1.0), 60e-3, None, "own E, unknown"),
        (eye(largest_n=20e-3, widest_gap=0.45), 15e-3, None, "own E, unknown"),
        (eye(largest_n=20e-3, widest_gap=0.46), 15e-3, None, "own E, unknown, sparse"),
    ],
)
def test_traits_follow_the_causes_of_errors(
    setup: Setup, force_n: float, fit: BoundaryFit | None, traits: str
):
    reading = replace(fit_reading(FIT, BOUNDS_N), force_n=force_n)
    score = score_reading("fit", reading, setup, "an eye", force_n, fit)
    assert score.traits == tuple(traits.split(", "))


def test_factors_are_multiplied_and_are_one_where_there_is_none():
    fit = {"own E": {"open": 0.5, "uneven": 1.5}}
    factors = IntervalFactors(fit=fit, network={"other E": {"sealed": 2.0}})
    own = eye(globe=OPEN)
    assert factors.of_fit(own, FIT) == 0.5
    assert factors.of_fit(own, UNEVEN) == 0.75
    assert factors.of_fit(eye(globe=SEALED), UNEVEN) == 1.5
    assert factors.of_network(Setup(eye=Eye(globe=SEALED)), 30e-3) == 2.0
    assert factors.of_network(own, 30e-3) == 1.0

    scattered = eye(globe=OPEN, scatter=1.7)
    assert factors.of_fit(scattered, FIT) == pytest.approx(1.7 * 0.5)
    assert NO_FACTORS.of_fit(scattered, FIT) == 1.7
    # another model of the eye: its errors do not follow
    assert factors.of_network(scattered, 30e-3) == 1.0


def test_a_surface_that_bends_like_a_cornea_on_both_sides_is_not_a_sclera():
    prior = prior_of(Setup(), ReaderStudy())
    fit = replace(FIT, unknown=prior.mean.copy())
    assert no_wall_of_an_eye(fit, prior) is None
    fit.unknown[FORM.start + FORMS.index("left_curvature")] = 45.0
    assert no_wall_of_an_eye(fit, prior) is None
    fit.unknown[FORM.start + FORMS.index("right_angle_rad")] = -0.2
    assert "cornea on both sides" in str(no_wall_of_an_eye(fit, prior))
