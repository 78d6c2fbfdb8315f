"""`scleraforce demo`, `doctor`, `init`, `cite` and `reproduce`: a first session."""

import platform
import sys
import time
from dataclasses import asdict
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scleraforce.base.errors import StudyError
from scleraforce.base.units import from_si
from scleraforce.base.version import __version__
from scleraforce.front.cli.options import PATH, STUDY_FILE, options
from scleraforce.front.cli.output import (
    Command,
    Report,
    count_bar,
    progress_bar,
    say,
    share_bar,
    wrapped,
)
from scleraforce.records.model_folder import model_name
from scleraforce.records.study import PRESETS, Study, preset_toml, refuse_unused

if TYPE_CHECKING:
    from scleraforce.calibration.evaluation import Evaluation

REMEDY = " " * 25 + "-> "
BIBTEX = f"""\
@software{{scleraforce,
  title = {{scleraforce: the force of a needle on the eye,
           read from a single {{OCT}} slice}},
  author = {{{{The scleraforce authors}}}},
  version = {{{__version__}}},
  license = {{BSD-3-Clause}}
}}

@article{{mendizabal2020force,
  title = {{Force classification during robotic interventions
           through simulation-trained neural networks}},
  author = {{Mendizabal, Andrea and Sznitman, Raphael and Cotin, Stephane}},
  journal = {{International Journal of Computer Assisted Radiology
             and Surgery}},
  year = {{2020}}
}}"""


@click.command(cls=Command)
@click.option(
    "--out",
    type=PATH,
    default=Path("scleraforce-demo"),
    show_default=True,
    help="Folder to make; must not exist.",
)
@click.option("--open", "open_page", is_flag=True, help="Open the page in the browser.")
def demo(out: Path, open_page: bool) -> Report:
    """Simulate a small session, read it with the bundled reader, write a page.

    A virtual eye is pushed twelve times (finite strain), imaged, and calibrated
    on three of its frames; the reader `default` reads the others. The folder
    has the recording, the calibration and the page. It takes about ten seconds.
    """
    start = time.perf_counter()
    # 980 ms: the whole pipeline, not for `init`, `cite` and --help
    from scleraforce.calibration.answer_metrics import mean_absolute_error
    from scleraforce.front.paper.demo import SETUP, run_demo

    with share_bar("demo") as reach:
        done = run_demo(out, datetime.now(UTC), reach)

    evaluation = done.evaluation
    true_mpa = from_si(SETUP.eye.modulus_pa, "mpa")
    found_mpa = from_si(done.modulus_pa, "mpa")
    frames = len(evaluation.frames)
    read = evaluation.accuracy.total
    result = {
        "page": str(done.page),
        "recording": str(done.recording),
        "calibration": str(done.calibration),
        "youngs_modulus_mpa": {"true": true_mpa, "found": found_mpa},
        "frames": frames,
        "read": read,
        "right": evaluation.accuracy.hits,
        "mae_mn": from_si(mean_absolute_error(evaluation.true_forces), "mn"),
        "intervals_hold": evaluation.true_coverage.hits,
        "seconds": time.perf_counter() - start,
    }

    if open_page:
        click.launch(str(done.page))

    lines = [
        "research use only: not a medical device",
        (
            f"wrote {done.recording}: a virtual eye of {true_mpa:.2f} MPa, pushed"
            f" {frames} times"
        ),
        f"calibrated on {frames - read} frames: {found_mpa:.2f} MPa",
        (
            f"read the other {read}: {result['right']} in the right class, mean error"
            f" {result['mae_mn']:.2f} mN,"
        ),
        f"  {result['intervals_hold']} of their 90 % intervals hold the true force",
        f"{result['seconds']:.0f} s; the page: {done.page}",
    ]
    return Report(result, lines)


@click.command(cls=Command)
def doctor() -> Report:
    """Check this installation: packages, machine, and three small runs.

    A load path is solved, a frame read and a reader trained, ten seconds in
    all. A `missing` package is optional; the line below it says how to get it.
    If anything has `failed`, the exit code is 1.
    """
    start = time.perf_counter()
    # 500 ms: Numba and SciPy, not for `init`, `cite` and --help
    from scleraforce.front.cli.installation_checks import (
        TRIALS,
        machine,
        packages,
        tried,
    )

    found = [
        *packages(),
        *machine(),
        *(tried(name) for name in progress_bar(TRIALS, "trials", total=len(TRIALS))),
    ]
    python = platform.python_version()
    system = f"{platform.system()} {platform.machine()}"
    ok = all(finding.state != "failed" for finding in found)
    result = {"scleraforce": __version__, "python": python, "system": system, "ok": ok}
    result |= {
        "findings": [asdict(finding) for finding in found],
        "seconds": time.perf_counter() - start,
    }
    lines = [f"scleraforce {__version__}, Python {python}, {system}"]

    for one in found:
        lines.append(wrapped(one.found, f"{one.state:<8} {one.name:<15} "))
        lines += [wrapped(one.remedy, REMEDY)] if one.remedy else []

    return Report(result, lines, code=0 if ok else 1)


@click.command(cls=Command)
def cite() -> Report:
    """Print BibTeX entries of this software and of the paper whose method it has."""
    return Report({"bibtex": BIBTEX}, BIBTEX.splitlines())


