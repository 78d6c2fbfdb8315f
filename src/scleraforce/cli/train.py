"""`scleraforce train`: train a network on simulated slices, on a response library, or on drawn scenes."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scleraforce.cli.output import count_bar, print_json, say
from scleraforce.cli.place_of_work import chosen_workers
from scleraforce.study import Study, read_study
from scleraforce.study.unused import refuse_unused
from scleraforce.units import from_si

if TYPE_CHECKING:
    from scleraforce.learning.classifier.train import Trained


@click.command()
@click.argument("dataset_path", metavar="[DATASET]", required=False, type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Model folder to write; must not exist.")
@click.option("--kind", type=click.Choice(["classifier", "reader", "raw-reader", "wall-finder"]),
              default="classifier", show_default=True, help="What the network answers, and from what.")  # fmt: skip
@click.option(
    "--search", is_flag=True, help="Try every size of the grid (search_widths x search_depths), keep the best."
)
@click.option("--study", "study_path", type=click.Path(path_type=Path),
              help="Study file whose [network], [reader], [raw_reader] or [wall_finder], with what these are drawn "
                   "from, to use; default: the data set's, the paper's.")  # fmt: skip
@click.option("--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers train the sizes of --search, or "
              "draw the scenes of a wall finder.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def train(
    dataset_path: Path | None,
    out: Path,
    kind: str,
    search: bool,
    study_path: Path | None,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Train a network on DATASET, or on drawings alone.

    The classifier learns from a data set of `scleraforce generate`, the reader
    from a response library of `scleraforce library`. So does the raw reader,
    which sees raw frames of its walls: of the scanner that [phantom] in the
    study describes (`scleraforce scanner` measures one). The wall finder needs
    no DATASET: it learns from scenes that are drawn as it goes.

    Writes a model folder: model.onnx, study.toml, card.md and model.json with
    the curves of the training; a reader's has library.npz, too. The same data
    and study give the same weights on the same machine.

    Example: scleraforce train paper.zarr --out model

    Example: scleraforce train library.zarr --kind reader --out model

    Example: scleraforce train library.zarr --kind raw-reader --out raw

    Example: scleraforce train --kind wall-finder --out finder
    """
    if scheduler is not None and not (search or kind == "wall-finder"):
        raise click.UsageError("--scheduler: for --search and --kind wall-finder; this training is one process's work")
    workers = chosen_workers(scheduler, None)
    if kind == "wall-finder":
        if dataset_path is not None:
            raise click.UsageError(f"{dataset_path}: --kind wall-finder draws its scenes; leave DATASET out")
        _train_wall_finder(out, search, study_path, workers, as_json)
    elif dataset_path is None:
        raise click.UsageError(f"--kind {kind}: DATASET is missing; only --kind wall-finder needs none")
    elif kind in ("reader", "raw-reader"):
        _train_reader(kind, dataset_path, out, search, study_path, as_json)
    else:
        _train_classifier(dataset_path, out, search, study_path, workers, as_json)


