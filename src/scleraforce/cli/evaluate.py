"""`scleraforce evaluate`: a model's answers beside the force logs of recordings."""

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from scleraforce.cli.options import PATH, options
from scleraforce.cli.output import Command, Report, count_bar, refuse_existing
from scleraforce.plain_text import wrapped
from scleraforce.units import from_si

if TYPE_CHECKING:
    from scleraforce.reader.evaluate import Evaluation, FrameAnswer
    from scleraforce.reader.metrics import Proportion


@click.command(cls=Command)
@click.argument("model", type=PATH)
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True, type=PATH)
@options("calibration", "finder", "html",
         calibration="File of `calibrate`: gives a reader the eyes' moduli; its frames are not scored.")  # fmt: skip
def evaluate(
    model: Path, recordings: tuple[Path, ...], calibration: Path | None, finder: Path | None, html: Path | None
) -> Report:
    """Read every frame of RECORDINGs with MODEL and compare with the force log.

    MODEL is a folder that `train` wrote, or `default`, the bundled reader.

    A label is given with the standard deviation of its error, by the log's own
    noise, steps and drift. Intervals are held against labels with that error,
    and against truth.json where the eye is a virtual one.

    Trials over the largest force of the model's study, and pierced ones, are
    listed and left out. A frame that cannot be judged counts as class 2. A
    model of kind "reader" reads an eye that the calibration knows with its own
    modulus, others with the population's; a classifier knows one modulus only.
    """
    import scleraforce as sf

    refuse_existing(html)
    reader = sf.load_model(model, wall_finder=finder)
    evaluation = sf.evaluate(reader, recordings, calibration, counting=count_bar)
    if html is not None:
        from scleraforce.report.evaluation_page import write_evaluation_html
        from scleraforce.report.frames import look_at_all, shown_frames

        looks = look_at_all(shown_frames(evaluation.frames))
        write_evaluation_html(evaluation, looks, html, datetime.now(UTC))
    parts = (_frames, _confusion, _forces, _notes)
    return Report(
        evaluation.as_json(), ["\n\n".join("\n".join(lines) for part in parts if (lines := part(evaluation)))]
    )


def _frames(evaluation: "Evaluation") -> list[str]:
    """Return a table of all frames, recording by recording."""
    lines = []
    for recording in dict.fromkeys(frame.recording for frame in evaluation.frames):
        read = f"{'read/mN':>9}{'90 %':>14}" if evaluation.reads_force else ""
        lines += [recording, f"  {'frame':<16}{'force/mN':>12}{'target':>7}{'read':>5}{'p':>7}{read or '  remark'}"]
        lines += [_frame(frame, bool(read)) for frame in evaluation.frames if frame.recording == recording]
    return lines


def _frame(frame: "FrameAnswer", with_force: bool) -> str:
    force = "-" if frame.measured_force_n is None else f"{from_si(frame.measured_force_n, 'mn'):.1f}"
    force += "" if frame.measured_force_sd_n is None else f" ± {from_si(frame.measured_force_sd_n, 'mn'):.1f}"
    target = "-" if frame.target is None else str(frame.target)
    share = "-" if frame.answer.probabilities is None else f"{max(frame.answer.probabilities):.3f}"
    figures = f"  {frame.file:<16}{force:>12}{target:>7}{frame.answer.predicted:>5}{share:>7}"
    if not with_force:
        return wrapped(_remark(frame), f"{figures}  ")
    lines = [f"{figures}{_read_force(frame)}"]
    return "\n".join(lines + [wrapped(remark, "    ") for remark in [_remark(frame)] if remark])


def _read_force(frame: "FrameAnswer") -> str:
    if frame.answer.force_n is None or frame.answer.interval_n is None:
        return f"{'-':>9}{'-':>14}"
    low, high = (from_si(end, "mn") for end in frame.answer.interval_n)
    return f"{from_si(frame.answer.force_n, 'mn'):>9.1f}{f'{low:.1f} to {high:.1f}':>14}"


def _remark(frame: "FrameAnswer") -> str:
    remarks = [
        "misread" if frame.scored and frame.misread else "",
        "" if frame.answer.usable else f"not usable: {frame.answer.reason}",
        f"left out: {frame.excluded}" if frame.excluded else "",
        "left out: calibrated on" if frame.calibration else "",
        *frame.answer.warnings,
    ]
    return "; ".join(remark for remark in remarks if remark)


def _confusion(evaluation: "Evaluation") -> list[str]:
    """Return Table 3: rows are targets, with recall; columns are answers, with precision."""
    if not evaluation.scored:
        return ["no frame has a label that counts: no metrics"]
    classes = range(len(evaluation.confusion))
    lines = ["target \\ read" + "".join(f"{label:>8}" for label in classes) + "   recall (95 % interval)"]
    for label, row, share in zip(classes, evaluation.confusion, evaluation.recall, strict=True):
        lines.append(f"class {label:<7}" + "".join(f"{count:>8}" for count in row) + f"   {_share(share)}")
    lines.append("precision    " + "".join(f"{_value(share):>8}" for share in evaluation.precision))
    total = evaluation.accuracy
    lines.append(f"accuracy      {_share(total)}: {total.hits} of {total.total}")
    usable = evaluation.usable.accuracy
    if usable.total < total.total:
        lines.append(f"  usable only {_share(usable)}: {usable.hits} of {usable.total}")
    return lines


def _forces(evaluation: "Evaluation") -> list[str]:
    """Return how far the forces are off, and how the intervals did; nothing where none was read.

    Interval and label agree where their difference is within both errors at 90 % (`ForceTrial.covered`).
    """
    from scleraforce.reader.metrics import SHARED_ERROR, held_by_eye, mean_absolute_error

    if not evaluation.forces:
        return []
    logged, true, sd_mn = evaluation.coverage, evaluation.true_coverage, from_si(evaluation.label_sd_n, "mn")
    lines = [
        f"force error   {from_si(evaluation.mae_n, 'mn'):.2f} mN in the mean, {logged.total} usable frames",
        f"              against labels that are sure to {sd_mn:.2f} mN (standard deviation)",
    ]
    if true.total:
        true_mn = from_si(mean_absolute_error(evaluation.true_forces), "mn")
        lines += [
            f"              {true_mn:.2f} mN against the true forces of truth.json",
            f"90 % interval holds the true force in {_share(true)}: {true.hits} of {true.total}",
        ]
    lines.append(f"90 % interval and label agree in {_share(logged)}: {logged.hits} of {logged.total}")
    compared = evaluation.true_forces or evaluation.forces
    if len({trial.eye for trial in compared}) > 1:
        lines.append(wrapped(held_by_eye(compared), "  by eye: "))
    return [*lines, wrapped(SHARED_ERROR)]


def _value(share: "Proportion") -> str:
    return f"{share.value:.2f}" if share.total else "-"


def _share(share: "Proportion") -> str:
    low, high = share.interval
    return f"{share.value:.2f} ({low:.2f} to {high:.2f})" if share.total else "-"


def _notes(evaluation: "Evaluation") -> list[str]:
    return [wrapped(note, "note: ") for note in evaluation.notes]
