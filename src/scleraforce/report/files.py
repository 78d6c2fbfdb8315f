"""How figures look, and how figures and pages are written."""

import base64
from collections.abc import Callable
from functools import wraps
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Literal, ParamSpec

import matplotlib as mpl
from matplotlib.figure import Figure

from scleraforce.errors import InputError
from scleraforce.whole_files import renamed_when_whole, write_whole

if TYPE_CHECKING:
    from scleraforce.report.html import Html

BLUE, AMBER, RED, BLACK, GREY = "#0072B2", "#E69F00", "#D55E00", "#222222", "#8A8A8A"
CLASS_COLOURS = (BLUE, AMBER, RED)
CLASS_INKS = (BLUE, "#A06800", "#BF5300")  # the same, dark enough for letters on white
CLASS_MARKERS = ("o", "s", "^")
SCAN_COLOURS = "gray"

Kind = Literal["png", "svg", "pdf"]
UNDATED: dict[Kind, dict[str, str | None]] = {
    "png": {"Software": None},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}

STYLE: dict[str, object] = {
    "axes.edgecolor": BLACK,
    "axes.grid": False,
    "axes.labelcolor": BLACK,
    "axes.labelsize": 8,
    "axes.linewidth": 0.6,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 8,
    "figure.constrained_layout.use": True,
    "figure.dpi": 200,
    "font.family": "DejaVu Sans",
    "font.size": 7.5,
    "image.interpolation": "antialiased",
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "lines.linewidth": 1.1,
    "pdf.fonttype": 42,  # letters that journals can search and edit
    "savefig.facecolor": "white",
    "svg.fonttype": "path",
    "svg.hashsalt": "scleraforce",
    "text.parse_math": False,  # a frame may be called `$\\frac$.png`; formulas ask for it
    "xtick.direction": "out",
    "xtick.labelsize": 7.5,
    "xtick.major.width": 0.6,
    "ytick.labelsize": 7.5,
    "ytick.major.width": 0.6,
}

Arguments = ParamSpec("Arguments")


def styled(draw: Callable[Arguments, Figure]) -> Callable[Arguments, Figure]:
    """Run a drawing function under the common style."""

    @wraps(draw)
    def drawn(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Figure:
        with mpl.rc_context(STYLE):  # type: ignore[arg-type]  # matplotlib types the keys as literals
            return draw(*args, **kwargs)

    return drawn


def inches(width_mm: float, height_mm: float) -> tuple[float, float]:
    """Return a figure's size as matplotlib wants it; a page is 170 mm wide."""
    return width_mm / 25.4, height_mm / 25.4


def save(figure: Figure, target: Path | BytesIO, kind: Kind) -> None:
    """Write a figure under the common style, without a date: the same figure gives the same bytes."""
    with mpl.rc_context(STYLE):  # type: ignore[arg-type]  # as above
        figure.savefig(target, format=kind, metadata=UNDATED[kind])


def data_uri(figure: Figure, kind: Literal["png", "svg"] = "png") -> str:
    """Return a figure as text that stands in a page's `src`: line art as SVG, images as PNG."""
    content = BytesIO()
    save(figure, content, kind)
    media = "image/svg+xml" if kind == "svg" else "image/png"
    return f"data:{media};base64,{base64.b64encode(content.getvalue()).decode('ascii')}"


FIGURE_KINDS: dict[str, Kind] = {".png": "png", ".svg": "svg", ".pdf": "pdf"}


def write_page(content: "Html", path: Path, *, overwrite: bool = False) -> None:
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
