"""The README quotes the tables of docs/figures.md as they stand there."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
FIT, PAPER = "the reader's fit (default), the eye's E", "the paper's: linear, E of the population"


def rows(page: Path) -> list[list[str]]:
    """The cells of every row of a page's tables."""
    lines = page.read_text(encoding="utf-8").splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")]


def figures(method: str) -> list[dict[str, str]]:
    """What docs/figures.md says of a method, for plain and for harder eyes: heading -> cell without its counts."""
    found, head = [], []
    for row in rows(ROOT / "docs" / "figures.md"):
        head = row if "force error, mN" in row else head
        if row[0] == method:
            found.append(dict(zip(head, (re.sub(r" \(.*", "", cell) for cell in row), strict=True)))
    return found


def quoted(start: str) -> list[str]:
    """The two cells of the README's row that starts so."""
    (row,) = [row for row in rows(ROOT / "README.md") if row[0].startswith(start)]
    return row[1:]


def test_the_readme_quotes_the_figures_of_the_page() -> None:
    fit, paper = figures(FIT), figures(PAPER)
    assert len(fit) == len(paper) == 2
    assert quoted("frames in the right class, the reader") == [group["class accuracy, all frames"] for group in fit]
    assert quoted("mean error of the force") == [f"{group['force error, mN']} mN" for group in fit]
    harmless = [group["class 2 read as 0"] for group in fit]
    assert quoted("forces above 30 mN read as harmless") == ["none" if count == "0" else count for count in harmless]
    assert quoted("the paper's linear method") == [group["class accuracy, all frames"] for group in paper]
