"""Intervals that hold: scores, factors of traits, and what a factor does to a reading."""

from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest

from scleraforce.errors import ModelError
from scleraforce.known import NO_DISCREPANCY, OPEN, SEALED, Known, Modulus
from scleraforce.library.fit import BoundaryFit
from scleraforce.library.prior import prior_of
from scleraforce.library.unknowns import FORM, FORMS, NAMES
from scleraforce.reader.answer import Reading, fit_reading
from scleraforce.reader.intervals import (
    FIT_TRAITS,
    GLOBE_TRAITS,
    NETWORK_TRAITS,
    NO_FACTORS,
    IntervalFactors,
    Score,
    conformal_quantile,
    intervals_record,
    parse_factors,
    score,
    stretched,
    stretches,
    traits_of,
)
from scleraforce.reader.networks import histogram_reading, ratio_edges
from scleraforce.reader.verdicts import no_wall_of_an_eye
from scleraforce.study import ReaderStudy

BOUNDS_N = (5e-3, 30e-3)


OWN_EVEN = ("own E", "open")


def scores_of_eyes(rng: np.random.Generator, eyes: int, frames: int) -> list[Score]:
    """Scores of eyes that differ: each has an error of its own, larger than those of its frames."""
    own = np.abs(rng.standard_normal(eyes))
    return [
        Score("fit", OWN_EVEN, str(eye), float(abs(own[eye] + 0.2 * rng.standard_normal())))
        for eye in range(eyes)
        for _ in range(frames)
    ]


def of_fit(score_of_eye: dict[str, float]) -> list[Score]:
    return [Score("fit", OWN_EVEN, eye, value) for eye, value in score_of_eye.items()]


def test_the_quantile_of_some_eyes_holds_on_others() -> None:
    rng = np.random.default_rng(3)
    held = []
    for _ in range(200):
        factor = conformal_quantile(scores_of_eyes(rng, 60, 5))
        held.append(np.mean([entry.score <= factor for entry in scores_of_eyes(rng, 60, 5)]))
    assert np.mean(held) == pytest.approx(0.905, abs=0.012)  # 0.9 (n + 1)/n of the eyes' readings


def test_an_eye_of_many_frames_weighs_as_one_of_few() -> None:
    few = of_fit({str(eye): 0.5 for eye in range(99)})
    many = of_fit({"long": 9.0}) * 10_000
    assert conformal_quantile([*few, *many]) == pytest.approx(0.5)
    assert conformal_quantile(few[:4] + many) == pytest.approx(9.0)


def test_with_few_eyes_the_widest_reading_counts() -> None:
    assert conformal_quantile(of_fit({str(eye): 1.0 + eye for eye in range(5)})) == pytest.approx(5.0)


def test_the_share_is_that_of_a_new_eye() -> None:
    scores = of_fit({str(eye): 1.0 + eye for eye in range(10)})
    assert conformal_quantile(scores) == pytest.approx(10.0)  # 0.9 (10 + 1)/10 of them, not 0.9


def test_stretches_count_what_held_before_and_are_of_all_readings_with_one_kind_of_modulus() -> None:
    did = ((0.5, "open"), (1.0, "open"), (1.5, "taut"), (3.0, "taut"))
    scores = [Score("fit", ("own E", kind, "light"), str(eye % 3), value) for eye, (value, kind) in enumerate(did)]
    scores += [Score("fit", ("other E", "sealed"), "x", 2.0), Score("network", ("own E", "open"), "x", 4.0)]
    of_other, of_own, of_network = stretches(scores)
    assert (of_own.method, of_own.modulus, of_own.globes) == ("fit", "own E", ("open", "taut"))
    assert (of_own.eyes, of_own.readings, of_own.held, of_own.factor) == (3, 4, 0.5, 3.0)
    assert (of_other.modulus, of_other.globes, of_other.factor) == ("other E", ("sealed",), 2.0)
    assert (of_network.method, of_network.factor) == ("network", 4.0)


def test_a_score_is_one_at_both_ends_of_an_interval() -> None:
    reading = Reading(probabilities=(0.0, 1.0, 0.0), force_n=10e-3, interval_n=(8e-3, 14e-3), contact_m=0.0)
    assert [score(reading, force_n) for force_n in (8e-3, 10e-3, 14e-3)] == pytest.approx([1.0, 0.0, 1.0])