def _train_reader(
    kind: str, library_path: Path, out: Path, search: bool, study_path: Path | None, as_json: bool
) -> None:
    start, section = time.perf_counter(), kind.replace("-", "_")
    if search:
        raise click.UsageError(f"--search is for --kind classifier: a {kind} has the sizes of [{section}]")
    study = Study() if study_path is None else read_study(study_path)
    refuse_unused(study, f"train --kind {kind}", file=study_path)
    # Imported here: stores take longer to import than the help to print.
    from scleraforce.library.store import open_library
    from scleraforce.notebook.work import train_on_library, train_on_raw_frames

    library = open_library(library_path)
    if kind == "reader":
        of_slices = train_on_library(library, study, out, count_bar)
        metrics, learned = of_slices.metrics, {"epochs": of_slices.epochs, "samples": of_slices.samples}
    else:
        of_frames = train_on_raw_frames(library, study, out, count_bar)
        metrics, learned = of_frames.metrics, {"batches": of_frames.batches, "frames": of_frames.frames}
    seconds = time.perf_counter() - start
    if as_json:
        print_json(
            {
                "model": str(out),
                "kind": kind,
                "validation_accuracy": metrics.accuracy,
                "validation_interval": metrics.interval,
                "mae_mn": from_si(metrics.mae_n, "mn"),
                "coverage": metrics.coverage,
                "lateral_mae_mm": from_si(metrics.lateral_mae_m, "mm"),
                **learned,
                "seconds": seconds,
            }
        )
        return
    low, high = metrics.interval
    say(
        f"wrote {out}: {', '.join(f'{count} {name}' for name, count in learned.items())}, {seconds:.1f} s\n"
        f"validation: force {from_si(metrics.mae_n, 'mn'):.2f} mN off, {metrics.coverage:.1%} within the 90 % "
        "interval\n"
        f"validation accuracy {metrics.accuracy:.2%} (95 % interval {low:.2%} to {high:.2%})"
    )


def _train_wall_finder(out: Path, search: bool, study_path: Path | None, workers: int | None, as_json: bool) -> None:
    start = time.perf_counter()
    if search:
        raise click.UsageError("--search is for --kind classifier: a wall finder has the sizes of [wall_finder]")
    study = Study() if study_path is None else read_study(study_path)
    # Imported here: PyTorch takes longer to import than the help to print.
    from scleraforce.learning.wall_finder.train import train_wall_finder

    with count_bar("batches", study.wall_finder.batches) as advance:
        trained = train_wall_finder(study, out, workers, advance)
    metrics, seconds = trained.metrics, time.perf_counter() - start
    if as_json:
        found = {"model": str(out), "kind": "wall-finder", "batches": trained.batches, "scenes": trained.scenes}
        print_json({**found, **vars(metrics), "seconds": seconds})
        return
    say(
        f"wrote {out}: {trained.scenes} scenes in {trained.batches} batches, {seconds:.1f} s\n"
        f"scenes that it never saw: Dice {metrics.dice_mean:.3f} in the mean, {metrics.dice_median:.3f} in the median; "
        f"{metrics.coverage:.1%} of the boundaries within 1.645 standard deviations"
    )


def _train_classifier(
    dataset_path: Path, out: Path, search: bool, study_path: Path | None, workers: int | None, as_json: bool
) -> None:
    start = time.perf_counter()
    # Imported here: stores take longer to import than the help to print.
    from scleraforce.dataset.store import open_dataset
    from scleraforce.notebook.work import train_on_slices

    dataset = open_dataset(dataset_path)
    network = None if study_path is None else read_study(study_path).network
    trained = train_on_slices(dataset, network, out, count_bar, search=search, workers=workers)
    seconds = time.perf_counter() - start
    if as_json:
        print_json(_result(trained, out, seconds))
    else:
        say("\n".join(_lines(trained, out, seconds)))


def _result(trained: "Trained", out: Path, seconds: float) -> dict[str, Any]:
    return {
        "model": str(out),
        "kind": "classifier",
        "hidden": trained.network.hidden,
        "validation_accuracy": trained.validation_accuracy,
        "validation_interval": trained.validation_interval,
        "validation_loss": trained.curves.validation_loss[-1],
        "epochs": trained.network.epochs,
        "seconds": seconds,
        "search": [vars(entry) for entry in trained.candidates],
    }


def _lines(trained: "Trained", out: Path, seconds: float) -> list[str]:
    low, high = trained.validation_interval
    return [
        *_table(trained),
        f"wrote {out}: hidden layers {_sizes(trained.network.hidden)}",
        f"{trained.network.epochs} epochs{' of each' if trained.candidates else ''}, {seconds:.1f} s",
        f"validation accuracy {trained.validation_accuracy:.2%} (95 % interval {low:.2%} to {high:.2%}), "
        f"loss {trained.curves.validation_loss[-1]:.4f}",
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
