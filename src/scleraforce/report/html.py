"""The few pieces of HTML that a page is made of, each as a function from text to escaped HTML.

A page is one file: the style sheet and all images stand inside, it fetches nothing, and it prints. A page to steer in
(`browser`, `eye_view`) has a script, which stands inside as well.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any, NewType

from scleraforce.plain_json import finite

Html = NewType("Html", str)

# Within a script element `<!--<script>` hides its end, and `</script>` is one; json.dumps escapes U+2028 itself.
JSON_ESCAPES = {ord(letter): f"\\u{ord(letter):04x}" for letter in "<>&"}
STACKED_COLUMNS, STACKED_SENTENCES = 7, 3  # from as many columns, a table's rows become blocks on a narrow screen
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
    remarks: bool = False,
) -> Html:
    """Return a table; the first column names the rows. Where a screen is too narrow for columns, rows become blocks.

    Args:
        head: the columns' titles.
        rows: the cells.
        caption: what the table shows.
        marked: cells (row, column) that stand out.
        prose: whether the cells hold sentences, to be set flush left.
        remarks: whether those of the last column do.
    """
    classes = dict.fromkeys(marked, "marked")
    if remarks:
        classes |= {(number, len(head) - 1): "words" for number in range(len(rows))}
    top = "".join(
        f'<th scope="col"{_class("words" if remarks and entry is head[-1] else "")}>{text(entry)}</th>'
        for entry in head
    )
    body = "".join(_row(number, row, head, classes) for number, row in enumerate(rows))
    stacked = "stacked" if len(head) >= (STACKED_SENTENCES if prose else STACKED_COLUMNS) else ""
    return Html(
        f'<div class="table"><table{_class("prose" if prose else "", stacked)}><caption>{text(caption)}</caption>'
        f"<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _row(number: int, row: Sequence[object], head: Sequence[str], classes: Mapping[tuple[int, int], str]) -> str:
    """Return a row; each cell carries its column's title, for where the row becomes a block."""
    first, *rest = (text(entry) for entry in row)
    cells = (
        f'<td data-title="{escape(title)}"{_class(classes.get((number, column), ""))}>{entry}</td>'
        for column, (title, entry) in enumerate(zip(head[1:], rest, strict=True), start=1)
    )
    return f'<tr><th scope="row">{first}</th>{"".join(cells)}</tr>'


def _class(*names: str) -> str:
    """Return the attribute of the names that are not empty."""
    chosen = " ".join(name for name in names if name)
    return f' class="{chosen}"' if chosen else ""


def figure(source: str, alternative: str, caption: str) -> Html:
    """Return an image (its data URI) with a caption; `alternative` says what it shows to who cannot see it."""
    return Html(
        f'<figure><img src="{escape(source)}" alt="{escape(alternative)}">'
        f"<figcaption>{text(caption)}</figcaption></figure>"
    )


def gallery(pictures: Iterable[tuple[str, str, str]], marked: Iterable[int] = ()) -> Html:
    """Return small pictures side by side.

    Args:
        pictures: the data URI of each, its name, and what is to be said of it.
        marked: numbers of the pictures that stand out.
    """
    stand_out = set(marked)
    items = (
        f"<figure{_class('marked' if number in stand_out else '')}>"
        f'<img src="{escape(source)}" alt="{escape(f"{name}: {words}")}">'
        f"<figcaption><b>{text(name)}</b> {text(words)}</figcaption></figure>"
        for number, (source, name, words) in enumerate(pictures)
    )
    return Html(f'<div class="gallery">{"".join(items)}</div>')


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


def embedded(name: str, data: Mapping[str, Any]) -> Html:
    r"""Return data that a script reads from the element of a name; numbers that are not finite become null.

    No text in it ends the element or begins another one: what HTML gives a meaning to is escaped as JSON allows.

    >>> embedded("said", {"word": "</script>"})
    '<script type="application/json" id="said">{"word":"\\u003c/script\\u003e"}</script>'
    """
    content = json.dumps(finite(data), allow_nan=False, separators=(",", ":")).translate(JSON_ESCAPES)
    return Html(f'<script type="application/json" id="{escape(name)}">{content}</script>')


def page(title: str, lead: str, stamp: str, *sections: Html, style: str = "", script: str = "") -> Html:
    """Return a whole page.

    Args:
        title: its heading.
        lead: what it is about, in a sentence or two.
        stamp: what made it, and when.
        sections: what follows.
        style: rules beside those of every page.
        script: what runs when the page is there.
    """
    steered = f"<script>\n{script}</script>" if script else ""
    return Html(
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{text(title)}</title><style>\n{STYLE_SHEET}{style}</style></head>\n"
        f"<body><main><header><h1>{text(title)}</h1><p>{text(lead)}</p>"
        f'<p class="stamp">{text(stamp)}</p></header>\n' + "\n".join(sections) + f"</main>{steered}</body></html>\n"
    )