def drawn_fit(draws_n: np.ndarray) -> BoundaryFit:
    low_n, median_n, high_n = np.quantile(draws_n, [0.05, 0.5, 0.95])
    return BoundaryFit(
        force_n=float(median_n), interval_n=(float(low_n), float(high_n)), draws_n=draws_n, contact_m=0.0, tip_m=1e-3,
        misfit_m=3e-6, outliers=0.0, wall_bmc=np.zeros((2, 2, 2)), iop_pa=300.0, tension=0.02, loss=0.0,
        unknown=np.zeros(len(NAMES)), sd=np.zeros(len(NAMES)),
    )  # fmt: skip


@pytest.mark.parametrize("factor", [0.5, 1.0, 3.0])
def test_a_stretched_fit_is_that_of_stretched_draws(factor: float) -> None:
    rng = np.random.default_rng(0)
    draws_n = 28e-3 + 3e-3 * rng.standard_normal(4001)
    fit = drawn_fit(draws_n)
    found = fit_reading(fit, BOUNDS_N, factor)
    wanted = drawn_fit(fit.force_n + factor * (draws_n - fit.force_n))
    assert found.interval_n == pytest.approx(wanted.interval_n, rel=1e-9)
    assert found.probabilities == pytest.approx(wanted.probabilities(BOUNDS_N), abs=1e-3)
    assert found.force_n == fit.force_n


@pytest.mark.parametrize("factor", [0.5, 2.5])
def test_a_stretched_histogram_is_that_of_stretched_forces(factor: float) -> None:
    rng = np.random.default_rng(1)
    edges_m2 = ratio_edges(64, 0.2e-6)
    histogram = np.exp(-0.5 * ((np.arange(64) - 40.0) / 4.0) ** 2)
    plain = histogram_reading(histogram.tolist(), edges_m2.tolist(), 0.3e6, BOUNDS_N)
    found = histogram_reading(
        histogram.tolist(), edges_m2.tolist(), 0.3e6, BOUNDS_N, 0.0, {plain.force_n: factor}.__getitem__
    )
    drawn = np.interp(rng.random(400_000), np.append(0.0, histogram.cumsum() / histogram.sum()), edges_m2) * 0.3e6
    drawn = plain.force_n + factor * (drawn - plain.force_n)
    assert found.interval_n == pytest.approx(tuple(np.quantile(drawn, [0.05, 0.95])), rel=5e-3)
    below = np.searchsorted(np.sort(drawn), BOUNDS_N) / len(drawn)
    assert found.probabilities == pytest.approx((below[0], below[1] - below[0], 1.0 - below[1]), abs=4e-3)


def test_no_stretched_interval_begins_below_zero_and_no_nan_becomes_a_number() -> None:
    fit = drawn_fit(np.abs(1e-3 + 1e-3 * np.random.default_rng(0).standard_normal(501)))
    assert fit_reading(fit, BOUNDS_N, 5.0).interval_n[0] == 0.0
    broken = replace(fit, force_n=nan, interval_n=(nan, nan))
    assert not fit_reading(broken, BOUNDS_N, 5.0).finite


def test_traits_follow_what_makes_a_reader_wrong() -> None:
    own, fit = Modulus(mean_pa=3e5, sd_pa=1e4, source="own"), drawn_fit(np.linspace(0.0, 3e-2, 11))
    force_n = fit.force_n
    assert traits_of(Known(modulus=own, globe=OPEN), force_n, fit) == ("own E", "open")
    uneven = replace(fit, misfit_m=20e-6)
    assert traits_of(Known(modulus=own, globe=OPEN), force_n, uneven) == ("own E", "open", "uneven")
    bulging = fit.unknown.copy()
    bulging[FORM.start + 1] = -0.1
    other = Known(modulus=replace(own, source="population"), globe=SEALED)
    assert traits_of(other, force_n, replace(fit, unknown=bulging)) == ("other E", "sealed", "uneven")
    assert traits_of(Known(modulus=own), force_n) == ("own E", "unknown")
    assert traits_of(Known(modulus=replace(own, source="stated")), force_n) == ("other E", "unknown")  # told, not found
    taut = replace(fit, tension=0.1)
    assert [traits_of(Known(modulus=own, globe=globe), force_n, taut)[1] for globe in (OPEN, SEALED, None)] == [
        "open", "taut", "taut",
    ]  # fmt: skip
    assert traits_of(other, 9.9e-3, replace(taut, misfit_m=20e-6)) == ("other E", "taut", "uneven", "light")


