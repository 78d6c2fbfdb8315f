"""HTML of pages without templates or dependencies: elements, tables of answers, provenance; an evaluation's page."""

import base64
import platform
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from html import escape
from importlib.metadata import version
from importlib.resources import files
from math import isnan
from pathlib import Path
from typing import Literal, NewType

import cv2
import numpy as np
from matplotlib.figure import Figure

from scleraforce import __version__
from scleraforce.arrays import Integers
from scleraforce.errors import InputError
from scleraforce.known import MODULUS_SOURCES
from scleraforce.reader.evaluate import Evaluation, FrameAnswer
from scleraforce.reader.kinds import Reader
from scleraforce.reader.metrics import SHARED_ERROR, Proportion, mean_absolute_error, precision, recall
from scleraforce.report.files import data_uri, evenly
from scleraforce.report.frame_figures import WIDTH, AnsweredFrame, draw_read_forces, draw_trial_forces
from scleraforce.segmentation.found import draw_overlay
from scleraforce.study import Study, study_hash
from scleraforce.units import from_si
from scleraforce.whole_files import write_whole

Html = NewType("Html", str)

STACKED_COLUMNS, STACKED_SENTENCES = 7, 3  # from as many columns, a table's rows become blocks on a narrow screen
STYLE_SHEET = files("scleraforce.report").joinpath("page.css").read_text(encoding="utf-8")


def text(content: object) -> Html:
    """Return a value as escaped text."""
    return Html(escape(str(content)))


def paragraph(content: str, *, notice: bool = False) -> Html:
    """Return a paragraph of plain text; a `notice` must not be missed."""
    return Html(f"<p{_class('notice' if notice else '')}>{text(content)}</p>")


def bullets(entries: Iterable[str]) -> Html:
    """Return a list of plain texts."""
    return Html("<ul>" + "".join(f"<li>{text(entry)}</li>" for entry in entries) + "</ul>")


