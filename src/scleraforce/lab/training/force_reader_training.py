"""The reader's network and its training: from a slice and the eye's known values to a
histogram of F/E and a place.

Three numbers describe a column: whether there is wall, its amount, and its mean depth
below the undeformed circle of the eye. Convolutions along the columns follow, then
layers that also see the known values.

The loss is the negative log-likelihood of the force, a proper score (Gneiting and
Raftery, "Strictly proper scoring rules", 2007), plus Huber's loss of the contact's
place; AdamW descends on samples drawn afresh for every epoch, half of them mirror
images: a wall costs more time to draw than to learn from.
"""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from functools import partial
from itertools import count, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.units import from_si, to_si
from scleraforce.calibration.answer_metrics import accuracy, confusion_matrix
from scleraforce.lab.training import gradient_descent
from scleraforce.lab.training.gradient_descent import (
    Losses,
    Progress,
    TrainingResult,
    tensor,
    torch,
)
from scleraforce.lab.training.reader_samples import (
    CHUNK,
    ForceSamples,
    ReaderSamples,
    SampleSource,
    concatenated,
    validation_chunks,
)
from scleraforce.library.plane_cut import column_laterals
from scleraforce.reading.force_network import (
    CONTACT,
    GIVEN,
    GIVEN_INPUT,
    HISTOGRAM,
    SLICES,
    histogram_reading,
    ratio_edges,
)
from scleraforce.records.study import Choice, ReaderStudy, SliceStudy, Study
from scleraforce.wall.wall_network import FINDER_FRAMES

FEATURES = 3  # of a column: wall at all, amount of wall, mean depth below the circle
KERNEL = 5
STRIDE = 2
GIVEN_UNITS = 32
COMPONENTS = 3  # of the mixture that describes the force
# least and largest logarithm of a component's scale, over the range of the histogram
SHARPNESS = (
    -6.0,
    1.0,
)
FAR = 1e4  # stands for the ends of the line, over the range of the histogram
# m: amounts and depths enter in such units, so that they are of order one
TYPICAL_WALL = 0.6e-3
PLACE_WEIGHT = 2.0
PLACE_KNEE_MM = 0.2


