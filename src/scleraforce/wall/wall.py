"""The result of a segmentation: the wall with a verdict, or the reason why it was not
found; and its picture.
"""

from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Bytes, Flags, Floats, Places
from scleraforce.base.notebook_cards import grey_picture, html_card
from scleraforce.base.units import from_si
from scleraforce.records.frame import Pixels
from scleraforce.wall.needle_in_frame import SeenNeedle

WALL = 255
LEAST_CONTRAST = 0.6  # of the surface, in standard deviations of a pixel's noise
LEAST_COVER = 0.4  # of the imaged width must show the wall
# share of the frame at (nearly) the largest count: saturated
SATURATED_SHARE = 0.4
SATURATED_LEVEL = 0.99
# share of the brightest count: a frame that stands out of its noise by less is empty
EMPTY_SHARE = 1e-3
# below the surface: the mask ends here where the inner boundary cannot be seen
UNSEEN_DEPTH_M = 1e-3


@dataclass(frozen=True)
class SeenWall:
    """The wall in a frame, at evenly spaced columns (point,); rows of pixel centres."""

    column: Floats  #: of the frame
    outer_row: Floats  #: upper boundary
    inner_row: Floats  #: lower boundary
    outer_sd: Floats  #: of the rows
    inner_sd: Floats  #: of the rows
    there: Flags  #: has wall; elsewhere the rows say nothing
    step_rows: float  #: of the frame in one of the reduced frame

    @property
    def frame_column(self) -> Places:
        """The frame's column that lies nearest to each point."""
        return np.rint(self.column).astype(np.intp)

    def there_at(self, column: NDArray[Any]) -> Flags:
        """Return whether the nearest point to each column has wall."""
        there: Flags = self.there[
            np.abs(self.column[None] - column[:, None]).argmin(axis=1)
        ]
        return there


@dataclass(frozen=True, eq=False)
class BothWalls:
    """The wall by each method: `classical` (`first` is the one on top of a
    conjunctiva), and the network's.

    `disagreement`: the largest difference in multiples of the largest usable one; above
    1 the frame is refused, or its inner boundary is not used.
    """

    classical: "Segmentation"
    first: "Segmentation"
    network: SeenWall
    disagreement: float


@dataclass(frozen=True)
class Segmentation:
    """The wall in one frame: boundaries (column,) in rows of pixel centres, NaN without
    wall or behind a needle.

    It covers rows r with outer_row <= r < inner_row; boundaries may lie beyond the last
    of the frame's `rows`.
    """

    outer_row: Floats
    inner_row: Floats
    rows: int
    usable: bool  #: a wall was found that can be judged
    reason: str  #: why it is not usable
    # : if not, the inner boundary cannot be seen, and the mask ends 1 mm below the
    # surface
    inner_found: bool
    _: KW_ONLY
    # : median along the surface's normal, NaN if the inner boundary was not found
    thickness_m: float
    needle: SeenNeedle | None = None  #: that crosses the frame
    # : median thickness of a layer over the wall, along its normal, if one is seen
    conjunctiva_m: float | None = None
    methods: BothWalls | None = None  #: the wall by each, if a network looked as well
    # : "found" in the frame, or given, as a "mask" or "corrected" in the recording
    source: str = "found"
    # : why the inner boundary is not used, although the surface is; '': it is used, or
    # no edge shows it
    inner_doubt: str = ""
    sd_rows: float = 0.0  #: standard deviation of given boundaries
    # : the frame, of `sf.segment` and `sf.read`
    pixels: Pixels | None = field(default=None, compare=False, repr=False)

    def __repr__(self) -> str:
        shown = (
            ""
            if self.thickness_m != self.thickness_m
            else f"wall of {from_si(self.thickness_m, 'um'):.0f} µm, "
        )
        return (
            "<Segmentation:"
            f" {shown}{'usable' if self.usable else f'not usable: {self.reason}'}>"
        )

    def _repr_html_(self) -> str:
        """The frame, or its mask, with the wall, for Jupyter."""
        facts = {
            "thickness": f"{from_si(self.thickness_m, 'um'):.0f} µm",
            "usable": self.reason or "yes",
        }
        return html_card("Wall", facts, self.overlay)

    @property
    def boundaries(self) -> str:
        """Which boundaries forces are read from: "both", or "surface"."""
        return "both" if self.inner_found else "surface"

    @property
    def overlay(self) -> Bytes:
        """The frame, or its mask without one, with the boundaries; see
        `draw_overlay`.
        """
        return draw_overlay(self.mask if self.pixels is None else self.pixels, self)

    @cached_property
    def mask(self) -> Bytes:
        """255 in the rows whose centre lies in the wall, else 0, shape (row, column);
        computed lazily.
        """
        row = np.arange(self.rows, dtype=np.float32)[:, None]
        # NaN compares as False: no wall
        inside = (row >= self.outer_row) & (row < self.inner_row)
        return inside.view(np.uint8) * np.uint8(WALL)


