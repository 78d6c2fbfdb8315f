"""Answers as plain records, how they are frozen, and how two sets of them are compared.

An answer has a name ("plain/0001.png/read") and a record of values. The end of a
value's name is its unit (`force_mn`), which decides how far it may move before it is
reported.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

Value = Any  # None, bool, int, float, str, or a list of them: what JSON holds
Record = dict[str, Value]
Answers = dict[str, Record]

FROZEN = Path(__file__).with_name("answers.json")
DIGITS = 9  # kept of a number: far below every tolerance


@dataclass(frozen=True)
class Tolerance:
    """How far a value of some unit may move: the larger of an absolute bound and a
    share of the frozen value.
    """

    unit: str
    absolute: float
    relative: float = 0.0

    def allows(self, frozen: float, now: float) -> bool:
        """Return whether a number has not moved."""
        return abs(now - frozen) <= max(self.absolute, self.relative * abs(frozen))


# By the end of a value's name. On one machine a run repeats itself to the last digit.
# Other BLAS kernels and numbers of threads move E by 3e-7 and forces by as much; a
# descent that stops one step earlier moves them by 1e-4. A bound of 1 uN is a
# thousandth of the narrowest interval and what the plan of the restructuring allows a
# force to move.
TOLERANCES: Mapping[str, Tolerance] = {
    "mn": Tolerance("mN", absolute=1e-3),
    "um": Tolerance("um", absolute=1e-2),
    "rows": Tolerance("rows", absolute=2e-3),
    "mm": Tolerance("mm", absolute=1e-4),
    "mpa": Tolerance("MPa", absolute=0.0, relative=1e-4),
    "pa": Tolerance("Pa", absolute=1e-3, relative=1e-4),
    "deg": Tolerance("deg", absolute=1e-2),
    "ms": Tolerance(
        "ms", absolute=0.1
    ),  # a time to the bound divides a force by its slope
    "s": Tolerance("s", absolute=1e-6),
    "share": Tolerance("share", absolute=1e-4),
    "grey": Tolerance("grey levels", absolute=1e-6),
    "kib": Tolerance("KiB", absolute=2.0, relative=0.01),
    "parameter": Tolerance("parameter", absolute=1e-4, relative=1e-4),
}
COUNT = Tolerance(
    "count", absolute=0.0
)  # of values without a unit: classes, frames, calls


@dataclass(frozen=True)
class Move:
    """One value that moved: `size` is its change in `unit`, None where words, a length
    or a presence changed.
    """

    answer: str
    value: str
    unit: str
    size: float | None
    words: str


@dataclass(frozen=True)
class Comparison:
    """The values that moved, and the names of the answers that only one of two sets
    has.
    """

    moves: tuple[Move, ...]
    missing: tuple[str, ...]
    new: tuple[str, ...]

    @property
    def moved(self) -> tuple[str, ...]:
        """The names of the answers of which a value moved."""
        return tuple(dict.fromkeys(move.answer for move in self.moves))

    @property
    def is_empty(self) -> bool:
        """True if nothing moved."""
        return not (self.moves or self.missing or self.new)


def tolerance_of(value: str) -> Tolerance:
    """Return the tolerance of a value by the end of its name."""
    return TOLERANCES.get(value.rpartition("_")[2], COUNT)


def compared(frozen: Answers, now: Answers) -> Comparison:
    """Compare two sets of answers."""
    moves = [
        move
        for name, record in frozen.items()
        if name in now
        for move in _record_moves(name, record, now[name])
    ]
    missing = tuple(name for name in frozen if name not in now)
    new = tuple(name for name in now if name not in frozen)
    return Comparison(tuple(moves), missing, new)


def _record_moves(answer: str, frozen: Record, now: Record) -> list[Move]:
    moves = []
    for value in dict.fromkeys((*frozen, *now)):
        tolerance = tolerance_of(value)
        if value not in now:
            moves.append(Move(answer, value, "presence", None, f"was {frozen[value]}"))
        elif value not in frozen:
            moves.append(Move(answer, value, "presence", None, f"is new: {now[value]}"))
        else:
            size, words = _difference(frozen[value], now[value], tolerance)
            if words:
                unit = tolerance.unit if size is not None else "words"
                moves.append(Move(answer, value, unit, size, words))
    return moves


def _difference(
    frozen: Value, now: Value, tolerance: Tolerance
) -> tuple[float | None, str]:
    """Return by how much a value moved and what it was and is; (None, "") if it has not
    moved.
    """
    if _is_number(frozen) and _is_number(now):
        if tolerance.allows(frozen, now):
            return None, ""
        return now - frozen, f"{frozen:.6g} -> {now:.6g}"
    if isinstance(frozen, list) and isinstance(now, list) and len(frozen) == len(now):
        return _list_difference(frozen, now, tolerance)
    if frozen == now:
        return None, ""
    return None, f"{frozen!r} -> {now!r}"


def _list_difference(
    frozen: Sequence[Value], now: Sequence[Value], tolerance: Tolerance
) -> tuple[float | None, str]:
    """Return the largest difference between the elements of two lists; words count as
    larger than any number.
    """
    largest: tuple[float | None, str] = None, ""
    for before, after in zip(frozen, now, strict=True):
        size, words = _difference(before, after, tolerance)
        if words and size is None:
            return size, words
        if size is not None and (largest[0] is None or abs(size) > abs(largest[0])):
            largest = size, words
    return largest


def _is_number(value: Value) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def plain(value: Any) -> Value:
    """Return a value as JSON will hold it: numbers with `DIGITS` digits, None for what
    is not finite.

    >>> plain((0.1 + 0.2, float("nan"), "why", True))
    [0.3, None, 'why', True]
    """
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, Mapping):
        return {str(name): plain(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, int):
        return value
    number = float(value)
    return float(f"{number:.{DIGITS}g}") if isfinite(number) else None


def frozen_text(made: Record, groups: Mapping[str, Answers]) -> str:
    """Return the text of the frozen file: an answer a line, so that a change of it can
    be read.
    """
    lines = ['{"made": ' + json.dumps(made) + ",", '"answers": {']
    for number, group in enumerate(sorted(groups)):
        entries = sorted(groups[group].items())
        lines.append(f"{json.dumps(group)}: {{")
        rows = [
            f"{json.dumps(name)}: {json.dumps(record, ensure_ascii=False)}"
            for name, record in entries
        ]
        lines.append(",\n".join(rows))
        lines.append("}" + "," * (number < len(groups) - 1))
    return "\n".join([*lines, "}}", ""])


def read_frozen(path: Path) -> tuple[Record, dict[str, Answers]]:
    """Return how frozen answers were made, and the answers of each group."""
    content = json.loads(path.read_text(encoding="utf-8"))
    return content["made"], content["answers"]
