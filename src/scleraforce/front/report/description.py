"""What `show` says of an artefact: title, facts and a picture."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure

from scleraforce.base.units import HumanUnit, from_si

LOG_FILES = "decisions-*.jsonl"

RANGE = {"min", "max"}  # a value, not a table of keys


@dataclass(frozen=True, kw_only=True)
class Description:
    """A described thing: `facts` for JSON in human units, `rows` and `lines` for
    people, and a picture.

    A row is a name and a sentence; it is left out if that is empty.
    """

    kind: str
    facts: Mapping[str, Any]
    rows: tuple[tuple[str, str], ...]
    lines: tuple[str, ...] = ()
    draw: Callable[[], Figure]


def range_text(values: Iterable[float], unit: HumanUnit, printed: str) -> str:
    """Return the range of some values in words.

    >>> range_text([4e-4, 8e-4], "um", "µm")
    '400 to 800 µm'
    >>> range_text([4e-4], "um", "µm")
    '400 µm'
    """
    ends = sorted(
        {f"{from_si(value, unit):.4g}": value for value in values}.items(),
        key=lambda end: end[1],
    )
    words = ends[0][0] if len(ends) == 1 else f"{ends[0][0]} to {ends[-1][0]}"
    return f"{words} {printed}"
