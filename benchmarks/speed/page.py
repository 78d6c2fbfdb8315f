"""RESULTS.md: a run's results, rendered."""

from markdown_tables import markdown, number
from speed.record import QUOTED, Results, Row, Table

HEAD = ["", "value", "spread", "beside it", "ratio", "goal"]
QUICK = (
    "**A quick run: sizes are reduced, and the figures say only that every part"
    " works.**"
)
READ = """One run, without other work of ours. Seconds are this machine's; ratios carry
over to other machines: each figure over the one beside it, measured in turns unless
stated otherwise. Values are medians; the spread is from 10 to 90 % of the
repetitions."""


def as_markdown(results: Results) -> str:
    """Return the page."""
    tables = results.tables
    goals = [
        row for table in tables.values() for row in table.rows if row.goal is not None
    ]
    lines = ["# Speed", "", results.made, ""]
    lines += [QUICK, ""] if results.quick else []
    lines += [READ, ""]
    lines += [f"- {name}: {words}" for name, words in results.machine.items()]
    lines += [f"- the run took {results.seconds / 60.0:.1f} minutes", ""]
    lines += ["## Goals", "", markdown(HEAD, map(_cells, goals)), ""]
    for table in tables.values():
        lines += [f"## {table.title}", "", *table_lines(table), ""]

    return "\n".join(lines)


def table_lines(table: Table) -> list[str]:
    """Return a table, what holds for all of it above, what holds for single rows
    below.
    """
    if table.failed:
        return [f"**This part failed**: {table.failed}"]

    further = list(dict.fromkeys(name for row in table.rows for name in row.more))
    head = [*HEAD, *further]
    rows = [
        [*_cells(row), *(number(row.more.get(name)) for name in further)]
        for row in table.rows
    ]
    used = [
        column
        for column, name in enumerate(head)
        if not name or any(row[column] for row in rows)
    ]
    head, *rows = [[cells[column] for column in used] for cells in (head, *rows)]
    notes = [f"- {row.what}: {words}" for row in table.rows if (words := _note(row))]
    return [
        table.settings,
        "",
        markdown(head, rows),
        *([""] if notes else []),
        *notes,
    ]


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
