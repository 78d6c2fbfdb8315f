"""`scleraforce library`, `generate` and `train`: from a study to a model."""

import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

import scleraforce as sf
from scleraforce.front.api.progress import Bars
from scleraforce.front.cli.options import PATH, chosen_workers, options
from scleraforce.front.cli.output import Command, Report, count_bar, resumable_bar, say
from scleraforce.records.calibration_file import read_calibration
from scleraforce.records.model_folder import read_folder
from scleraforce.records.study import Study, refuse_unused


@click.command(cls=Command)
@options("study")
@click.option("--out", type=PATH, required=True, help="Library to write (Zarr).")
@options(
    "scheduler", "workers", scheduler="Dask scheduler whose workers solve the paths."
)
def library(
    study: Study, out: Path, scheduler: str | None, workers: int | None
) -> Report:
    """Compute a response library: load paths of walls at finite strain.

    Other commands use the bundled reader's library for the paper's study. For
    another study they compute one when they first need it, and keep it in the
    user's cache. This command writes it to --out, on a Dask cluster if --scheduler
    is given. The same command resumes an interrupted run. The library does not
    depend on the number of workers.
    """
    # 430 ms: Zarr and SciPy, not for --help
    from scleraforce.library.library_plan import plan_library
    from scleraforce.library.library_store import build_library

    refuse_unused(study, "library")

    with resumable_bar(
        out, "load paths", "library", plan_library(study).units
    ) as advance:
        made = build_library(
            study, out, workers=chosen_workers(scheduler, workers), progress=advance
        )

    return Report(
        {"paths": made.paths, "seconds": made.seconds},
        [f"{out}: {made.paths} load paths, {made.seconds:.1f} s"],
    )


@click.command(cls=Command)
@options("study", required=("study",), study="Study file (TOML).")
@click.option("--out", type=PATH, required=True, help="Data set to write (Zarr).")
@options(
    "calibration",
    "mechanics",
    "scheduler",
    "workers",
    calibration=(
        "File of `calibrate`; its population's Young's modulus replaces the study's."
    ),
    scheduler="Dask scheduler whose workers make the slices.",
)
def generate(
    study: Study,
    out: Path,
    calibration: Path | None,
    mechanics: str | None,
    scheduler: str | None,
    workers: int | None,
) -> Report:
    """Simulate slices of the deformed sclera with their forces.

    Finite strain needs a response library; for another study than the paper's
    it is computed once (a minute). The same command resumes an interrupted run.
    The data set does not depend on the number of workers.
    """
    # 600 ms: Zarr and Numba, not for --help
    from scleraforce.front.api.calibrating import library_for
    from scleraforce.lab.training.slice_dataset import generate_dataset

    kind = mechanics or study.mechanics.kind
    refuse_unused(study, "generate", kind)

    modulus = read_calibration(calibration) if calibration else None
    if modulus and modulus.mechanics != kind:
        say(
            f"{calibration}: E was fitted with {modulus.mechanics} mechanics, the"
            f" slices are {kind}",
            err=True,
        )

    workers = chosen_workers(scheduler, workers)
    library = library_for(study, kind, count_bar, workers)

    with resumable_bar(
        out, "images", "generate", sum(group.images for group in study.dataset.group)
    ) as advance:
        made = generate_dataset(
            study,
            out,
            calibration=modulus,
            library=library,
            workers=workers,
            progress=advance,
        )

    return Report(
        {
            "images": made.images,
            "seconds": made.seconds,
            "images_per_second": made.images_per_second,
        },
        [
            f"{out}: {made.images} images, {made.seconds:.1f} s,"
            f" {made.images_per_second:.0f} images/s"
        ],
    )


