"""Write figures and pages, whole or not at all."""

from pathlib import Path

from matplotlib.figure import Figure

from scleraforce.errors import InputError
from scleraforce.report.html import Html
from scleraforce.report.style import Kind, save
from scleraforce.whole_files import renamed_when_whole, write_whole

FIGURE_KINDS: dict[str, Kind] = {".png": "png", ".svg": "svg", ".pdf": "pdf"}


def write_page(content: Html, path: Path, *, overwrite: bool = False) -> None:
    """Write a page.

    Raises:
        InputError: the file exists and may not be overwritten, or its folder cannot be written to.
    """
    if path.exists() and not overwrite:
        raise InputError(f"{path}: exists already; remove it or choose another name")
    write_whole(content, path)


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, SVG or PDF, by the ending of `path`.

    Raises:
        InputError: another ending, or the folder cannot be written to.
    """
    kind = check_figure_path(path)
    with renamed_when_whole(path) as part:
        save(figure, part, kind)


def check_figure_path(path: Path) -> Kind:
    """Return which kind of file a figure's name asks for by its ending; known before there is a figure.

    Raises:
        InputError: it is none of .png, .svg, .pdf.
    """
    if path.suffix.lower() not in FIGURE_KINDS:
        raise InputError(f"{path}: give a name that ends in {', '.join(FIGURE_KINDS)}")
    return FIGURE_KINDS[path.suffix.lower()]
