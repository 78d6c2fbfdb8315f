"""`scleraforce reproduce`: the whole pipeline, to an HTML report."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from scleraforce.cli.output import print_json, progress_bar, say
from scleraforce.models import model_name
from scleraforce.processes import available_cores
from scleraforce.study import Study, read_study
from scleraforce.study.unused import refuse_unused
from scleraforce.units import from_si

if TYPE_CHECKING:
    from scleraforce.reader.evaluate import Evaluation
    from scleraforce.reproduction.run import Progress, Run


@click.command()
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, help="Folder of all results; new, or a former run's."
)
@click.option(
    "--study",
    "study_path",
    type=click.Path(path_type=Path),
    help="Study file; by default the paper's, with framing ranges.",
)
@click.option(
    "--train", is_flag=True, help="Train the force reader, in place of the bundled one (10 to 30 minutes more)."
)
@click.option("--workers", type=click.IntRange(min=1), help="Processes; as many as there are cores by default.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def reproduce(out: Path, study_path: Path | None, train: bool, workers: int | None, as_json: bool) -> None:
    """Run the whole pipeline and write OUT/report.html.

    Five virtual eyes in the paper's design (45 trials), the simulated slices,
    the paper's classifier trained on them, its answers to the raw frames, and a
    page that shows them beside the paper's; then the same eyes computed at
    finite strain, read by the paper's method and by the force reader.

    The force reader and its library are the bundled ones. --train makes both
    for this study; a study for another eye, needle or slice, or with other
    classes, needs it.

    After Ctrl-C, the same command continues. Results from other versions of the
    code are not reused: the command says so, and repeats all stages. A folder
    of another study is refused. With and without --train share a folder.

    On a terminal each stage has a progress bar; in a pipe, one line on standard
    error when it is done, with its time.

    By default the study is the paper's, with framing ranges of the virtual
    laboratory; your own study is used unchanged.

    Example: scleraforce reproduce --out out/reproduce
    """
    # Imported here: mechanics and training take longer to import than the help to print.
    from scleraforce.reproduction.run import framed_for_laboratory, open_run
    from scleraforce.reproduction.stages import reproduce as reproduce_all

    study = framed_for_laboratory(Study()) if study_path is None else read_study(study_path)
    refuse_unused(study, "reproduce", file=study_path)
    run = open_run(out, study, workers or available_cores(), train=train, study_file=study_path)
    say(f"reads walls of finite strain with {_reader_words(run)}", err=True)
    found = reproduce_all(run, _stage, datetime.now(UTC), lambda line: say(line, err=True))
    evaluation, seconds = found.evaluation, found.seconds
    mean_pa, spread_pa = found.calibration.population
    answer = evaluation.as_json()
    result = {
        "report": str(run.report),
        **{key: answer[key] for key in ("accuracy", "confusion", "recall", "precision", "intervals", "scored")},
        "to_the_bounds": {key: found.to_the_bounds.as_json()[key] for key in ("accuracy", "confusion", "scored")},
        "youngs_modulus_mpa": {"mean_mpa": from_si(mean_pa, "mpa"), "sd_mpa": from_si(spread_pa, "mpa")},
        "finite_strain": {
            "paper": _metrics(found.bent_paper),
            "reader": _metrics(found.bent_reader) | _true_metrics(found.bent_reader),
        },
        "reader": {"model": model_name(run.reader), "trained": run.train},
        "seconds": seconds | {"total": round(sum(seconds.values()), 2)},
    }
    if as_json:
        print_json(result)
        return
    say(f"Young's modulus {from_si(mean_pa, 'mpa'):.3f} MPa, mean of {len(found.calibration.eyes)} virtual eyes")
    right, total = evaluation.accuracy.hits, evaluation.accuracy.total
    say(f"{right} of {total} simulated trials read right ({from_si(evaluation.accuracy.value, 'percent'):.0f} %)")
    others = {
        "with forces up to the bounds of the classes": found.to_the_bounds,
        "on walls of finite strain: the paper's method": found.bent_paper,
        f"on walls of finite strain: {_reader_words(run)}": found.bent_reader,
    }
    for words, one in others.items():
        say(f"{words} {one.accuracy.hits} of {one.accuracy.total}")
    say(_coverage_words(found.bent_reader))
    say(f"wrote {run.report} in {sum(seconds.values()):.0f} s")


def _reader_words(run: "Run") -> str:
    """Name the force reader: the run's own, or the bundled one."""
    if run.train:
        return "a reader that this run trains"
    return f"the bundled reader, {model_name(run.reader)!r} (--train trains one)"


def _metrics(evaluation: "Evaluation") -> dict[str, object]:
    answer = evaluation.as_json()
    return {key: answer[key] for key in ("accuracy", "confusion", "recall", "scored", "mae_mn", "coverage")}


def _true_metrics(evaluation: "Evaluation") -> dict[str, object]:
    """Return how far forces are from the true ones, and the share of these in their 90 % intervals."""
    from scleraforce.reader.metrics import band_of, coverage, coverage_by_eye, mean_absolute_error

    true = evaluation.true_forces
    return {
        "true_mae_mn": from_si(mean_absolute_error(true), "mn"),
        "true_coverage": coverage(true).value,
        "true_coverage_interval": band_of(true),
        "true_coverage_by_eye": {eye: one.value for eye, one in coverage_by_eye(true).items()},
    }


def _coverage_words(evaluation: "Evaluation") -> str:
    """Say how many forces the 90 % intervals hold: of the log, with its own error, and of the true ones."""
    from scleraforce.reader.metrics import SHARED_ERROR, held_by_eye

    logged, true = evaluation.coverage, evaluation.true_coverage
    return (
        f"its 90 % intervals hold {true.hits} of {true.total} true forces: {held_by_eye(evaluation.true_forces)}; they "
        f"agree with {logged.hits} of {logged.total} labels of the force log, the labels' own error counted. "
        f"{SHARED_ERROR}"
    )


@contextmanager
def _stage(title: str, length: int) -> "Iterator[Progress]":
    """Show a stage: a progress bar on a terminal, a line with its time when it is done anywhere else."""
    start = time.perf_counter()
    with progress_bar(range(length), title, total=length) as bar:

        def advance(steps: int) -> None:
            bar.update(steps)

        yield advance
    if not sys.stderr.isatty():
        say(f"{title}: {time.perf_counter() - start:.1f} s", err=True)
