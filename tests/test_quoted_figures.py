"""The README quotes the tables of docs/figures.md as they stand there."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
FIT, PAPER = "the reader's fit (default), the eye's E", "the paper's: linear, E of the population"
COLUMNS = ("class accuracy, all frames", "force error, mN", "90 % intervals that hold", "class 2 read as 0")


def cells(line: str) -> list[str]:
    """The cells of a row of a table; all but the first without their counts."""
    first, *others = (cell.strip() for cell in line.strip("|").split("|"))
    return [first, *(re.sub(r" \(.*", "", cell) for cell in others)]


def figures() -> dict[str, dict[str, dict[str, str]]]:
    """What docs/figures.md says: group -> method -> heading -> cell."""
    found: dict[str, dict[str, dict[str, str]]] = {}
    group, head = "", []
    for line in (ROOT / "docs" / "figures.md").read_text(encoding="utf-8").splitlines():
        if title := re.match(r"\*\*(\w+) eyes\*\*", line):
            group, head = title[1], []
            found[group] = {}
        elif line.startswith("|") and group:
            head = head or cells(line)
            if "force error, mN" in head and len(cells(line)) == len(head):
                found[group][cells(line)[0]] = dict(zip(head, cells(line), strict=True))
    return {name: methods for name, methods in found.items() if methods}


def test_the_readme_quotes_the_figures_of_the_page() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    rows = {row[0].split(":")[0]: row[1:] for row in map(cells, readme) if row[0].split(":")[0] in figures()}
    assert set(rows) == set(figures())
    for group, (right, error, held, harmless, paper) in rows.items():
        methods = figures()[group]
        fit = [methods[FIT][column] for column in COLUMNS]
        assert [right, error.removesuffix(" mN"), held, harmless.replace("none", "0")] == fit, group
        assert paper == methods[PAPER][COLUMNS[0]], group
