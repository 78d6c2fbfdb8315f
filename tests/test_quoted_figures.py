"""The README quotes the tables of docs/figures.md."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
FIT, PAPER = "The reader's fit (default), the eye's E", "The paper's: linear, E of the population"
COLUMNS = ("right class, %", "force error, mN", "intervals hold, %", "class 2 read as 0")


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


def figures() -> dict[str, dict[str, dict[str, str]]]:
    """Return the tables of docs/figures.md: method -> group -> heading -> cell, without goals."""
    found: dict[str, dict[str, dict[str, str]]] = {}
    rows, head = {}, []
    for line in (ROOT / "docs" / "figures.md").read_text(encoding="utf-8").splitlines():
        if title := re.fullmatch(r"\*\*(.+)\*\*", line):
            rows, head = found.setdefault(title[1], {}), []
        elif not line and head:  # the end of a table
            rows, head = {}, []
        elif line.startswith("| ") and not line.startswith("| ---"):
            head = head or cells(line)
            rows[cells(line)[0]] = dict(zip(head, (re.sub(r" \(.*", "", cell) for cell in cells(line)), strict=False))
    return found


def test_the_readme_quotes_the_figures_of_the_page() -> None:
    fit, paper = figures()[FIT], figures()[PAPER]
    readme = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    quoted = {
        row[0].split(":")[0]: row[1:] for row in map(cells, readme) if len(row) == 6 and row[0].split(":")[0] in fit
    }
    assert len(quoted) >= 3
    for group, (right, error, held, harmless, papers) in quoted.items():
        stated = [right.removesuffix(" %"), error.removesuffix(" mN"), held.removesuffix(" %"), harmless]
        assert stated == [fit[group][column] for column in COLUMNS], group
        assert papers.removesuffix(" %") == paper[group][COLUMNS[0]], group
