"""Intervals that hold: scores, factors of traits, and what a factor does to a
reading.
"""

from dataclasses import replace
from itertools import pairwise, product
from math import inf, nan

import numpy as np
import pytest

from scleraforce.base.errors import ModelError
from scleraforce.base.units import to_si
from scleraforce.fit.one_frame import BoundaryFit
from scleraforce.fit.prior_of_an_eye import prior_of
from scleraforce.fit.unknowns import FORM, FORMS, NAMES
from scleraforce.reading.answer import fit_reading
from scleraforce.reading.force_network import histogram_reading, ratio_edges
from scleraforce.reading.frame_checks import no_wall_of_an_eye
from scleraforce.reading.interval_widths import (
    FIT_TRAITS,
    NETWORK_TRAITS,
    NO_FACTORS,
    IntervalScore,
    conformal_quantile,
    find_stretches,
    parse_factors,
    score_reading,
    traits_of,
)
from scleraforce.records.eye import NO_DISCREPANCY, Eye, Modulus
from scleraforce.records.globe import OPEN, SEALED
from scleraforce.records.setup import Setup
from scleraforce.records.study import ReaderStudy

BOUNDS_N = (5e-3, 30e-3)


OWN_EVEN = ("own E", "open")


def scores_of_eyes(
    rng: np.random.Generator, eyes: int, frames: int
) -> list[IntervalScore]:
    """Scores of eyes that differ: each has an error of its own, larger than its
    frames'.
    """
    own = np.abs(rng.standard_normal(eyes))
    return [
        IntervalScore(
            "fit",
            OWN_EVEN,
            str(eye),
            float(abs(own[eye] + 0.2 * rng.standard_normal())),
        )
        for eye in range(eyes)
        for _ in range(frames)
    ]


def of_fit(score_of_eye: dict[str, float]) -> list[IntervalScore]:
    return [
        IntervalScore("fit", OWN_EVEN, eye, value)
        for eye, value in score_of_eye.items()
    ]


def test_the_quantile_of_some_eyes_holds_on_others() -> None:
    rng = np.random.default_rng(3)
    held = []

    for _ in range(200):
        factor = conformal_quantile(scores_of_eyes(rng, 60, 5))
        held.append(
            np.mean([entry.score <= factor for entry in scores_of_eyes(rng, 60, 5)])
        )

    # 0.9 (n + 1)/n of the eyes' readings
    assert np.mean(held) == pytest.approx(0.905, abs=0.012)


def test_the_quantile_weighs_eyes_alike_and_counts_a_new_one() -> None:
    few = of_fit({str(eye): 0.5 for eye in range(99)})
    many = of_fit({"long": 9.0}) * 10_000
    assert conformal_quantile([*few, *many]) == pytest.approx(0.5)
    assert conformal_quantile(few[:4] + many) == pytest.approx(9.0)
    assert conformal_quantile(
        of_fit({str(eye): 1.0 + eye for eye in range(5)})
    ) == pytest.approx(5.0)
    ten = of_fit({str(eye): 1.0 + eye for eye in range(10)})
    # 0.9 (10 + 1)/10 of them, not 0.9
    assert conformal_quantile(ten) == pytest.approx(10.0)


def test_stretches_count_what_held_before_and_are_of_all_readings_with_one_kind_of_modulus():
    did = ((0.5, "open"), (1.0, "open"), (1.5, "taut"), (3.0, "taut"))
    scores = [
        IntervalScore("fit", ("own E", kind, "light"), str(eye % 3), value)
        for eye, (value, kind) in enumerate(did)
    ]
    scores += [
        IntervalScore("fit", ("other E", "sealed"), "x", 2.0),
        IntervalScore("network", ("own E", "open"), "x", 4.0),
    ]
    of_other, of_own, of_network = find_stretches(scores)
    assert (of_own.method, of_own.modulus, of_own.globes) == (
        "fit",
        "own E",
        ("open", "taut"),
    )
    assert (of_own.eyes, of_own.readings, of_own.held, of_own.factor) == (
        3,
        4,
        0.5,
        3.0,
    )
    assert (of_other.modulus, of_other.globes, of_other.factor) == (
        "other E",
        ("sealed",),
        2.0,
    )
    assert (of_network.method, of_network.factor) == ("network", 4.0)


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
        unknown=np.zeros(len(NAMES)),
        spread=np.zeros((len(NAMES), len(NAMES))),
    )


