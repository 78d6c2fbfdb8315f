"""PyTorch and ONNX, with one clear line if they are missing; the descent of all
networks; networks as ONNX models.
"""

import os
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from math import cos, pi
from typing import Any, Generic, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.errors import InputError, SolverError
from scleraforce.base.worker_processes import work_in_order
from scleraforce.records.study import (
    NetworkStudy,
    RawReaderStudy,
    ReaderStudy,
    WallFinderStudy,
)

# Threads that wait by spinning take the cores from whoever else needs them, and from
# each other: on a busy machine an epoch then takes five times as long. OpenMP reads
# this when PyTorch loads it.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
# repeatable sums on a GPU need it
os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")

try:
    import onnx as onnx
    import torch as torch
except ModuleNotFoundError as fault:
    raise InputError(
        f"training needs {fault.name}, which is not installed: pip install"
        " 'scleraforce[train]'"
    ) from None

OPSET = 17  # old enough for every ONNX Runtime since 1.12


def onnx_bytes(
    network: torch.nn.Module,
    inputs: Mapping[str, torch.Tensor],
    outputs: Sequence[str],
    provenance: Mapping[str, str],
    folded: bool = True,
) -> bytes:
    """Return a network in evaluation mode as a checked ONNX model; equal networks and
    provenance give equal bytes.
    """
    file = BytesIO()
    with warnings.catch_warnings():
        # of tracing: the other exporter needs one more package
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.onnx.export(
            network,
            tuple(inputs.values()),
            file,  # type: ignore[arg-type]  # tracing writes to files, too
            dynamo=False,
            opset_version=OPSET,
            do_constant_folding=folded,
            input_names=list(inputs),
            output_names=list(outputs),
            dynamic_axes={name: {0: "n"} for name in (*inputs, *outputs)},
        )

    model = onnx.load_model_from_string(file.getvalue())
    model.producer_name = "scleraforce"
    onnx.helper.set_model_props(model, dict(sorted(provenance.items())))
    onnx.checker.check_model(model, full_check=True)
    content: bytes = model.SerializeToString(deterministic=True)

    return content


Settings = NetworkStudy | ReaderStudy | WallFinderStudy | RawReaderStudy
SECTIONS = dict(
    zip(
        get_args(Settings),
        ("network", "reader", "wall_finder", "raw_reader"),
        strict=True,
    )
)
CURVE_POINTS = 50
AHEAD = 4  # chunks of samples for each process that are drawn or wait
READER_THREADS = 1
DEVICES = ("auto", "cpu", "cuda")
Progress = Callable[[int], object] | None
# mean losses of batches, computed lazily, and their numbers of samples
Losses = Iterable[tuple[torch.Tensor, int]]
Drawn = TypeVar("Drawn")
Samples = TypeVar("Samples")
Network = TypeVar("Network", bound=torch.nn.Module)


def drawn_ahead(
    draw: Callable[[int], Drawn], numbers: Sequence[int], workers: int
) -> Generator[Drawn, None, None]:
    """Yield numbered samples in order, drawn ahead by `workers` processes (or a
    cluster's) until closed; 0: here.
    """
    if not workers:
        return (draw(number) for number in numbers)
    # nothing is prepared
    return work_in_order(
        partial(partial, draw), numbers, workers, ahead=AHEAD * workers
    )


def chosen_device(name: str) -> str:
    """Return "cuda" or "cpu"; of "auto", the GPU if PyTorch finds one.

    Raises:
        InputError: another name, or "cuda" where PyTorch finds no GPU.
    """
    if name not in DEVICES:
        raise InputError(f"device: {name!r}; give one of {', '.join(DEVICES)}")

    found = torch.cuda.is_available()
    if name == "cuda" and not found:
        raise InputError(
            "device: cuda, but PyTorch finds no GPU on this machine; give cpu or auto"
        )

    return "cuda" if found and name != "cpu" else "cpu"


def tensor(array: NDArray[Any]) -> torch.Tensor:
    """Return an array as a tensor on the device of the training."""
    return torch.from_numpy(array).to(torch.get_default_device())


