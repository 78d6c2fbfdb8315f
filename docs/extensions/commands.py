"""Help texts of `sphinx_click` as plain text, so that `*.png` does not begin an
emphasis.
"""

from sphinx.application import Sphinx


def setup(app: Sphinx) -> dict[str, bool]:
    """Escape reStructuredText markup."""
    app.connect("sphinx-click-process-description", _as_text)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _as_text(_app: Sphinx, _command: object, lines: list[str]) -> None:
    lines[:] = [line.replace("*", r"\*") for line in lines]
