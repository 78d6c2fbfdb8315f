"""Gradient descent for the reader, on samples that are drawn afresh for every epoch.

The loss is the negative log-likelihood of the force, a proper score (Gneiting and Raftery, "Strictly proper scoring
rules", 2007): least for the true distribution of the force given what the network sees. Plus Huber's loss of the
contact's place. The optimiser is AdamW with a warm-up and a cosine.
"""

from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import SolverError
from scleraforce.learning.classifier.training import learning_rate, repeatable
from scleraforce.learning.framework import torch
from scleraforce.learning.reader.draws import CHUNK, Source, chunks_ahead
from scleraforce.learning.reader.network import ReaderNetwork, histogram, log_density
from scleraforce.learning.reader.samples import ReaderSamples, concatenated
from scleraforce.reader.metrics import accuracy, confusion_matrix
from scleraforce.reader.networks import ForceDistribution, force_distribution, ratio_edges
from scleraforce.study import ReaderStudy, Study
from scleraforce.units import from_si, to_si

Floats = NDArray[np.float64]

READER_THREADS = 1  # the other cores draw samples; more threads would also sum in another order
PLACE_WEIGHT, PLACE_KNEE_MM = 2.0, 0.2
VALIDATION_CHUNK = 2**31  # numbers from here on are chunks of the validation set


@dataclass(frozen=True)
class _Batch:
    """Samples as tensors: slices (0 or 1), given values, place of the force in the histogram, contact's place in mm."""

    slices: torch.Tensor
    given: torch.Tensor
    force: torch.Tensor
    place_mm: torch.Tensor


@dataclass(frozen=True)
class ReaderCurves:
    """Mean loss of each epoch's samples, taken before they are learned from: no sample is seen twice."""

    training_loss: tuple[float, ...]


@dataclass(frozen=True)
class Answers:
    """What a network says of samples: the force's distribution, and the contact's place (sample,), m."""

    forces: ForceDistribution
    lateral_m: Floats


@dataclass(frozen=True, kw_only=True)
class ReaderMetrics:
    """How answers agree with the truth.

    `accuracy` and `interval` (95 %, Wilson) of the classes, `mae_n` of the median, `coverage` of the 90 % intervals,
    `lateral_mae_m` of the contact's place; `confusion` has a row for each true class.
    """

    accuracy: float
    interval: tuple[float, float]
    mae_n: float
    coverage: float
    lateral_mae_m: float
    confusion: tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class FittedReader:
    """A trained network, its curves, and how it does on samples that it never saw."""

    network: ReaderNetwork
    curves: ReaderCurves
    metrics: ReaderMetrics


def fit_reader(
    study: Study, source: Source, workers: int, progress: Callable[[int], object] | None = None
) -> FittedReader:
    """Train a reader; the same study and library give the same weights on the same machine, whatever `workers` is.

    Args:
        study: the study with its `[reader]`.
        source: what samples are drawn from.
        workers: processes that draw them.
        progress: called with 1 after each epoch.

    Raises:
        SolverError: the descent diverged.
    """
    reader = study.reader
    chunks = range(reader.epochs * _chunks(reader))
    with closing(chunks_ahead(source, chunks, workers)) as drawn:
        network, curves = descend_reader(study, drawn, progress)
    with repeatable(reader.seed, READER_THREADS):
        return FittedReader(network, curves, measure(network, _validation_samples(source), study))


