"""Tables of figures as Markdown, for a terminal and for a page alike."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain

import numpy as np

QUANTILES = ("n", "median", "99 %", "99.9 %", "max")


def markdown(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table.

    >>> print(markdown(["what", "ms"], [["a", 0.12345], ["b", None]]))
    | what | ms |
    | --- | --- |
    | a | 0.123 |
    | b |  |
    """
    return "\n".join(lines(head, rows))


def lines(head: Sequence[str], rows: Iterable[Sequence[object]]) -> Iterator[str]:
    """Yield the lines of a table, each as soon as its row is there."""
    for cells in chain([head, ["---"] * len(head)], rows):
        yield f"| {' | '.join(map(_cell, cells))} |"


def number(value: float | None) -> str:
    """Return three digits, with a comma between thousands; "" for None.

    >>> number(0.12345), number(43929.0), number(12.0), number(None)
    ('0.123', '43,929', '12', '')
    """
    if value is None:
        return ""
    return f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def quantiles_ms(values_s: Iterable[float]) -> dict[str, float | None]:
    """Return number, median, 99 %, 99.9 % and maximum of times in s, in ms; None where
    there is nothing.

    >>> quantiles_ms([1e-3, 2e-3, 3e-3])["median"], quantiles_ms([])["max"]
    (2.0, None)
    """
    found_ms = 1e3 * np.fromiter(values_s, dtype=np.float64)
    if not len(found_ms):
        return dict.fromkeys(QUANTILES, None) | {"n": 0}

    shares = np.quantile(found_ms, (0.5, 0.99, 0.999, 1.0)).tolist()
    return dict(zip(QUANTILES, [len(found_ms), *shares], strict=True))


def _cell(value: object) -> str:
    if value is None or isinstance(value, float):
        return number(value)
    return str(value)
