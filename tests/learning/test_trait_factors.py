"""Factors of traits: quantile regression, against plain quantiles, drawn scores and what it promises."""

import numpy as np
import pytest

from scleraforce.learning.intervals import trait_factors
from scleraforce.reader.intervals import Score, conformal_quantile

TRAITS = {"sealed": 0.6, "taut": 0.9, "uneven": 1.5, "light": 2.0, "sparse": 1.0}


def drawn(rng: np.random.Generator, eyes: int, frames: int) -> list[Score]:
    """Scores of eyes with traits that multiply: sealed or taut, and each of the others of a half."""
    found = []
    for eye in range(eyes):
        of_eye = [name for name in ("uneven", "sparse") if rng.random() < 0.5]
        own = abs(rng.standard_normal())
        for _ in range(frames):
            traits = ["taut" if rng.random() < 0.3 else "sealed", *of_eye, *["light"] * (rng.random() < 0.4)]
            size = np.prod([TRAITS[trait] for trait in traits])
            found.append(Score("fit", ("own E", *traits), str(eye), float(size * abs(own + rng.normal(0.0, 0.4)))))
    return found


def test_of_one_trait_the_factor_is_the_quantile() -> None:
    rng = np.random.default_rng(0)
    scores = [
        Score("fit", ("own E", "open"), str(eye), float(value)) for eye, value in enumerate(rng.uniform(0.4, 3, 77))
    ]
    assert trait_factors(scores) == {"fit": {"own E": {"open": pytest.approx(conformal_quantile(scores), rel=0.02)}}}


def test_traits_that_multiply_are_found() -> None:
    factors = trait_factors(drawn(np.random.default_rng(1), 1000, 6))["fit"]["own E"]
    held = factors["sealed"] / TRAITS["sealed"]  # what 90 % of the eyes' own errors stay below
    assert held == pytest.approx(1.75, rel=0.05)
    for trait, size in TRAITS.items():
        wanted = size * (held if trait in ("sealed", "taut") else 1.0)
        assert factors[trait] == pytest.approx(wanted, rel=0.08), trait


@pytest.mark.slow
def test_of_each_trait_90_percent_are_held_and_of_new_eyes_too() -> None:
    rng = np.random.default_rng(2)
    of_new = []
    for _ in range(12):
        scores, others = drawn(rng, 200, 6), drawn(rng, 200, 6)
        factors = trait_factors(scores)["fit"]["own E"]

        def held(entries: list[Score], trait: str, given: dict[str, float]) -> float:
            having = [entry for entry in entries if trait in entry.traits]
            return float(
                np.mean([entry.score <= np.prod([given[name] for name in entry.traits[1:]]) for entry in having])
            )

        for trait in ("sealed", "uneven", "light"):
            assert held(scores, trait, factors) == pytest.approx(0.905, abs=0.02), trait
        of_new.append([held(others, trait, factors) for trait in TRAITS])
    np.testing.assert_allclose(np.mean(of_new, axis=0), 0.90, atol=0.02)


def test_no_trait_beside_the_kind_makes_intervals_narrower() -> None:
    scores = [Score("network", ("other E", "open"), str(eye), 1.0) for eye in range(50)]
    scores += [Score("network", ("other E", "open", "sparse"), str(eye), 0.1) for eye in range(50)]
    assert trait_factors(scores)["network"]["other E"]["sparse"] == 1.0


def test_an_eye_of_many_frames_weighs_as_one_of_few() -> None:
    scores = [Score("fit", ("own E", "open"), str(eye), 0.5) for eye in range(99)]
    scores += [Score("fit", ("own E", "open"), "long", 9.0)] * 2000
    assert trait_factors(scores)["fit"]["own E"]["open"] == pytest.approx(0.5)


def test_methods_and_moduli_are_apart_and_a_force_at_the_median_counts() -> None:
    sizes = {("fit", "own E"): 0.5, ("fit", "other E"): 2.0, ("network", "own E"): 3.0}
    scores = [Score(method, (modulus, "open"), str(eye), size)
              for (method, modulus), size in sizes.items() for eye in range(60)]  # fmt: skip
    scores.append(Score("fit", ("own E", "open"), "60", 0.0))
    found = trait_factors(scores)
    assert {(m, e): factors["open"] for m, of in found.items() for e, factors in of.items()} == pytest.approx(sizes)


@pytest.mark.parametrize(("score", "factor"), [(0.01, 0.3), (100.0, 20.0)])
def test_a_few_eyes_promise_no_more_and_say_no_less_than_a_bound(score: float, factor: float) -> None:
    scores = [Score("fit", ("own E", "open"), str(eye), score) for eye in range(30)]
    assert trait_factors(scores)["fit"]["own E"]["open"] == pytest.approx(factor)
    assert conformal_quantile(scores) == pytest.approx(factor)
