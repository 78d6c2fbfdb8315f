"""Gradient descent for the wall finder, on scenes that are drawn afresh for every batch.

The loss of a boundary is the cross-entropy of its row's distribution, plus the ranked probability score (Epstein 1969),
which knows how far off a wrong row is; both are proper, so that the spread that is told is the one that is meant.
Columns without wall count for the third output alone, and a wall that nobody can see for none.
"""

from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from scleraforce.errors import SolverError
from scleraforce.learning.classifier.training import learning_rate, repeatable
from scleraforce.learning.framework import torch
from scleraforce.learning.wall_finder.network import WallFinderNetwork
from scleraforce.learning.wall_finder.samples import SceneBatch, batches_ahead
from scleraforce.study import ScenesStudy, WallFinderStudy

FINDER_THREADS = 1  # the other core draws; more threads would also sum in another order
RANKED_WEIGHT, WALL_WEIGHT = 0.5, 1.0
CURVE_POINTS = 50


@dataclass(frozen=True)
class FittedFinder:
    """A trained network, and its mean loss in even parts of the training, before these were learned from."""

    network: WallFinderNetwork
    training_loss: tuple[float, ...]


def fit_wall_finder(
    scenes: ScenesStudy, study: WallFinderStudy, workers: int, progress: Callable[[int], object] | None = None
) -> FittedFinder:
    """Train the network; the same studies give the same weights on the same machine, whatever `workers` is.

    Args:
        scenes: what is drawn.
        study: the network and its descent.
        workers: processes that draw.
        progress: called with 1 after each batch.

    Raises:
        SolverError: the descent diverged.
    """
    with closing(batches_ahead(scenes, study, range(study.batches), workers)) as drawn:
        return descend_finder(study, drawn, progress)


def descend_finder(
    study: WallFinderStudy, drawn: Iterable[SceneBatch], progress: Callable[[int], object] | None = None
) -> FittedFinder:
    """Train a new network on batches of scenes, in order; arguments and errors of `fit_wall_finder`."""
    losses: list[float] = []
    with repeatable(study.seed, FINDER_THREADS):
        network = WallFinderNetwork(study)
        optimiser = torch.optim.AdamW(network.parameters(), study.learning_rate, weight_decay=study.weight_decay)
        network.train()
        for step, batch in enumerate(drawn):
            for group in optimiser.param_groups:
                group["lr"] = learning_rate(study, step, study.batches)
            losses.append(_learn(network, optimiser, batch, study))
            if not np.isfinite(losses[-1]):
                raise SolverError("training diverged; lower wall_finder.learning_rate")
            if progress:
                progress(1)
    network.eval()
    parts = np.array_split(losses, min(CURVE_POINTS, len(losses)))
    return FittedFinder(network, tuple(float(part.mean()) for part in parts))


def _learn(
    network: WallFinderNetwork, optimiser: torch.optim.Optimizer, batch: SceneBatch, study: WallFinderStudy
) -> float:
    """Take a step for a batch, a random half of its scenes mirrored; return the mean loss."""
    drawn = tuple(torch.from_numpy(each) for each in (batch.frames, batch.boundaries, batch.judged))
    turned = torch.rand(len(batch.frames)) < 0.5
    for each in drawn:
        each[turned] = each[turned].flip(-1)
    frames, boundaries, judged = drawn
    row_logits, wall_logits = network(frames)
    loss = finder_loss(row_logits, wall_logits, boundaries, judged, study.target_rows)
    optimiser.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]  # PyTorch does not annotate it
    torch.nn.utils.clip_grad_norm_(network.parameters(), study.max_gradient_norm)
    optimiser.step()
    return loss.item()


def finder_loss(
    row_logits: torch.Tensor,
    wall_logits: torch.Tensor,
    boundaries: torch.Tensor,
    judged: torch.Tensor,
    target_rows: float,
) -> torch.Tensor:
    """Return the mean loss of a batch.

    Args:
        row_logits: of the boundaries' rows, (n, 2, row, column).
        wall_logits: of there being wall, (n, column).
        boundaries: true rows (n, 2, column), NaN where there is no wall.
        judged: False in columns that count for nothing, (n, column).
        target_rows: standard deviation by which the true row is blurred.
    """
    there = torch.isfinite(boundaries).all(dim=1)
    wall = torch.nn.functional.binary_cross_entropy_with_logits(wall_logits, there.float(), judged.float())
    if not there.any():
        return WALL_WEIGHT * wall
    of_row = row_logits.log_softmax(dim=2).transpose(2, 3)  # (n, 2, column, row)
    seen = there[:, None].expand(-1, of_row.shape[1], -1)
    logs, true = of_row[seen], boundaries[seen]
    rows = torch.arange(logs.shape[1], dtype=logs.dtype)
    target = torch.softmax(-((rows - true[:, None]) ** 2) / (2.0 * target_rows**2), dim=1)
    entropy = -(target * logs).sum(dim=1).mean()
    below = logs.exp().cumsum(dim=1) - target.cumsum(dim=1)
    return entropy + RANKED_WEIGHT * below.square().sum(dim=1).mean() + WALL_WEIGHT * wall
