"""Pages from templates: tables of answers, provenance, downloads; an evaluation's
page.
"""

import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from math import isnan
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from scleraforce.base.arrays import Integers
from scleraforce.base.errors import InputError
from scleraforce.base.units import from_si
from scleraforce.base.version import __version__
from scleraforce.base.whole_files import write_whole
from scleraforce.calibration.answer_metrics import (
    SHARED_ERROR,
    Proportion,
    mean_absolute_error,
    precision,
    recall,
)
from scleraforce.calibration.evaluation import Evaluation, FrameAnswer
from scleraforce.front.report.figure_files import data_uri, evenly, png_uri, svg_uri
from scleraforce.front.report.frame_figures import (
    WIDTH,
    AnsweredFrame,
    draw_residuals,
    draw_trial_forces,
)
from scleraforce.reading.reading_models import Reader
from scleraforce.recordings.exported_files import csv_text
from scleraforce.records.eye import MODULUS_SOURCES
from scleraforce.records.study import Study, study_hash
from scleraforce.wall.wall import draw_overlay


@dataclass(frozen=True)
class PageTable:
    """A table of a page: titles of the columns, rows, and the cells (row, column) to
    highlight.

    `records` are the rows of its CSV file; by default, the cells.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[object]]
    marked: Iterable[tuple[int, int]] = ()
    records: Sequence[Mapping[str, Any]] = ()

    @property
    def csv(self) -> str:
        """The address of the CSV file."""
        records = self.records or [
            dict(zip(self.head, map(_value, row), strict=True)) for row in self.rows
        ]
        return data_uri(csv_text(records).encode(), "text/csv")


def _value(cell: object) -> object:
    """Return a cell as a value of a CSV file: a number, a text, or None."""
    words = str(cell).replace(NO_BREAK, " ")
    try:
        return (
            None
            if words == NOTHING
            else float(words)
            if isinstance(cell, str)
            else cell
        )
    except ValueError:
        return words


def write_page(
    template: str,
    path: Path,
    made_at: datetime,
    values: Mapping[str, Any],
    *,
    overwrite: bool = False,
) -> None:
    """Write a page from a template of the package and its values, as one file; raises
    `InputError`.
    """
    if path.exists() and not overwrite:
        raise InputError(f"{path}: exists already; remove it or choose another name")

    pages = Environment(
        loader=PackageLoader("scleraforce", ""),
        autoescape=True,
        undefined=StrictUndefined,
    )
    pages.filters |= {"svg": svg_uri, "png": png_uri, "si": from_si}
    pages.filters |= {"cards": evaluation_cards, "confusion": confusion_table}
    pages.filters |= {"residuals": draw_residuals, "trial_forces": draw_trial_forces}
    write_whole(
        pages.get_template(template).render(values, made=made_line(made_at)), path
    )


NOTHING = "\N{EN DASH}"  # in a cell that has no value
NO_BREAK = "\N{NO-BREAK SPACE}"


def class_names(bounds_n: Sequence[float]) -> tuple[str, str, str]:
    """Return the classes with their bounds.

    >>> class_names((0.005, 0.03))
    ('class 0: below 5 mN', 'class 1: 5 to 30 mN', 'class 2: above 30 mN')
    """
    low, high = (f"{from_si(bound, 'mn'):g}" for bound in bounds_n)
    return (
        f"class 0: below {low} mN",
        f"class 1: {low} to {high} mN",
        f"class 2: above {high} mN",
    )


def confusion_table(
    evaluation: Evaluation, confusion: Integers | None = None
) -> PageTable:
    """Return the confusion matrix, or another one, with recall and precision; misread
    trials are highlighted.
    """
    names = class_names(evaluation.bounds_n)
    confusion = evaluation.confusion if confusion is None else confusion
    rows = [
        [f"target {name}", *counts.tolist(), found.words(NOTHING)]
        for name, counts, found in zip(names, confusion, recall(confusion), strict=True)
    ]
    rows.append(
        ["precision", *(right.words(NOTHING) for right in precision(confusion)), ""]
    )
    wrong = [(r, c + 1) for r, c in np.argwhere(confusion > 0).tolist() if r != c]
    head = ["", *(f"predicted {number}" for number in range(len(names))), "recall"]

    return PageTable(head, rows, wrong)


def frame_table(evaluation: Evaluation, frames: Sequence[FrameAnswer]) -> PageTable:
    """Return a row for each frame: measured and read force, and remarks; of several
    eyes, with the eye's name.
    """
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

    return PageTable(head, rows, wrong, [frame.to_dict() for frame in frames])


def measured_force(frame: FrameAnswer) -> str:
    """Return the measured force of a frame with its standard deviation, mN."""
    if frame.measured_force_n is None:
        return NOTHING

    force = f"{from_si(frame.measured_force_n, 'mn'):.1f}"
    sd_n = frame.measured_force_sd_n
    return (
        force
        if sd_n is None
        else f"{force}{NO_BREAK}±{NO_BREAK}{from_si(sd_n, 'mn'):.1f}"
    )


def read_force(frame: FrameAnswer) -> tuple[str, str]:
    """Return the force that was read in a frame, and its interval, mN."""
    if frame.answer.force_n is None or frame.answer.interval_n is None:
        return NOTHING, NOTHING

    low_mn, high_mn = (from_si(end, "mn") for end in frame.answer.interval_n)
    return (
        f"{from_si(frame.answer.force_n, 'mn'):.1f}",
        f"{low_mn:.1f}{NO_BREAK}to{NO_BREAK}{high_mn:.1f}",
    )


def _remark(frame: FrameAnswer) -> str:
    remarks = []
    if not frame.answer.usable:
        remarks.append(
            f"not usable ({frame.answer.reason})"
            if frame.answer.reason
            else "not usable"
        )

    if frame.calibration:
        remarks.append("Young's modulus was fitted on it: not counted")
    if frame.excluded:
        remarks.append(f"not counted: {frame.excluded}")

    return "; ".join([*remarks, *frame.answer.warnings])


RESEARCH_USE = "Research use only: not a medical device."

PACKAGES = (
    "scleraforce",
    "numpy",
    "scipy",
    "opencv-python-headless",
    "onnxruntime",
    "zarr",
    "matplotlib",
)


def made_line(made_at: datetime) -> str:
    """Return the version that made a page, the date, and its use.

    >>> from datetime import timedelta, timezone
    >>> moment = datetime(2026, 3, 1, 0, 30, tzinfo=timezone(timedelta(hours=1)))
    >>> made_line(moment).partition(", ")[2]
    '2026-02-28 23:30 UTC. Research use only: not a medical device.'
    """
    return (
        f"scleraforce {__version__}, {made_at.astimezone(UTC):%Y-%m-%d %H:%M} UTC."
        f" {RESEARCH_USE}"
    )


def provenance_table(study: Study, reader: Reader) -> PageTable:
    """Return study hash, seeds, model and data set hashes, and the versions of the
    packages.
    """
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
    return PageTable(["", "value"], rows)


def write_evaluation_html(
    evaluation: Evaluation,
    answered_frames: Sequence[AnsweredFrame],
    path: Path,
    made_at: datetime,
) -> None:
    """Write an evaluation as one self-contained page, with pictures of some frames;
    raises `InputError`.
    """
    recordings = dict.fromkeys(frame.recording for frame in evaluation.frames)
    tables = {
        name: frame_table(
            evaluation,
            [frame for frame in evaluation.frames if frame.recording == name],
        )
        for name in recordings
    }
    several = len(recordings) > 1
    names = [
        f"{answered.answer.eye}/{answered.answer.file}"
        if several
        else answered.answer.file
        for answered in answered_frames
    ]
    pictures = [
        (_picture(answered), name, _words(answered.answer), answered.answer.misread)
        for answered, name in zip(answered_frames, names, strict=True)
    ]
    values = {
        "evaluation": evaluation,
        "lead": _lead(evaluation),
        "shared_error": SHARED_ERROR,
    }
    write_page(
        "front/report/evaluation.html",
        path,
        made_at,
        values | {"pictures": pictures, "tables": tables},
    )


def _lead(evaluation: Evaluation) -> str:
    if not evaluation.reads_force:
        modulus_mpa = from_si(evaluation.youngs_modulus_pa, "mpa")
        return (
            f"Model {evaluation.model}, trained at a Young's modulus of"
            f" {modulus_mpa:.3g} MPa."
        )

    eyes = {
        frame.eye: (frame.youngs_modulus_pa, frame.modulus_source)
        for frame in evaluation.frames
    }
    moduli = (
        (
            f"{eye}: not known"
            if modulus_pa is None
            else (
                f"{eye}: {from_si(modulus_pa, 'mpa'):.3g} MPa"
                f" ({MODULUS_SOURCES[str(source)]})"
            )
        )
        for eye, (modulus_pa, source) in eyes.items()
    )

    return (
        f"Model {evaluation.model}. Young's modulus with which each eye was read:"
        f" {', '.join(moduli)}."
    )


def evaluation_cards(evaluation: Evaluation) -> list[tuple[str, str, str]]:
    """Return the figures that matter most: value, what it is, a remark."""
    low, high = evaluation.accuracy.interval
    danger = evaluation.recall[-1]
    unusable = [frame for frame in evaluation.frames if not frame.answer.usable]
    most = [
        (_percent(evaluation.accuracy.value), "accuracy", _of(evaluation.accuracy)),
        (f"{_percent(low)} to {_percent(high)}", "95 % interval", "Wilson's"),
        (_percent(danger.value), "of the dangerous forces seen", _of(danger)),
        (
            str(len(unusable)),
            "frames not usable",
            f"of {len(evaluation.frames)}; each counts as class 2",
        ),
    ]

    return [*most, *_force_cards(evaluation)]


def _force_cards(evaluation: Evaluation) -> list[tuple[str, str, str]]:
    logged = evaluation.coverage
    true = evaluation.true_coverage
    if not logged.total:
        return []

    error_n = (
        mean_absolute_error(evaluation.true_forces) if true.total else evaluation.mae_n
    )
    against = (
        f"against truth.json, {true.total} trials"
        if true.total
        else f"{logged.total} usable trials"
    )
    held = [(_percent(true.value), "of true forces in their 90 % interval", _of(true))]
    agree = (
        f"{_of(logged)}; labels sure to {from_si(evaluation.label_sd_n, 'mn'):.2f} mN"
    )

    return [
        (f"{from_si(error_n, 'mn'):.2f} mN", "mean error of the force", against),
        *(held if true.total else []),
        (_percent(logged.value), "of labels agree with their 90 % interval", agree),
    ]


def _percent(value: float) -> str:
    return NOTHING if isnan(value) else f"{from_si(value, 'percent'):.0f} %"


def _of(found: Proportion) -> str:
    return f"{found.hits} of {found.total} trials"


# maximum number of pictures of 20 KB each, once to see and once to save: a page of 2
# MB, which a mail carries
MOST_PICTURES = 48
QUALITY = 75
DEEPEST = 2.0  # times as deep as wide, at most


def shown_frames(frames: Sequence[FrameAnswer]) -> tuple[FrameAnswer, ...]:
    """Return the frames that a page pictures, in their order: misread and unusable
    ones, then others in even steps.
    """
    first = [
        n for n, frame in enumerate(frames) if not frame.answer.usable or frame.misread
    ]
    others = sorted(set(range(len(frames))) - set(first))
    chosen = evenly(first, MOST_PICTURES)

    return tuple(
        frames[n] for n in sorted(chosen + evenly(others, MOST_PICTURES - len(chosen)))
    )


def _picture(answered: AnsweredFrame) -> str:
    """Return a frame with its wall as the `src` of an image in a page."""
    width_m, depth_m = answered.extent_m
    rows = max(1, round(WIDTH * min(depth_m / width_m, DEEPEST)))
    picture = draw_overlay(answered.frame, answered.found, (rows, WIDTH))
    # Thin coloured lines need their colour at full resolution.
    full_colour = (
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
    )
    content = cv2.imencode(
        ".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY, *full_colour]
    )[1].tobytes()

    return data_uri(content, "image/jpeg")


def _words(answer: FrameAnswer) -> str:
    texts = measured_force(answer), *read_force(answer)
    measured, force, interval = (each.replace(NO_BREAK, " ") for each in texts)
    known = (
        "not measured"
        if measured == NOTHING
        else f"measured {measured} mN (class {answer.target})"
    )

    if not answer.answer.usable:
        return f"{known}; not usable" + (
            f": {answer.answer.reason}" if answer.answer.reason else ""
        )
    if force == NOTHING:
        return f"{known}; read class {answer.answer.predicted}"

    return f"{known}; read {force} mN ({interval}; class {answer.answer.predicted})"
