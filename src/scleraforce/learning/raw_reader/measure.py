"""How well a raw reader's network does on drawn frames that no training saw."""

from scleraforce.learning.framework import torch
from scleraforce.learning.raw_reader.network import RawReaderNetwork
from scleraforce.learning.raw_reader.samples import FRAMES_TOGETHER, RawSamples, RawSource
from scleraforce.learning.reader.samples import concatenated
from scleraforce.learning.reader.training import ReaderMetrics, answers_of, compared
from scleraforce.study import Study

VALIDATION_CHUNK = 2**31  # numbers from here on are chunks of the validation set


def measure_raw_reader(network: RawReaderNetwork, source: RawSource, study: Study) -> ReaderMetrics:
    """Compare a network's answers with the truth of `[raw_reader] validation_frames` frames."""
    count = study.raw_reader.validation_frames
    parts = [
        source.chunk(VALIDATION_CHUNK + n, min(FRAMES_TOGETHER, count - n * FRAMES_TOGETHER))
        for n in range(-(-count // FRAMES_TOGETHER))
    ]
    mixtures, places_mm = (torch.cat(each) for each in zip(*(_answers(network, part) for part in parts), strict=True))
    samples = concatenated(parts)
    answers = answers_of(mixtures, places_mm, samples.modulus_pa, study.reader)
    return compared(answers, samples.force_n, samples.lateral_m, study)


def _answers(network: RawReaderNetwork, samples: RawSamples) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the mixtures of the force and the contact's places, mm."""
    with torch.inference_mode():
        mixtures, places, _, _ = network(torch.from_numpy(samples.frames), torch.from_numpy(samples.given))
    return mixtures, places
