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
from scleraforce.compiled import use_compiled_loops
from scleraforce.processes import available_cores
from scleraforce.study import Study, read_study
from scleraforce.study.unused import refuse_unused
from scleraforce.units import from_si

if TYPE_CHECKING:
    from scleraforce.reader.evaluation import Evaluation
    from scleraforce.reproduction.run import Progress


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
@click.option("--workers", type=click.IntRange(min=1), help="Processes; as many as there are cores by default.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def reproduce(out: Path, study_path: Path | None, workers: int | None, as_json: bool) -> None:
    """Run the whole pipeline and write OUT/report.html.

    Five virtual eyes in the paper's design (45 trials), the simulated slices,
    the network, its answers to the raw frames, and a page that shows them
    beside the paper's; then the same eyes computed at finite strain, read by
    the paper's method and by the force reader.

    Interrupted with Ctrl-C, the same command goes on. Results that other code
    has made, before an update, are not taken up: the command says so, and does
    all stages again. A folder of another study is refused.

    On a terminal each stage has a progress bar; anywhere else it is a line on
    standard error when it is done, with its time.

    Without --study it is the paper's study, its data set framed as the virtual
    laboratory frames its eyes; a study of your own is taken as it is.

    Example: scleraforce reproduce --out out/reproduce
    """
    # Imported here: mechanics and training take longer to import than the help to print.
    from scleraforce.reproduction.framing import framed_for_laboratory
    from scleraforce.reproduction.run import open_run
    from scleraforce.reproduction.stages import reproduce as reproduce_all

    study = framed_for_laboratory(Study()) if study_path is None else read_study(study_path)
    refuse_unused(study, "reproduce", file=study_path)
    use_compiled_loops()
    run = open_run(out, study, workers or available_cores())
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
        "on walls of finite strain: the force reader": found.bent_reader,
    }
    for words, one in others.items():
        say(f"{words} {one.accuracy.hits} of {one.accuracy.total}")
    say(_coverage_words(found.bent_reader))
    say(f"wrote {run.report} in {sum(seconds.values()):.0f} s")


def _metrics(evaluation: "Evaluation") -> dict[str, object]:
    answer = evaluation.as_json()
    return {key: answer[key] for key in ("accuracy", "confusion", "recall", "scored", "mae_mn", "coverage")}


def _true_metrics(evaluation: "Evaluation") -> dict[str, object]:
    """Return how far forces are from the true ones, and the share of these in their 90 % intervals."""
    from scleraforce.reader.metrics import coverage, coverage_by_eye, mean_absolute_error
    from scleraforce.reproduction.against_truth import against_truth, band_of

    true = against_truth(evaluation)
    return {
        "true_mae_mn": from_si(mean_absolute_error(true), "mn"),
        "true_coverage": coverage(true).value,
        "true_coverage_interval": band_of(true),
        "true_coverage_by_eye": {eye: one.value for eye, one in coverage_by_eye(true).items()},
    }


def _coverage_words(evaluation: "Evaluation") -> str:
    """Say how many forces the 90 % intervals hold: of the log, with its own error, and of the true ones."""
    from scleraforce.reader.metrics import coverage
    from scleraforce.reproduction.against_truth import against_truth, held_by_eye

    logged, trials = evaluation.coverage, against_truth(evaluation)
    true = coverage(trials)
    return (
        f"its 90 % intervals hold {logged.hits} of {logged.total} forces of the force log, which is noisy itself, and "
        f"{true.hits} of {true.total} true forces: {held_by_eye(trials)}"
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
