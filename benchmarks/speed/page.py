"""RESULTS.md: a run's results, rendered."""

from markdown_tables import markdown, number
from speed.record import QUOTED, Results, Row, Table

HEAD = ["", "value", "spread", "beside it", "ratio", "goal", "last release", "factor"]
QUICK = (
    "**A quick run: sizes are reduced, and the figures say only that every part"
    " works.**"
)
READ = """One run, without other work of ours. Seconds are this machine's; ratios carry
over to other machines: each figure over the one beside it, measured in turns unless
stated otherwise. Values are medians; the spread is from 10 to 90 % of the
repetitions."""
LAST = """The last release's ratio, or its value where nothing is beside it, is of its
own run: {made} The factor is that by which it is less now; of values without a ratio it
is one of two machines."""


def as_markdown(results: Results, released: Results | None = None) -> str:
    """Return the page; `released`: what the last release took."""
    tables = results.tables
    last = _Last(released)
    goals = [
        (name, row)
        for name, table in tables.items()
        for row in table.rows
        if row.goal is not None
    ]
    lines = ["# Speed", "", results.made, ""]
    lines += [QUICK, ""] if results.quick else []
    lines += [READ, ""]
    if released is not None:
        lines += [LAST.format(made=released.made.strip("*")), ""]
    lines += [f"- {name}: {words}" for name, words in results.machine.items()]
    lines += [f"- the run took {results.seconds / 60.0:.1f} minutes", ""]
    goal_rows = [[*_cells(row), *last.cells(name, row)] for name, row in goals]
    lines += ["## Goals", "", markdown(*_used(HEAD, goal_rows)), ""]
    for name, table in tables.items():
        lines += [f"## {table.title}", "", *table_lines(table, name, last), ""]

    return "\n".join(lines)


class _Last:
    """What the last release took, None: there was none."""

    def __init__(self, released: Results | None = None) -> None:
        self._rows = {
            (name, row.what): row
            for name, table in (released.tables if released else {}).items()
            for row in table.rows
        }

    def cells(self, name: str, row: Row) -> list[str]:
        """Return the release's ratio or value of a part's row, and the factor since."""
        before = self._rows.get((name, row.what))
        if before is None or row.source or None in (before.value, row.value):
            return ["", ""]

        if row.ratio and before.ratio and row.beside == before.beside:
            return [number(before.ratio), number(before.ratio / row.ratio)]
        assert before.value
        assert row.value
        return [_with_unit(before.value, before), number(before.value / row.value)]


def table_lines(table: Table, name: str = "", last: _Last | None = None) -> list[str]:
    """Return a table, what holds for all of it above, what holds for single rows
    below.
    """
    last = last or _Last()
    if table.failed:
        return [f"**This part failed**: {table.failed}"]

    further = list(dict.fromkeys(column for row in table.rows for column in row.more))
    head, rows = _used(
        [*HEAD, *further],
        [
            [
                *_cells(row),
                *last.cells(name, row),
                *(number(row.more.get(column)) for column in further),
            ]
            for row in table.rows
        ],
    )
    notes = [f"- {row.what}: {words}" for row in table.rows if (words := _note(row))]
    return [
        table.settings,
        "",
        markdown(head, rows),
        *([""] if notes else []),
        *notes,
    ]


def _used(head: list[str], rows: list[list[str]]) -> tuple[list[str], list[list[str]]]:
    """Return a table's head and rows without the columns that are empty."""
    used = [
        column
        for column, title in enumerate(head)
        if not title or any(row[column] for row in rows)
    ]
    head, *rows = [[cells[column] for column in used] for cells in (head, *rows)]
    return head, rows


def _cells(row: Row) -> list[str]:
    met = {True: ", met", False: ", **missed**", None: ""}[row.goal_met]
    value = _with_unit(row.value, row) or "-"
    return [
        row.what,
        f"{value} ({QUOTED})" if row.source else value,
        " to ".join(map(number, row.spread or ())),
        _joined(": ", row.beside, _with_unit(row.beside_value, row)),
        number(row.ratio),
        "" if row.goal is None else _with_unit(row.goal, row) + met,
    ]


def _with_unit(value: float | None, row: Row) -> str:
    return "" if value is None else f"{number(value)} {row.unit}"


def _note(row: Row) -> str:
    return _joined("; ", row.settings, row.source and f"{QUOTED}: {row.source}")


def _joined(between: str, *words: str) -> str:
    return between.join(filter(None, words))
