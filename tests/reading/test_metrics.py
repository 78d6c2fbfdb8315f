"""Metrics against naive counts, and the Wilson interval against published values and
its defining equation.
"""

from math import isnan, nan, sqrt

import numpy as np
import pytest
from hypothesis import given, strategies as st

from scleraforce.calibration import answer_metrics

PAPER = np.array([[5, 2, 0], [0, 14, 1], [0, 0, 23]])
PAIRS = st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2)), max_size=40)


def share(hits: int, total: int) -> float:
    return hits / total if total else nan


def values(proportions: tuple[answer_metrics.Proportion, ...]) -> list[float]:
    return [proportion.value for proportion in proportions]


@given(PAIRS)
def test_metrics_equal_naive_counts(pairs: list[tuple[int, int]]) -> None:
    target = [t for t, _ in pairs]
    predicted = [p for _, p in pairs]
    confusion = answer_metrics.confusion_matrix(target, predicted)

    for row in range(3):
        for column in range(3):
            assert confusion[row, column] == sum(
                pair == (row, column) for pair in pairs
            )

    np.testing.assert_equal(
        answer_metrics.accuracy(confusion).value,
        share(sum(t == p for t, p in pairs), len(pairs)),
    )
    for found, counted in (
        (answer_metrics.recall, target),
        (answer_metrics.precision, predicted),
    ):
        expected = [
            share(sum(t == p == k for t, p in pairs), counted.count(k))
            for k in range(3)
        ]
        np.testing.assert_equal(values(found(confusion)), expected)


def test_the_papers_table_3_has_the_two_names_the_other_way_round() -> None:
    printed_as_precision = [0.71, 0.93, 1.00]
    printed_as_recall = [1.00, 0.88, 0.96]
    np.testing.assert_allclose(
        values(answer_metrics.recall(PAPER)), printed_as_precision, atol=0.005
    )
    np.testing.assert_allclose(
        values(answer_metrics.precision(PAPER)), printed_as_recall, atol=0.005
    )
    assert round(answer_metrics.accuracy(PAPER).value, 2) == 0.93


def test_wilson_intervals_equal_the_published_ones() -> None:
    """Newcombe, Statistics in Medicine 17 (1998) 857, Table I, method 3 (score, without
    continuity correction).
    """
    published = (
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    )
    for hits, total, *ends in published:
        np.testing.assert_allclose(
            answer_metrics.Proportion(hits, total).interval, ends, atol=5e-5
        )


@given(st.integers(1, 500), st.data())
def test_the_ends_of_a_wilson_interval_are_where_the_score_test_rejects(
    total: int, data: st.DataObject
) -> None:
    hits = data.draw(st.integers(0, total))
    for end in answer_metrics.Proportion(hits, total).interval:
        if 1e-9 < end < 1.0 - 1e-9:
            score = abs(hits / total - end) / sqrt(end * (1 - end) / total)
            assert score == pytest.approx(1.959963985, rel=1e-6)


def test_undefined_metrics_are_not_a_number_and_impossible_labels_are_refused() -> None:
    nothing = answer_metrics.confusion_matrix([], [])
    assert all(
        isnan(value)
        for value in (
            answer_metrics.accuracy(nothing).value,
            *values(answer_metrics.recall(nothing)),
        )
    )
    assert all(isnan(end) for end in answer_metrics.accuracy(nothing).interval)

    for target, predicted in (([0], []), ([3], [0]), ([0], [-1])):
        with pytest.raises(ValueError):
            answer_metrics.confusion_matrix(target, predicted)


def test_the_band_of_the_coverage_is_that_of_whole_eyes() -> None:
    """If every eye is right or wrong as a whole, it is the band of as many coins; 17
    frames an eye do not help.
    """
    rng = np.random.default_rng(0)
    right = rng.uniform(size=30) < 0.9
    eyes = np.repeat([f"eye-{number}" for number in range(30)], 17).tolist()
    low, high = answer_metrics.coverage_band(eyes, np.repeat(right, 17).tolist())
    share = right.mean()
    half = 1.96 * sqrt(share * (1.0 - share) / 30)
    assert low == pytest.approx(share - half, abs=0.04)
    assert high == pytest.approx(min(share + half, 1.0), abs=0.04)
    assert answer_metrics.coverage_band(eyes, [True] * len(eyes)) == (1.0, 1.0)
    # drawn from one seed
    assert answer_metrics.coverage_band(eyes, np.repeat(right, 17).tolist()) == (
        low,
        high,
    )


def agreeing(
    read: np.ndarray, measured: np.ndarray, label_sd: float, below: float, above: float
) -> float:
    """The coverage of readings whose intervals reach from `below` under the force to
    `above` over it.
    """
    pairs = zip(read.tolist(), measured.tolist(), strict=True)
    trials = [
        answer_metrics.ForceTrial(
            eye="a",
            measured_n=label,
            read_n=force,
            interval_n=(force - below, force + above),
            measured_sd_n=label_sd,
        )
        for force, label in pairs
    ]

    return answer_metrics.coverage(trials).value


def test_honest_intervals_agree_with_nine_of_ten_labels_however_noisy_they_are():
    rng = np.random.default_rng(5)
    for label_sd in (0.0, 0.2, 1.0, 5.0):
        read, true, noise = rng.standard_normal((3, 20_000)) * np.array(
            [[0.0], [1.0], [label_sd]]
        )
        assert agreeing(read, true + noise, label_sd, 1.6449, 1.6449) == pytest.approx(
            0.9, abs=0.01
        )

    read, true, noise = rng.standard_normal((3, 5000)) * np.array([[0.0], [1.0], [0.5]])
    assert agreeing(read, true + noise, 0.5, 0.8, 0.8) < 0.75  # they claim too much
    # twice as large to one side
    errors = np.where((z := rng.standard_normal(40_000)) > 0.0, 2.0, 1.0) * z
    measured = errors + rng.normal(0.0, 1.5, len(errors))
    assert agreeing(0.0 * z, measured, 1.5, 1.6449, 2 * 1.6449) == pytest.approx(
        0.9, abs=0.015
    )
