"""The classifier of the paper (section 2.4): fully connected layers that learn from
simulated slices.

The descent is on the cross-entropy (Fig. 8a). The paper's dropout of 0.8 makes the
gradient noisy; Srivastava et al. ("Dropout", 2014, appendix A) recommend a high rate
with momentum, made safe here by a start scaled for dropout (`build_network`), a
warm-up, clipped gradients, and a rate that falls to zero along a cosine. Several
dropout masks a sample (Inoue, "Multi-sample dropout", 2019) are cheap: the first layer,
most of the work, is computed once for all.
"""

import hashlib
import threading
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise, product
from math import ceil, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Bytes, Flags, Floats, Integers
from scleraforce.base.errors import SolverError
from scleraforce.base.worker_processes import work_in_order
from scleraforce.lab.training.gradient_descent import (
    Losses,
    Progress,
    onnx_bytes,
    tensor,
    torch,
    train_network,
)
from scleraforce.reading.reading_models import INPUT, OUTPUT
from scleraforce.records.study import ClassesStudy, NetworkStudy, SliceStudy


@dataclass(frozen=True)
class Samples:
    """Slices, uint8 of shape (sample, row, column) with 0 or 255, and their classes,
    shape (sample,).
    """

    slices: Bytes
    target: Integers

    def __len__(self) -> int:
        return len(self.target)

    @property
    def pixels(self) -> Bytes:
        """The slices as a view, one row a sample, shape (sample, row * column)."""
        return self.slices.reshape(len(self.slices), -1)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle compressed, to a twentieth of the size: samples go to the workers of a
        cluster.
        """
        return _unpacked, (
            zlib.compress(self.slices.tobytes(), 1),
            self.slices.shape,
            self.target,
        )


def _unpacked(packed: bytes, shape: tuple[int, ...], target: Integers) -> Samples:
    return Samples(
        np.frombuffer(zlib.decompress(packed), dtype=np.uint8).reshape(shape), target
    )


def classes_at_modulus(
    force_n: Floats, ratio: float, classes: ClassesStudy
) -> Integers:
    """Return the class of each slice, shape (slice,), if the wall were `ratio` times as
    stiff.

    In linear mechanics the slice of a force F on a wall of modulus E is that of F E'/E
    on a wall of E' (under pressure and weight that scale alike, which bend the wall far
    less than the needle).
    """
    return np.array(
        [classes.classify(force) for force in ratio * force_n], dtype=np.int64
    )


def normalisation(
    training: Samples, mirror: bool = False
) -> tuple[NDArray[np.float32], Flags]:
    """Return the share of training slices (and mirror images) with wall at each pixel,
    and the varying pixels.

    Both of shape (row * column,). Centred inputs condition the gradient descent far
    better than 0 and 1 (LeCun et al., "Efficient BackProp", 1998, sec. 4.3). A pixel
    that never varies teaches nothing; its weights are zero.
    """
    wall = np.count_nonzero(training.slices, axis=0)
    count = len(training)
    if mirror:
        wall = wall + wall[:, ::-1]
        count = 2 * count

    mean = (wall / count).astype(np.float32)
    return mean.ravel(), ((wall > 0) & (wall < count)).ravel()


def content_hash(*parts: Samples) -> str:
    """Return the SHA-256 of slices and classes, in hexadecimal: the identity of a data
    set whatever its storage.
    """
    digest = hashlib.sha256()
    for part in parts:
        digest.update(np.ascontiguousarray(part.slices).data)
        digest.update(np.ascontiguousarray(part.target, dtype="<i8").data)
    return digest.hexdigest()


@dataclass(frozen=True)
class Curves:
    """Cross-entropy and accuracy after each epoch; in training they are taken during
    it, with dropout (Fig. 8a).
    """

    training_loss: tuple[float, ...] = ()
    training_accuracy: tuple[float, ...] = ()
    validation_loss: tuple[float, ...] = ()
    validation_accuracy: tuple[float, ...] = ()


@dataclass(frozen=True)
class TrainedNetwork:
    """Weights that read slices: pixels (0 to 1) minus `mean`, then the layers with ReLU
    between them, then softmax.

    A layer gives weight x + bias, of shapes (output, input) and (output,). `curves`: of
    its training.
    """

    mean: NDArray[np.float32]
    weights: tuple[NDArray[np.float32], ...]
    biases: tuple[NDArray[np.float32], ...]
    curves: Curves = Curves()

    def probabilities(self, slices: Bytes) -> Floats:
        """Return class probabilities in double precision, shape (slice, class): the
        definition, not the fast path.
        """
        signal: Floats = slices.reshape(len(slices), -1) / 255.0 - self.mean
        for number, (weight, bias) in enumerate(
            zip(self.weights, self.biases, strict=True)
        ):
            signal = (np.maximum(signal, 0.0) if number else signal) @ weight.T.astype(
                np.float64
            ) + bias

        powers: Floats = np.exp(signal - signal.max(axis=1, keepdims=True))
        powers /= powers.sum(axis=1, keepdims=True)
        return powers


def build_network(
    inputs: int, study: NetworkStudy, classes: int
) -> torch.nn.Sequential:
    """Build the network with random weights (from PyTorch's generator); dropout follows
    every hidden layer.

    He's initialisation keeps the signal's variance through ReLU layers (He et al. 2015,
    eq. 10). Inverted dropout multiplies the second moment of its output by 1/keep, so
    the layers behind it start smaller by sqrt(keep): otherwise logits start 1/keep = 5
    times too large at the paper's dropout and the first steps diverge.
    """
    sizes = (inputs, *study.hidden, classes)
    modules: list[torch.nn.Module] = []

    for number, (fan_in, fan_out) in enumerate(pairwise(sizes)):
        linear = torch.nn.Linear(fan_in, fan_out)
        keep = 1.0 - study.dropout if number else 1.0
        torch.nn.init.normal_(linear.weight, std=sqrt(2.0 * keep / fan_in))
        torch.nn.init.zeros_(linear.bias)
        modules += [linear, torch.nn.ReLU(), _Dropout(study.dropout)]

    return torch.nn.Sequential(*modules[:-2])


class _Dropout(torch.nn.Module):
    """Inverted dropout that decides from 16 random bits a value.

    Four values share a random number of 64 bits: PyTorch's own draws a number for each,
    which took a fifth of a training. The share that is kept is exact to 2**-17.
    """

    def __init__(self, dropout: float) -> None:
        super().__init__()
        self.keep = 1.0 - dropout

    def forward(self, signal: torch.Tensor) -> torch.Tensor:
        if not self.training or self.keep == 1.0:
            return signal

        numbers = torch.empty(
            ceil(signal.numel() / 4), dtype=torch.int64, device=signal.device
        )
        bits = numbers.random_(-(2**63), None).view(torch.int16)
        kept = bits[: signal.numel()] < round(self.keep * 2**16) - 2**15
        factor = kept.to(signal.dtype).mul_(1.0 / self.keep)
        return signal * factor.view(signal.shape)


def trained_network(
    network: torch.nn.Sequential, mean: NDArray[np.float32], varies: Flags
) -> TrainedNetwork:
    """Return the weights as NumPy arrays, the first layer spread over all pixels (zero
    where a pixel never varied).
    """
    layers = [module for module in network if isinstance(module, torch.nn.Linear)]
    weights, biases = (
        [getattr(layer, name).detach().numpy().copy() for layer in layers]
        for name in ("weight", "bias")
    )
    full = np.zeros((len(weights[0]), mean.size), dtype=np.float32)
    full[:, varies] = weights[0]

    return TrainedNetwork(mean, (full, *weights[1:]), tuple(biases))


class _OnnxClassifier(torch.nn.Module):
    """The ONNX model: slices, uint8, to probabilities. Matrices are kept in half
    precision.
    """

    def __init__(self, network: TrainedNetwork) -> None:
        super().__init__()
        self.mean = torch.nn.Parameter(
            torch.from_numpy(network.mean), requires_grad=False
        )
        halves = [weight.astype(np.float16) for weight in network.weights]
        self.weights, self.biases = (
            torch.nn.ParameterList(
                torch.nn.Parameter(torch.from_numpy(each), requires_grad=False)
                for each in values
            )
            for values in (halves, network.biases)
        )

    def forward(self, slices: torch.Tensor) -> torch.Tensor:
        signal = slices.flatten(1).float() * (1.0 / 255.0) - self.mean
        for number, (weight, bias) in enumerate(
            zip(self.weights, self.biases, strict=True)
        ):
            signal = torch.nn.functional.linear(
                signal.relu() if number else signal, weight.float(), bias
            )

        return signal.softmax(dim=1)


def with_half_weights(network: TrainedNetwork) -> TrainedNetwork:
    """Return a network with weights rounded to half precision, as the file has them;
    biases and mean are unchanged.
    """
    return replace(
        network,
        weights=tuple(
            each.astype(np.float16).astype(np.float32) for each in network.weights
        ),
    )


def classifier_bytes(
    network: TrainedNetwork, study: SliceStudy, provenance: Mapping[str, str]
) -> bytes:
    """Return a network of half precision as an ONNX model; ONNX Runtime widens the
    weights, and sums in float32.
    """
    slices = torch.zeros(2, study.rows, study.columns, dtype=torch.uint8)
    return onnx_bytes(
        _OnnxClassifier(network), {INPUT: slices}, [OUTPUT], provenance, folded=False
    )


# Sums in another order differ in the last bit, so a run is repeatable with an equal
# number of threads only.
CLASSIFIER_THREADS = 2


def fit_classifier(
    study: NetworkStudy,
    training: Samples,
    validation: Samples,
    classes: int = 3,
    progress: Progress = None,
    device: str = "cpu",
    threads: int = CLASSIFIER_THREADS,
) -> TrainedNetwork:
    """Train a network; the same study and samples give the same weights on the same
    machine.

    The weights are those after the last epoch: none are picked by their validation
    figures, which stay an honest estimate. `progress` is called with 1 after each
    epoch.
    """
    mean, varies = normalisation(training, study.mirror)
    # each training slice, then the mirror image of each: only whole rows are copied
    images = training.slices > 0
    if study.mirror:
        images = np.concatenate([images, images[:, :, ::-1]])

    with torch.device(device):
        centre = tensor(mean[varies])
        wall = tensor(images.reshape(len(images), -1)[:, varies])
        target, unseen_target = (
            tensor(samples.target.astype(np.int64))
            for samples in (training, validation)
        )
        unseen_wall = tensor(validation.pixels[:, varies] > 0)

    rows = list[tuple[float, ...]]()
    batches = ceil(len(training) / study.batch_size)

    def epoch(network: torch.nn.Sequential, *_: object) -> Losses:
        """Go through all training samples once, in random order; note accuracy, and
        loss and accuracy of the others.
        """
        network.train()
        right = 0.0

        for index in torch.tensor_split(torch.randperm(len(training)), batches):
            row = index
            if study.mirror:  # a random half of the samples
                row = index + len(training) * (torch.rand(len(index)) < 0.5)

            inputs = wall.index_select(0, row).float() - centre
            loss, share = cross_entropy(
                network, inputs, target[index], study.dropout_masks
            )
            right += share * len(index)
            yield loss, len(index)

        measured = _measure(network, centre, unseen_wall, unseen_target)
        rows.append((right / len(training), *measured))

    build = partial(build_network, int(varies.sum()), study, classes)
    numbers = (n for n in range(study.epochs))
    fitted = train_network(
        build,
        epoch,
        numbers,
        study,
        study.epochs * batches,
        progress,
        threads,
        device,
    )
    curves = Curves(fitted.training_loss, *zip(*rows, strict=True))

    return replace(trained_network(fitted.network, mean, varies), curves=curves)


def _measure(
    network: torch.nn.Sequential,
    centre: torch.Tensor,
    wall: torch.Tensor,
    target: torch.Tensor,
) -> tuple[float, float]:
    """Return mean loss and accuracy without dropout."""
    network.eval()
    loss = 0.0
    right = 0

    with torch.inference_mode():
        parts = (torch.split(each, 1024) for each in (wall, target))
        for of_wall, of_target in zip(*parts, strict=True):
            logits = network(of_wall.float() - centre)
            loss += torch.nn.functional.cross_entropy(
                logits, of_target, reduction="sum"
            ).item()
            right += int((logits.argmax(1) == of_target).sum())

    return loss / len(target), right / len(target)


def cross_entropy(
    network: torch.nn.Sequential,
    inputs: torch.Tensor,
    target: torch.Tensor,
    dropout_masks: int = 1,
) -> tuple[torch.Tensor, float]:
    """Return the mean loss and the accuracy over samples and dropout masks."""
    target = target.repeat(dropout_masks)
    # dropout begins behind the first two modules
    logits = network[2:](network[:2](inputs).repeat(dropout_masks, 1))
    right = (logits.argmax(1) == target).float().mean().item()
    return torch.nn.functional.cross_entropy(logits, target), right


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One size and its figures, None if its training diverged."""

    hidden: tuple[int, ...]
    weights: int
    validation_accuracy: float | None
    validation_loss: float | None


def grid(study: NetworkStudy) -> tuple[tuple[int, ...], ...]:
    """Return the sizes to try: hidden layers of one width each."""
    return tuple(
        (width,) * depth
        for depth, width in product(study.search_depths, study.search_widths)
    )


def best_candidate(candidates: Sequence[Candidate]) -> int:
    """Return the number of the candidate with the highest validation accuracy; of equal
    ones, the fewest weights.
    """
    reached = [
        (-entry.validation_accuracy, entry.weights, number)
        for number, entry in enumerate(candidates)
        if entry.validation_accuracy is not None
    ]
    if not reached:
        raise SolverError(
            "every size of the grid diverged; lower network.learning_rate"
        )

    return min(reached)[2]


def search_sizes(
    study: NetworkStudy,
    training: Samples,
    validation: Samples,
    classes: int = 3,
    progress: Progress = None,
    workers: int | None = None,
    device: str = "cpu",
    threads: int = CLASSIFIER_THREADS,
) -> tuple[tuple[Candidate, ...], NetworkStudy, TrainedNetwork]:
    """Train every size of the grid; return all candidates, and the study with the best
    size and its network.

    Whoever trains, the result is the same on one kind of processor. The validation set
    chooses, so the accuracy of the chosen size is slightly flattered.
    """
    sizes = grid(study)
    fitted = list[TrainedNetwork | None]()
    candidates = list[Candidate]()
    reported = progress if workers is None else None
    train = partial(
        fit_classifier,
        training=training,
        validation=validation,
        classes=classes,
        device=device,
        threads=threads,
        progress=reported,
    )
    # gives the function of a size's number
    prepare = partial(partial, _try_size, train, study)
    numbers = range(len(sizes))
    tried = (
        map(prepare(), numbers)
        if workers is None
        else work_in_order(prepare, numbers, workers, ahead=len(sizes))
    )

    for hidden, found in zip(sizes, tried, strict=True):
        if progress and workers is not None:
            progress(study.epochs)

        weights = sum(
            (a + 1) * b
            for a, b in pairwise((training.pixels.shape[1], *hidden, classes))
        )
        accuracy, loss = (
            (found.curves.validation_accuracy[-1], found.curves.validation_loss[-1])
            if found
            else (None, None)
        )
        fitted.append(found)
        candidates.append(
            Candidate(
                hidden=hidden,
                weights=weights,
                validation_accuracy=accuracy,
                validation_loss=loss,
            )
        )

    chosen = best_candidate(candidates)
    network = fitted[chosen]
    assert network is not None
    return tuple(candidates), replace(study, hidden=sizes[chosen]), network


# PyTorch's random numbers belong to the process, which may be a worker of threads
_one_training = threading.Lock()


def _try_size(
    train: Callable[[NetworkStudy], TrainedNetwork], study: NetworkStudy, number: int
) -> TrainedNetwork | None:
    """Train a size of the grid; return None if it diverges, as large ones may."""
    try:
        with _one_training:
            return train(replace(study, hidden=grid(study)[number]))
    except SolverError:
        return None