def test_forces_beyond_those_of_the_calibration_have_a_trait_of_their_own() -> None:
    taut = replace(drawn_fit(np.linspace(0.0, 3e-2, 11)), tension=0.1)
    own = Modulus(mean_pa=3e5, sd_pa=1e4, source="own")
    gentle = Known(modulus=own, discrepancy=replace(NO_DISCREPANCY, largest_n=20e-3, widest_gap=0.5))
    found = [[traits_of(gentle, force_n, fit)[2:] for fit in (None, taut)] for force_n in (23.9e-3, 24.1e-3, 40.1e-3)]
    assert found == [[("sparse",)] * 2, [("beyond",)] * 2, [("far beyond",)] * 2]
    lightly = replace(gentle, discrepancy=replace(NO_DISCREPANCY, largest_n=4e-3))
    assert traits_of(lightly, 9.9e-3, taut) == ("own E", "taut", "light", "far beyond")
    told = replace(gentle, modulus=replace(own, source="population"))  # whose discrepancy is another eye's
    for same in (told, replace(gentle, discrepancy=NO_DISCREPANCY), replace(gentle, discrepancy=None)):
        assert traits_of(same, 60e-3)[1:] == ("unknown",)


@pytest.mark.parametrize(("gap", "more"), [(0.45, ()), (0.46, ("sparse",)), (None, ())])
def test_a_calibration_with_a_wide_gap_is_a_trait(gap: float | None, more: tuple[str, ...]) -> None:
    own = Modulus(mean_pa=3e5, sd_pa=1e4, source="own")
    known = Known(modulus=own, discrepancy=replace(NO_DISCREPANCY, largest_n=20e-3, widest_gap=gap))
    assert traits_of(known, 15e-3) == ("own E", "unknown", *more)


def test_every_trait_of_a_reading_may_have_a_factor() -> None:
    fit = drawn_fit(np.linspace(0.0, 3e-2, 11))
    fits = [replace(fit, tension=tension, misfit_m=misfit_m, force_n=force_n)
            for tension in (0.0, 0.1) for misfit_m in (0.0, 1e-3) for force_n in (1e-3, 15e-3, 60e-3)]  # fmt: skip
    moduli = [Modulus(mean_pa=3e5, sd_pa=1e4, source=source) for source in ("own", "population")]
    discrepancies = [replace(NO_DISCREPANCY, largest_n=n, widest_gap=gap) for n in (8e-3, 14e-3) for gap in (0.3, 0.6)]
    found: dict[bool, set[tuple[str, str]]] = {True: set(), False: set()}
    for modulus in moduli:
        for known in [
            Known(modulus=modulus, globe=g, discrepancy=d) for g in (OPEN, SEALED, None) for d in discrepancies
        ]:
            for each in fits:
                for seen in (each, None):
                    first, *others = traits_of(known, each.force_n, seen)
                    found[seen is None] |= {(first, other) for other in others}
    for by_network, traits in found.items():
        allowed = NETWORK_TRAITS if by_network else FIT_TRAITS
        assert traits == {(modulus, trait) for modulus, of_modulus in allowed.items() for trait in of_modulus}
    assert set(GLOBE_TRAITS) <= set(FIT_TRAITS["own E"])


def test_factors_come_from_the_record_are_multiplied_and_are_one_where_it_has_none() -> None:
    record = {"intervals": {"fit": {"own E": {"open": 0.5, "uneven": 1.5}}, "network": {"other E": {"sealed": 2}}}}
    factors, fit = parse_factors(record, "model.json"), drawn_fit(np.linspace(0.0, 3e-2, 11))
    own = Known(modulus=Modulus(mean_pa=3e5, sd_pa=1e4, source="own"), globe=OPEN)
    assert (factors.of_fit(own, fit), factors.of_fit(own, replace(fit, misfit_m=1e-3))) == (0.5, 0.75)
    assert factors.of_fit(replace(own, globe=SEALED), replace(fit, misfit_m=1e-3)) == 1.5
    assert (factors.of_network(Known(globe=SEALED), 30e-3), factors.of_network(own, 30e-3)) == (2.0, 1.0)
    assert parse_factors({}, "model.json") == NO_FACTORS


