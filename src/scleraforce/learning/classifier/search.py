"""The grid search over sizes of the network (paper sec. 2.4): every width with every depth, all with one training."""

import threading
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import SolverError
from scleraforce.learning.classifier.samples import Samples
from scleraforce.learning.classifier.training import Fitted, fit
from scleraforce.processes import work_in_order
from scleraforce.study import NetworkStudy


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One size and what it reached; the figures are None where its training diverged."""

    hidden: tuple[int, ...]
    weights: int
    validation_accuracy: float | None
    validation_loss: float | None


@dataclass(frozen=True)
class Search:
    """All candidates in the order of the grid, the study with the best sizes, and its network."""

    candidates: tuple[Candidate, ...]
    study: NetworkStudy
    fitted: Fitted


def grid(study: NetworkStudy) -> tuple[tuple[int, ...], ...]:
    """Return the sizes to try: hidden layers of one width each.

    >>> grid(NetworkStudy(search_widths=(300, 600), search_depths=(1, 2)))
    ((300,), (600,), (300, 300), (600, 600))
    """
    return tuple((width,) * depth for depth, width in product(study.search_depths, study.search_widths))


def weights(inputs: int, hidden: tuple[int, ...], classes: int) -> int:
    """Return the number of weights and biases.

    >>> weights(5600, (600, 600), 3)
    3723003
    """
    sizes = (inputs, *hidden, classes)
    return sum((sizes[layer] + 1) * sizes[layer + 1] for layer in range(len(sizes) - 1))


def best(candidates: tuple[Candidate, ...]) -> int:
    """Return the number of the candidate with the highest validation accuracy; of equal ones, the fewest weights.

    Raises:
        SolverError: all diverged.
    """
    reached = [(-entry.validation_accuracy, entry.weights, number) for number, entry in enumerate(candidates)
               if entry.validation_accuracy is not None]  # fmt: skip
    if not reached:
        raise SolverError("every size of the grid diverged; lower network.learning_rate")
    return min(reached)[2]


def search_sizes(
    study: NetworkStudy,
    training: Samples,
    validation: Samples,
    classes: int = 3,
    progress: Callable[[int], object] | None = None,
    workers: int | None = None,
) -> Search:
    """Train every size of the grid and keep the best.

    The validation set chooses, so the accuracy of the chosen size is slightly flattered. The result is the same
    whoever trains, on the same kind of processor.

    Args:
        study: training and grid; its own sizes are not used.
        training: samples to descend on.
        validation: samples to choose by.
        classes: number of force classes.
        progress: called with 1 after each epoch of each size, or with the epochs of a size that workers have trained.
        workers: processes, or those of a cluster, that train a size each; None: one after the other in this process.

    Raises:
        SolverError: every size diverged, or a worker died.
    """
    sizes = grid(study)
    candidates: tuple[Candidate, ...] = ()
    kept: tuple[NetworkStudy, Fitted] | None = None
    tried: Iterable[Fitted | None]
    if workers is None:
        tried = (_try(replace(study, hidden=hidden), training, validation, classes, progress) for hidden in sizes)
    else:
        tried = _tried_by_workers(study, (training, validation), classes, workers, progress)
    for hidden, fitted in zip(sizes, tried, strict=True):
        candidates = (*candidates, _candidate(hidden, training, classes, fitted))
        if fitted and best(candidates) == len(candidates) - 1:
            kept = replace(study, hidden=hidden), fitted
    best(candidates)
    assert kept is not None
    return Search(candidates, *kept)


def _try(
    study: NetworkStudy,
    training: Samples,
    validation: Samples,
    classes: int,
    progress: Callable[[int], object] | None = None,
) -> Fitted | None:
    """Train one size; None where it diverges, which deep and wide ones may do at a rate that suits the others."""
    try:
        return fit(study, training, validation, classes, progress)
    except SolverError:
        return None


def _tried_by_workers(
    study: NetworkStudy,
    samples: Sequence[Samples],
    classes: int,
    workers: int,
    progress: Callable[[int], object] | None,
) -> Iterable[Fitted | None]:
    """Yield what the sizes of the grid reached, in its order."""
    count = len(grid(study))
    prepare = partial(_trying, study, [_Packed.of(part) for part in samples], classes)
    for fitted in work_in_order(prepare, range(count), workers, ahead=count):
        if progress is not None:
            progress(study.epochs)
        yield fitted


@dataclass(frozen=True)
class _Packed:
    """Samples on the way to a worker: slices are a twentieth of their size."""

    slices: bytes
    shape: tuple[int, ...]
    target: NDArray[np.int64]

    @classmethod
    def of(cls, samples: Samples) -> "_Packed":
        """Pack samples."""
        return cls(zlib.compress(samples.slices.tobytes(), 1), samples.slices.shape, samples.target)

    def unpacked(self) -> Samples:
        """Return the samples."""
        slices = np.frombuffer(zlib.decompress(self.slices), dtype=np.uint8).reshape(self.shape)
        return Samples(slices, self.target)


_one_training = threading.Lock()  # PyTorch's random numbers belong to the process, which may be a worker of threads


def _trying(study: NetworkStudy, packed: Sequence[_Packed], classes: int) -> Callable[[int], Fitted | None]:
    """Return what trains a size of the grid, in a worker."""
    training, validation = (part.unpacked() for part in packed)
    sizes = grid(study)

    def work(number: int) -> Fitted | None:
        with _one_training:
            return _try(replace(study, hidden=sizes[number]), training, validation, classes)

    return work


def _candidate(hidden: tuple[int, ...], training: Samples, classes: int, fitted: Fitted | None) -> Candidate:
    count = weights(training.pixels.shape[1], hidden, classes)
    if fitted is None:
        return Candidate(hidden=hidden, weights=count, validation_accuracy=None, validation_loss=None)
    return Candidate(
        hidden=hidden,
        weights=count,
        validation_accuracy=fitted.curves.validation_accuracy[-1],
        validation_loss=fitted.curves.validation_loss[-1],
    )
