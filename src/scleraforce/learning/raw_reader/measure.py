"""How well a raw reader's network does on drawn frames that no training saw."""

import numpy as np

from scleraforce.learning.framework import torch
from scleraforce.learning.raw_reader.network import RawReaderNetwork
from scleraforce.learning.raw_reader.samples import FRAMES_TOGETHER, RawSamples, RawSource
from scleraforce.learning.reader.network import histogram
from scleraforce.learning.reader.training import ReaderMetrics
from scleraforce.reader.force_distribution import force_distribution, ratio_edges
from scleraforce.reader.metrics import accuracy, confusion_matrix
from scleraforce.study import Study
from scleraforce.units import to_si

__all__ = ["measure_raw_reader"]

VALIDATION_CHUNK = 2**31  # numbers from here on are chunks of the validation set


def measure_raw_reader(network: RawReaderNetwork, source: RawSource, study: Study) -> ReaderMetrics:
    """Compare a network's answers with the truth of `[raw_reader] validation_frames` frames."""
    count = study.raw_reader.validation_frames
    parts = [
        source.chunk(VALIDATION_CHUNK + n, min(FRAMES_TOGETHER, count - n * FRAMES_TOGETHER))
        for n in range(-(-count // FRAMES_TOGETHER))
    ]
    mixtures, places_mm = (torch.cat(each) for each in zip(*(_answers(network, part) for part in parts), strict=True))
    samples, reader = RawSamples.joined(parts), study.reader
    edges = ratio_edges(reader.bins, reader.max_force_ratio)
    forces = force_distribution(histogram(mixtures, reader.bins).double().numpy(), edges, samples.modulus_pa)
    median_n, (low_n, high_n) = forces.median_n, forces.interval_n.T
    classify = study.classes.classify
    confusion = confusion_matrix(
        [classify(force) for force in samples.force_n.tolist()],
        [classify(force) for force in median_n.tolist()],
        len(study.classes.bounds_n) + 1,
    )
    share = accuracy(confusion)
    return ReaderMetrics(
        accuracy=share.value,
        interval=share.interval,
        mae_n=float(np.abs(median_n - samples.force_n).mean()),
        coverage=float(((samples.force_n >= low_n) & (samples.force_n <= high_n)).mean()),
        lateral_mae_m=float(np.abs(to_si(places_mm.double().numpy(), "mm") - samples.lateral_m).mean()),
        confusion=tuple(tuple(row) for row in confusion.tolist()),
    )


def _answers(network: RawReaderNetwork, samples: RawSamples) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the mixtures of the force and the contact's places, mm."""
    with torch.inference_mode():
        mixtures, places, _, _ = network(torch.from_numpy(samples.frames), torch.from_numpy(samples.given))
    return mixtures, places
