"""`scleraforce calibrate` and `evaluate`: whole recordings with their force logs."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import scleraforce as sf
from scleraforce.base.units import from_si
from scleraforce.front.api.progress import Bars
from scleraforce.front.cli.options import MODEL, PATH, RelaxationOption, options
from scleraforce.front.cli.output import (
    Command,
    Report,
    count_bar,
    is_json,
    resumable_bar,
    say,
    worded,
    wrapped,
)
from scleraforce.records.model_folder import model_name
from scleraforce.records.remark import Remark, sentences
from scleraforce.records.study_of_eye import relaxation_terms

if TYPE_CHECKING:
    from scleraforce.calibration.evaluation import Evaluation, FrameAnswer
    from scleraforce.reading.interval_widths import IntervalStretch

# columns of a summary by eye
COLUMNS = (
    ("accuracy", 9),
    ("mae_mn", 9),
    ("coverage", 6),
    ("youngs_modulus_mpa", 7),
)
# frames of each recording for the eye's modulus, where the others are read
CALIBRATED = 3


def _names(
    _: click.Context, __: click.Parameter, value: str | None
) -> tuple[str, ...] | None:
    return (
        None
        if value is None
        else tuple(part.strip().lower() for part in value.split(","))
    )


def _say_note(words: str) -> None:
    if not is_json():
        say(wrapped(words, "note: "))


@click.command(cls=Command)
@click.argument(
    "recordings", metavar="RECORDING...", nargs=-1, required=True, type=PATH
)
@options("study")
@click.option("--out", type=PATH, required=True, help="File to write; must not exist.")
@click.option(
    "--frames",
    type=click.IntRange(1),
    help=(
        "Number of frames (of several planes: moments) to use of each recording, all"
        " above 5 mN: the one with the highest force, and others at even fractions of"
        " it; default: all."
    ),
)
@click.option(
    "--method",
    "estimator",
    type=click.Choice(["ours", "roukf"]),
    show_default="ours; linear mechanics: roukf",
    help=(
        "How E is found: by one fit of all frames and their forces, or by the paper's"
        " filter, which has linear mechanics."
    ),
)
@click.option(
    "--mechanics",
    type=click.Choice(["finite-strain", "linear"]),
    show_default="finite-strain; roukf: linear",
    help="Mechanics of the wall; linear is the paper's.",
)
@click.option(
    "--parameters",
    metavar="NAME,NAME,...",
    callback=_names,
    show_default="e,stiffening; linear: e",
    help="Parameters to estimate: e, and any of stiffening, iop, thickness, gap.",
)
@options("thickness_m", "wall_finder", default="the recordings'")
@click.option(
    "--relaxation",
    type=RelaxationOption(auto=True),
    metavar="none|auto|SHARE:SECONDS,...",
    help=(
        "How the tissue relaxes: the share of a held force that is lost, and its time"
        " constant; none: it is elastic; auto, the default: as the recording says, else"
        " by the log's holds and frames."
    ),
)
@click.option(
    "--without-force",
    is_flag=True,
    help=(
        "Find E by the shape of the dents beside the stated IOP, without a "
        "force log; with --frames, that many known forces count as well."
    ),
)
@options(
    "calibration",
    calibration=(
        "With --without-force: other eyes' calibration; their population is the prior"
        " of E."
    ),
)
@click.option(
    "--intervals",
    "model",
    type=MODEL,
    metavar="MODEL",
    help=(
        "Adapt the intervals of this reader (`default`, or the path of a folder) to"
        " these recordings; --out is the adapted copy."
    ),
)
@options("plot")
@click.pass_context
def calibrate(
    ctx: click.Context,
    /,
    recordings: tuple[Path, ...],
    out: Path,
    frames: int | None,
    wall_finder: Path | None,
    model: Path | None,
    plot: Path | None,
    relaxation: str | None,
    **given: Any,
) -> Report:
    """Estimate Young's modulus of each eye from its RECORDINGs.

    One fit lays simulated walls on all frames of an eye and compares their
    forces with the log's: the frames share E and the rigidity of the globe.
    The stiffening of the tissue is found by a search. The population's modulus
    is the mean of the eyes' means. --method roukf is the paper's filter, frame
    by frame, with linear mechanics. Finite strain needs a response library;
    for another study than the paper's it is computed once (a minute). Notes at
    the start name the quantities that a reader of the study would ignore.

    A force that falls in the holds of a log may be the tissue's doing or the
    needle's. Two frames of one hold decide; without them the intervals cover
    both. --relaxation declares it.

    Recordings that contradict their frames (clocks, another log, pictures
    upside down, a wrong scale or index) are refused with the likely cause, and
    nothing is written.

    With --without-force, one fit of all frames of an eye finds E by how its
    dents spread, from the IOP; needle travel (travel_m) and changed pressures
    (iop_pa) in frames.csv count as well. E is then sure to 10 to 20 %.

    With --intervals, each eye is calibrated on three of its frames (or on
    --frames); the reader reads the others, and its copy in --out has intervals
    that hold for 90 % of them.
    """
    if model is not None:
        default = click.core.ParameterSource.DEFAULT
        others = "only --frames, --wall-finder and --json"

        if any(
            ctx.get_parameter_source(name) != default
            for name in (*given, "plot", "relaxation")
        ):
            raise click.UsageError(
                f"--intervals: takes the model's own study; of the options, {others}"
            )

        # 440 ms: not for `evaluate` and --help
        from scleraforce.front.api.calibrating import recalibrate_intervals

        remarks = list[Remark]()

        def noted(remark: Remark) -> None:
            remarks.append(remark)
            _say_note(str(remark))

        found = recalibrate_intervals(
            model,
            recordings,
            out,
            count_bar,
            frames=frames or CALIBRATED,
            wall_finder=wall_finder,
            note=noted,
        )
        result = {
            "model": str(out),
            "from": model_name(model),
            "stretches": list(map(asdict, found)),
            **_of_remarks(remarks),
        }

        return Report(result, [*_stretches(found), f"wrote {out}"])

    # 330 ms: not for `evaluate` and --help
    from scleraforce.calibration.calibration import calibration_lines
    from scleraforce.front.api.calibrating import CalibrationMethod
    from scleraforce.records.eye import Eye
    from scleraforce.records.tissue_relaxation import Relaxation

    terms = None if relaxation in (None, "auto") else relaxation_terms(relaxation)
    eye = Eye(
        thickness_m=given.pop("thickness_m"),
        relaxation=None if terms is None else Relaxation.declared(terms),
    )
    study = given.pop("study")
    method = CalibrationMethod(
        wall_finder=wall_finder, prior=given.pop("calibration"), **given
    )
    calibration = sf.calibrate(
        recordings,
        study,
        out=out,
        frames=frames,
        method=method,
        eye=eye,
        note=_say_note,
        progress=Bars(count_bar),
    )

    if plot is not None:
        # 600 ms: Matplotlib, not without --plot
        from scleraforce.front.report.figure_files import write_figure
        from scleraforce.front.report.recording_figures import draw_calibration

        write_figure(draw_calibration(calibration), plot)

    lines = [*calibration_lines(calibration), f"wrote {out}"]
    notes = {"notes": list(sentences(calibration.of_inputs))}
    return Report({**calibration.to_dict(), **notes}, lines)


def _of_remarks(remarks: Sequence[Remark]) -> dict[str, Any]:
    """Return the keys of remarks in a command's JSON."""
    return {
        "notes": list(sentences(remarks)),
        "remarks": [remark.to_dict() for remark in remarks],
    }


