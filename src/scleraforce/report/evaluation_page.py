"""Pages of an evaluation: all answers (the paper's Table 3 and Fig. 10), and a recording frame by frame."""

from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from importlib.resources import files
from math import isnan
from pathlib import Path
from typing import Any

from scleraforce.known import MODULUS_SOURCES
from scleraforce.reader.evaluate import Evaluation, FrameAnswer
from scleraforce.reader.metrics import SHARED_ERROR, mean_absolute_error
from scleraforce.recording.folder import read_recording
from scleraforce.report import html
from scleraforce.report.frame_figures import draw_read_forces, draw_trial_forces
from scleraforce.report.frames import WALL_COLOURS, AnsweredFrame, frame_pictures, shown_frames, wall_picture
from scleraforce.units import from_si

BROWSER_WIDTH = 560  # pixels of a picture
MOST_PICTURES = 1000  # what a browser opens at once: 40 MB
BROWSER = files("scleraforce.report").joinpath("browser")
KEYS = (
    "Left and right arrow: one frame; page up and down: ten; home and end: first and last; space: play. The curve "
    "shows all frames; click in it to go to one. Grey: the measured force. Dots with bars: the read force with "
    "its 90 % interval; a cross at the top: not usable."
)
NAMES_REMARK = (
    "Rows are targets, columns predictions; in brackets the 95 % Wilson interval. Recall is row-wise (of the trials of "
    "a class, how many were recognised), precision column-wise (of the answers of a class, how many were right); the "
    "paper's Table 3 has the two names the other way round."
)


def write_evaluation_html(
    evaluation: Evaluation, looks: Sequence[AnsweredFrame], path: Path, made_at: datetime
) -> None:
    """Write an evaluation as one self-contained page, with pictures of some frames; raises `InputError`."""
    limits = [html.section("What limits the result", html.bullets(evaluation.notes))] if evaluation.notes else []
    pictures = [frame_pictures(evaluation, looks)] if looks else []
    tables = [
        html.frame_table(evaluation, [frame for frame in evaluation.frames if frame.recording == name], name)
        for name in dict.fromkeys(frame.recording for frame in evaluation.frames)
    ]
    sections = [_result(evaluation), *limits, *pictures, html.section("Every frame", *tables)]
    title = "Forces of recordings" if evaluation.reads_force else "Force classes of recordings"
    html.write_page(html.page(title, _lead(evaluation), html.made_line(made_at), *sections), path)


def _lead(evaluation: Evaluation) -> str:
    if not evaluation.reads_force:
        modulus_mpa = from_si(evaluation.youngs_modulus_pa, "mpa")
        return f"Model {evaluation.model}, trained at a Young's modulus of {modulus_mpa:.3g} MPa."
    eyes = {frame.eye: (frame.youngs_modulus_pa, frame.modulus_source) for frame in evaluation.frames}
    moduli = (
        f"{eye}: not known"
        if modulus_pa is None
        else f"{eye}: {from_si(modulus_pa, 'mpa'):.3g} MPa ({MODULUS_SOURCES[str(source)]})"
        for eye, (modulus_pa, source) in eyes.items()
    )
    return f"Model {evaluation.model}. Young's modulus with which each eye was read: {', '.join(moduli)}."


def evaluation_cards(evaluation: Evaluation) -> html.Html:
    """Return the figures that matter most: accuracy, recall of the dangerous class, frames that could not be read."""
    low, high = evaluation.accuracy.interval
    danger = evaluation.recall[-1]
    unusable = [frame for frame in evaluation.frames if not frame.answer.usable]
    return html.cards(
        [
            (_percent(evaluation.accuracy.value), "accuracy", _of(evaluation.accuracy.hits, evaluation.accuracy.total)),
            (f"{_percent(low)} to {_percent(high)}", "95 % interval", "Wilson's"),
            (_percent(danger.value), "of the dangerous forces seen", _of(danger.hits, danger.total)),
            (str(len(unusable)), "frames not usable", f"of {len(evaluation.frames)}; each counts as class 2"),
            *_force_cards(evaluation),
        ]
    )


def _force_cards(evaluation: Evaluation) -> list[tuple[str, str, str]]:
    logged, true = evaluation.coverage, evaluation.true_coverage
    if not logged.total:
        return []
    error_n = mean_absolute_error(evaluation.true_forces) if true.total else evaluation.mae_n
    against = f"against truth.json, {true.total} trials" if true.total else f"{logged.total} usable trials"
    held = [(_percent(true.value), "of true forces in their 90 % interval", _of(true.hits, true.total))]
    agree = f"{_of(logged.hits, logged.total)}; labels sure to {from_si(evaluation.label_sd_n, 'mn'):.2f} mN"
    return [
        (f"{from_si(error_n, 'mn'):.2f} mN", "mean error of the force", against),
        *(held if true.total else []),
        (_percent(logged.value), "of labels agree with their 90 % interval", agree),
    ]