def table(
    head: Sequence[str], rows: Sequence[Sequence[object]], caption: str, marked: Iterable[tuple[int, int]] = (), *,
    prose: bool = False, remarks: bool = False,
) -> Html:  # fmt: skip
    """Return a table with `marked` cells (row, column); `prose`, or with `remarks` the last column, is flush left."""
    classes = dict.fromkeys(marked, "marked")
    if remarks:
        classes |= {(number, len(head) - 1): "words" for number in range(len(rows))}
    top = "".join(
        f'<th scope="col"{_class("words" if remarks and entry is head[-1] else "")}>{text(entry)}</th>'
        for entry in head
    )
    body = "".join(_row(number, row, head, classes) for number, row in enumerate(rows))
    stacked = "stacked" if len(head) >= (STACKED_SENTENCES if prose else STACKED_COLUMNS) else ""
    return Html(
        f'<div class="table"><table{_class("prose" if prose else "", stacked)}><caption>{text(caption)}</caption>'
        f"<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _row(number: int, row: Sequence[object], head: Sequence[str], classes: Mapping[tuple[int, int], str]) -> str:
    """Return a row; each cell carries its column's title, for where the row becomes a block."""
    first, *rest = (text(entry) for entry in row)
    cells = (
        f'<td data-title="{escape(title)}"{_class(classes.get((number, column), ""))}>{entry}</td>'
        for column, (title, entry) in enumerate(zip(head[1:], rest, strict=True), start=1)
    )
    return f'<tr><th scope="row">{first}</th>{"".join(cells)}</tr>'


def _class(*names: str) -> str:
    chosen = " ".join(name for name in names if name)
    return f' class="{chosen}"' if chosen else ""


def figure(drawn: Figure, alternative: str, caption: str, kind: Literal["png", "svg"] = "svg") -> Html:
    """Return a figure with a caption; `alternative` describes it in words. Images are PNG, line art is SVG."""
    return Html(
        f'<figure><img src="{data_uri(drawn, kind)}" alt="{escape(alternative)}">'
        f"<figcaption>{text(caption)}</figcaption></figure>"
    )


def gallery(pictures: Iterable[tuple[str, str, str]], marked: Iterable[int] = ()) -> Html:
    """Return small pictures (data URI, name, description) side by side; the numbers in `marked` are highlighted."""
    highlighted = set(marked)
    items = (
        f"<figure{_class('marked' if number in highlighted else '')}>"
        f'<img src="{escape(source)}" alt="{escape(f"{name}: {words}")}">'
        f"<figcaption><b>{text(name)}</b> {text(words)}</figcaption></figure>"
        for number, (source, name, words) in enumerate(pictures)
    )
    return Html(f'<div class="gallery">{"".join(items)}</div>')


def cards(entries: Iterable[tuple[str, str, str]]) -> Html:
    """Return the figures that matter most, side by side: value, what it is, a remark."""
    boxes = (
        f'<div class="card"><b>{text(value)}</b><span>{text(name)}</span><small>{text(remark)}</small></div>'
        for value, name, remark in entries
    )
    return Html(f'<div class="cards">{"".join(boxes)}</div>')


def section(title: str, *blocks: Html) -> Html:
    """Return a section of a page."""
    return Html(f"<section><h2>{text(title)}</h2>{''.join(blocks)}</section>")


def page(title: str, lead: str, stamp: str, *sections: Html) -> Html:
    """Return a whole page: heading, a sentence or two, version and date, sections."""
    return Html(
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{text(title)}</title><style>\n{STYLE_SHEET}</style></head>\n"
        f"<body><main><header><h1>{text(title)}</h1><p>{text(lead)}</p>"
        f'<p class="stamp">{text(stamp)}</p></header>\n' + "\n".join(sections) + "</main></body></html>\n"
    )


def write_page(content: Html, path: Path, *, overwrite: bool = False) -> None:
    """Write a page; raises `InputError`."""
    if path.exists() and not overwrite:
        raise InputError(f"{path}: exists already; remove it or choose another name")
    write_whole(content, path)


NOTHING = "\N{EN DASH}"  # in a cell that has no value
NO_BREAK = "\N{NO-BREAK SPACE}"


def class_names(bounds_n: Sequence[float]) -> tuple[str, str, str]:
    """Return the classes with their bounds.

    >>> class_names((0.005, 0.03))
    ('class 0: below 5 mN', 'class 1: 5 to 30 mN', 'class 2: above 30 mN')
    """
    low, high = (f"{from_si(bound, 'mn'):g}" for bound in bounds_n)
    return f"class 0: below {low} mN", f"class 1: {low} to {high} mN", f"class 2: above {high} mN"


def confusion_table(confusion: Integers, bounds_n: Sequence[float], caption: str) -> Html:
    """Return a confusion matrix, rows targets, with recall and precision; misread trials are highlighted."""
    names = class_names(bounds_n)
    rows = [
        [f"target {name}", *counts.tolist(), found.words(NOTHING)]
        for name, counts, found in zip(names, confusion, recall(confusion), strict=True)
    ]
    rows.append(["precision", *(right.words(NOTHING) for right in precision(confusion)), ""])
    wrong = [(r, c + 1) for r, c in np.argwhere(confusion > 0).tolist() if r != c]
    head = ["", *(f"predicted {number}" for number in range(len(names))), "recall"]
    return table(head, rows, caption, wrong)


def frame_table(evaluation: Evaluation, frames: Sequence[FrameAnswer], caption: str) -> Html:
    """Return a row for each frame: measured and read force, and remarks; of several eyes, with the eye's name."""
    several = len({frame.eye for frame in frames}) > 1
    with_force = evaluation.reads_force
    classes = [f"p({number})" for number in range(len(evaluation.bounds_n) + 1)]
    rows = [
        [
            f"{frame.eye}/{frame.file}" if several else frame.file, measured_force(frame),
            NOTHING if frame.target is None else frame.target, frame.answer.predicted,
            *(read_force(frame) if with_force else []), *(f"{p:.3f}" for p in frame.answer.probabilities or ()),
            *([] if frame.answer.probabilities else [NOTHING] * len(classes)), _remark(frame),
        ]
        for frame in frames
    ]  # fmt: skip
    wrong = [(r, 3) for r, f in enumerate(frames) if f.misread]
    read = ["read [mN]", "90 % [mN]"] if with_force else []
    head = ["frame", "force [mN]", "target", "predicted", *read, *classes, "remark"]
    return table(head, rows, caption, wrong, remarks=True)


def measured_force(frame: FrameAnswer) -> str:
    """Return the measured force of a frame with its standard deviation, mN."""
    if frame.measured_force_n is None:
        return NOTHING
    force, sd_n = f"{from_si(frame.measured_force_n, 'mn'):.1f}", frame.measured_force_sd_n
    return force if sd_n is None else f"{force}{NO_BREAK}±{NO_BREAK}{from_si(sd_n, 'mn'):.1f}"


def read_force(frame: FrameAnswer) -> tuple[str, str]:
    """Return the force that was read in a frame, and its interval, mN."""
    if frame.answer.force_n is None or frame.answer.interval_n is None:
        return NOTHING, NOTHING
    low_mn, high_mn = (from_si(end, "mn") for end in frame.answer.interval_n)
    return f"{from_si(frame.answer.force_n, 'mn'):.1f}", f"{low_mn:.1f}{NO_BREAK}to{NO_BREAK}{high_mn:.1f}"


def _remark(frame: FrameAnswer) -> str:
    remarks = []
    if not frame.answer.usable:
        remarks.append(f"not usable ({frame.answer.reason})" if frame.answer.reason else "not usable")
    if frame.calibration:
        remarks.append("Young's modulus was fitted on it: not counted")
    if frame.excluded:
        remarks.append(f"not counted: {frame.excluded}")
    return "; ".join([*remarks, *frame.answer.warnings])


RESEARCH_USE = "Research use only: not a medical device."

PACKAGES = ("scleraforce", "numpy", "scipy", "opencv-python-headless", "onnxruntime", "zarr", "matplotlib")


def made_line(made_at: datetime) -> str:
    """Return the version that made a page, the date, and its use.

    >>> from datetime import timedelta, timezone
    >>> made_line(datetime(2026, 3, 1, 0, 30, tzinfo=timezone(timedelta(hours=1)))).partition(", ")[2]
    '2026-02-28 23:30 UTC. Research use only: not a medical device.'
    """
    return f"scleraforce {__version__}, {made_at.astimezone(UTC):%Y-%m-%d %H:%M} UTC. {RESEARCH_USE}"


def provenance_table(study: Study, reader: Reader) -> Html:
    """Return study hash, seeds, model and data set hashes, and the versions of the packages."""
    rows: list[Sequence[object]] = [
        ["study, SHA-256", study_hash(study)], ["data set, SHA-256", reader.provenance.get("dataset_sha256", "")],
        ["seed of the data set", study.dataset.seed], ["seed of the network", study.network.seed],
        ["seed of the virtual eyes", study.phantom.seed], ["Python", platform.python_version()],
        ["PyTorch", reader.provenance.get("torch", "")], *([name, version(name)] for name in PACKAGES),
    ]  # fmt: skip
    caption = "Inputs of this run; the same study and versions give the same result."
    return table(["", "value"], rows, caption, prose=True)


NAMES_REMARK = ("Rows are targets, columns predictions; in brackets the 95 % Wilson interval. Recall is row-wise (of "
                "the trials of a class, how many were recognised), precision column-wise (of the answers of a class, "
                "how many were right); the paper's Table 3 has the two names the other way round.")  # fmt: skip


def write_evaluation_html(
    evaluation: Evaluation, looks: Sequence[AnsweredFrame], path: Path, made_at: datetime
) -> None:
    """Write an evaluation as one self-contained page, with pictures of some frames; raises `InputError`."""
    limits = [section("What limits the result", bullets(evaluation.notes))] if evaluation.notes else []
    pictures = [frame_pictures(evaluation, looks)] if looks else []
    tables = [
        frame_table(evaluation, [frame for frame in evaluation.frames if frame.recording == name], name)
        for name in dict.fromkeys(frame.recording for frame in evaluation.frames)
    ]
    sections = [_result(evaluation), *limits, *pictures, section("Every frame", *tables)]
    title = "Forces of recordings" if evaluation.reads_force else "Force classes of recordings"
    write_page(page(title, _lead(evaluation), made_line(made_at), *sections), path)


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


def evaluation_cards(evaluation: Evaluation) -> Html:
    """Return the figures that matter most: accuracy, recall of the dangerous class, frames that could not be read."""
    low, high = evaluation.accuracy.interval
    danger = evaluation.recall[-1]
    unusable = [frame for frame in evaluation.frames if not frame.answer.usable]
    most = [
        (_percent(evaluation.accuracy.value), "accuracy", _of(evaluation.accuracy)),
        (f"{_percent(low)} to {_percent(high)}", "95 % interval", "Wilson's"),
        (_percent(danger.value), "of the dangerous forces seen", _of(danger)),
        (str(len(unusable)), "frames not usable", f"of {len(evaluation.frames)}; each counts as class 2"),
    ]
    return cards([*most, *_force_cards(evaluation)])


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


def read_forces_figure(evaluation: Evaluation) -> Html:
    """Return the read forces with their intervals over the measured ones."""
    caption = ("Read force with its 90 % interval over the measured force. Dashed: class bounds. Misread trials are "
               "ringed and named; unusable trials are at the upper edge and count as class 2.")  # fmt: skip
    return figure(draw_read_forces(evaluation), "read force of each trial over its measured force", caption)


def forces_figure(evaluation: Evaluation) -> Html:
    """Return the measured forces with the class bounds and the misread trials (Fig. 10)."""
    caption = ("Measured forces of the trials that count, and the class bounds (Fig. 10). Colour and marker say what "
               "was read; misread trials are ringed. Each trial has the name of its "
               "frame where there is room.")  # fmt: skip
    return figure(draw_trial_forces(evaluation), "measured force of each trial against the class bounds", caption)


def _result(evaluation: Evaluation) -> Html:
    if not evaluation.scored:
        return section("Result", paragraph("No frame has a label that counts, so there are no metrics."))
    confusion = confusion_table(evaluation.confusion, evaluation.bounds_n, NAMES_REMARK)
    words = paragraph(f"A label is given with the standard deviation of its error. {SHARED_ERROR}")
    forces = [words, read_forces_figure(evaluation)] if evaluation.forces else []
    return section("Result", evaluation_cards(evaluation), confusion, *forces, forces_figure(evaluation))


def _percent(value: float) -> str:
    return NOTHING if isnan(value) else f"{from_si(value, 'percent'):.0f} %"


def _of(found: Proportion) -> str:
    return f"{found.hits} of {found.total} trials"


MOST_PICTURES = 48  # of 20 KB each: a page of 1 MB, which a mail carries
QUALITY = 75
DEEPEST = 2.0  # times as deep as wide, at most

WALL_COLOURS = ("Orange: the tissue's surface. Blue: the wall's inner boundary, dashed if it is not seen, 1 mm below "
                "the surface. Depth and width are to scale.")  # fmt: skip


def shown_frames(frames: Sequence[FrameAnswer]) -> tuple[FrameAnswer, ...]:
    """Return the frames that a page pictures, in their order: misread and unusable ones, then others in even steps."""
    first = [n for n, frame in enumerate(frames) if not frame.answer.usable or frame.misread]
    others = sorted(set(range(len(frames))) - set(first))
    chosen = evenly(first, MOST_PICTURES)
    return tuple(frames[n] for n in sorted(chosen + evenly(others, MOST_PICTURES - len(chosen))))


def frame_pictures(evaluation: Evaluation, looks: Sequence[AnsweredFrame]) -> Html:
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
    words = paragraph(f"{WALL_COLOURS} {left_out}")
    return section("The wall in the frames", words, gallery(pictures, marked))


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
    texts = measured_force(answer), *read_force(answer)
    measured, force, interval = (each.replace(NO_BREAK, " ") for each in texts)
    known = "not measured" if measured == NOTHING else f"measured {measured} mN (class {answer.target})"
    if not answer.answer.usable:
        return f"{known}; not usable" + (f": {answer.answer.reason}" if answer.answer.reason else "")
    if force == NOTHING:
        return f"{known}; read class {answer.answer.predicted}"
    return f"{known}; read {force} mN ({interval}; class {answer.answer.predicted})"
