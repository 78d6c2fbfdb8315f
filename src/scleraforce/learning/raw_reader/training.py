"""Gradient descent for the raw reader: slices first, then raw frames that are drawn afresh for every batch.

The layers that read slices learn from drawn slices, as the slice reader's do: those are many times cheaper than frames.
In the first batches of raw frames the wall alone is learned, by the wall finder's loss; then all of it, by the force's
(`reader_loss`) beside that.
"""

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import SolverError
from scleraforce.learning.classifier.training import learning_rate, repeatable
from scleraforce.learning.framework import torch
from scleraforce.learning.raw_reader.network import RawReaderNetwork
from scleraforce.learning.raw_reader.samples import FRAMES_TOGETHER, RawSamples, RawSource, raw_chunks_ahead
from scleraforce.learning.reader.draws import Source
from scleraforce.learning.reader.samples import concatenated
from scleraforce.learning.reader.training import READER_THREADS, fit_reader, reader_loss
from scleraforce.learning.wall_finder.training import finder_loss
from scleraforce.library import Library
from scleraforce.reader.verdicts import read_by_fit
from scleraforce.study import RawReaderStudy, Study
from scleraforce.units import from_si

CURVE_POINTS = 50


@dataclass(frozen=True)
class FittedRawReader:
    """A trained network, and its mean loss in even parts of the training, before these were learned from."""

    network: RawReaderNetwork
    training_loss: tuple[float, ...]


def fit_raw_reader(
    library: Library,
    study: Study,
    workers: int,
    progress: Callable[[int], object] | None = None,
    learned: Callable[[int], object] | None = None,
) -> FittedRawReader:
    """Train a raw reader; the same study and library give the same weights on the same machine.

    Args:
        library: of responses.
        study: with `[raw_reader]`, and the eyes and light of `[reader]` and `[phantom]`.
        workers: processes that draw samples.
        progress: called with 1 after each epoch of slices.
        learned: called with 1 after each batch of raw frames.

    Raises:
        SolverError: the descent diverged.
    """
    raw, gaps = study.raw_reader, read_by_fit(study.reader)
    on_slices = replace(study, reader=replace(gaps, epochs=raw.slice_epochs, seed=raw.seed))
    slices = Source.of(library, on_slices.reader, study.slice)
    reads_slices = fit_reader(on_slices, slices, workers, progress).network
    losses: list[float] = []
    with repeatable(raw.seed, READER_THREADS):
        network = RawReaderNetwork(study, reads_slices)
        optimiser = torch.optim.AdamW(network.parameters(), raw.learning_rate, weight_decay=raw.weight_decay)
        network.train()
        for step, batch in enumerate(_batches(RawSource.of(library, study), raw, workers)):
            for group in optimiser.param_groups:
                group["lr"] = learning_rate(raw.wall, step, raw.batches)
            losses.append(_learn(network, optimiser, batch, study, wall_alone=step < raw.wall_share * raw.batches))
            if not np.isfinite(losses[-1]):
                raise SolverError("training diverged; lower raw_reader.learning_rate")
            if learned:
                learned(1)
    network.eval()
    parts = np.array_split(losses, min(CURVE_POINTS, len(losses)))
    return FittedRawReader(network, tuple(float(part.mean()) for part in parts))


def _batches(source: RawSource, raw: RawReaderStudy, workers: int) -> Iterator[RawSamples]:
    """Yield the training's batches, each of frames of its own."""
    frames = raw.batches * raw.batch_size
    left: RawSamples | None = None
    with closing(raw_chunks_ahead(source, range(-(-frames // FRAMES_TOGETHER)), workers)) as chunks:
        for _ in range(raw.batches):
            while left is None or len(left) < raw.batch_size:
                chunk = next(chunks)
                left = chunk if left is None else concatenated([left, chunk])
            yield left.picked(np.arange(raw.batch_size))
            left = left.picked(np.arange(raw.batch_size, len(left)))


def _learn(
    network: RawReaderNetwork, optimiser: torch.optim.Optimizer, batch: RawSamples, study: Study, *, wall_alone: bool
) -> float:
    """Take a step for a batch; return its mean loss."""
    frames, given, boundaries = (torch.from_numpy(each) for each in (batch.frames, batch.given, batch.boundary_rows))
    mixtures, places, row_logits, wall_logits = network(frames, given)
    judged = torch.ones_like(wall_logits, dtype=torch.bool)
    loss = finder_loss(row_logits, wall_logits, boundaries, judged, study.raw_reader.target_rows)
    if not wall_alone:
        share = batch.force_n / batch.modulus_pa / study.reader.max_force_ratio
        place_mm = from_si(batch.lateral_m, "mm")
        loss = loss + reader_loss(mixtures, places, _tensor(np.sqrt(share)), _tensor(place_mm))
    optimiser.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]  # PyTorch does not annotate it
    torch.nn.utils.clip_grad_norm_(network.parameters(), study.raw_reader.max_gradient_norm)
    optimiser.step()
    return loss.item()


def _tensor(values: NDArray[np.float64]) -> torch.Tensor:
    return torch.from_numpy(values.astype(np.float32))