def _stretches(changes: "Sequence[IntervalStretch]") -> Iterator[str]:
    # 300 ms: not for --help
    from scleraforce.reading.interval_widths import FEW_EYES

    yield (
        f"{'method':<9}{'modulus':<9}{'globe':<28}{'eyes':>5}{'readings':>10}"
        f"{'held':>7}{'factor':>8}"
    )
    for change in changes:
        yield (
            f"{change.method:<9}{change.modulus:<9}{', '.join(change.globes):<28}"
            f"{change.eyes:>5}{change.readings:>10}{change.held:>7.0%}"
            f"{change.factor:>8.2f}"
        )

    if min(change.eyes for change in changes) < FEW_EYES:
        yield (
            f"note: fewer than {FEW_EYES} eyes: the widest reading decides; no interval"
            " narrows"
        )


@click.command(cls=Command)
@click.argument("model", type=MODEL)
@click.argument(
    "recordings", metavar="RECORDING...", nargs=-1, required=True, type=PATH
)
@options(
    "calibration",
    "wall_finder",
    "html",
    calibration=(
        "File of `calibrate`: gives a reader the eyes' moduli; its frames are not"
        " scored."
    ),
)
@click.option(
    "--table",
    type=PATH,
    metavar="FILE",
    help=(
        "File to write with a row for each frame, .csv or .parquet, "
        "in place of the printed table; after Ctrl-C the same command completes it."
    ),
)
def evaluate(
    model: Path,
    recordings: tuple[Path, ...],
    calibration: Path | None,
    wall_finder: Path | None,
    html: Path | None,
    table: Path | None,
) -> Report:
    """Read every frame of RECORDINGs with MODEL and compare with the force log.

    MODEL is `default`, the bundled reader, or the path of a folder that
    `train` wrote: ./mine.

    Each label has the standard deviation of its error, from the noise, steps
    and drift of the force log. Intervals are compared with the labels,
    including that error, and for a virtual eye also with truth.json.

    Trials above the largest force of the model's study, and pierced ones, are
    listed and left out. A frame that cannot be judged counts as class 2. A
    model of kind "reader" uses an eye's own modulus if the calibration has it,
    otherwise the population's; a classifier knows one modulus only.

    With --table, RECORDINGs are read one by one and a summary by eye is
    printed. Recordings that have not changed are not read again, unless for
    --html; other files and folders among RECORDINGs are left out.
    """
    if table is not None:
        return _table(model, recordings, table, calibration, wall_finder, html)

    reader = sf.load_model(model, wall_finder=wall_finder)
    evaluation = sf.evaluate(reader, recordings, calibration, progress=Bars(count_bar))

    if html is not None:
        _write_html(evaluation, html)

    notes = (wrapped(note, "note: ") for note in evaluation.notes)
    parts = (
        "\n".join(part)
        for part in (
            _frames(evaluation),
            (f"model: {reader.words}",),
            _confusion(evaluation),
            _forces(evaluation),
            notes,
        )
    )

    return Report(evaluation.to_dict(), ["\n\n".join(filter(None, parts))])