def test_a_stretched_fit_has_the_quantiles_of_stretched_draws() -> None:
    draws_n = 28e-3 + 3e-3 * np.random.default_rng(0).standard_normal(4001)
    fit = drawn_fit(draws_n)

    for factor in (0.5, 1.0, 3.0):
        found = fit_reading(fit, BOUNDS_N, factor)
        wanted = drawn_fit(fit.force_n + factor * (draws_n - fit.force_n))
        assert found.interval_n == pytest.approx(wanted.interval_n, rel=1e-9)
        assert found.probabilities == pytest.approx(
            wanted.probabilities(BOUNDS_N), abs=1e-3
        )
        assert found.force_n == fit.force_n
        ends_n = *found.interval_n, found.force_n
        scores = [
            score_reading("fit", found, Setup(), "an eye", end_n).score
            for end_n in ends_n
        ]
        assert scores == pytest.approx([1.0, 1.0, 0.0])

    light = drawn_fit(
        np.abs(1e-3 + 1e-3 * np.random.default_rng(0).standard_normal(501))
    )
    assert fit_reading(light, BOUNDS_N, 5.0).interval_n[0] == 0.0
    assert not fit_reading(
        replace(light, force_n=nan, interval_n=(nan, nan)), BOUNDS_N, 5.0
    ).finite


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


@pytest.mark.parametrize("factor", [0.43, 1.0, 2.6])
@pytest.mark.parametrize("force_mn", [0.5, 2, 4, 7, 15, 28, 32, 38, 45, 58])
@pytest.mark.parametrize("kind", FORCES)
def test_a_class_farther_from_the_force_is_never_likelier(
    kind: str, force_mn: float, factor: float
) -> None:
    """Of single-peaked forces; shares were 0.001, 0.000 and 0.999 at 38 mN."""
    for seed in range(20):
        drawn_n = FORCES[kind](np.random.default_rng(seed), to_si(force_mn, "mn"))
        found = fit_reading(drawn_fit(np.maximum(drawn_n, 0.0)), BOUNDS_N, factor)
        assert sum(found.probabilities) == pytest.approx(1.0, abs=1e-12)
        assert min(found.probabilities) >= 0.0
        assert ordered(found.probabilities, found.force_n), found.probabilities


PEAKS_MN = {0.66: (0.5, 4, 15, 32, 38, 58), 1.35: (15, 32, 38, 58)}
PEAKS_MN |= {1.0: PEAKS_MN[0.66], 2.35: PEAKS_MN[1.35]}


@pytest.mark.parametrize(
    ("peak_mn", "factor"),
    [(peak_mn, factor) for factor in PEAKS_MN for peak_mn in PEAKS_MN[factor]],
)
@pytest.mark.parametrize("floor", [0.0, 1e-6, 1e-4])
def test_a_farther_class_of_a_histogram_with_one_peak_is_never_likelier(
    floor: float, peak_mn: float, factor: float
) -> None:
    """`floor` of each bin: a network never says 0. Stretched, it makes the highest
    class wider than the one below.
    """
    edges_m2 = ratio_edges(64, 0.2e-6)
    middles_mn = (edges_m2[1:] + edges_m2[:-1]) / 2 * 0.3e9
    sd_mn = 0.5 + 0.1 * peak_mn
    density = np.exp(-0.5 * ((middles_mn - peak_mn) / sd_mn) ** 2)
    shares = density * np.diff(edges_m2)
    histogram = shares / shares.sum() + floor
    found = histogram_reading(
        histogram.tolist(), edges_m2.tolist(), 0.3e6, BOUNDS_N, 0.0, lambda _: factor
    )
    assert ordered(found.probabilities, found.force_n), found.probabilities


def test_the_tail_beyond_the_draws_is_no_lighter_than_a_normal_one() -> None:
    """Shares that 512 draws cannot show, beside those of many more."""
    rng = np.random.default_rng(4)
    few = drawn_fit(rng.normal(38e-3, 2e-3, 512))
    many_n = rng.normal(38e-3, 2e-3, 2_000_000)
    for bound_n in (30e-3, 31e-3, 46e-3):
        shares = few.probabilities((bound_n,))
        true = float((many_n < bound_n).mean())
        beyond = min(range(2), key=shares.__getitem__)
        assert 0.3 * min(true, 1.0 - true) < shares[beyond] < 2e-3
    assert fit_reading(few, BOUNDS_N).probabilities[0] < 1e-5


