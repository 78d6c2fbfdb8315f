"""The factors of a reading's traits, by which intervals are stretched, from scores of virtual eyes.

Quantile regression (Koenker and Bassett 1978): the logarithm of what 90 % of the scores stay below is a sum over the
traits. At its solution 90 % of the scores of each trait stay below, whatever else these readings have (conditional
conformal prediction over groups that overlap: Gibbs, Cherian and Candes 2023), and few eyes tell it, for a trait is
learned from all readings that have it. A factor for each combination of traits instead had 4 to 40 eyes; the share for
a new eye is then 0.92 to 1 of theirs, and intervals were too wide.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_array, eye_array, hstack

from scleraforce.errors import SolverError
from scleraforce.reader.intervals import (
    GLOBE_TRAITS,
    LARGEST,
    SMALLEST,
    Factors,
    Score,
    eye_count,
    of_each_modulus,
    share_of_new_eye,
    weights_of_eyes,
)

LEAST_SCORE = 1e-3  # a force at the median has no logarithm


def trait_factors(scores: Sequence[Score]) -> Mapping[str, Factors]:
    """Return the factor of every trait that scores are of, by method and modulus.

    The factor of what is told of the globe (`interval_traits.GLOBE_TRAITS`) is at least `SMALLEST`, that of any other
    trait at least 1: these make a reader worse, and what few eyes say to the contrary is chance.

    Raises:
        SolverError: the regression has no solution.
    """
    found: dict[str, dict[str, dict[str, float]]] = {}
    for (method, modulus), entries in of_each_modulus(scores).items():
        found.setdefault(method, {})[modulus] = _regression(entries)
    return found


def _regression(scores: Sequence[Score]) -> dict[str, float]:
    """Return the factors of the traits of readings with one kind of modulus.

    The linear programme of Koenker and Bassett: of what scores are above and below what is predicted, each eye with the
    same weight, the least sum of share times above and (1 - share) times below.
    """
    traits = sorted({trait for entry in scores for trait in entry.traits[1:]})
    has = csr_array(np.array([[trait in entry.traits for trait in traits] for entry in scores], dtype=np.float64))
    logs = np.log([max(entry.score, LEAST_SCORE) for entry in scores])
    share, weight = share_of_new_eye(eye_count(scores)), len(scores) * weights_of_eyes(scores)  # 1 in the mean
    one = eye_array(len(scores))
    ends = [(np.log(SMALLEST) if trait in GLOBE_TRAITS else 0.0, np.log(LARGEST)) for trait in traits]
    solution = linprog(
        np.concatenate([np.zeros(len(traits)), share * weight, (1.0 - share) * weight]),
        A_eq=hstack([has, one, -one], format="csr"),
        b_eq=logs,
        bounds=[*ends, *[(0.0, None)] * (2 * len(scores))],
        method="highs",
    )
    if solution.x is None:
        raise SolverError(f"factors of the intervals: {solution.message}")
    return {trait: round(float(np.exp(value)), 4) for trait, value in zip(traits, solution.x, strict=False)}