@click.command(cls=Command)
@click.argument("dataset_path", metavar="[DATASET]", required=False, type=PATH)
@click.option(
    "--out", type=PATH, required=True, help="Model folder to write; must not exist."
)
@click.option(
    "--kind",
    type=click.Choice(["classifier", "reader", "raw-reader", "wall-finder"]),
    default="classifier",
    show_default=True,
    help="Kind of network: its answer and its input.",
)
@click.option(
    "--search",
    is_flag=True,
    help="Try every size of the grid (search_widths x search_depths), keep the best.",
)
@click.option(
    "--device",
    type=click.Choice(["auto", "cpu", "cuda"]),
    default="auto",
    show_default=True,
    help="Where the network learns: cuda is a GPU, auto the GPU if PyTorch finds one.",
)
@options(
    "study",
    "scheduler",
    study=(
        "Study file: settings of the network, and of the samples that it learns from;"
        " default: the data set's (classifier) or the paper's."
    ),
    scheduler=(
        "Dask scheduler whose workers train the sizes of --search, or draw the scenes"
        " of a wall finder."
    ),
)
@click.pass_context
def train(
    ctx: click.Context,
    /,
    dataset_path: Path | None,
    out: Path,
    kind: str,
    search: bool,
    device: str,
    study: Study,
    scheduler: str | None,
) -> Report:
    """Train a network on DATASET, or on drawings alone.

    DATASET depends on --kind. A classifier learns from a data set of
    `scleraforce generate`; a reader and a raw reader from a response library of
    `scleraforce library`. A raw reader sees raw frames of the library's walls,
    from the scanner that [phantom] of the study describes (`scleraforce
    scanner` measures one). A wall finder draws its own scenes: it needs no
    DATASET.

    It writes a model folder: model.onnx, study.toml, card.md and model.json
    with the curves of the training; a reader's also has library.npz. The same
    data and study give the same weights on the same machine and device.

    Example: scleraforce train paper.zarr --out model

    Example: scleraforce train library.zarr --kind reader --out model

    Example: scleraforce train library.zarr --kind raw-reader --out raw

    Example: scleraforce train --kind wall-finder --out finder
    """
    section = kind.replace("-", "_")
    if scheduler is not None and not (search or kind == "wall-finder"):
        raise click.UsageError(
            "--scheduler: for --search and --kind wall-finder; this training is one"
            " process's work"
        )

    workers = chosen_workers(scheduler, None)
    if kind == "wall-finder" and dataset_path is not None:
        raise click.UsageError(
            f"{dataset_path}: --kind wall-finder draws its scenes; leave DATASET out"
        )
    if kind != "wall-finder" and dataset_path is None:
        raise click.UsageError(
            f"--kind {kind}: DATASET is missing; only --kind wall-finder needs none"
        )
    if search and kind != "classifier":
        raise click.UsageError(
            f"--search is for --kind classifier: a {kind} has the sizes of [{section}]"
        )

    start = time.perf_counter()

    if dataset_path is None:
        # 1,900 ms: PyTorch, not for --help
        from scleraforce.lab.training.trained_models import train_wall_finder

        with count_bar("batches", study.wall_finder.batches) as advance:
            train_wall_finder(study, out, workers, advance, device)

        record = read_folder(out).record
        result = {
            "batches": record["batches"],
            "scenes": record["scenes"]["training"],
            **record["metrics"],
        }
    elif kind == "classifier":
        given = ctx.get_parameter_source("study") != ParameterSource.DEFAULT
        dataset = sf.open_dataset(dataset_path)
        model = sf.train(
            dataset,
            out,
            study if given else None,
            search=search,
            workers=workers,
            device=device,
            progress=Bars(count_bar),
        )
        reached = {
            key: model.record["metrics"][key] for key in (*ACCURACY, "validation_loss")
        }
        result = {
            "hidden": model.study.network.hidden,
            **reached,
            "epochs": model.record["epochs"],
            "search": model.record["search"],
        }
    else:
        refuse_unused(study, f"train kind={kind}")  # before the library is opened
        library = sf.open_library(dataset_path)
        record = sf.train(
            library, out, study, kind=kind, device=device, progress=Bars(count_bar)
        ).record
        steps, samples = (
            ("batches", "frames") if "batches" in record else ("epochs", "samples")
        )
        result = {
            key: record["metrics"][key]
            for key in (*ACCURACY, "mae_mn", "coverage", "lateral_mae_mm")
        }
        result |= {steps: record[steps], samples: record["samples"]["training"]}

    seconds = time.perf_counter() - start
    lines = _LINES[kind](out, result, f"{seconds:.1f} s")
    return Report(
        {"model": str(out), "kind": kind, **result, "seconds": seconds}, lines
    )


ACCURACY = ("validation_accuracy", "validation_interval")


def _finder_lines(out: Path, result: Mapping[str, Any], took: str) -> Iterator[str]:
    yield (
        f"wrote {out}: {result['scenes']} scenes in {result['batches']} batches, {took}"
    )
    yield (
        f"scenes that it never saw: Dice {result['dice_mean']:.3f} in the mean,"
        f" {result['dice_median']:.3f} in the median; {result['coverage']:.1%} of the"
        " boundaries within 1.645 standard deviations"
    )


def _reader_lines(out: Path, result: Mapping[str, Any], took: str) -> Iterator[str]:
    counts = [
        f"{result[name]} {name}"
        for name in ("epochs", "batches", "samples", "frames")
        if name in result
    ]
    yield f"wrote {out}: {', '.join(counts)}, {took}"
    yield (
        f"validation: force {result['mae_mn']:.2f} mN off, {result['coverage']:.1%}"
        " within the 90 % interval"
    )
    yield _accuracy(result)


def _classifier_lines(out: Path, result: Mapping[str, Any], took: str) -> Iterator[str]:
    if result["search"]:
        yield (
            f"{'hidden layers':<24}{'weights':>12}{'validation accuracy':>22}"
            f"{'loss':>10}"
        )

    for entry in result["search"]:
        chosen = "  <" if tuple(entry["hidden"]) == tuple(result["hidden"]) else ""
        reached = entry["validation_accuracy"]
        loss = entry["validation_loss"]
        accuracy = "diverged" if reached is None else f"{reached:.2%}"
        loss = "" if loss is None else f"{loss:.4f}"
        yield (
            f"{_sizes(entry['hidden']):<24}{entry['weights']:>12,}{accuracy:>22}"
            f"{loss:>10}{chosen}"
        )

    yield f"wrote {out}: hidden layers {_sizes(result['hidden'])}"
    yield f"{result['epochs']} epochs{' of each' if result['search'] else ''}, {took}"
    yield f"{_accuracy(result)}, loss {result['validation_loss']:.4f}"


_LINES = {
    "classifier": _classifier_lines,
    "reader": _reader_lines,
    "raw-reader": _reader_lines,
    "wall-finder": _finder_lines,
}


def _accuracy(result: Mapping[str, Any]) -> str:
    low, high = result["validation_interval"]
    return (
        f"validation accuracy {result['validation_accuracy']:.2%} (95 % interval"
        f" {low:.2%} to {high:.2%})"
    )


def _sizes(hidden: Sequence[int]) -> str:
    return "-".join(str(width) for width in hidden) or "none"
