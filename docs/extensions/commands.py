"""What `sphinx_click` shows of a command: help is plain text, so that `*.png` in it begins no emphasis."""

from sphinx.application import Sphinx

__all__ = ["setup"]


def setup(app: Sphinx) -> dict[str, bool]:
    """Escape what reStructuredText would take for markup."""
    app.connect("sphinx-click-process-description", _as_text)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _as_text(_app: Sphinx, _command: object, lines: list[str]) -> None:
    lines[:] = [line.replace("*", r"\*") for line in lines]