@pytest.mark.parametrize("factor", [0.5, 2.5])
def test_a_stretched_histogram_has_the_quantiles_of_stretched_forces(
    factor: float,
) -> None:
    edges_m2 = ratio_edges(64, 0.2e-6)
    histogram = np.exp(-0.5 * ((np.arange(64) - 40.0) / 4.0) ** 2)
    read = histogram.tolist(), edges_m2.tolist(), 0.3e6, BOUNDS_N
    plain = histogram_reading(*read)
    found = histogram_reading(*read, 0.0, {plain.force_n: factor}.__getitem__)
    share = np.random.default_rng(1).random(400_000)
    drawn = (
        np.interp(share, np.append(0.0, histogram.cumsum() / histogram.sum()), edges_m2)
        * 0.3e6
    )
    drawn = plain.force_n + factor * (drawn - plain.force_n)
    assert found.interval_n == pytest.approx(
        tuple(np.quantile(drawn, [0.05, 0.95])), rel=5e-3
    )
    lower = drawn[(drawn >= 0.0) & (drawn < plain.force_n)]  # half of all
    below = 0.5 * np.mean(lower < BOUNDS_N[0]), np.mean(drawn < BOUNDS_N[1])
    assert found.probabilities == pytest.approx(
        (below[0], below[1] - below[0], 1.0 - below[1]), abs=4e-3
    )


OWN = Modulus(mean_pa=3e5, sd_pa=1e4, source="own")
FIT = drawn_fit(np.linspace(0.0, 3e-2, 11))


def test_traits_follow_the_causes_of_errors() -> None:
    force_n = FIT.force_n
    uneven = replace(FIT, misfit_m=20e-6)
    assert traits_of(Setup(eye=Eye(modulus=OWN, globe=OPEN)), force_n, FIT) == (
        "own E",
        "open",
    )
    assert traits_of(Setup(eye=Eye(modulus=OWN, globe=OPEN)), force_n, uneven) == (
        "own E",
        "open",
        "uneven",
    )
    bulging = FIT.unknown.copy()
    bulging[FORM.start + 1] = -0.1
    other = Setup(eye=Eye(modulus=replace(OWN, source="population"), globe=SEALED))
    assert traits_of(other, force_n, replace(FIT, unknown=bulging)) == (
        "other E",
        "sealed",
        "uneven",
    )
    assert traits_of(Setup(eye=Eye(modulus=OWN)), force_n) == ("own E", "unknown")

    for source in ("stated", "shape"):
        assert traits_of(
            Setup(eye=Eye(modulus=replace(OWN, source=source))), force_n
        ) == (
            "other E",
            "unknown",
        )

    taut = replace(FIT, tension=0.1)
    found = [
        traits_of(Setup(eye=Eye(modulus=OWN, globe=globe)), force_n, taut)[1]
        for globe in (OPEN, SEALED, None)
    ]
    assert found == ["open", "taut", "taut"]
    assert traits_of(other, 9.9e-3, replace(taut, misfit_m=20e-6)) == (
        "other E",
        "taut",
        "uneven",
        "light",
    )


def test_forces_beyond_the_calibration_s_and_wide_gaps_have_traits_of_their_own():
    taut = replace(FIT, tension=0.1)
    gentle = Setup(
        eye=Eye(
            modulus=OWN,
            discrepancy=replace(NO_DISCREPANCY, largest_n=20e-3, widest_gap=0.5),
        )
    )
    found = [
        [traits_of(gentle, force_n, fit)[2:] for fit in (None, taut)]
        for force_n in (23.9e-3, 24.1e-3, 40.1e-3)
    ]
    assert found == [[("sparse",)] * 2, [("beyond",)] * 2, [("far beyond",)] * 2]
    lightly = replace(
        gentle,
        eye=replace(gentle.eye, discrepancy=replace(NO_DISCREPANCY, largest_n=4e-3)),
    )
    assert traits_of(lightly, 9.9e-3, taut) == ("own E", "taut", "light", "far beyond")
    # its discrepancy is another eye's
    stranger = replace(
        gentle, eye=replace(gentle.eye, modulus=replace(OWN, source="population"))
    )

    for same in (
        stranger,
        replace(gentle, eye=replace(gentle.eye, discrepancy=NO_DISCREPANCY)),
        replace(gentle, eye=replace(gentle.eye, discrepancy=None)),
    ):
        assert traits_of(same, 60e-3)[1:] == ("unknown",)

    for gap, more in ((0.45, ()), (0.46, ("sparse",)), (None, ())):
        known = replace(
            gentle,
            eye=replace(
                gentle.eye,
                discrepancy=replace(NO_DISCREPANCY, largest_n=20e-3, widest_gap=gap),
            ),
        )
        assert traits_of(known, 15e-3) == ("own E", "unknown", *more)


