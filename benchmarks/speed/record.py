"""Results of a benchmark: rows of a table, printed, stored as JSON and read back."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

QUOTED = "not of this run"


@dataclass(frozen=True, kw_only=True)
class Row:
    """One figure.

    Attributes:
        what: the figure's name.
        value: in `unit`, the median where it was taken several times; None: not
            measured, and `settings` say why.
        unit: "s", "ms".
        spread: 10 % and 90 % of the times.
        beside: what one would use instead, measured in turns with it, with its value in
            the same unit.
        goal: at most so much.
        settings: in words.
        source: where the value is from, if it is not of this run.
        more: further figures of the same thing, by their column.
    """

    what: str
    value: float | None
    unit: str
    spread: tuple[float, float] | None = None
    beside: str = ""
    beside_value: float | None = None
    goal: float | None = None
    settings: str = ""
    source: str = ""
    more: Mapping[str, float | None] = field(default_factory=dict)

    @property
    def ratio(self) -> float | None:
        """Ratio to the value beside it."""
        if self.value is None or not self.beside_value:
            return None
        return self.value / self.beside_value

    @property
    def goal_met(self) -> bool | None:
        """True if the goal is met; None without a goal or a value."""
        return (
            None if self.goal is None or self.value is None else self.value <= self.goal
        )


@dataclass(frozen=True)
class Table:
    """Rows that belong together, and what holds for all of them, in words; `failed`
    says why there are none.
    """

    title: str
    settings: str
    rows: tuple[Row, ...]
    failed: str = ""


@dataclass(frozen=True, kw_only=True)
class Results:
    """A whole run: when, where, from which code, how long it took; its tables by the
    part that made them.
    """

    made: str
    quick: bool
    machine: Mapping[str, str]
    seconds: float
    tables: Mapping[str, Table]

    def as_json(self) -> dict[str, Any]:
        """Return plain values."""
        return asdict(self)

    @classmethod
    def from_json(cls, plain: Mapping[str, Any]) -> "Results":
        """Return the results that were kept as JSON."""
        tables = {name: table_of(found) for name, found in plain["tables"].items()}
        return cls(**{**plain, "tables": tables})


def table_of(plain: Mapping[str, Any]) -> Table:
    """Return a table that was kept as JSON."""
    rows = (
        Row(**row | {"spread": row["spread"] and tuple(row["spread"])})
        for row in plain["rows"]
    )
    return Table(**{**plain, "rows": tuple(rows)})


def failed_table(name: str, words: str) -> Table:
    """Return the table of a part that failed."""
    return Table(name.replace("_", " ").capitalize(), "", (), words)


def spread(times: Sequence[float]) -> dict[str, Any]:
    """Return `value` and `spread` of a row; one value has no spread.

    >>> spread([3.0, 1.0, 2.0])["value"], spread([3.0])
    (2.0, {'value': 3.0, 'spread': None})
    """
    low, middle, high = np.quantile(times, (0.1, 0.5, 0.9)).tolist()
    return {"value": middle, "spread": (low, high) if len(times) > 1 else None}


def rows_beside(
    times: Mapping[str, Sequence[float]],
    beside: str,
    unit: str,
    *,
    settings: Mapping[str, str],
    goals: Mapping[str, float] | None = None,
    more: Mapping[str, Mapping[str, float | None]] | None = None,
) -> tuple[Row, ...]:
    """Return a row of each thing's times, and in it the median of the thing beside, if
    that was timed.
    """
    other = spread(times[beside])["value"] if beside in times else None
    return tuple(
        Row(
            what=name,
            unit=unit,
            **spread(found),
            beside=beside if other is not None and name != beside else "",
            beside_value=other if name != beside else None,
            goal=(goals or {}).get(name),
            settings=settings.get(name, ""),
            more=(more or {}).get(name, {}),
        )
        for name, found in times.items()
    )
