"""Gradient descent as all networks are trained: its steps, its rate, and what makes it repeatable."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from math import cos, pi

import numpy as np

from scleraforce.errors import SolverError
from scleraforce.learning.framework import torch
from scleraforce.study import NetworkStudy, RawReaderStudy, ReaderStudy, WallFinderStudy

Settings = NetworkStudy | ReaderStudy | WallFinderStudy | RawReaderStudy

CURVE_POINTS = 50


def descend(
    network: torch.nn.Module,
    optimiser: torch.optim.Optimizer,
    rounds: Iterable[Iterable[tuple[torch.Tensor, int]]],
    study: Settings,
    steps: int,
    section: str,
) -> Iterator[float]:
    """Take a step down the gradient of each batch's loss, its norm clipped; yield the mean loss of each round.

    Args:
        network: to train.
        optimiser: of its weights.
        rounds: in each, mean losses of batches and how many samples they are of; each is computed when it is asked for.
        study: rate, warm-up and largest norm of the gradient.
        steps: number of batches, for the rate.
        section: of the study, for the message.

    Raises:
        SolverError: the descent diverged.
    """
    step = 0
    for batches in rounds:
        total, samples = 0.0, 0
        for loss, count in batches:
            for group in optimiser.param_groups:
                group["lr"] = learning_rate(study, step, steps)
            optimiser.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]  # PyTorch does not annotate it
            torch.nn.utils.clip_grad_norm_(network.parameters(), study.max_gradient_norm)
            optimiser.step()
            step += 1
            total, samples = total + loss.item() * count, samples + count
            if not np.isfinite(total):
                raise SolverError(f"training diverged in step {step} of {steps}; lower {section}.learning_rate")
        yield total / samples


def learning_rate(study: Settings, step: int, steps: int) -> float:
    """Return the rate of a step: a linear warm-up, then half a cosine down to zero.

    >>> study = NetworkStudy(learning_rate=0.1, warmup=0.1)
    >>> [round(learning_rate(study, step, 100), 4) for step in (0, 9, 55, 99)]
    [0.01, 0.1, 0.05, 0.0]
    """
    warm = study.warmup * steps
    if step < warm:
        return study.learning_rate * min(1.0, (step + 1) / warm)
    return study.learning_rate * 0.5 * (1.0 + cos(pi * (step - warm) / (steps - warm)))


def curve(losses: Sequence[float]) -> tuple[float, ...]:
    """Return the mean losses of `CURVE_POINTS` even parts of a training."""
    return tuple(float(part.mean()) for part in np.array_split(losses, min(CURVE_POINTS, len(losses))))


@contextmanager
def repeatable(seed: int, of_torch: int) -> Iterator[None]:
    """Seed PyTorch and fix its number of threads; put everything back afterwards."""
    threads, strict = torch.get_num_threads(), torch.are_deterministic_algorithms_enabled()
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        torch.set_num_threads(of_torch)
        torch.use_deterministic_algorithms(True)
        try:
            yield
        finally:
            torch.set_num_threads(threads)
            torch.use_deterministic_algorithms(strict)
