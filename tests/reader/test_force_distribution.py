"""What the reader says of a force, against brute force on samples of the same distribution."""

from math import inf, isfinite, nan

import numpy as np
import pytest

from scleraforce.reader.networks import (
    ForceDistribution,
    force_distribution,
    histogram_reading,
    quantile,
    ratio_edges,
)

EDGES_M2 = ratio_edges(20, 0.4e-6)
MODULUS_PA = np.array([0.2e6, 0.31e6, 0.5e6])
BOUNDS_N = (5e-3, 30e-3)


@pytest.fixture
def histograms() -> np.ndarray:
    return np.random.default_rng(5).dirichlet(np.full(20, 0.3), size=3)


def drawn_forces(histogram: np.ndarray, modulus_pa: float, count: int) -> np.ndarray:
    rng = np.random.default_rng(6)
    bins = rng.choice(len(histogram), size=count, p=histogram)
    return modulus_pa * rng.uniform(EDGES_M2[bins], EDGES_M2[bins + 1])


def class_probabilities(distribution: ForceDistribution, bounds_n: tuple[float, ...]) -> np.ndarray:
    """The probability of each class (sample, class), with arrays: the oracle of `histogram_reading`."""
    below = np.empty((len(distribution.share_sk), len(bounds_n) + 2))
    below[:, 0], below[:, -1] = 0.0, 1.0
    for row, edges, shares in zip(below, distribution.edge_n_sk, distribution.share_sk, strict=True):
        row[1:-1] = np.interp(bounds_n, edges, shares)
    probabilities: np.ndarray = below[:, 1:] - below[:, :-1]
    return probabilities


def test_quantiles_and_classes_are_those_of_forces_drawn_from_the_histogram(histograms) -> None:
    found = force_distribution(histograms, EDGES_M2, MODULUS_PA)
    classes = class_probabilities(found, BOUNDS_N)
    for sample, modulus_pa in enumerate(MODULUS_PA):
        forces_n = drawn_forces(histograms[sample], modulus_pa, 200_000)
        for share in (0.05, 0.3, 0.5, 0.95):
            assert abs((forces_n < quantile(found, share)[sample]).mean() - share) < 0.005
        counted = np.histogram(forces_n, [0.0, *BOUNDS_N, np.inf])[0] / len(forces_n)
        np.testing.assert_allclose(classes[sample], counted, atol=0.005)


def test_the_median_lies_in_the_class_that_has_more_than_half() -> None:
    many = np.random.default_rng(7).dirichlet(np.full(20, 0.2), size=500)
    found = force_distribution(many, EDGES_M2, np.full(500, 0.3e6))
    classes = class_probabilities(found, BOUNDS_N)
    np.testing.assert_allclose(classes.sum(axis=1), 1.0, atol=1e-12)
    clear = classes.max(axis=1) > 0.5 + 1e-9
    assert clear.sum() > 300
    np.testing.assert_array_equal(np.searchsorted(BOUNDS_N, found.median_n)[clear], classes.argmax(axis=1)[clear])


def test_the_interval_of_an_even_distribution_leaves_a_twentieth_on_either_side() -> None:
    even = force_distribution(np.diff(EDGES_M2)[None], EDGES_M2, np.array([0.25e6]))
    np.testing.assert_allclose(even.interval_n, [[5e-3, 95e-3]], rtol=1e-12)
    np.testing.assert_allclose(even.median_n, [50e-3], rtol=1e-12)
    np.testing.assert_allclose(class_probabilities(even, BOUNDS_N), [[0.05, 0.25, 0.7]], atol=1e-12)


@pytest.mark.parametrize("place", [0, 7, 19])
def test_a_sure_answer_stays_within_its_bin(place: int) -> None:
    sure = np.zeros((1, 20), dtype=np.float32)
    sure[0, place] = 1.0
    found = force_distribution(sure, EDGES_M2, np.array([0.25e6]))
    low, high = 0.25e6 * EDGES_M2[place : place + 2]
    np.testing.assert_allclose(found.interval_n, [[low + 0.05 * (high - low), low + 0.95 * (high - low)]], rtol=1e-9)


def test_a_bound_beyond_the_largest_force_leaves_its_class_empty() -> None:
    found = ForceDistribution(np.array([[0.0, 10e-3]]), np.array([[0.0, 1.0]]))
    np.testing.assert_allclose(class_probabilities(found, (5e-3, 30e-3)), [[0.5, 0.5, 0.0]], atol=1e-12)


@pytest.mark.parametrize("concentration", [0.02, 0.3, 5.0])
def test_a_single_frame_is_judged_as_many_are(concentration: float) -> None:
    rng = np.random.default_rng(8)
    histograms = rng.dirichlet(np.full(20, concentration), size=200) * rng.uniform(0.1, 3.0, (200, 1))
    moduli_pa = rng.uniform(0.2e6, 0.5e6, 200)
    many = force_distribution(histograms, EDGES_M2, moduli_pa)
    classes = class_probabilities(many, BOUNDS_N)
    for number, (histogram, modulus_pa) in enumerate(zip(histograms, moduli_pa, strict=True)):
        single = histogram_reading(histogram.tolist(), EDGES_M2.tolist(), modulus_pa, BOUNDS_N)
        np.testing.assert_allclose(single.force_n, many.median_n[number], rtol=1e-9)
        np.testing.assert_allclose(single.interval_n, many.interval_n[number], rtol=1e-9)
        np.testing.assert_allclose(single.probabilities, classes[number], atol=1e-12)


def test_a_single_frame_without_force_above_the_bounds_leaves_their_class_empty() -> None:
    single = histogram_reading([1.0], [0.0, 1e-8], 1e6, (5e-3, 30e-3))
    np.testing.assert_allclose(single.probabilities, [0.5, 0.5, 0.0], atol=1e-12)


@pytest.mark.parametrize("wrong", [nan, inf])
@pytest.mark.parametrize("place", [0, 7, 19])
def test_a_histogram_that_is_no_number_gives_no_number(wrong: float, place: int) -> None:
    histogram = [0.05] * 20
    histogram[place] = wrong
    single = histogram_reading(histogram, EDGES_M2.tolist(), 0.3e6, BOUNDS_N)
    assert not isfinite(single.force_n)
    assert not all(map(isfinite, single.probabilities))


def test_an_empty_histogram_gives_no_number() -> None:
    single = histogram_reading([0.0] * 20, EDGES_M2.tolist(), 0.3e6, BOUNDS_N)
    assert not any(map(isfinite, (single.force_n, *single.interval_n, single.probabilities[1])))
