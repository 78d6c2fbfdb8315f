"""The elastic force of tissue that relaxes, from the force that a sensor feels, with
its compiled loops; `tissue_material` has the model.
"""

from collections.abc import Sequence

import numpy as np

from scleraforce.base.arrays import Flags, Floats
from scleraforce.base.compiled_loops import compiled
from scleraforce.mechanics.tissue_material import line_weights


def driven_back(
    felt_n: Floats,
    time_s: Floats,
    contact: Flags,
    shares: Floats,
    times_s: Sequence[float],
    *,
    anew: bool = False,
) -> tuple[Floats, Floats]:
    """Return Fe (candidate, sample) and every m_i (candidate, sample, term) from F
    (sample,), at rest before it.

    `shares` (candidate, term). Fe is 0 where `contact` is False: nothing pulls there.
    `anew`: m_i is 0 there, too, so that each push begins at rest.
    """
    weights = line_weights(np.diff(time_s, prepend=time_s[:1]), times_s)
    return _driven_back(
        np.ascontiguousarray(felt_n, np.float64),
        np.ascontiguousarray(contact, np.bool_),
        np.ascontiguousarray(shares, np.float64),
        weights,
        anew,
    )


@compiled
def _driven_back(
    felt_n: Floats, contact: Flags, shares: Floats, weights: Floats, anew: bool
) -> tuple[Floats, Floats]:
    candidates, terms = shares.shape
    samples = len(felt_n)
    found_n = np.zeros((candidates, samples))
    memories_n = np.zeros((candidates, samples, terms))

    for candidate in range(candidates):
        memory_n = np.zeros(terms)
        elastic_n = 0.0

        for sample in range(samples):
            lag_n = 0.0
            at_once = 1.0
            for term in range(terms):
                old = weights[sample, 0, term]
                kept = weights[sample, 1, term]
                share = shares[candidate, term]
                memory_n[term] = kept * memory_n[term] + old * elastic_n
                lag_n += share * memory_n[term]
                at_once -= share * weights[sample, 2, term]

            elastic_n = (felt_n[sample] + lag_n) / at_once if contact[sample] else 0.0
            for term in range(terms):
                memory_n[term] += weights[sample, 2, term] * elastic_n
                if anew and not contact[sample]:
                    memory_n[term] = 0.0
                memories_n[candidate, sample, term] = memory_n[term]

            found_n[candidate, sample] = elastic_n

    return found_n, memories_n
