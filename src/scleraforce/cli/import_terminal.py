"""What `import` prints: its questions on a terminal, and its report for people and as JSON."""

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from scleraforce.notebook.importing import PREVIEW
from scleraforce.plain_text import wrapped
from scleraforce.recording.folder import RecordingInfo
from scleraforce.recording.importing import NOBODY, Asker, Import, Question, provenance
from scleraforce.recording.pixels import TOP
from scleraforce.recording.scan import UnansweredError
from scleraforce.recording.sources import ImportOptions
from scleraforce.units import from_si

OPEN = "-"  # leaves an optional question open
UNITS = {"_mm": "mm", "_um": "µm"}


def asker(as_json: bool, kinds: "Mapping[str, click.ParamType[Any]]") -> Asker:
    """Return who sits before the terminal, or nobody.

    Args:
        as_json: whether the command prints JSON.
        kinds: of the options' values, by their names.
    """
    if not _can_ask(as_json):
        return NOBODY

    def ask(questions: Mapping[str, Question]) -> dict[str, Any]:
        return {name: _answer(name, question, kinds[name]) for name, question in questions.items()}

    return Asker(_settle, ask, lambda fault: click.echo(f"error: {fault}", err=True))


def _can_ask(as_json: bool) -> bool:
    return not as_json and sys.stdin.isatty() and sys.stderr.isatty()


def _settle(answers: ImportOptions, open_point: UnansweredError) -> ImportOptions:
    """Ask for what a source leaves open."""
    click.echo(str(open_point), err=True)
    name = open_point.option.removeprefix("--").replace("-", "_")
    if name == "by_arrival":
        return replace(answers, by_arrival=click.confirm("by arrival", abort=True, err=True))
    if open_point.forms:
        shorts = [form.partition("=")[0] for form in open_point.forms]
        columns = [_column(short) for short in shorts]
        return replace(answers, columns=(*answers.columns, *columns))
    answer: dict[str, Any] = {name: click.prompt(open_point.option, err=True)}
    return replace(answers, **answer)


def _column(short: str) -> str:
    """Ask for a column; the question shows answers that begin with its name, so both forms are taken."""
    answer = click.prompt(f"{short} (NAME:UNIT)", err=True)
    return f"{short}={answer.strip().removeprefix(f'{short}=')}"


def _answer(name: str, question: Question, kind: "click.ParamType[Any]") -> Any:
    """Ask until the answer can be used; an optional question offers what the sources suggest, or to leave it open."""

    def checked(text: str) -> Any:
        if question.optional and text.strip() == OPEN:
            return None
        value = kind.convert(text.strip(), None, None)
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


def entries(out: Path, done: Import) -> dict[str, Any]:
    """Return the command's JSON object."""
    info = done.info
    return {
        "recording": str(out),
        "preview": str(out / PREVIEW),
        "frames": len(done.gathered.scan.names),
        "force_samples": None if done.log is None else len(done.log.time_s),
        "width_mm": from_si(info.oct.width_m, "mm"),
        "depth_mm": from_si(info.oct.depth_m, "mm"),
        "refractive_index": info.oct.refractive_index,
        "bits": info.oct.bits,
        **provenance(done),
    }


def lines(out: Path, done: Import) -> list[str]:
    """Return the command's report, at 80 columns."""
    found = [_frames(done), _times(done)]
    if done.log is not None:
        columns = ", ".join(column.answer() for column in done.gathered.columns) or ", ".join(done.log.columns)
        rate = f"{len(done.log.time_s)} samples, {done.log.sample_rate_hz:.4g} a second"
        found.append(f"forces: {rate} ({columns}){_contact(done.info)}")
    if done.greys.scaled:
        found.append(f"note: pixels of {done.greys.low:.6g} to {done.greys.high:.6g} became counts of 0 to {TOP}")
    elif done.greys.low:
        found.append(f"note: {-done.greys.low:g} was added to all pixels, so that the smallest is 0")
    if done.greys.lost:
        found.append(f"note: {done.greys.lost} pixels are not finite numbers; they became 0")
    found += [f"note: {note}" for note in done.gathered.notes]
    return [*map(wrapped, found), f"wrote {out}; look at {out / PREVIEW}"]


def _frames(done: Import) -> str:
    scan, info, source = done.gathered.scan, done.info.oct, done.sources
    count = "1 frame" if len(scan.names) == 1 else f"{len(scan.names)} frames"
    return (
        f"{count} of {scan.rows} x {scan.columns} pixels (depth x lateral), {info.bits} bits; "
        f"{from_si(info.width_m, 'mm'):.4g} mm wide ({source['width_mm']}), {from_si(info.depth_m, 'mm'):.4g} mm deep "
        f"({source['depth_mm']}), refractive index {info.refractive_index:g} ({source['refractive_index']})"
    )


def _times(done: Import) -> str:
    first_s, last_s = done.times.time_s[0], done.times.time_s[-1]
    begin = f"; 0 s is {done.origin_s:.0f} s of the sources' clock" if done.origin_s else ""
    return f"times: {first_s:.3f} to {last_s:.3f} s ({done.sources['times']}){begin}"


def _contact(info: RecordingInfo) -> str:
    return "" if info.force is None else f"; contact is {'+' if info.force.contact_sign > 0 else '-'}{info.force.axis}"