def _write_html(evaluation: "Evaluation", html: Path) -> None:
    # 790 ms: Matplotlib, not without --html
    from scleraforce.front.report.evaluation_page import write_answers_page

    write_answers_page(evaluation, html, worded)


def _table(
    model: Path,
    recordings: tuple[Path, ...],
    table: Path,
    calibration: Path | None,
    wall_finder: Path | None,
    html: Path | None,
) -> Report:
    # 420 ms: not for `calibrate` and --help
    from scleraforce.front.api.evaluation_table import by_eye, evaluate_to_table

    bar = partial(resumable_bar, table, "recordings")
    batch = evaluate_to_table(
        model,
        recordings,
        table,
        calibration,
        wall_finder,
        bar,
        whole=html is not None,
    )
    if html is not None and batch.evaluation is not None:
        _write_html(batch.evaluation, html)

    eyes = by_eye(batch.rows)
    lines = [
        f"{'eye':<20}{'frames':>7}{'scored':>7}{'accuracy':>9}{'error/mN':>9}{'held':>6}{'E/MPa':>7}"
        "  from"
    ]

    for eye in eyes:
        figures = (
            f"{'-' if eye[name] is None else f'{eye[name]:.2f}':>{width}}"
            for name, width in COLUMNS
        )
        lines.append(
            f"{eye['eye']:<20}{eye['frames']:>7}{eye['scored']:>7}{''.join(figures)} "
            f" {eye['modulus_source']}"
        )

    wrote = (
        f"wrote {table}: {len(batch.rows)} frames; recordings read now: {batch.read} of"
        f" {batch.recordings}"
    )
    notes = [wrapped(note, "note: ") for note in batch.notes]
    result = {
        "table": str(table),
        "recordings": batch.recordings,
        "read": batch.read,
        "frames": len(batch.rows),
    }

    of_remarks = _of_remarks(batch.remarks)
    return Report({**result, "eyes": eyes, **of_remarks}, [*lines, *notes, wrote])


def _frames(evaluation: "Evaluation") -> Iterator[str]:
    for recording in dict.fromkeys(frame.recording for frame in evaluation.frames):
        read = f"{'read/mN':>9}{'90 %':>14}" if evaluation.reads_force else "  remark"
        yield recording
        yield f"  {'frame':<16}{'force/mN':>12}{'target':>7}{'read':>5}{'p':>7}{read}"
        for frame in evaluation.frames:
            if frame.recording == recording:
                yield from _frame(frame, evaluation.reads_force)


