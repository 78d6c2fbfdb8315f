"""The common style of figures, and functions that draw an image and write a figure."""

import base64
import warnings
from collections.abc import Callable
from functools import wraps
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, Locator, NullFormatter
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.units import from_si
from scleraforce.whole_files import renamed_when_whole

BLUE, AMBER, RED, BLACK, GREY = "#0072B2", "#E69F00", "#D55E00", "#222222", "#8A8A8A"
CLASS_COLOURS = (BLUE, AMBER, RED)
CLASS_INKS = (BLUE, "#A06800", "#BF5300")  # the same, dark enough for letters on white
CLASS_MARKERS = ("o", "s", "^")
SCAN_COLOURS = "gray"

Kind = Literal["png", "svg", "pdf"]
FIGURE_KINDS: dict[str, Kind] = {".png": "png", ".svg": "svg", ".pdf": "pdf"}
LEFT_OUT: dict[Kind, str] = {"png": "Software", "svg": "Date", "pdf": "CreationDate"}  # of the metadata

STYLE = files("scleraforce.report").joinpath("figures.mplstyle")
Arguments = ParamSpec("Arguments")
Entry = TypeVar("Entry")


def styled(draw: Callable[Arguments, Figure]) -> Callable[Arguments, Figure]:
    """Run a drawing function under the common style."""

    @wraps(draw)
    def drawn(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Figure:
        with mpl.rc_context(fname=str(STYLE)):
            return draw(*args, **kwargs)

    return drawn


def inches(width_mm: float, height_mm: float) -> tuple[float, float]:
    """Return a figure's size as matplotlib wants it; a page is 170 mm wide."""
    return width_mm / 25.4, height_mm / 25.4


def evenly(entries: list[Entry], most: int) -> list[Entry]:
    """Return at most `most` of some entries, in even steps."""
    if len(entries) <= most:
        return entries
    return [entries[n] for n in np.linspace(0, len(entries) - 1, most).round().astype(int)] if most else []


def show_image(axes: Axes, image: NDArray[Any], extent_m: tuple[float, float], **options: Any) -> None:
    """Draw an image (row, column) to scale, in mm from its upper left corner; `extent_m` is its width and depth."""
    extent = (0.0, from_si(extent_m[0], "mm"), from_si(extent_m[1], "mm"), 0.0)
    axes.imshow(image, **{"cmap": SCAN_COLOURS, "extent": extent, **options})


def log_scale(axes: Axes, ticks: Locator | None = None) -> None:
    """Make the vertical axis logarithmic, with plain numbers."""
    axes.set_yscale("log")
    if ticks is not None:
        axes.yaxis.set_major_locator(ticks)
    axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def data_uri(figure: Figure, kind: Literal["png", "svg"] = "png") -> str:
    """Return a figure as the `src` of an image in a page: line art as SVG, images as PNG."""
    content = BytesIO()
    _save(figure, content, kind)
    media = "image/svg+xml" if kind == "svg" else "image/png"
    return f"data:{media};base64,{base64.b64encode(content.getvalue()).decode('ascii')}"


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, SVG or PDF, by the ending of `path`; raises `InputError`."""
    kind = check_figure_path(path)
    with renamed_when_whole(path) as part:
        _save(figure, part, kind)


def _save(figure: Figure, target: Path | BytesIO, kind: Kind) -> None:
    """Write a figure under the common style, without a date: the same figure gives the same bytes."""
    with mpl.rc_context(fname=str(STYLE)), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")  # of a file's name: it is shown as a box
        figure.savefig(target, format=kind, metadata={LEFT_OUT[kind]: None})


def check_figure_path(path: Path) -> Kind:
    """Return a figure's format by the ending of its name; raises `InputError`."""
    if path.suffix.lower() not in FIGURE_KINDS:
        raise InputError(f"{path}: give a name that ends in {', '.join(FIGURE_KINDS)}")
    return FIGURE_KINDS[path.suffix.lower()]
