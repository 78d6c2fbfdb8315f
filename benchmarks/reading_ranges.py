"""The box "Will it read my data?" of README: the ranges of the bundled reader's study.

python benchmarks/reading_ranges.py     (`make ranges`)

writes it between its two marks; a test fails if it is out of date.
"""

from pathlib import Path

from scleraforce.reading.trained_ranges import reading_ranges

README = Path(__file__).parents[1] / "README.md"
BEGIN = "<!-- ranges: `make ranges` -->\n"
END = "<!-- end of ranges -->\n"


def box() -> str:
    """Return the box, with its marks."""
    rows = "".join(
        f"| {name} | {words} |\n" for name, words in reading_ranges(Path("default"))
    )
    return f"{BEGIN}| | `default` reads |\n|---|---|\n{rows}{END}"


def boxed(text: str) -> str:
    """Return a page with the box of today.

    Raises:
        ValueError: the page has no such marks.
    """
    before, _, rest = text.partition(BEGIN)
    _, found, after = rest.partition(END)
    if not found:
        raise ValueError(
            f"{README}: the marks {BEGIN.strip()} and {END.strip()} are not there"
        )

    return before + box() + after


if __name__ == "__main__":
    README.write_text(boxed(README.read_text(encoding="utf-8")), encoding="utf-8")
