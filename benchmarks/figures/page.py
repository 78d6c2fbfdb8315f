"""The tables of the figures in a page of the docs, between two marks."""

from pathlib import Path

from provenance.stamps import Stamp
from scleraforce.base.errors import InputError
from scleraforce.base.whole_files import write_whole

BEGIN = "<!-- made by `make figures`: begin -->"
END = "<!-- made by `make figures`: end -->"


def insert_tables(tables: str, stamp: Stamp, page: Path) -> None:
    """Replace the tables between a page's marks, with the line that says where the new
    ones are from.

    Raises:
        InputError: the page lacks a mark.
    """
    text = page.read_text(encoding="utf-8")
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        raise InputError(
            f"{page}: expected one line {BEGIN!r} and one {END!r} around the tables"
        )

    before, rest = text.split(BEGIN)
    write_whole(
        f"{before}{BEGIN}\n\n{stamp}\n\n{tables}\n{END}{rest.split(END)[1]}", page
    )
