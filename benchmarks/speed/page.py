"""RESULTS.md: a run's results, rendered."""

from collections.abc import Sequence

from speed.record import QUOTED, Results, Row, Table

PICTURE = "static_solves.png"
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
    lines = ["# Speed", "", results.made, ""]
    lines += [QUICK, ""] if results.quick else []
    lines += [
        READ,
        "",
        *(f"- {name}: {words}" for name, words in results.machine.items()),
    ]
    lines += [
        f"- the run took {results.seconds / 60.0:.1f} minutes",
        "",
        "## Goals",
        "",
        *_goals(results),
        "",
    ]

    for name, table in results.tables.items():
        lines += [f"## {table.title}", "", *table_lines(table), ""]
        lines += (
            [f"![Error over time of the static solves]({PICTURE})", ""]
            if name == "static_solve"
            else []
        )

    return "\n".join(lines)


def table_lines(table: Table) -> list[str]:
    """Return a table, what holds for all of it above, what holds for single rows
    below.
    """
    if table.failed:
        return [f"**This part failed**: {table.failed}"]

    further = list(dict.fromkeys(name for row in table.rows for name in row.more))
    head = ["", "value", "spread", "beside it", "ratio", "goal", *further]
    rows = [
        [*_cells(row), *(_number(row.more.get(name)) for name in further)]
        for row in table.rows
    ]
    used = [
        place
        for place, name in enumerate(head)
        if not name or any(row[place] for row in rows)
    ]
    shown = [[row[place] for place in used] for row in (head, *rows)]
    notes = [f"- {row.what}: {words}" for row in table.rows if (words := _note(row))]

    return [table.settings, "", *_lines(shown), *([""] if notes else []), *notes]


def _goals(results: Results) -> list[str]:
    rows = [
        row
        for table in results.tables.values()
        for row in table.rows
        if row.goal is not None
    ]
    return _lines(
        [
            ["", "value", "spread", "beside it", "ratio", "goal"],
            *(_cells(row) for row in rows),
        ]
    )


def _cells(row: Row) -> list[str]:
    goal = "" if row.goal is None else f"{_number(row.goal)} {row.unit}"
    verdict = {True: ", met", False: ", **missed**", None: ""}[row.goal_met]
    value = "-" if row.value is None else f"{_number(row.value)} {row.unit}"
    return [
        row.what,
        f"{value} ({QUOTED})" if row.source else value,
        f"{_number(row.spread[0])} to {_number(row.spread[1])}" if row.spread else "",
        (
            f"{row.beside}: {_number(row.beside_value)} {row.unit}"
            if row.beside_value is not None
            else row.beside
        ),
        _number(row.ratio),
        goal + verdict if goal else "",
    ]


def _note(row: Row) -> str:
    return "; ".join(
        filter(None, (row.settings, f"{QUOTED}: {row.source}" if row.source else ""))
    )


def _number(value: float | None) -> str:
    """Return three digits, and thousands apart.

    >>> _number(0.12345), _number(43929.0), _number(12.0), _number(None)
    ('0.123', '43,929', '12', '')
    """
    if value is None:
        return ""
    return f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def _lines(rows: Sequence[Sequence[str]]) -> list[str]:
    head, *others = rows
    return [
        f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *others)
    ]
