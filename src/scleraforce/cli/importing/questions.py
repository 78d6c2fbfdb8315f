"""What `import` asks on a terminal."""

import sys
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import click

from scleraforce.cli.importing.options import AXIS, BITS, GAP, GAUGE, INDEX, LENGTH, RATE, SIGN, THICKNESS
from scleraforce.errors import InputError
from scleraforce.recording.importing import NOBODY, Asker, ImportAnswers, Question
from scleraforce.recording.scan import UnansweredError

# What an answer is, by the names of the questions.
KINDS: dict[str, click.ParamType[Any]] = {
    "width_mm": LENGTH, "depth_mm": LENGTH, "refractive_index": INDEX, "bits": BITS, "rate_hz": RATE,
    "clock_offset_s": click.FLOAT, "axis": AXIS, "contact_sign": SIGN, "eye": click.STRING, "gauge": GAUGE,
    "gap_mm": GAP, "thickness_um": THICKNESS,
}  # fmt: skip

OPEN = "-"  # leaves an optional question open
UNITS = {"_mm": "mm", "_um": "µm"}


def asker(as_json: bool) -> Asker:
    """Return who sits before the terminal, or nobody."""
    return Asker(_settle, _ask, _say_again) if _can_ask(as_json) else NOBODY


def _can_ask(as_json: bool) -> bool:
    return not as_json and sys.stdin.isatty() and sys.stderr.isatty()


def _settle(answers: ImportAnswers, open_point: UnansweredError) -> ImportAnswers:
    """Ask for what a source leaves open."""
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


def _say_again(fault: InputError) -> None:
    click.echo(f"error: {fault}", err=True)


def _ask(questions: Mapping[str, Question]) -> dict[str, Any]:
    return {name: _answer(name, question) for name, question in questions.items()}


def _answer(name: str, question: Question) -> Any:
    """Ask until the answer can be used; an optional question offers what the sources suggest, or to leave it open."""

    def checked(text: str) -> Any:
        if question.optional and text.strip() == OPEN:
            return None
        value = KINDS[name].convert(text.strip(), None, None)
        if fault := question.fault(value):
            raise click.UsageError(fault)
        return value

    words, offered = _words(name, question), question.offered()
    if offered is not None:
        words = f"{words}; the first frames show {offered:g}"
    default = (OPEN if offered is None else f"{offered:g}") if question.optional else None
    return click.prompt(words, default=default, value_proc=checked, err=True)


def _words(name: str, question: Question) -> str:
    unit = next((f", in {printed}" for ending, printed in UNITS.items() if name.endswith(ending)), "")
    return f"{question.words}{unit}{f' ({OPEN}: not known)' if question.optional else ''}"
