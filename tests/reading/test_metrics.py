"""Metrics against naive counts, and the Wilson interval against published values and
its defining equation.
"""

from math import isnan, nan, sqrt

import numpy as np
import pytest
from hypothesis import given, strategies as st

from scleraforce.calibration.answer_metrics import (
    ForceTrial,
    Proportion,
    accuracy,
    band_of,
    confusion_matrix,
    coverage,
    precision,
    recall,
)

PAPER = np.array([[5, 2, 0], [0, 14, 1], [0, 0, 23]])
PAIRS = st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2)), max_size=40)


def share(hits: int, total: int) -> float:
    return hits / total if total else nan


def values(proportions: tuple[Proportion, ...]) -> list[float]:
    return [proportion.value for proportion in proportions]


@given(PAIRS)
def test_metrics_equal_naive_counts(pairs: list[tuple[int, int]]):
    target = [t for t, _ in pairs]
    predicted = [p for _, p in pairs]
    confusion = confusion_matrix(target, predicted)
    for cell in np.ndindex(3, 3):
        assert confusion[cell] == pairs.count(cell)

    right = sum(t == p for t, p in pairs)
    np.testing.assert_equal(accuracy(confusion).value, share(right, len(pairs)))
    for found, counted in ((recall, target), (precision, predicted)):
        expected = [share(pairs.count((k, k)), counted.count(k)) for k in range(3)]
        np.testing.assert_equal(values(found(confusion)), expected)


def test_the_papers_table_3_has_the_two_names_the_other_way_round():
    printed_as_precision = [0.71, 0.93, 1.00]
    printed_as_recall = [1.00, 0.88, 0.96]
    assert values(recall(PAPER)) == pytest.approx(printed_as_precision, abs=0.005)
    assert values(precision(PAPER)) == pytest.approx(printed_as_recall, abs=0.006)
    assert round(accuracy(PAPER).value, 2) == 0.93


@pytest.mark.parametrize(
    ("hits", "total", "low", "high"),
    [
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_wilson_intervals_equal_the_published_ones(hits, total, low, high):
    """Newcombe, Statistics in Medicine 17 (1998) 857, Table I, method 3 (score, without
    continuity correction).
    """
    assert Proportion(hits, total).interval == pytest.approx((low, high), abs=5e-5)
    assert all(map(isnan, Proportion(0, 0).interval))


@given(st.integers(1, 500), st.data())
def test_the_ends_of_a_wilson_interval_are_where_the_score_test_rejects(
    total: int, data: st.DataObject
):
    hits = data.draw(st.integers(0, total))
    for end in Proportion(hits, total).interval:
        if 1e-9 < end < 1.0 - 1e-9:
            score = abs(hits / total - end) / sqrt(end * (1 - end) / total)
            assert score == pytest.approx(1.959963985, rel=1e-6)


@pytest.mark.parametrize("labels", [([0], []), ([3], [0]), ([0], [-1])])
def test_impossible_labels_are_refused(labels):
    with pytest.raises(ValueError):
        confusion_matrix(*labels)


def trials(
    read_n: np.ndarray,
    measured_n: np.ndarray,
    sd_n: float,
    reach_n: tuple[float, float],
    eyes: np.ndarray | None = None,
) -> list[ForceTrial]:
    """Trials whose intervals reach from below the read force to above it."""
    names = np.zeros(len(read_n)) if eyes is None else eyes
    return [
        ForceTrial(
            eye=f"{eye}",
            measured_n=measured,
            read_n=read,
            interval_n=(read - reach_n[0], read + reach_n[1]),
            measured_sd_n=sd_n,
        )
        for eye, read, measured in zip(names, read_n, measured_n, strict=True)
    ]


def test_the_band_of_the_coverage_is_that_of_whole_eyes():
    """If every eye is right or wrong as a whole, it is the band of as many coins; 17
    frames an eye do not help.
    """
    rng = np.random.default_rng(0)
    right = rng.uniform(size=30) < 0.9
    off_n = np.repeat(np.where(right, 0.0, 9.0), 17)
    eyes = np.repeat(np.arange(30), 17)
    of_eyes = trials(off_n, 0.0 * off_n, 0.0, (1.0, 1.0), eyes)
    low, high = band_of(of_eyes)
    half = 1.96 * sqrt(right.mean() * (1.0 - right.mean()) / 30)
    assert low == pytest.approx(right.mean() - half, abs=0.04)
    assert high == pytest.approx(min(right.mean() + half, 1.0), abs=0.04)
    assert band_of(of_eyes) == (low, high)  # drawn from one seed
    assert band_of(trials(0.0 * off_n, 0.0 * off_n, 0.0, (1.0, 1.0), eyes)) == (1, 1)


@pytest.mark.parametrize("label_sd", [0.0, 0.2, 1.0, 5.0])
def test_honest_intervals_agree_with_nine_of_ten_labels_however_noisy_they_are(
    label_sd,
):
    true, noise = np.random.default_rng(5).standard_normal((2, 20_000))
    measured = true + label_sd * noise
    honest = trials(0.0 * true, measured, label_sd, (1.6449, 1.6449))
    assert coverage(honest).value == pytest.approx(0.9, abs=0.01)


def test_intervals_that_claim_too_much_agree_with_fewer_and_lopsided_ones_may_be_honest():
    rng = np.random.default_rng(5)
    z, noise = rng.standard_normal((2, 40_000))
    claiming = trials(0.0 * z, z + 0.5 * noise, 0.5, (0.8, 0.8))
    assert coverage(claiming).value < 0.75
    # twice as large to one side
    measured = np.where(z > 0.0, 2.0, 1.0) * z + 1.5 * noise
    lopsided = trials(0.0 * z, measured, 1.5, (1.6449, 2 * 1.6449))
    assert coverage(lopsided).value == pytest.approx(0.9, abs=0.015)