def read_forces_figure(evaluation: Evaluation) -> html.Html:
    """Return the read forces with their intervals over the measured ones."""
    caption = (
        "Read force with its 90 % interval over the measured force. Dashed: class bounds. Misread trials are ringed "
        "and named; unusable trials are at the upper edge and count as class 2."
    )
    return html.figure(draw_read_forces(evaluation), "read force of each trial over its measured force", caption)


def forces_figure(evaluation: Evaluation) -> html.Html:
    """Return the measured forces with the class bounds and the misread trials (Fig. 10)."""
    caption = (
        "Measured forces of the trials that count, and the class bounds (Fig. 10). Colour and marker say what was "
        "read; misread trials are ringed. Each trial has the name of its frame where there is room."
    )
    return html.figure(draw_trial_forces(evaluation), "measured force of each trial against the class bounds", caption)


def _result(evaluation: Evaluation) -> html.Html:
    if not evaluation.scored:
        return html.section("Result", html.paragraph("No frame has a label that counts, so there are no metrics."))
    confusion = html.confusion_table(evaluation.confusion, evaluation.bounds_n, NAMES_REMARK)
    words = html.paragraph(f"A label is given with the standard deviation of its error. {SHARED_ERROR}")
    forces = [words, read_forces_figure(evaluation)] if evaluation.forces else []
    return html.section("Result", evaluation_cards(evaluation), confusion, *forces, forces_figure(evaluation))


def _percent(value: float) -> str:
    return html.NOTHING if isnan(value) else f"{from_si(value, 'percent'):.0f} %"


def _of(hits: int, total: int) -> str:
    return f"{hits} of {total} trials"


def write_browser_html(
    evaluation: Evaluation, path: Path, made_at: datetime, progress: Callable[[int], object]
) -> None:
    """Write the page that browses one recording, with the wall that was read; `progress` counts frames."""
    name = evaluation.frames[0].recording
    data = {
        "classes": html.class_names(evaluation.bounds_n),
        "bounds_mn": [from_si(bound, "mn") for bound in evaluation.bounds_n],
        "frames": list(_frames(evaluation, progress)),
    }
    markup, script, style = (
        BROWSER.joinpath(f"browser.{kind}").read_text(encoding="utf-8") for kind in ("html", "js", "css")
    )
    limits = [html.section("What limits the readings", html.bullets(evaluation.notes))] if evaluation.notes else []
    content = html.page(
        f"Recording {evaluation.frames[0].eye}",
        f"{name}, read by {evaluation.model}.",
        html.made_line(made_at),
        html.Html(markup + html.embedded("frames", data)),
        html.section("How to read it", html.paragraph(KEYS), html.paragraph(WALL_COLOURS)),
        *limits,
        style=style,
        script=script,
    )
    html.write_page(content, path)


def _frames(evaluation: Evaluation, progress: Callable[[int], object]) -> Iterator[dict[str, Any]]:
    recording = read_recording(evaluation.frames[0].recording)
    pictured = {answer.file for answer in shown_frames(evaluation.frames, MOST_PICTURES)}
    for entry, answer in zip(recording.frames, evaluation.frames, strict=True):
        picture = None
        if entry.file in pictured:
            look = AnsweredFrame(answer, recording, recording.frame(entry))
            picture = wall_picture(look.frame, look.found, look.extent_m, BROWSER_WIDTH)
        yield {"time_s": entry.time_s, "picture": picture, **_answered(answer)}
        progress(1)


def _answered(answer: FrameAnswer) -> dict[str, Any]:
    return {
        "file": answer.file,
        "measured_mn": from_si(answer.measured_force_n, "mn"),
        "read_mn": from_si(answer.answer.force_n, "mn"),
        "interval_mn": answer.answer.interval_n and [from_si(end, "mn") for end in answer.answer.interval_n],
        "predicted": answer.answer.predicted,
        "target": answer.target,
        "usable": answer.answer.usable,
        "reason": answer.answer.reason,
        "remarks": [
            *answer.answer.warnings,
            *(["Young's modulus was calibrated on this frame"] if answer.calibration else []),
            *([f"left out of metrics: {answer.excluded}"] if answer.excluded else []),
        ],
    }
