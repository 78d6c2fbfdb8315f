"""Text for a terminal: lines of at most 80 columns, without control characters."""

from textwrap import fill
from unicodedata import category


def printable(text: str) -> str:
    r"""Return a text with an escape for each character that a terminal would obey
    instead of showing it; lines stay lines.

    >>> print(printable("a\x1b]0;b\x07.png"))
    a\x1b]0;b\x07.png
    """
    if text.isascii() and text.isprintable():
        return text

    return "".join(
        letter
        if letter.isprintable() or letter == "\n" or category(letter) == "Zs"
        else letter.encode("unicode_escape").decode()
        for letter in text
    )


def wrapped(text: str, start: str = "") -> str:
    """Return a text at 80 columns, behind what starts its line."""
    if not text:
        return start.rstrip()

    return fill(
        text,
        80,
        initial_indent=start,
        subsequent_indent=" " * len(start),
        break_long_words=False,
        break_on_hyphens=False,
    )