@click.command(cls=Command)
@click.argument("directory", type=PATH)
@click.option(
    "--preset",
    type=click.Choice(PRESETS),
    default=PRESETS[0],
    show_default=True,
    help="Study to start from: the paper's, or living pressure and stiffness.",
)
def init(directory: Path, preset: str) -> Report:
    """Write DIRECTORY/study.toml, the paper's study or another preset, with
    comments.
    """
    path = directory / "study.toml"
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8") as file:
            file.write(preset_toml(preset))
    except FileExistsError as fault:
        raise StudyError(
            f"{path}: exists already; remove it or choose another directory"
        ) from fault

    return Report({"path": str(path), "preset": preset}, [f"wrote {path}"])


@click.command(cls=Command)
@click.option(
    "--out",
    type=PATH,
    required=True,
    help="Folder of all results: a new one, or that of an interrupted run.",
)
@options("study", study="Study file; default: the paper's study, with framing ranges.")
@click.option(
    "--train",
    is_flag=True,
    help="Train the force reader (10 to 30 minutes more); default: the bundled one.",
)
@options("workers")
@click.pass_context
def reproduce(
    ctx: click.Context, /, out: Path, study: Study, train: bool, workers: int | None
) -> Report:
    """Run the whole pipeline and write OUT/report.html.

    It simulates five virtual eyes in the paper's design (45 trials) and slices,
    trains the paper's classifier on the slices, reads the raw frames with it,
    and compares the answers with the paper's. Then it computes the same eyes at
    finite strain, and reads them with the paper's method and the force reader.

    By default, the force reader and its library are the bundled ones. --train
    makes both for this study; a study with another eye, needle or slice, or
    with other classes, needs it.

    After Ctrl-C, the same command continues. Results from other versions of the
    code are not reused: the command says so, and repeats all stages. A folder
    of another study is refused. Runs with and without --train can share a
    folder.

    With two processes or more, some stages are done at the same time. On a
    terminal each stage has a progress bar; in a pipe, one line on standard
    error when it is done, with its time.

    By default the study is the paper's, with framing ranges of the virtual
    laboratory; your own study is used unchanged.

    Example: scleraforce reproduce --out out/reproduce
    """
    # 2,400 ms: PyTorch and Matplotlib, not for `init`, `cite` and --help
    from scleraforce.base.worker_processes import available_cores
    from scleraforce.calibration.answer_metrics import (
        SHARED_ERROR,
        band_of,
        held_by_eye,
    )
    from scleraforce.front.paper.run_folder import framed_for_laboratory, open_run
    from scleraforce.front.paper.stages import reproduce as run_stages

    file = ctx.meta.get(STUDY_FILE)
    refuse_unused(study, "reproduce")
    study = framed_for_laboratory(study) if file is None else study
    run = open_run(out, study, workers or available_cores(), train=train)
    bundled = f"the bundled reader, {model_name(run.reader)!r} (--train trains one)"
    reader = "a reader that this run trains" if train else bundled
    say(f"reads walls of finite strain with {reader}", err=True)
    tell = partial(say, err=True)
    start = time.perf_counter()
    found = run_stages(
        run,
        count_bar,
        datetime.now(UTC),
        tell,
        # a terminal has shown bars
        note=(lambda _: None) if sys.stderr.isatty() else tell,
    )
    seconds = time.perf_counter() - start
    evaluation = found.evaluation
    others = found.to_the_bounds
    bent = found.bent_reader
    mean_pa, spread_pa = found.calibration.population
    result = {
        "report": str(run.report),
        **_metrics(
            evaluation,
            "accuracy",
            "confusion",
            "recall",
            "precision",
            "intervals",
            "scored",
        ),
        "to_the_bounds": _metrics(others, "accuracy", "confusion", "scored"),
        "youngs_modulus_mpa": {
            "mean_mpa": from_si(mean_pa, "mpa"),
            "sd_mpa": from_si(spread_pa, "mpa"),
        },
        "finite_strain": {
            "paper": _metrics(found.bent_paper, *FORCES),
            "reader": (
                _metrics(bent, *FORCES, *TRUE)
                | {"true_coverage_interval": band_of(bent.true_forces)}
            ),
        },
        "reader": {"model": model_name(run.reader), "trained": train},
        "seconds": found.seconds | {"total": round(seconds, 2)},
    }
    accuracy = evaluation.accuracy
    logged = bent.coverage
    true = bent.true_coverage
    counted = {
        "with forces up to the bounds of the classes": others,
        "on walls of finite strain: the paper's method": found.bent_paper,
        f"on walls of finite strain: {reader}": bent,
    }

    return Report(
        result,
        [
            (
                f"Young's modulus {from_si(mean_pa, 'mpa'):.3f} MPa, mean of"
                f" {len(found.calibration.eyes)} virtual eyes"
            ),
            (
                f"{accuracy.hits} of {accuracy.total} simulated trials read right "
                f"({from_si(accuracy.value, 'percent'):.0f} %)"
            ),
            *(
                f"{words} {one.accuracy.hits} of {one.accuracy.total}"
                for words, one in counted.items()
            ),
            (
                f"its 90 % intervals hold {true.hits} of {true.total} true forces:"
                f" {held_by_eye(bent.true_forces)}; they agree with {logged.hits} of"
                f" {logged.total} labels of the force log, the labels' own error"
                f" counted. {SHARED_ERROR}"
            ),
            f"wrote {run.report} in {seconds:.0f} s",
        ],
    )


FORCES = ("accuracy", "confusion", "recall", "scored", "mae_mn", "coverage")
TRUE = ("true_mae_mn", "true_coverage", "true_coverage_by_eye")


def _metrics(evaluation: "Evaluation", *keys: str) -> dict[str, Any]:
    answer = evaluation.to_dict()
    return {key: answer[key] for key in keys}