def without_wall(
    shape: tuple[int, ...], reason: str, needle: SeenNeedle | None = None
) -> Segmentation:
    """Return the result for a frame that shows no wall."""
    outer, inner = np.full((2, shape[1]), np.nan)
    return Segmentation(
        outer,
        inner,
        shape[0],
        False,
        reason,
        False,
        thickness_m=float("nan"),
        needle=needle,
    )


def surface_fault(seen: int, points: int, contrast: float, noise: float) -> str:
    """Return why a surface that `seen` of `points` points show cannot be judged, or '';
    `noise` is of a pixel.
    """
    if not seen:
        return "no wall was found"
    if contrast < LEAST_CONTRAST * noise:
        return (
            f"the signal is too weak: the surface stands out by {contrast / noise:.1f}"
            f" times the noise, not {LEAST_CONTRAST}"
        )

    cover = seen / points
    if cover < LEAST_COVER:
        return f"the wall covers {cover:.0%} of the imaged width, not {LEAST_COVER:.0%}"

    return ""


# The console's and the app's colours: orange, sky blue, purple; blue, green, red, as
# OpenCV has them.
SURFACE = (0, 159, 230)
INNER = (233, 180, 86)
SHAFT = (167, 121, 204)
DASHES = 40  # of an inner boundary that is not seen, with the gaps between them
SUBPIXEL_BITS = 4


def draw_overlay(
    pixels: Pixels, found: Segmentation, size: tuple[int, int] | None = None
) -> Bytes:
    """Return a frame in colour with its boundaries: surface orange, inner blue (dashed
    if not seen), needle purple.

    The picture, of `size` or the frame's, is (row, column, 3), blue, green, red, as
    OpenCV writes it.
    """
    rows, columns = size or pixels.shape
    grey = grey_picture(pixels)
    if grey.shape != (rows, columns):
        method = cv2.INTER_AREA if rows * columns < grey.size else cv2.INTER_LINEAR
        grey = np.asarray(
            cv2.resize(grey, (columns, rows), interpolation=method), dtype=np.uint8
        )

    picture = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    stretch_xy = np.array([columns / pixels.shape[1], rows / pixels.shape[0]])
    width = max(1, max(rows, columns) // 240)
    lines = []
    gaps = np.arange(len(found.inner_row)) * DASHES // len(found.inner_row) % 2 == 1
    inner_row = (
        found.inner_row
        if found.inner_found
        else np.where(gaps, np.nan, found.inner_row)
    )

    for boundary, colour in ((inner_row, INNER), (found.outer_row, SURFACE)):
        there = np.flatnonzero(np.isfinite(boundary))
        runs = np.split(there, np.flatnonzero(np.diff(there) > 1) + 1)
        lines += [(np.stack([run, boundary[run]], axis=1), colour) for run in runs]

    if found.needle is not None:
        lines.append((np.array([found.needle.top, found.needle.tip]), SHAFT))

    for places_xy, colour in lines:
        centres_xy = (places_xy + 0.5) * stretch_xy - 0.5
        points = np.rint(centres_xy * 2**SUBPIXEL_BITS).astype(np.int32)
        cv2.polylines(
            picture, [points], False, colour, width, cv2.LINE_AA, SUBPIXEL_BITS
        )

    return np.asarray(picture, dtype=np.uint8)