def _frame(frame: "FrameAnswer", with_force: bool) -> Iterator[str]:
    force = (
        "-"
        if frame.measured_force_n is None
        else f"{from_si(frame.measured_force_n, 'mn'):.1f}"
    )
    force += (
        ""
        if frame.measured_force_sd_n is None
        else f" ± {from_si(frame.measured_force_sd_n, 'mn'):.1f}"
    )
    target = "-" if frame.target is None else str(frame.target)
    answer = frame.answer
    share = "-" if answer.probabilities is None else f"{max(answer.probabilities):.3f}"
    figures = f"  {frame.file:<16}{force:>12}{target:>7}{answer.predicted:>5}{share:>7}"
    remarks = [
        "misread" if frame.scored and frame.misread else "",
        "" if answer.usable else f"not usable: {answer.reason}",
        f"left out: {frame.excluded}" if frame.excluded else "",
        "left out: calibrated on" if frame.calibration else "",
        *answer.warnings,
    ]
    remark = "; ".join(filter(None, remarks))

    if not with_force:
        yield wrapped(remark, f"{figures}  ")
        return

    if answer.force_n is None or answer.interval_n is None:
        yield f"{figures}{'-':>9}{'-':>14}"
    else:
        low, high = (from_si(end, "mn") for end in answer.interval_n)
        interval = f"{low:.1f} to {high:.1f}"
        yield f"{figures}{from_si(answer.force_n, 'mn'):>9.1f}{interval:>14}"

    if remark:
        yield wrapped(remark, "    ")


def _confusion(evaluation: "Evaluation") -> Iterator[str]:
    """Yield Table 3: rows are targets, with recall; columns are answers, with
    precision.
    """
    if not evaluation.scored:
        yield "no frame has a label that counts: no metrics"
        return

    classes = range(len(evaluation.confusion))
    yield (
        "target \\ read"
        + "".join(f"{label:>8}" for label in classes)
        + "   recall (95 % interval)"
    )

    for label, row, share in zip(
        classes, evaluation.confusion, evaluation.recall, strict=True
    ):
        yield (
            f"class {label:<7}"
            + "".join(f"{count:>8}" for count in row)
            + f"   {share.words()}"
        )

    precisions = (
        f"{share.value:.2f}" if share.total else "-" for share in evaluation.precision
    )
    yield "precision    " + "".join(f"{share:>8}" for share in precisions)
    total = evaluation.accuracy
    usable = evaluation.usable.accuracy
    yield f"accuracy      {total.words()}: {total.hits} of {total.total}"

    if usable.total < total.total:
        yield f"  usable only {usable.words()}: {usable.hits} of {usable.total}"


def _forces(evaluation: "Evaluation") -> Iterator[str]:
    """Yield the error of the forces and the coverage of their intervals
    (`ForceTrial.covered`).
    """
    # 4 ms: not for --help
    from scleraforce.calibration.answer_metrics import (
        SHARED_ERROR,
        held_by_eye,
        mean_absolute_error,
    )

    if not evaluation.forces:
        return

    logged = evaluation.coverage
    true = evaluation.true_coverage
    sd_mn = from_si(evaluation.label_sd_n, "mn")
    yield (
        f"force error   {from_si(evaluation.mae_n, 'mn'):.2f} mN in the mean,"
        f" {logged.total} usable frames"
    )
    yield (
        f"              against labels that are sure to {sd_mn:.2f} mN (standard"
        " deviation)"
    )

    if true.total:
        true_mn = from_si(mean_absolute_error(evaluation.true_forces), "mn")
        yield f"              {true_mn:.2f} mN against the true forces of truth.json"
        yield (
            f"90 % interval holds the true force in {true.words()}: {true.hits} of"
            f" {true.total}"
        )

    yield (
        f"90 % interval and label agree in {logged.words()}: {logged.hits} of"
        f" {logged.total}"
    )
    compared = evaluation.true_forces or evaluation.forces
    if len({trial.eye for trial in compared}) > 1:
        yield wrapped(held_by_eye(compared), "  by eye: ")

    yield wrapped(SHARED_ERROR)