def test_every_trait_of_a_reading_may_have_a_factor() -> None:
    found: dict[bool, set[tuple[str, str]]] = {True: set(), False: set()}
    for (
        source,
        globe,
        largest_n,
        gap,
        tension,
        misfit_m,
        force_n,
        by_network,
    ) in product(
        ("own", "population"),
        (OPEN, SEALED, None),
        (8e-3, 14e-3),
        (0.3, 0.6),
        (0.0, 0.1),
        (0.0, 1e-3),
        (1e-3, 15e-3, 60e-3),
        (True, False),
    ):
        discrepancy = replace(NO_DISCREPANCY, largest_n=largest_n, widest_gap=gap)
        known = Setup(
            eye=Eye(
                modulus=replace(OWN, source=source),
                globe=globe,
                discrepancy=discrepancy,
            )
        )
        fit = None if by_network else replace(FIT, tension=tension, misfit_m=misfit_m)
        first, *others = traits_of(known, force_n, fit)
        found[by_network] |= {(first, other) for other in others}

    for by_network, traits in found.items():
        allowed = NETWORK_TRAITS if by_network else FIT_TRAITS
        assert traits == {
            (modulus, trait)
            for modulus, of_modulus in allowed.items()
            for trait in of_modulus
        }


def test_factors_come_from_the_record_are_multiplied_and_are_one_where_it_has_none():
    record = {
        "intervals": {
            "fit": {"own E": {"open": 0.5, "uneven": 1.5}},
            "network": {"other E": {"sealed": 2}},
        }
    }
    factors = parse_factors(record, "model.json")
    own = Setup(eye=Eye(modulus=OWN, globe=OPEN))
    assert (
        factors.of_fit(own, FIT),
        factors.of_fit(own, replace(FIT, misfit_m=1e-3)),
    ) == (0.5, 0.75)
    assert (
        factors.of_fit(
            replace(own, eye=replace(own.eye, globe=SEALED)),
            replace(FIT, misfit_m=1e-3),
        )
        == 1.5
    )
    assert (
        factors.of_network(Setup(eye=Eye(globe=SEALED)), 30e-3),
        factors.of_network(own, 30e-3),
    ) == (2.0, 1.0)
    assert parse_factors({}, "model.json") == NO_FACTORS
    scattered = replace(
        own, eye=replace(own.eye, discrepancy=replace(NO_DISCREPANCY, scatter=1.7))
    )
    assert (own.eye.scatter, scattered.eye.scatter) == (1.0, 1.7)
    assert factors.of_fit(scattered, FIT) == pytest.approx(1.7 * 0.5)
    assert NO_FACTORS.of_fit(scattered, FIT) == 1.7
    # another model of the eye: its errors do not follow
    assert factors.of_network(scattered, 30e-3) == 1.0


def test_a_record_with_other_factors_is_refused() -> None:
    for intervals in (
        *(
            3,
            {"fit": 3},
            {"fit": {"nobody": {}}},
            {"fit": {"own E": 1.0}},
            {"network": {"own E": {"uneven": 1.0}}},
        ),
        *(
            {"network": {"own E": {"open": value}}}
            for value in (0.0, -1.0, nan, inf, "1", True, None)
        ),
    ):
        with pytest.raises(ModelError, match=r"model\.json: intervals"):
            parse_factors({"intervals": intervals}, "model.json")

    with pytest.raises(ModelError, match="earlier version has to be made anew"):
        parse_factors({"intervals": {"fit": {"own E, open, even": 1.5}}}, "model.json")


def test_few_eyes_widen_intervals_and_never_narrow_them() -> None:
    for eyes, narrowed in ((8, 1.0), (9, 0.5)):
        for value, factor in ((0.5, narrowed), (3.0, 3.0)):
            (change,) = find_stretches(of_fit({str(eye): value for eye in range(eyes)}))
            assert change.factor == factor


def test_a_surface_that_bends_like_a_cornea_on_both_sides_is_not_a_sclera() -> None:
    prior = prior_of(Setup(), ReaderStudy())
    fit = replace(FIT, unknown=prior.mean.copy())
    assert no_wall_of_an_eye(fit, prior) is None
    fit.unknown[FORM.start + FORMS.index("left_curvature")] = 45.0
    assert no_wall_of_an_eye(fit, prior) is None
    fit.unknown[FORM.start + FORMS.index("right_angle_rad")] = -0.2
    assert "cornea on both sides" in str(no_wall_of_an_eye(fit, prior))
