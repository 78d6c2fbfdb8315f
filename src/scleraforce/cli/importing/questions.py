"""What `import` asks where the sources do not say it: on the terminal, or by an error that names the options."""

import sys
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import click

from scleraforce.cli.importing.options import AXIS, BITS, GAP, GAUGE, INDEX, LENGTH, RATE, SIGN, ImportAnswers
from scleraforce.errors import InputError

if TYPE_CHECKING:
    from scleraforce.formats.scan import UnansweredError

__all__ = ["QUESTIONS", "answered", "ask_missing", "can_ask"]


@dataclass(frozen=True)
class _Question:
    """What is asked, the options that answer it, and what an answer is."""

    words: str
    options: str
    kind: click.ParamType[Any]


# By the name of the option's value, in the order in which they are asked.
QUESTIONS = {
    "width_mm": _Question("width of the frames in mm", "--width-mm", LENGTH),
    "depth_mm": _Question("depth of the frames in mm, as stored", "--depth-mm", LENGTH),
    "refractive_index": _Question(
        "index by which depth is stretched: 1 where the scanner has corrected it (geometric depth), else that of the "
        "tissue, about 1.38 (optical depth)", "--refractive-index", INDEX,
    ),
    "bits": _Question("bits of a pixel that are used", "--bits", BITS),
    "rate_hz": _Question("frames taken in a second", "--rate-hz or --times", RATE),
    "clock_offset_s": _Question(
        "seconds that the force log's clock shows more than the frames'", "--clock-offset-s", click.FLOAT
    ),
    "axis": _Question("axis of the force sensor along the needle", "--axis", AXIS),
    "contact_sign": _Question("sign of that axis in contact", "--contact-sign", SIGN),
    "eye": _Question("name of the eye", "--eye", click.STRING),
    "gauge": _Question("gauge of the needle", "--gauge", GAUGE),
    "gap_mm": _Question("distance of the B-scan plane from the needle's axis in mm", "--gap-mm", GAP),
}  # fmt: skip


def can_ask(as_json: bool) -> bool:
    """Return whether somebody sits before a terminal."""
    return not as_json and sys.stdin.isatty() and sys.stderr.isatty()


def answered(answers: ImportAnswers, open_point: "UnansweredError", ask: bool) -> ImportAnswers:
    """Return the answers with that to what a source leaves open, asked on the terminal.

    Raises:
        UnansweredError: nobody can be asked.
    """
    if not ask:
        raise open_point
    click.echo(str(open_point), err=True)
    name = open_point.option.removeprefix("--").replace("-", "_")
    if name == "by_arrival":
        return replace(answers, by_arrival=click.confirm("by arrival", abort=True, err=True))
    if open_point.forms:
        shorts = [form.partition("=")[0] for form in open_point.forms]
        told = [f"{short}={click.prompt(f'{short} (NAME:UNIT)', err=True)}" for short in shorts]
        return replace(answers, columns=(*answers.columns, *told))
    answer: dict[str, Any] = {name: click.prompt(open_point.option, err=True)}
    return replace(answers, **answer)


def ask_missing(missing: set[str], ask: bool) -> dict[str, Any]:
    """Return answers to questions, by the names of their options.

    Raises:
        InputError: nobody can be asked; the message names all options at once.
    """
    questions = {name: question for name, question in QUESTIONS.items() if name in missing}
    if questions and not ask:
        listed = "; ".join(f"{question.words} ({question.options})" for question in questions.values())
        raise InputError(f"not in the sources, and not told: {listed}")
    return {name: click.prompt(question.words, type=question.kind, err=True) for name, question in questions.items()}
