"""What is asked where the sources do not say it, and who is asked."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from scleraforce.errors import InputError
from scleraforce.formats.importing.told import ImportAnswers
from scleraforce.formats.scan import UnansweredError
from scleraforce.recording.info import eye_id_fault


def _nothing() -> None:
    """Return that nothing is offered."""


def _no_fault(_: Any) -> None:
    """Return that nothing is wrong with an answer."""


@dataclass(frozen=True)
class Question:
    """What is asked, and the options that answer it.

    Attributes:
        words: the question.
        options: that answer it.
        fault: returns why an answer is wrong, None where it is not.
        optional: whether it may stay open (None).
        offered: returns the answer to an optional question that the sources suggest, None where they do not.
    """

    words: str
    options: str
    fault: Callable[[Any], str | None] = _no_fault
    optional: bool = False
    offered: Callable[[], float | None] = _nothing


# By the name of the option's value, in the order in which they are asked.
QUESTIONS = {
    "width_mm": Question("width of the frames", "--width-mm"),
    "depth_mm": Question("depth of the frames, as stored", "--depth-mm"),
    "refractive_index": Question(
        "index by which depth is stretched: 1 where the scanner has corrected it (geometric depth), else that of the "
        "tissue, about 1.38 (optical depth)", "--refractive-index",
    ),
    "bits": Question("bits of a pixel that are used", "--bits"),
    "rate_hz": Question("frames taken in a second", "--rate-hz or --times"),
    "clock_offset_s": Question("seconds that the force log's clock shows more than the frames'", "--clock-offset-s"),
    "axis": Question("axis of the force sensor along the needle", "--axis"),
    "contact_sign": Question("sign of that axis in contact", "--contact-sign"),
    "eye": Question("name of the eye", "--eye", eye_id_fault),
    "gauge": Question("gauge of the needle", "--gauge"),
    "gap_mm": Question("distance of the B-scan plane from the needle's axis", "--gap-mm"),
    "thickness_um": Question("thickness of the wall", "--thickness-um", optional=True),
}  # fmt: skip


@dataclass(frozen=True)
class Asker:
    """Who is asked.

    Attributes:
        settle: returns the answers with that to what a source leaves open.
        missing: returns answers to questions, by their names in `QUESTIONS`.
        again: says what is wrong with the answers so far, before they are asked for again; raises it if nobody is.
    """

    settle: Callable[[ImportAnswers, UnansweredError], ImportAnswers]
    missing: Callable[[Mapping[str, Question]], dict[str, Any]]
    again: Callable[[InputError], None]


def _leave_open(_: ImportAnswers, open_point: UnansweredError) -> ImportAnswers:
    raise open_point


def _name_all(questions: Mapping[str, Question]) -> dict[str, Any]:
    """Name the options of all questions at once; optional ones stay open."""
    needed = [question for question in questions.values() if not question.optional]
    if needed:
        listed = "; ".join(f"{question.words} ({question.options})" for question in needed)
        raise InputError(f"not in the sources, and not told: {listed}")
    return {}


def _raise(fault: InputError) -> None:
    raise fault


NOBODY = Asker(_leave_open, _name_all, _raise)
