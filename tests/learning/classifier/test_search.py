"""The grid search tries every size with the same training, and keeps the best by a stated rule."""

from dataclasses import replace

import numpy as np
import pytest

from scleraforce.errors import SolverError
from scleraforce.learning.classifier.network import build_network, linear_layers
from scleraforce.learning.classifier.search import Candidate, best, grid, search_sizes, weights
from scleraforce.learning.classifier.training import fit
from scleraforce.study import NetworkStudy


def test_the_best_candidate_is_the_most_accurate_and_of_equals_the_smallest() -> None:
    tried = (
        Candidate(hidden=(9,), weights=500, validation_accuracy=0.97, validation_loss=0.1),
        Candidate(hidden=(5,), weights=300, validation_accuracy=0.99, validation_loss=0.3),
        Candidate(hidden=(3, 3), weights=200, validation_accuracy=0.99, validation_loss=0.4),
        Candidate(hidden=(2,), weights=100, validation_accuracy=None, validation_loss=None),
    )
    assert best(tried) == 2
    with pytest.raises(SolverError, match="every size"):
        best(tried[3:])


def test_weights_are_counted_as_pytorch_counts_them() -> None:
    network = build_network(50, NetworkStudy(hidden=(7, 4)), 3)
    expected = sum(x.weight.numel() + x.bias.numel() for x in linear_layers(network))
    assert weights(50, (7, 4), 3) == expected


@pytest.mark.slow
def test_the_search_returns_what_training_the_chosen_size_alone_would(bars, small) -> None:
    study = replace(small, search_widths=(2, 12), search_depths=(1, 2), epochs=2)
    ticks: list[int] = []
    found = search_sizes(study, *bars, progress=ticks.append)
    assert [entry.hidden for entry in found.candidates] == list(grid(study))
    assert sum(ticks) == 2 * len(found.candidates)
    assert found.study.hidden == found.candidates[best(found.candidates)].hidden
    alone = fit(found.study, *bars)
    assert alone.curves == found.fitted.curves
    np.testing.assert_array_equal(alone.network.layers[-1].weight, found.fitted.network.layers[-1].weight)
