"""What is said of a thing, for the terminal, as JSON and as a picture."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure

from scleraforce.units import HumanUnit, from_si


@dataclass(frozen=True, kw_only=True)
class Thing:
    """A thing that was looked at.

    Attributes:
        kind: what it is, "recording".
        facts: what is said of it as JSON; the names carry human units.
        rows: the same for people, a name and a sentence each.
        lines: what stands below the rows as it is, a table for instance.
        draw: makes its picture.
    """

    kind: str
    facts: Mapping[str, Any]
    rows: tuple[tuple[str, str], ...]
    lines: tuple[str, ...] = ()
    draw: Callable[[], Figure]


def span(values: Iterable[float], unit: HumanUnit, printed: str) -> str:
    """Return the range of some values in words.

    >>> span([4e-4, 8e-4], "um", "µm")
    '400 to 800 µm'
    >>> span([4e-4], "um", "µm")
    '400 µm'
    """
    ends = sorted({f"{from_si(value, unit):.4g}": value for value in values}.items(), key=lambda end: end[1])
    words = ends[0][0] if len(ends) == 1 else f"{ends[0][0]} to {ends[-1][0]}"
    return f"{words} {printed}"


def value_words(value: float | None, unit: HumanUnit, printed: str) -> str:
    """Return a value in words, or that it is not stated.

    >>> value_words(None, "mmhg", "mmHg")
    'not stated'
    """
    return "not stated" if value is None else f"{from_si(value, unit):.4g} {printed}"
