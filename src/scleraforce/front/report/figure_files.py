"""The common style of figures, and functions that draw an image and write a figure."""

import base64
import warnings
from collections.abc import Callable
from dataclasses import dataclass
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

from scleraforce.base.errors import InputError
from scleraforce.base.units import from_si
from scleraforce.base.whole_files import renamed_when_whole

BLUE = "#0072B2"
AMBER = "#E69F00"
RED = "#D55E00"
BLACK = "#222222"
GREY = "#8A8A8A"
# behind everything, of lines in the background, of a drawn wall
PAPER = "#FFFFFF"
FAINT = "#C9CED3"
TISSUE = "#E9EDF2"
CLASS_COLOURS = (BLUE, AMBER, RED)
CLASS_INKS = (BLUE, "#A06800", "#BF5300")  # the same, dark enough for letters on white
CLASS_MARKERS = ("o", "s", "^")
SCAN_COLOURS = "gray"
# on a B-scan, with AMBER: lines, letters, and the letters' edge
SKY = "#56B4E9"
LIGHT = "#F4F4F4"
SHADE = "#111111"

# An SVG's colours where the viewer prefers dark pages; others, and what is drawn on a
# B-scan, suit both.
DARK = {
    PAPER: "#14181C",
    BLACK: "#E3E7EA",
    BLUE: SKY,
    CLASS_INKS[1]: "#F0B02C",
    CLASS_INKS[2]: "#FF9D57",
    FAINT: "#5A646D",
    TISSUE: "#39424A",
}
_RULES = (
    f'[style*="{kind}: {light.lower()}"]{{{kind}:{dark}!important}}'
    for light, dark in DARK.items()
    for kind in ("fill", "stroke")
)
DARK_RULES = f"@media screen and (prefers-color-scheme: dark){{{''.join(_RULES)}}}"

Kind = Literal["png", "svg", "pdf"]
FIGURE_KINDS: dict[str, Kind] = {".png": "png", ".svg": "svg", ".pdf": "pdf"}
# entries of the metadata that are left out
LEFT_OUT: dict[Kind, str] = {
    "png": "Software",
    "svg": "Date",
    "pdf": "CreationDate",
}

STYLE = files("scleraforce.front.report").joinpath("figures.mplstyle")
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

    return (
        [entries[n] for n in np.linspace(0, len(entries) - 1, most).round().astype(int)]
        if most
        else []
    )


def last_letters(name: str, most: int) -> str:
    """Return a name, or its end after an ellipsis: the ends of frames' names differ.

    >>> last_letters("scan-of-monday-0001.png", 9)
    '…0001.png'
    """
    return name if len(name) <= most else f"…{name[1 - most :]}"


def show_image(
    axes: Axes, image: NDArray[Any], extent_m: tuple[float, float], **options: Any
) -> None:
    """Draw an image (row, column) to scale, in mm from its upper left corner;
    `extent_m` is its width and depth.
    """
    extent = (0.0, from_si(extent_m[0], "mm"), from_si(extent_m[1], "mm"), 0.0)
    axes.imshow(image, **{"cmap": SCAN_COLOURS, "extent": extent, **options})


def log_scale(axes: Axes, ticks: Locator | None = None) -> None:
    """Make the vertical axis logarithmic, with plain numbers."""
    axes.set_yscale("log")
    if ticks is not None:
        axes.yaxis.set_major_locator(ticks)
    axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def data_uri(content: bytes, media: str) -> str:
    """Return a file's content as an address that needs no network."""
    return f"data:{media};base64,{base64.b64encode(content).decode('ascii')}"


@dataclass(frozen=True)
class EncodedFigure:
    """A figure as addresses of its files: an SVG, and a PNG ("" for line art)."""

    svg: str
    png: str


def encode_figure(figure: Figure) -> EncodedFigure:
    """Return a figure as addresses of its files."""
    return EncodedFigure(svg_uri(figure), png_uri(figure))


def svg_uri(figure: Figure | EncodedFigure) -> str:
    """Return a figure as the address of an SVG."""
    if isinstance(figure, EncodedFigure):
        return figure.svg
    return data_uri(_encoded(figure, "svg"), "image/svg+xml")


def png_uri(figure: Figure | EncodedFigure) -> str:
    """Return a figure that has images as the address of a PNG; '' for line art."""
    if isinstance(figure, EncodedFigure):
        return figure.png

    has_image = any(axes.images for axes in figure.axes)
    return data_uri(_encoded(figure, "png"), "image/png") if has_image else ""


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, SVG or PDF, by the ending of `path`; raises
    `InputError`.
    """
    kind = check_figure_path(path)
    with renamed_when_whole(path) as part:
        part.write_bytes(_encoded(figure, kind))


def _encoded(figure: Figure, kind: Kind) -> bytes:
    """Return a figure's file under the common style, without a date: the same figure
    gives the same bytes.
    """
    content = BytesIO()
    with mpl.rc_context(fname=str(STYLE)), warnings.catch_warnings():
        # of a file's name: it is shown as a box
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        figure.savefig(content, format=kind, metadata={LEFT_OUT[kind]: None})

    found = content.getvalue()
    return (
        found.replace(b"</style>", f"{DARK_RULES}</style>".encode(), 1)
        if kind == "svg"
        else found
    )


def check_figure_path(path: Path) -> Kind:
    """Return a figure's format by the ending of its name; raises `InputError`."""
    if path.suffix.lower() not in FIGURE_KINDS:
        raise InputError(f"{path}: give a name that ends in {', '.join(FIGURE_KINDS)}")
    return FIGURE_KINDS[path.suffix.lower()]
