"""HTML of pages without templates or dependencies: elements, tables of answers, and what a page was made from."""

import platform
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from html import escape
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Literal, NewType

import numpy as np
from matplotlib.figure import Figure

from scleraforce import __version__
from scleraforce.arrays import Integers
from scleraforce.errors import InputError
from scleraforce.reader import Reader
from scleraforce.reader.evaluate import Evaluation, FrameAnswer
from scleraforce.reader.metrics import precision, recall
from scleraforce.report.files import data_uri
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
    head: Sequence[str],
    rows: Sequence[Sequence[object]],
    caption: str,
    marked: Iterable[tuple[int, int]] = (),
    *,
    prose: bool = False,
    remarks: bool = False,
) -> Html:
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
            f"{frame.eye}/{frame.file}" if several else frame.file,
            measured_force(frame),
            NOTHING if frame.target is None else frame.target,
            frame.answer.predicted,
            *(read_force(frame) if with_force else []),
            *(f"{p:.3f}" for p in frame.answer.probabilities or ()),
            *([] if frame.answer.probabilities else [NOTHING] * len(classes)),
            _remark(frame),
        ]
        for frame in frames
    ]
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
        ["study, SHA-256", study_hash(study)],
        ["data set, SHA-256", reader.provenance.get("dataset_sha256", "")],
        ["seed of the data set", study.dataset.seed],
        ["seed of the network", study.network.seed],
        ["seed of the virtual eyes", study.phantom.seed],
        ["Python", platform.python_version()],
        ["PyTorch", reader.provenance.get("torch", "")],
        *([name, version(name)] for name in PACKAGES),
    ]
    caption = "Inputs of this run; the same study and versions give the same result."
    return table(["", "value"], rows, caption, prose=True)
