"""Text for a terminal: lines of at most 80 columns."""

from textwrap import fill


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