class ReaderNetwork(torch.nn.Module):
    """A mixture of logistic distributions of the force's place, and the contact's place
    in mm (sample,).

    The force's place is sqrt(x / max x), x = F/E: from 0 to 1 along the histogram. A
    few numbers give the force and its uncertainty; a network that has to give the
    heights of 128 bins learns slowly to be certain.

    `slices`: float, 0 or 1, shape (sample, row, column); `given`: shape (sample,
    len(GIVEN)).
    """

    def __init__(
        self, reader: ReaderStudy, slice_study: SliceStudy, radius_m: float
    ) -> None:
        """Build the network with random weights (from PyTorch's generator)."""
        super().__init__()
        depth = (
            (np.arange(slice_study.rows) + 0.5 - slice_study.rows / 2)
            * slice_study.pixel_m
            / TYPICAL_WALL
        )
        projection = np.stack([np.ones(slice_study.rows), depth])[:, :, None]
        lateral_m = column_laterals(slice_study)
        circle = (
            radius_m - np.sqrt(np.maximum(radius_m**2 - lateral_m**2, 0.0))
        ) / TYPICAL_WALL  # below its top
        self.wall_unit = slice_study.pixel_m / TYPICAL_WALL
        self.projection: torch.Tensor
        self.circle: torch.Tensor

        for name, values in (("projection", projection), ("circle", circle)):
            self.register_buffer(name, torch.from_numpy(values.astype(np.float32)))

        sizes = (FEATURES, *reader.channels)
        layers = (
            torch.nn.Conv1d(below, above, KERNEL, STRIDE, KERNEL // 2)
            for below, above in pairwise(sizes)
        )
        self.convolutions = torch.nn.ModuleList(layers)
        columns = slice_study.columns

        for _ in reader.channels:
            columns = (columns - 1) // STRIDE + 1

        self.given_layer = torch.nn.Linear(len(GIVEN), GIVEN_UNITS)
        widths = (sizes[-1] * columns, *reader.hidden)
        hidden = (
            torch.nn.Linear(below + GIVEN_UNITS, above)
            for below, above in pairwise(widths)
        )
        self.hidden = torch.nn.ModuleList(hidden)
        self.force = torch.nn.Linear(widths[-1], 3 * COMPONENTS)

        with torch.no_grad():
            middles = torch.linspace(0.3, 0.9, COMPONENTS)
            self.force.bias[:] = torch.cat(
                [torch.zeros(COMPONENTS), middles, torch.full((COMPONENTS,), -2.0)]
            )

        self.bins = reader.bins
        # of its input
        self.example = torch.zeros(
            2, slice_study.rows, slice_study.columns, dtype=torch.uint8
        )
        self.place = torch.nn.Linear(widths[-1], 1)

    def forward(
        self, slices: torch.Tensor, given: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return mixtures (sample, 3 COMPONENTS): logits of weights, middles, log
        scales; and the contact's places.
        """
        signal = self.features(slices)
        for convolution in self.convolutions:
            signal = torch.relu(convolution(signal))

        known = torch.relu(self.given_layer(given))
        signal = signal.flatten(1)
        for layer in self.hidden:
            signal = torch.relu(layer(torch.cat([signal, known], dim=1)))

        return self.force(signal), self.place(signal)[:, 0]

    def features(self, slices: torch.Tensor) -> torch.Tensor:
        """Return the three numbers that describe a column (sample, FEATURES,
        column).
        """
        amount, moment = torch.nn.functional.conv1d(slices, self.projection).unbind(1)
        there = amount.clamp(max=1.0)
        below_circle = moment / amount.clamp(min=1.0) - self.circle * there
        return torch.stack(
            [there, amount * self.wall_unit - there, below_circle], dim=1
        )


def log_density(mixture: torch.Tensor, place: torch.Tensor) -> torch.Tensor:
    """Return the logarithm of a mixture's density at places (sample,)."""
    weight, middle, log_scale = _parts(mixture)
    z = (place[:, None] - middle) * torch.exp(-log_scale)
    each = (
        torch.nn.functional.logsigmoid(z)
        + torch.nn.functional.logsigmoid(-z)
        - log_scale
    )

    return torch.logsumexp(torch.log_softmax(weight, dim=1) + each, dim=1)


def histogram(mixture: torch.Tensor, bins: int) -> torch.Tensor:
    """Return the mixture's share in each bin (sample, bin); the end bins have
    everything beyond.
    """
    return shares_between(torch.from_numpy(bin_ends(bins)), mixture)


def shares_between(ends: torch.Tensor, mixture: torch.Tensor) -> torch.Tensor:
    """Return the mixture's share between neighbouring places (sample, place - 1)."""
    weight, middle, log_scale = _parts(mixture)
    below = torch.sigmoid(
        (ends - middle[:, :, None]) * torch.exp(-log_scale)[:, :, None]
    )
    shares = (torch.softmax(weight, dim=1)[:, :, None] * below).sum(dim=1)
    return shares[:, 1:] - shares[:, :-1]


def _parts(mixture: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return logits of the weights, middles and log scales, each (sample,
    COMPONENTS).
    """
    weight, middle, log_scale = torch.split(mixture, COMPONENTS, dim=1)
    return weight, middle, log_scale.clamp(*SHARPNESS)


def bin_ends(bins: int) -> NDArray[np.float32]:
    """Return the places of the bins' ends (bins + 1,); the first and the last are far
    away.
    """
    ends = np.linspace(0.0, 1.0, bins + 1, dtype=np.float32)
    ends[[0, -1]] = -FAR, FAR
    return ends


class _OnnxForceReader(torch.nn.Module):
    """The ONNX model: slices, uint8, or reduced frames, and given values to histogram
    and contact's place, m.
    """

    def __init__(self, network: Any) -> None:
        super().__init__()
        self.network = network
        self.ends: torch.Tensor
        self.register_buffer("ends", torch.from_numpy(bin_ends(network.bins)))

    def forward(
        self, seen: torch.Tensor, given: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        seen = seen.float() * (1.0 / 255.0) if seen.dtype == torch.uint8 else seen
        mixtures, places_mm = self.network(seen, given)[:2]
        return shares_between(self.ends, mixtures), places_mm * to_si(1.0, "mm")


def force_bytes(network: Any, provenance: Mapping[str, str]) -> bytes:
    """Return a network of slices, uint8, 0 or 255, or of reduced frames as an ONNX
    model that reads forces.

    From these (n, row, column) and `given`, float32, it answers with `histogram`,
    float32 (n, bins), rows sum to 1, and `contact_m`, float32 (n,).
    """
    name = SLICES if network.example.dtype == torch.uint8 else FINDER_FRAMES
    inputs = {
        name: network.example,
        GIVEN_INPUT: torch.zeros(len(network.example), len(GIVEN)),
    }

    return gradient_descent.onnx_bytes(
        _OnnxForceReader(network).eval(), inputs, [HISTOGRAM, CONTACT], provenance
    )


def fit_reader(
    study: Study,
    draw: Callable[[int], ReaderSamples],
    workers: int,
    progress: Progress = None,
    device: str = "cpu",
) -> TrainingResult[ReaderNetwork]:
    """Train a reader on chunks of samples, none seen twice but for mirror images;
    losses and `progress` are of epochs.

    The same study and library give the same weights on the same machine, for any number
    of drawing processes (0: here).
    """
    reader = study.reader
    done = count(1)
    chunks = -(-reader.samples_per_epoch // CHUNK)
    rounds = reader.epochs * chunks
    steps = reader.epochs * chunks * -(-CHUNK // reader.batch_size)

    def report(_: int) -> None:
        if progress and next(done) % chunks == 0:
            progress(1)

    build = partial(ReaderNetwork, reader, study.slice, study.eye.radius_m)
    drawn = _rounds(draw, reader, rounds, workers)
    fitted = gradient_descent.train_network(
        build, partial(_losses, reader), drawn, reader, steps, report, device=device
    )
    of_epochs = np.reshape(fitted.training_loss, (reader.epochs, chunks)).mean(axis=1)

    return TrainingResult(fitted.network, tuple(of_epochs.tolist()))


def _rounds(
    draw: Callable[[int], ReaderSamples], reader: ReaderStudy, rounds: int, workers: int
) -> Generator[ReaderSamples, None, None]:
    """Yield the samples of each round; where left and right are drawn alike, mirror
    images follow their originals.
    """
    drawn_from = (reader.lateral_m, reader.rotation_rad)
    places = [
        each.values if isinstance(each, Choice) else each.bounds for each in drawn_from
    ]
    alike = all(
        sorted(values) == sorted(-value for value in values) for values in places
    )

    with closing(
        gradient_descent.drawn_ahead(draw, range(-(-rounds // (1 + alike))), workers)
    ) as drawn:
        for number, samples in enumerate(drawn):
            yield samples
            if alike and 2 * number + 1 < rounds:
                yield samples.mirrored()


def _losses(
    reader: ReaderStudy, network: ReaderNetwork, _: int, samples: ReaderSamples
) -> Losses:
    """Yield the mean losses of the batches of samples, and their sizes."""
    slices, given = _tensors(samples)
    force, place_mm = targets(samples, reader)
    for index in torch.split(torch.arange(len(samples)), reader.batch_size):
        mixtures, places = network(slices[index], given[index])
        yield reader_loss(mixtures, places, force[index], place_mm[index]), len(index)


def measure_reader(
    network: ReaderNetwork, source: SampleSource, study: Study
) -> dict[str, Any]:
    """Return `metrics` of `model.json`, of `[reader] validation_samples` new
    samples.
    """
    with gradient_descent.repeatable(
        study.reader.seed, gradient_descent.READER_THREADS
    ):
        unseen = concatenated(
            validation_chunks(source.chunk, study.reader.validation_samples, CHUNK)
        )
        return reader_metrics(network_outputs(network, unseen), unseen, study)


def network_outputs(
    network: ReaderNetwork, samples: ReaderSamples
) -> list[tuple[torch.Tensor, torch.Tensor]]:
    """Return a network's outputs for parts of samples."""
    network.eval()
    slices, given = _tensors(samples)

    with torch.inference_mode():
        return [
            network(slices[part], given[part])
            for part in torch.split(torch.arange(len(samples)), 512)
        ]


def reader_metrics(
    outputs: Sequence[tuple[torch.Tensor, torch.Tensor]],
    truth: ForceSamples,
    study: Study,
) -> dict[str, Any]:
    """Return `metrics` of `model.json` from a network's outputs for all parts of
    samples.

    Accuracy, its 95 % interval (Wilson) and confusion (a row for each true class) are
    of the classes; the mean error is of the median, the coverage of the 90 % intervals.
    """
    mixtures, places_mm = (torch.cat(values) for values in zip(*outputs, strict=True))
    shares = histogram(mixtures, study.reader.bins).double().tolist()
    bounds_n = study.classes.bounds_n
    edges_m2 = ratio_edges(study.reader.bins, study.reader.max_force_ratio).tolist()
    force_n = truth.force_n
    of_eyes = zip(shares, truth.modulus_pa.tolist(), strict=True)
    readings = [
        histogram_reading(each, edges_m2, modulus_pa, bounds_n)
        for each, modulus_pa in of_eyes
    ]
    median_n = np.array([reading.force_n for reading in readings])
    low_n, high_n = np.array([reading.interval_n for reading in readings]).T
    target, found = (
        list(map(study.classes.classify, each.tolist())) for each in (force_n, median_n)
    )
    confusion = confusion_matrix(target, found, len(bounds_n) + 1)
    share = accuracy(confusion)
    off_m = to_si(places_mm.double().numpy(), "mm") - truth.lateral_m

    return {
        "validation_accuracy": share.value,
        "validation_interval": share.interval,
        "validation_confusion": confusion.tolist(),
        "mae_mn": from_si(float(np.abs(median_n - force_n).mean()), "mn"),
        "coverage": float(((force_n >= low_n) & (force_n <= high_n)).mean()),
        "lateral_mae_mm": from_si(float(np.abs(off_m).mean()), "mm"),
    }


def reader_loss(
    mixtures: torch.Tensor,
    places_mm: torch.Tensor,
    force: torch.Tensor,
    true_place_mm: torch.Tensor,
) -> torch.Tensor:
    """Return the mean loss of mixtures and places, mm, given the true places of the
    forces and contacts.
    """
    place = torch.nn.functional.huber_loss(
        places_mm, true_place_mm, delta=PLACE_KNEE_MM
    )
    return PLACE_WEIGHT * place - log_density(mixtures, force).mean()


def targets(truth: ForceSamples, reader: ReaderStudy) -> tuple[torch.Tensor, ...]:
    """Return the true places of forces in the histogram, 0 to 1, and of the contact,
    mm, (sample,).
    """
    force_ratio = truth.force_n / truth.modulus_pa
    places = (
        np.sqrt(force_ratio / reader.max_force_ratio),
        from_si(truth.lateral_m, "mm"),
    )
    return tuple(tensor(values.astype(np.float32)) for values in places)


def _tensors(samples: ReaderSamples) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the network's inputs: slices of 0 and 1, and given values."""
    return tensor((samples.slices > 0).astype(np.float32)), tensor(samples.given)