def test_an_eye_whose_frames_scattered_has_wider_intervals_of_the_fit() -> None:
    own, fit = Modulus(mean_pa=3e5, sd_pa=1e4, source="own"), drawn_fit(np.linspace(0.0, 3e-2, 11))
    even = Known(modulus=own, globe=OPEN)
    scattered = replace(even, discrepancy=replace(NO_DISCREPANCY, scatter=1.7))
    assert (even.scatter, scattered.scatter, NO_DISCREPANCY.scatter) == (1.0, 1.7, 1.0)
    factors = IntervalFactors(network={"own E": {"open": 2.0}}, fit={"own E": {"open": 1.5}})
    assert factors.of_fit(scattered, fit) == pytest.approx(1.7 * 1.5)
    assert NO_FACTORS.of_fit(scattered, fit) == 1.7
    assert factors.of_network(scattered, 30e-3) == 2.0  # another model of the eye: its errors do not follow


@pytest.mark.parametrize(
    "intervals",
    [3, {"fit": 3}, {"fit": {"nobody": {}}}, {"fit": {"own E": 1.0}}, {"network": {"own E": {"uneven": 1.0}}}]
    + [{"network": {"own E": {"open": value}}} for value in (0.0, -1.0, nan, inf, "1", True, None)],
)
def test_a_record_with_other_factors_is_refused(intervals: object) -> None:
    with pytest.raises(ModelError, match=r"model\.json: intervals"):
        parse_factors({"intervals": intervals}, "model.json")


def test_a_record_of_an_earlier_version_says_what_to_do() -> None:
    with pytest.raises(ModelError, match="earlier version has to be made anew"):
        parse_factors({"intervals": {"fit": {"own E, open, even": 1.5}}}, "model.json")


def test_scores_that_count_from_stretched_intervals_stretch_them_again() -> None:
    before = IntervalFactors(network={"own E": {"open": 3.0}}, fit={"own E": {"open": 1.5, "taut": 4.0, "light": 1.2}})
    scores = [Score("fit", ("own E", kind, "light"), str(eye), 2.0) for eye in range(20) for kind in ("open", "sealed")]
    after = stretched(before, stretches(scores))
    assert after["fit"] == {"own E": {"open": 3.0, "taut": 4.0, "light": 1.2, "sealed": 2.0}}
    assert after["network"] == before.network
    assert before.fit["own E"]["open"] == 1.5
    record = intervals_record(scores, after, "recordings of eye-a")
    assert parse_factors({"intervals": record}, "m").fit == after["fit"]
    assert (record["eyes"], record["readings"], record["source"]) == (20, 40, "recordings of eye-a")


@pytest.mark.parametrize(("eyes", "narrowed"), [(8, 1.0), (9, 0.5)])
def test_few_eyes_widen_intervals_and_never_narrow_them(eyes: int, narrowed: float) -> None:
    (change,) = stretches(of_fit({str(eye): 0.5 for eye in range(eyes)}))
    assert change.factor == narrowed
    (change,) = stretches(of_fit({str(eye): 3.0 for eye in range(eyes)}))
    assert change.factor == 3.0


def test_a_surface_that_bends_like_a_cornea_on_both_sides_is_no_sclera() -> None:
    prior = prior_of(Known(), ReaderStudy())
    fit = replace(drawn_fit(np.linspace(0.0, 1e-2, 11)), unknown=prior.mean.copy())
    assert no_wall_of_an_eye(fit, prior) is None
    fit.unknown[FORM.start + FORMS.index("left_curvature")] = 45.0
    assert no_wall_of_an_eye(fit, prior) is None
    fit.unknown[FORM.start + FORMS.index("right_angle_rad")] = -0.2
    assert "cornea on both sides" in str(no_wall_of_an_eye(fit, prior))