def descend_reader(
    study: Study, drawn: Iterable[ReaderSamples], progress: Callable[[int], object] | None = None
) -> tuple[ReaderNetwork, ReaderCurves]:
    """Train a new network on the chunks of all epochs.

    Args:
        study: the study with its `[reader]`.
        drawn: the chunks of samples, in order.
        progress: called with 1 after each epoch.

    Raises:
        SolverError: the descent diverged.
    """
    reader, chunks = study.reader, _chunks(study.reader)
    steps = reader.epochs * chunks * -(-CHUNK // reader.batch_size)
    losses: list[float] = []
    with repeatable(reader.seed, READER_THREADS):
        network = ReaderNetwork(reader, study.slice, study.eye.radius_m)
        optimiser = torch.optim.AdamW(
            network.parameters(), reader.learning_rate, weight_decay=reader.weight_decay, fused=True
        )
        descent = _Descent(network, optimiser, reader, steps)
        for number, samples in enumerate(drawn, start=1):
            losses.append(descent.learn(samples))
            if not np.isfinite(losses[-1]):
                raise SolverError("training diverged; lower reader.learning_rate")
            if number % chunks == 0 and progress:
                progress(1)
    per_epoch = np.reshape(losses, (reader.epochs, chunks)).mean(axis=1)
    return network, ReaderCurves(tuple(per_epoch.tolist()))


def _chunks(reader: ReaderStudy) -> int:
    """Return the number of chunks in an epoch."""
    return -(-reader.samples_per_epoch // CHUNK)


def _validation_samples(source: Source) -> ReaderSamples:
    """Return samples that no training sees: from streams of their own."""
    count = source.reader.validation_samples
    numbers = range(-(-count // CHUNK))
    parts = [source.chunk(VALIDATION_CHUNK + n, min(CHUNK, count - n * CHUNK)) for n in numbers]
    return concatenated(parts)


def measure(network: ReaderNetwork, samples: ReaderSamples, study: Study) -> ReaderMetrics:
    """Compare a network's answers with the truth."""
    return compared(answer(network, samples, study.reader), samples.force_n, samples.lateral_m, study)


def compared(answers: Answers, force_n: Floats, lateral_m: Floats, study: Study) -> ReaderMetrics:
    """Compare answers with the true forces (sample,), N, and places of the contact (sample,), m."""
    median_n, (low_n, high_n) = answers.forces.median_n, answers.forces.interval_n.T
    classify = study.classes.classify
    confusion = confusion_matrix(
        [classify(force) for force in force_n.tolist()],
        [classify(force) for force in median_n.tolist()],
        len(study.classes.bounds_n) + 1,
    )
    share = accuracy(confusion)
    return ReaderMetrics(
        accuracy=share.value,
        interval=share.interval,
        mae_n=float(np.abs(median_n - force_n).mean()),
        coverage=float(((force_n >= low_n) & (force_n <= high_n)).mean()),
        lateral_mae_m=float(np.abs(answers.lateral_m - lateral_m).mean()),
        confusion=tuple(tuple(row) for row in confusion.tolist()),
    )


def answer(network: ReaderNetwork, samples: ReaderSamples, reader: ReaderStudy) -> Answers:
    """Return a network's answers."""
    network.eval()
    batch = _batch(samples, reader)
    with torch.inference_mode():
        parts = [network(batch.slices[i], batch.given[i]) for i in torch.split(torch.arange(len(samples)), 512)]
    mixtures, places_mm = (torch.cat(values) for values in zip(*parts, strict=True))
    return answers_of(mixtures, places_mm, samples.modulus_pa, reader)


def answers_of(mixtures: torch.Tensor, places_mm: torch.Tensor, modulus_pa: Floats, reader: ReaderStudy) -> Answers:
    """Return the answers that a network's outputs are, with the moduli that it was told (sample,), Pa."""
    edges = ratio_edges(reader.bins, reader.max_force_ratio)
    probabilities = histogram(mixtures, reader.bins).double().numpy()
    return Answers(force_distribution(probabilities, edges, modulus_pa), to_si(places_mm.double().numpy(), "mm"))


def reader_loss(
    mixtures: torch.Tensor, places_mm: torch.Tensor, force: torch.Tensor, true_place_mm: torch.Tensor
) -> torch.Tensor:
    """Return the mean loss.

    Args:
        mixtures: of the force (sample, 3 COMPONENTS).
        places_mm: of the contact, as read (sample,).
        force: true place of the force in the histogram, 0 to 1 (sample,).
        true_place_mm: of the contact (sample,).
    """
    place = torch.nn.functional.huber_loss(places_mm, true_place_mm, delta=PLACE_KNEE_MM)
    return PLACE_WEIGHT * place - log_density(mixtures, force).mean()


class _Descent:
    """The steps down the gradient; keeps count of them."""

    def __init__(
        self, network: ReaderNetwork, optimiser: torch.optim.Optimizer, reader: ReaderStudy, steps: int
    ) -> None:
        self._network, self._optimiser, self._reader = network, optimiser, reader
        self._step, self._steps = 0, steps

    def learn(self, samples: ReaderSamples) -> float:
        """Take a step for each batch of the samples; return their mean loss."""
        self._network.train()
        batch = _batch(samples, self._reader)
        losses = []
        for index in torch.split(torch.arange(len(samples)), self._reader.batch_size):
            for group in self._optimiser.param_groups:
                group["lr"] = learning_rate(self._reader, self._step, self._steps)
            mixtures, places = self._network(batch.slices[index], batch.given[index])
            loss = reader_loss(mixtures, places, batch.force[index], batch.place_mm[index])
            self._optimiser.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]  # PyTorch does not annotate it
            torch.nn.utils.clip_grad_norm_(self._network.parameters(), self._reader.max_gradient_norm)
            self._optimiser.step()
            losses.append(loss.item() * len(index))
            self._step += 1
        return sum(losses) / len(samples)


def _batch(samples: ReaderSamples, reader: ReaderStudy) -> _Batch:
    share = samples.force_n / samples.modulus_pa / reader.max_force_ratio
    return _Batch(
        torch.from_numpy((samples.slices > 0).astype(np.float32)),
        torch.from_numpy(samples.given),
        torch.from_numpy(np.sqrt(share).astype(np.float32)),
        torch.from_numpy(from_si(samples.lateral_m, "mm").astype(np.float32)),
    )
