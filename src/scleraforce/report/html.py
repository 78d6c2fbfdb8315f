"""The few pieces of HTML that a page is made of, each as a function from text to escaped HTML.

A page is one file: the style sheet and all images stand inside, there is no script, and it prints.
"""

from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from typing import NewType

__all__ = ["Html", "bullets", "cards", "figure", "notice", "page", "paragraph", "section", "table", "text"]

Html = NewType("Html", str)

STYLE_SHEET = files("scleraforce.report").joinpath("page.css").read_text(encoding="utf-8")


def text(content: object) -> Html:
    """Return a value as escaped text; what is HTML already stays as it is only through the other functions."""
    return Html(escape(str(content)))


def paragraph(content: str) -> Html:
    """Return a paragraph of plain text."""
    return Html(f"<p>{text(content)}</p>")


def notice(content: str) -> Html:
    """Return a paragraph that must not be missed."""
    return Html(f'<p class="notice">{text(content)}</p>')


def bullets(entries: Iterable[str]) -> Html:
    """Return a list of plain texts."""
    return Html("<ul>" + "".join(f"<li>{text(entry)}</li>" for entry in entries) + "</ul>")


def table(
    head: Sequence[str],
    rows: Sequence[Sequence[object]],
    caption: str,
    marked: Iterable[tuple[int, int]] = (),
    *,
    prose: bool = False,
) -> Html:
    """Return a table; the first column names the rows.

    Args:
        head: the columns' titles.
        rows: the cells.
        caption: what the table shows.
        marked: cells (row, column) that stand out.
        prose: whether the cells hold sentences, to be set flush left.
    """
    stand_out = set(marked)
    top = "".join(f'<th scope="col">{text(entry)}</th>' for entry in head)
    body = "".join(_row(row, {c for r, c in stand_out if r == number}) for number, row in enumerate(rows))
    kind = ' class="prose"' if prose else ""
    return Html(
        f'<div class="table"><table{kind}><caption>{text(caption)}</caption>'
        f"<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _row(row: Sequence[object], marked: set[int]) -> str:
    first, *rest = (text(entry) for entry in row)
    cells = (f"<td{' class=marked' if n in marked else ''}>{entry}</td>" for n, entry in enumerate(rest, start=1))
    return f'<tr><th scope="row">{first}</th>{"".join(cells)}</tr>'


def figure(source: str, alternative: str, caption: str) -> Html:
    """Return an image (its data URI) with a caption; `alternative` says what it shows to who cannot see it."""
    return Html(
        f'<figure><img src="{escape(source)}" alt="{escape(alternative)}">'
        f"<figcaption>{text(caption)}</figcaption></figure>"
    )


def cards(entries: Iterable[tuple[str, str, str]]) -> Html:
    """Return the figures that matter most, side by side: value, what it is, a remark."""
    boxes = (
        f'<div class="card"><b>{text(value)}</b><span>{text(name)}</span><small>{text(remark)}</small></div>'
        for value, name, remark in entries
    )
    return Html(f'<div class="cards">{"".join(boxes)}</div>')


def section(title: str, *blocks: Html) -> Html:
    """Return a section of a page."""
    return Html(f"<section><h2>{text(title)}</h2>{''.join(blocks)}</section>")


def page(title: str, lead: str, *sections: Html) -> Html:
    """Return a whole page."""
    return Html(
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{text(title)}</title><style>\n{STYLE_SHEET}</style></head>\n"
        f"<body><main><header><h1>{text(title)}</h1><p>{text(lead)}</p></header>\n"
        + "\n".join(sections)
        + "</main></body></html>\n"
    )
