"""The page of an evaluation: all answers (the paper's Table 3 and Fig. 10)."""

import base64
from collections.abc import Sequence
from datetime import datetime
from math import isnan
from pathlib import Path

import cv2

from scleraforce.known import MODULUS_SOURCES
from scleraforce.reader.evaluate import Evaluation, FrameAnswer
from scleraforce.reader.metrics import SHARED_ERROR, Proportion, mean_absolute_error
from scleraforce.report import html
from scleraforce.report.files import evenly
from scleraforce.report.frame_figures import WIDTH, AnsweredFrame, draw_read_forces, draw_trial_forces
from scleraforce.segmentation.found import draw_overlay
from scleraforce.units import from_si

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
    cards = [
        (_percent(evaluation.accuracy.value), "accuracy", _of(evaluation.accuracy)),
        (f"{_percent(low)} to {_percent(high)}", "95 % interval", "Wilson's"),
        (_percent(danger.value), "of the dangerous forces seen", _of(danger)),
        (str(len(unusable)), "frames not usable", f"of {len(evaluation.frames)}; each counts as class 2"),
    ]
    return html.cards([*cards, *_force_cards(evaluation)])


def _force_cards(evaluation: Evaluation) -> list[tuple[str, str, str]]:
    logged, true = evaluation.coverage, evaluation.true_coverage
    if not logged.total:
        return []
    error_n = mean_absolute_error(evaluation.true_forces) if true.total else evaluation.mae_n
    against = f"against truth.json, {true.total} trials" if true.total else f"{logged.total} usable trials"
    held = [(_percent(true.value), "of true forces in their 90 % interval", _of(true))]
    agree = f"{_of(logged)}; labels sure to {from_si(evaluation.label_sd_n, 'mn'):.2f} mN"
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


def _of(found: Proportion) -> str:
    return f"{found.hits} of {found.total} trials"


MOST_PICTURES = 48  # of 20 KB each: a page of 1 MB, which a mail carries
QUALITY = 75
DEEPEST = 2.0  # times as deep as wide, at most

WALL_COLOURS = (
    "Red: the tissue's surface. Green: the wall's inner boundary; blue where it is not seen, 1 mm below the surface. "
    "Depth and width are to scale."
)


def shown_frames(frames: Sequence[FrameAnswer]) -> tuple[FrameAnswer, ...]:
    """Return the frames that a page pictures, in their order: misread and unusable ones, then others in even steps."""
    first = [n for n, frame in enumerate(frames) if not frame.answer.usable or frame.misread]
    others = sorted(set(range(len(frames))) - set(first))
    chosen = evenly(first, MOST_PICTURES)
    return tuple(frames[n] for n in sorted(chosen + evenly(others, MOST_PICTURES - len(chosen))))


def frame_pictures(evaluation: Evaluation, looks: Sequence[AnsweredFrame]) -> html.Html:
    """Return the section with the pictures of `shown_frames`, and how many frames it leaves out."""
    several, total = len({frame.recording for frame in evaluation.frames}) > 1, len(evaluation.frames)
    pictures = [
        (_picture(look), f"{look.answer.eye}/{look.answer.file}" if several else look.answer.file, _words(look.answer))
        for look in looks
    ]
    marked = {n for n, look in enumerate(looks) if look.answer.misread}
    left_out = f"All {total} frames are shown." if len(looks) == total else (
        f"{len(looks)} of the {total} frames are shown: first the frames that were misread or could not be read, then "
        "others in even steps; the table below lists all."
    )  # fmt: skip
    words = html.paragraph(f"{WALL_COLOURS} {left_out}")
    return html.section("The wall in the frames", words, html.gallery(pictures, marked))


def _picture(look: AnsweredFrame) -> str:
    """Return a frame with its wall as the `src` of an image in a page."""
    width_m, depth_m = look.extent_m
    rows = max(1, round(WIDTH * min(depth_m / width_m, DEEPEST)))
    picture = draw_overlay(look.frame, look.found, (rows, WIDTH))
    # Thin coloured lines need their colour at full resolution.
    full_colour = (cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444)
    content = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY, *full_colour])[1].tobytes()
    return f"data:image/jpeg;base64,{base64.b64encode(content).decode('ascii')}"


def _words(answer: FrameAnswer) -> str:
    texts = html.measured_force(answer), *html.read_force(answer)
    measured, force, interval = (text.replace(html.NO_BREAK, " ") for text in texts)
    known = "not measured" if measured == html.NOTHING else f"measured {measured} mN (class {answer.target})"
    if not answer.answer.usable:
        return f"{known}; not usable" + (f": {answer.answer.reason}" if answer.answer.reason else "")
    if force == html.NOTHING:
        return f"{known}; read class {answer.answer.predicted}"
    return f"{known}; read {force} mN ({interval}; class {answer.answer.predicted})"
