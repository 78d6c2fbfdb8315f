"""What `import` asks on a terminal."""

import sys
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import click

from scleraforce.cli.importing.options import AXIS, BITS, GAP, GAUGE, INDEX, LENGTH, RATE, SIGN
from scleraforce.formats.importing.questions import NOBODY, Asker, Question
from scleraforce.formats.importing.told import ImportAnswers
from scleraforce.formats.scan import UnansweredError

__all__ = ["KINDS", "asker"]

# What an answer is, by the names of the questions.
KINDS: dict[str, click.ParamType[Any]] = {
    "width_mm": LENGTH, "depth_mm": LENGTH, "refractive_index": INDEX, "bits": BITS, "rate_hz": RATE,
    "clock_offset_s": click.FLOAT, "axis": AXIS, "contact_sign": SIGN, "eye": click.STRING, "gauge": GAUGE,
    "gap_mm": GAP,
}  # fmt: skip


def asker(as_json: bool) -> Asker:
    """Return who sits before the terminal, or nobody."""
    return Asker(_settle, _ask) if _can_ask(as_json) else NOBODY


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


def _ask(questions: Mapping[str, Question]) -> dict[str, Any]:
    return {name: click.prompt(_words(name, question), type=KINDS[name], err=True)
            for name, question in questions.items()}  # fmt: skip


def _words(name: str, question: Question) -> str:
    return f"{question.words}, in mm" if name.endswith("_mm") else question.words
