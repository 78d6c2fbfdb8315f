"""State diagrams as tables: GitHub draws `mermaid` blocks with a script, which a page
without a network has not.
"""

import re

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

ARROW = re.compile(r"\s*(\S+) --> (\w+)(?:: (.*))?")
HEAD = ("state", "next state", "on")


class StateTable(Directive):
    """A row for each arrow of a `stateDiagram-v2`."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the table; any line but an arrow is an error."""
        kind, *lines = (line for line in self.content if line.strip())
        arrows = [ARROW.fullmatch(line) for line in lines]
        if kind != "stateDiagram-v2" or None in arrows:
            raise self.error(
                "mermaid: only the arrows of a stateDiagram-v2 are shown here"
            )
        rows = [
            (one[1].replace("[*]", "(start)"), one[2], one[3] or "")
            for one in arrows
            if one
        ]
        return [_table([HEAD, *rows])]


def setup(app: Sphinx) -> dict[str, bool]:
    """Read `mermaid` blocks."""
    app.add_directive("mermaid", StateTable)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _table(rows: list[tuple[str, ...]]) -> nodes.table:
    group = nodes.tgroup("", *(nodes.colspec(colwidth=1) for _ in HEAD), cols=len(HEAD))
    group += nodes.thead("", _row(rows[0]))
    group += nodes.tbody("", *(_row(row) for row in rows[1:]))
    return nodes.table("", group)


def _row(cells: tuple[str, ...]) -> nodes.row:
    return nodes.row(
        "", *(nodes.entry("", nodes.paragraph(text=cell)) for cell in cells)
    )