def train_in_rounds(
    network: torch.nn.Module,
    optimiser: torch.optim.Optimizer,
    rounds: Iterable[Losses],
    study: Settings,
    steps: int,
) -> Iterator[float]:
    """Take a step down the gradient of each batch's loss, its norm clipped; yield the
    mean loss of each round.

    `steps` batches make all rounds.
    """
    step = 0
    for batches in rounds:
        total = 0.0
        samples = 0

        for loss, count in batches:
            for group in optimiser.param_groups:
                group["lr"] = learning_rate(study, step, steps)

            optimiser.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]  # PyTorch does not annotate it
            torch.nn.utils.clip_grad_norm_(
                network.parameters(), study.max_gradient_norm
            )
            optimiser.step()
            step += 1
            total = total + loss.item() * count
            samples = samples + count

            if not np.isfinite(total):
                key = f"{SECTIONS[type(study)]}.learning_rate"
                raise SolverError(
                    f"training diverged in step {step} of {steps}; lower {key}"
                )

        yield total / samples


@dataclass(frozen=True)
class TrainingResult(Generic[Network]):
    """A trained network, and mean losses in parts of its training, each before it was
    learned from.
    """

    network: Network
    training_loss: tuple[float, ...]


def train_network(
    build: Callable[[], Network],
    losses_of: Callable[[Network, int, Samples], Losses],
    drawn: Generator[Samples, None, None],
    study: Settings,
    steps: int,
    progress: Progress = None,
    threads: int = READER_THREADS,
    device: str = "cpu",
) -> TrainingResult[Network]:
    """Train a new network on one thread or on a GPU, as others draw; the losses are of
    each draw.

    `losses_of` gives the mean losses of the batches in the samples of a draw, by its
    number, and their sizes; `drawn` is closed in the end; more `threads`, or another
    `device`, sum in another order. The first weights are the same on every device; the
    network comes back to the CPU.
    """
    losses: list[float] = []
    with closing(drawn), repeatable(study.seed, threads, device):
        network = build().to(device).train()
        rounds = (
            losses_of(network, number, samples) for number, samples in enumerate(drawn)
        )

        with torch.device(device):
            for loss in train_in_rounds(
                network, _optimiser(network, study), rounds, study, steps
            ):
                losses.append(loss)
                if progress:
                    progress(1)

    return TrainingResult(network.eval().cpu(), tuple(losses))


def _optimiser(network: torch.nn.Module, study: Settings) -> torch.optim.Optimizer:
    if isinstance(study, NetworkStudy):
        return torch.optim.SGD(
            network.parameters(), study.learning_rate, study.momentum, fused=True
        )

    fused = True if isinstance(study, ReaderStudy) else None
    return torch.optim.AdamW(
        network.parameters(),
        study.learning_rate,
        weight_decay=study.weight_decay,
        fused=fused,
    )


def learning_rate(study: Settings, step: int, steps: int) -> float:
    """Return the rate of a step: a linear warm-up, then half a cosine down to zero."""
    warm = study.warmup * steps
    if step < warm:
        return study.learning_rate * min(1.0, (step + 1) / warm)
    return study.learning_rate * 0.5 * (1.0 + cos(pi * (step - warm) / (steps - warm)))


def loss_curve(losses: Sequence[float]) -> tuple[float, ...]:
    """Return the mean losses of `CURVE_POINTS` even parts of a training."""
    return tuple(
        float(part.mean())
        for part in np.array_split(losses, min(CURVE_POINTS, len(losses)))
    )


@contextmanager
def repeatable(seed: int, of_torch: int, device: str = "cpu") -> Iterator[None]:
    """Seed PyTorch and fix its number of threads; put everything back afterwards."""
    threads = torch.get_num_threads()
    strict = torch.are_deterministic_algorithms_enabled()
    memory: Any = torch.utils.deterministic
    filled = memory.fill_uninitialized_memory

    with torch.random.fork_rng(devices=[0] if device == "cuda" else []):
        torch.manual_seed(seed)
        torch.set_num_threads(of_torch)
        torch.use_deterministic_algorithms(True)
        # 5 % of a classifier's step; nothing here reads memory before it is written
        memory.fill_uninitialized_memory = False

        try:
            yield
        finally:
            torch.set_num_threads(threads)
            torch.use_deterministic_algorithms(strict)
            memory.fill_uninitialized_memory = filled
