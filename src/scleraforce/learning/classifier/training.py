"""Gradient descent on the cross-entropy (paper sec. 2.4, Fig. 8a).

The paper's dropout of 0.8 makes the gradient noisy, and with random framing plain descent stalls. What helps is what
Srivastava et al. ("Dropout", 2014, appendix A) recommend, a high rate with momentum, made safe by a start scaled for
dropout (`network.build_network`), a warm-up, clipped gradients, and a rate that falls to zero along a cosine. Several
dropout masks a sample (Inoue, "Multi-sample dropout", 2019) lessen the noise for little: the first layer, which is
most of the work, is computed once for all of them.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import ceil, cos, pi

import numpy as np

from scleraforce.errors import SolverError
from scleraforce.learning.classifier.network import TrainedNetwork, build_network, trained_network
from scleraforce.learning.classifier.samples import Normalisation, Samples, mirrored_pixels, normalisation
from scleraforce.learning.framework import torch
from scleraforce.study import NetworkStudy, ReaderStudy, WallFinderStudy

# Sums in another order differ in the last bit, so the number of threads is part of what makes a run repeatable.
CLASSIFIER_THREADS = 2


@dataclass(frozen=True)
class Curves:
    """Cross-entropy and accuracy after each epoch; those of training are taken during it, with dropout (Fig. 8a)."""

    training_loss: tuple[float, ...] = ()
    training_accuracy: tuple[float, ...] = ()
    validation_loss: tuple[float, ...] = ()
    validation_accuracy: tuple[float, ...] = ()

    def extended(self, training: tuple[float, float], validation: tuple[float, float]) -> "Curves":
        """Return the curves with one more epoch: (loss, accuracy) of training and validation."""
        return Curves(
            (*self.training_loss, training[0]),
            (*self.training_accuracy, training[1]),
            (*self.validation_loss, validation[0]),
            (*self.validation_accuracy, validation[1]),
        )


@dataclass(frozen=True)
class Fitted:
    """A trained network and how it got there."""

    network: TrainedNetwork
    curves: Curves


@dataclass(frozen=True)
class _Batches:
    """Samples as tensors: the varying pixels (bool, shape (sample, pixel)), what to subtract, the classes.

    `mirrored` is, for each pixel, the one on the other side of the slice.
    """

    wall: torch.Tensor
    mean: torch.Tensor
    target: torch.Tensor
    mirrored: torch.Tensor | None = None

    def take(self, index: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return centred inputs and classes of some samples."""
        return self.wall[index].float() - self.mean, self.target[index]

    def draw(self, index: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the same with a random half of the samples mirrored (where there is `mirrored`)."""
        inputs, target = self.take(index)
        if self.mirrored is not None:
            turned = torch.rand(len(index)) < 0.5
            inputs[turned] = inputs[turned][:, self.mirrored]
        return inputs, target


def fit(
    study: NetworkStudy,
    training: Samples,
    validation: Samples,
    classes: int = 3,
    progress: Callable[[int], object] | None = None,
) -> Fitted:
    """Train a network; the same study and samples give the same weights on the same machine.

    The weights are those after the last epoch, where the rate has come down to zero. None are picked by their
    validation figures, so these figures stay an honest estimate.

    Args:
        study: sizes, dropout, rate, momentum, batches, epochs and seed.
        training: samples to descend on.
        validation: samples to report on, of other contacts.
        classes: number of force classes.
        progress: called with 1 after each epoch.

    Raises:
        SolverError: the descent diverged.
    """
    norm = normalisation(training, study.mirror)
    seen, unseen = _batches(training, norm), _batches(validation, norm)
    if study.mirror:
        seen = replace(seen, mirrored=torch.from_numpy(mirrored_pixels(norm, training.slices.shape[2])))
    curves = Curves()
    with repeatable(study.seed, CLASSIFIER_THREADS):
        network = build_network(int(norm.varies.sum()), study, classes)
        optimiser = torch.optim.SGD(network.parameters(), study.learning_rate, study.momentum, fused=True)
        for epoch in range(study.epochs):
            curves = curves.extended(_epoch(network, optimiser, seen, study, epoch), _measure(network, unseen))
            if not np.isfinite(curves.training_loss[-1]):
                raise SolverError(f"training diverged in epoch {epoch + 1}; lower network.learning_rate")
            if progress:
                progress(1)
    return Fitted(trained_network(network, norm), curves)


def learning_rate(study: NetworkStudy | ReaderStudy | WallFinderStudy, step: int, steps: int) -> float:
    """Return the rate of a step: a linear warm-up, then half a cosine down to zero.

    >>> study = NetworkStudy(learning_rate=0.1, warmup=0.1)
    >>> [round(learning_rate(study, step, 100), 4) for step in (0, 9, 55, 99)]
    [0.01, 0.1, 0.05, 0.0]
    """
    warm = study.warmup * steps
    if step < warm:
        return study.learning_rate * min(1.0, (step + 1) / warm)
    return study.learning_rate * 0.5 * (1.0 + cos(pi * (step - warm) / (steps - warm)))


def train_step(
    network: torch.nn.Sequential,
    optimiser: torch.optim.Optimizer,
    inputs: torch.Tensor,
    target: torch.Tensor,
    max_gradient_norm: float,
    dropout_masks: int = 1,
) -> tuple[float, float]:
    """Take one step down the gradient, its norm clipped; return mean loss and accuracy over samples and masks."""
    target = target.repeat(dropout_masks)
    logits = network[2:](network[:2](inputs).repeat(dropout_masks, 1))  # dropout begins behind the first two modules
    loss = torch.nn.functional.cross_entropy(logits, target)
    optimiser.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]  # PyTorch does not annotate it
    torch.nn.utils.clip_grad_norm_(network.parameters(), max_gradient_norm)
    optimiser.step()
    return loss.item(), (logits.argmax(1) == target).float().mean().item()


def _batches(samples: Samples, norm: Normalisation) -> _Batches:
    wall = torch.from_numpy(samples.pixels[:, norm.varies] > 0)
    return _Batches(wall, torch.from_numpy(norm.mean[norm.varies]), torch.from_numpy(samples.target.astype(np.int64)))


def _epoch(
    network: torch.nn.Sequential, optimiser: torch.optim.Optimizer, seen: _Batches, study: NetworkStudy, epoch: int
) -> tuple[float, float]:
    """Go through all training samples once, in random order; return mean loss and accuracy."""
    network.train()
    count = len(seen.target)
    batches = ceil(count / study.batch_size)
    loss, right = 0.0, 0.0
    for number, index in enumerate(torch.tensor_split(torch.randperm(count), batches)):
        optimiser.param_groups[0]["lr"] = learning_rate(study, epoch * batches + number, study.epochs * batches)
        batch = seen.draw(index)
        mean_loss, share = train_step(network, optimiser, *batch, study.max_gradient_norm, study.dropout_masks)
        loss, right = loss + mean_loss * len(index), right + share * len(index)
    return loss / count, right / count


def _measure(network: torch.nn.Sequential, unseen: _Batches) -> tuple[float, float]:
    """Return mean loss and accuracy without dropout."""
    network.eval()
    loss, right = 0.0, 0
    with torch.inference_mode():
        for index in torch.split(torch.arange(len(unseen.target)), 1024):
            inputs, target = unseen.take(index)
            logits = network(inputs)
            loss += torch.nn.functional.cross_entropy(logits, target, reduction="sum").item()
            right += int((logits.argmax(1) == target).sum())
    return loss / len(unseen.target), right / len(unseen.target)


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
