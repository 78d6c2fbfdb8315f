"""Speed of training and reading, and what each part of the training brings.

    python benchmarks/bench_learning.py [DATASET...] [--slices 17280] [--readings 2000] [--epochs N]

Without data sets: processor seconds of an epoch of the paper's size, and the time of one reading. With data sets (of
`scleraforce generate`): the accuracy that the study's training reaches on each, and without each of its parts in turn.
"""

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from scleraforce.learning.classifier import CLASSIFIER_THREADS, Fitted, Samples, classifier_bytes, fit
from scleraforce.learning.dataset import open_dataset
from scleraforce.learning.train import split_samples
from scleraforce.models import write_folder
from scleraforce.reader import load_classifier
from scleraforce.study import NetworkStudy, Study, format_study, study_hash

PAPER_TRAINING, VALIDATION_SHARE = 17_280, 1 / 9

VARIANTS: dict[str, dict[str, float | int | bool]] = {
    "the study's training": {},
    "without mirrored slices": {"mirror": False},
    "one dropout mask a sample": {"dropout_masks": 1},
    "rate 0.01": {"learning_rate": 0.01},
    "gradients not clipped, no warm-up": {"max_gradient_norm": 1e6, "warmup": 0.0},
}


def random_samples(count: int, rng: np.random.Generator) -> Samples:
    """Return slices of the paper's size in which every pixel varies; the time of training depends on no more."""
    wall = rng.random((count, 40, 140), dtype=np.float32) < 0.2
    return Samples(wall.astype(np.uint8) * np.uint8(255), rng.integers(0, 3, count))


def print_epoch_times(training: Samples, validation: Samples) -> Fitted:
    """Print what an epoch costs; return a network."""
    print(f"{'an epoch of ' + str(len(training)) + ' slices':<40}{'processor s':>12}{'clock s':>10}")
    for masks in (4, 2, 1):
        processor, clock = time.process_time(), time.perf_counter()
        fitted = fit(NetworkStudy(epochs=1, dropout_masks=masks), training, validation)
        spent = time.process_time() - processor, time.perf_counter() - clock
        print(f"{f'{masks} dropout masks, {CLASSIFIER_THREADS} threads':<40}{spent[0]:>12.1f}{spent[1]:>10.1f}")
    return fitted


def print_reading_times(fitted: Fitted, validation: Samples, readings: int) -> None:
    """Print the time of one slice through ONNX Runtime, one thread."""
    study = Study()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "model"
        graph = classifier_bytes(fitted.network, study.slice, {"study_sha256": study_hash(study)})
        write_folder(out, graph, format_study(study), "", {"kind": "classifier"})
        reader = load_classifier(out)
    times = []
    for number in range(readings):
        start = time.perf_counter()
        reader.probabilities(validation.slices[number % len(validation)][None])
        times.append(time.perf_counter() - start)
    low, middle, high = np.quantile(times, (0.0, 0.5, 0.99)) * 1e3
    print(
        f"\none reading, one thread: {low:.2f} ms least, {middle:.2f} ms median, {high:.2f} ms at the 99th percentile"
    )


def print_accuracies(path: Path, network: NetworkStudy) -> None:
    """Print what the study's training reaches on a data set, and without each of its parts."""
    dataset = open_dataset(path)
    training, validation = split_samples(dataset, dataset.youngs_modulus_pa)
    print(f"\n{path!s:<40}{'validation':>12}{'loss':>10}{'clock s':>10}")
    for name, changes in VARIANTS.items():
        start = time.perf_counter()
        curves = fit(replace(network, **changes), training, validation).curves  # type: ignore[arg-type]  # by name
        seconds = time.perf_counter() - start
        print(f"{name:<40}{curves.validation_accuracy[-1]:>12.2%}{curves.validation_loss[-1]:>10.4f}{seconds:>10.0f}")


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("dataset", type=Path, nargs="*")
    parser.add_argument("--slices", type=int, default=PAPER_TRAINING, help="of an epoch")
    parser.add_argument("--readings", type=int, default=2_000)
    parser.add_argument("--epochs", type=int, default=NetworkStudy().epochs, help="of a training on a data set")
    given = parser.parse_args()
    rng = np.random.default_rng(0)
    validation = random_samples(round(VALIDATION_SHARE * given.slices), rng)
    fitted = print_epoch_times(random_samples(given.slices, rng), validation)
    print_reading_times(fitted, validation, given.readings)
    for path in given.dataset:
        print_accuracies(path, NetworkStudy(epochs=given.epochs))


if __name__ == "__main__":
    main()
