"""`scleraforce train`: train a network on simulated slices, on a response library, or on drawn scenes."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from scleraforce.cli.options import PATH, chosen_workers, options
from scleraforce.cli.output import Command, Report, count_bar
from scleraforce.study import NetworkStudy, Study
from scleraforce.units import from_si

if TYPE_CHECKING:
    from scleraforce.learning.train import Trained

SECONDS = "<seconds>"  # stands for the duration in lines
Made = tuple[dict[str, Any], list[str]]  # the object of --json, and lines


@click.command(cls=Command)
@click.argument("dataset_path", metavar="[DATASET]", required=False, type=PATH)
@click.option("--out", type=PATH, required=True, help="Model folder to write; must not exist.")
@click.option("--kind", type=click.Choice(["classifier", "reader", "raw-reader", "wall-finder"]),
              default="classifier", show_default=True, help="What the network answers, and from what.")  # fmt: skip
@click.option(
    "--search", is_flag=True, help="Try every size of the grid (search_widths x search_depths), keep the best."
)
@options("study", "scheduler",
         study="Study file whose [network], [reader], [raw_reader] or [wall_finder], with what these are drawn from, "
         "to use; default: the data set's, the paper's.",
         scheduler="Dask scheduler whose workers train the sizes of --search, or draw the scenes of a wall "
         "finder.")  # fmt: skip
@click.pass_context
def train(
    ctx: click.Context,
    /,
    dataset_path: Path | None,
    out: Path,
    kind: str,
    search: bool,
    study: Study,
    scheduler: str | None,
) -> Report:
    """Train a network on DATASET, or on drawings alone.

    The classifier learns from a data set of `scleraforce generate`, the reader
    from a response library of `scleraforce library`. So does the raw reader,
    which sees raw frames of its walls: of the scanner that [phantom] in the
    study describes (`scleraforce scanner` measures one). The wall finder needs
    no DATASET: it draws the scenes that it learns from.

    Writes a model folder: model.onnx, study.toml, card.md and model.json with
    the curves of the training; a reader's has library.npz, too. The same data
    and study give the same weights on the same machine.

    Example: scleraforce train paper.zarr --out model

    Example: scleraforce train library.zarr --kind reader --out model

    Example: scleraforce train library.zarr --kind raw-reader --out raw

    Example: scleraforce train --kind wall-finder --out finder
    """
    section = kind.replace("-", "_")
    if scheduler is not None and not (search or kind == "wall-finder"):
        raise click.UsageError("--scheduler: for --search and --kind wall-finder; this training is one process's work")
    workers = chosen_workers(scheduler, None)
    if kind == "wall-finder" and dataset_path is not None:
        raise click.UsageError(f"{dataset_path}: --kind wall-finder draws its scenes; leave DATASET out")
    if kind != "wall-finder" and dataset_path is None:
        raise click.UsageError(f"--kind {kind}: DATASET is missing; only --kind wall-finder needs none")
    if search and kind != "classifier":
        raise click.UsageError(f"--search is for --kind classifier: a {kind} has the sizes of [{section}]")
    start = time.perf_counter()
    if dataset_path is None:
        result, lines = _train_wall_finder(study, out, workers)
    elif kind == "classifier":
        given = ctx.get_parameter_source("study") != ParameterSource.DEFAULT
        result, lines = _train_classifier(dataset_path, out, search, study.network if given else None, workers)
    else:
        result, lines = _train_reader(kind, dataset_path, out, study)
    seconds = time.perf_counter() - start
    lines = [line.replace(SECONDS, f"{seconds:.1f} s") for line in lines]
    return Report({"model": str(out), "kind": kind, **result, "seconds": seconds}, lines)


def _train_reader(kind: str, library_path: Path, out: Path, study: Study) -> Made:
    # Imported here: stores take longer to import than the help to print.
    import scleraforce as sf
    from scleraforce.notebook.training import train_on_library, train_on_raw_frames
    from scleraforce.study.unused import refuse_unused

    refuse_unused(study, f"train --kind {kind}")
    library = sf.open_library(library_path)
    if kind == "reader":
        of_slices = train_on_library(library, study, out, count_bar)
        metrics, learned = of_slices.metrics, {"epochs": of_slices.epochs, "samples": of_slices.samples}
    else:
        of_frames = train_on_raw_frames(library, study, out, count_bar)
        metrics, learned = of_frames.metrics, {"batches": of_frames.batches, "frames": of_frames.frames}
    result = {
        "validation_accuracy": metrics.accuracy,
        "validation_interval": metrics.interval,
        "mae_mn": from_si(metrics.mae_n, "mn"),
        "coverage": metrics.coverage,
        "lateral_mae_mm": from_si(metrics.lateral_mae_m, "mm"),
        **learned,
    }
    low, high = metrics.interval
    return result, [
        f"wrote {out}: {', '.join(f'{count} {name}' for name, count in learned.items())}, {SECONDS}",
        f"validation: force {from_si(metrics.mae_n, 'mn'):.2f} mN off, {metrics.coverage:.1%} within the 90 % interval",
        f"validation accuracy {metrics.accuracy:.2%} (95 % interval {low:.2%} to {high:.2%})",
    ]


def _train_wall_finder(study: Study, out: Path, workers: int | None) -> Made:
    # Imported here: PyTorch takes longer to import than the help to print.
    from scleraforce.learning.train import train_wall_finder

    with count_bar("batches", study.wall_finder.batches) as advance:
        trained = train_wall_finder(study, out, workers, advance)
    metrics = trained.metrics
    return {"batches": trained.batches, "scenes": trained.scenes, **vars(metrics)}, [
        f"wrote {out}: {trained.scenes} scenes in {trained.batches} batches, {SECONDS}",
        f"scenes that it never saw: Dice {metrics.dice_mean:.3f} in the mean, {metrics.dice_median:.3f} in the median; "
        f"{metrics.coverage:.1%} of the boundaries within 1.645 standard deviations",
    ]


def _train_classifier(
    dataset_path: Path, out: Path, search: bool, network: NetworkStudy | None, workers: int | None
) -> Made:
    # Imported here: stores take longer to import than the help to print.
    import scleraforce as sf
    from scleraforce.notebook.training import train_on_slices

    trained = train_on_slices(sf.open_dataset(dataset_path), network, out, count_bar, search=search, workers=workers)
    low, high = trained.validation_interval
    loss = trained.curves.validation_loss[-1]
    result = {
        "hidden": trained.network.hidden,
        "validation_accuracy": trained.validation_accuracy,
        "validation_interval": trained.validation_interval,
        "validation_loss": loss,
        "epochs": trained.network.epochs,
        "search": [vars(entry) for entry in trained.candidates],
    }
    return result, [
        *_table(trained),
        f"wrote {out}: hidden layers {_sizes(trained.network.hidden)}",
        f"{trained.network.epochs} epochs{' of each' if trained.candidates else ''}, {SECONDS}",
        f"validation accuracy {trained.validation_accuracy:.2%} (95 % interval {low:.2%} to {high:.2%}), "
        f"loss {loss:.4f}",
    ]


def _table(trained: "Trained") -> list[str]:
    """Return the grid search as a table; nothing where there was none."""
    if not trained.candidates:
        return []
    lines = [f"{'hidden layers':<24}{'weights':>12}{'validation accuracy':>22}{'loss':>10}"]
    for entry in trained.candidates:
        chosen = "  <" if entry.hidden == trained.network.hidden else ""
        reached = "diverged" if entry.validation_accuracy is None else f"{entry.validation_accuracy:.2%}"
        loss = "" if entry.validation_loss is None else f"{entry.validation_loss:.4f}"
        lines.append(f"{_sizes(entry.hidden):<24}{entry.weights:>12,}{reached:>22}{loss:>10}{chosen}")
    return lines


def _sizes(hidden: tuple[int, ...]) -> str:
    return "-".join(str(width) for width in hidden) or "none"
