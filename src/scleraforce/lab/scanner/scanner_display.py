"""A measured frame of an eye at rest, its display, and the air above the tissue, whose
noise tells light from counts.

Detector noise has an exponential intensity on any scanner: its quantiles are -ln(1 - p)
times the mean (Goodman, Speckle Phenomena in Optics, ch. 3). A line through the
quantiles of the counts, over their values on a display of a known kind
(`display_kind`), gives gain and offset, also where the display cuts off darker pixels.
If a scanner averages frames, the noise spreads less but the wall's speckle does not: on
a logarithmic display the speckle then gives the scale and the noise the number of
averaged looks; on other displays averaged noise looks like an offset, which is refused.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, curve_fit
from scipy.signal import find_peaks, savgol_filter
from scipy.stats import gamma, linregress, ncx2, sigmaclip, theilslopes

from scleraforce.base.arrays import Flags, Floats, Places
from scleraforce.base.errors import FrameError
from scleraforce.base.normal_distribution import robust_spread
from scleraforce.lab.tissue_light import ReflectionLine, amplitude_sigma
from scleraforce.records.frame import Pixels
from scleraforce.records.scan import PixelScale
from scleraforce.wall.frame_light import imaged_columns
from scleraforce.wall.wall import Segmentation


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A value in SI and its standard error; `at_most`: it is an upper bound."""

    value: float
    error: float = 0.0
    at_most: bool = False


@dataclass(frozen=True)
class Unmeasured:
    """The reason why a value could not be measured."""

    reason: str


Measured = Estimate | Unmeasured


def estimate_or_reason(
    value: float, error: float, most: float, reason: str
) -> Measured:
    """Return a fit's value if its standard error is small enough, else the reason."""
    if isfinite(value) and isfinite(error) and error <= most:
        return Estimate(value=float(value), error=float(error))
    return Unmeasured(reason)


def fitted_curve(
    model: Callable[..., Floats],
    at: NDArray[Any],
    seen: Floats,
    start: Sequence[float] | Floats,
    **options: Any,
) -> tuple[Floats, Floats] | None:
    """Return the parameters of a curve and their standard errors; None if no curve
    fits.
    """
    try:
        value, covariance = curve_fit(model, at, seen, start, **options)
    except (RuntimeError, ValueError):
        return None
    return value, np.sqrt(np.diag(covariance))


def level_db(intensity: Floats) -> Floats:
    """Return intensities in dB."""
    return 10.0 * np.log10(np.maximum(intensity, 1e-12))


# lateral smoothing of the surface: an eye at rest is smoother than its speckle
SMOOTH_M = 0.6e-3
# what a boundary's own light and its error reach
EDGE_ROWS = 4
EDGE_M = 20e-6
# below the surface there is wall, where the inner boundary is not seen
UNSEEN_M = 0.4e-3


@dataclass(frozen=True, eq=False)
class ImagedEye:
    """A frame, `pixels` (row, column) of `bits` bits, and its `wall`."""

    name: str
    pixels: Pixels
    scale: PixelScale
    bits: int
    wall: Segmentation

    @property
    def top(self) -> int:
        """The largest count that the display has."""
        return int(2**self.bits - 1)

    @property
    def edge_rows(self) -> int:
        """Rows on both sides of a boundary that measurements beside it leave out."""
        return EDGE_ROWS + round(EDGE_M / self.scale.depth_m)

    @property
    def row_m(self) -> float:
        """Depth in tissue, m, of one row: geometric, not optical."""
        return self.scale.depth_m / self.scale.refractive_index

    @cached_property
    def bands(self) -> tuple[int, int]:
        """Columns that are black at the left and at the right side."""
        imaged = imaged_columns(self.pixels)
        if imaged is None:
            raise FrameError(f"{self.name}: the frame is empty: all pixels are alike")
        return imaged[0], self.pixels.shape[1] - imaged[1]

    @cached_property
    def walled(self) -> Flags:
        """The columns that show the wall, (column,)."""
        return np.isfinite(self.wall.outer_row) & np.isfinite(self.wall.inner_row)

    @cached_property
    def surface_row(self) -> Floats:
        """The smoothed surface, (column,), NaN where there is no wall."""
        columns = np.flatnonzero(self.walled)
        every = np.arange(columns[0], columns[-1] + 1)
        window = max(5, round(SMOOTH_M / self.scale.lateral_m) | 1)
        row = np.interp(every, columns, self.wall.outer_row[columns])
        smooth = np.full(len(self.walled), np.nan)
        smooth[every] = (
            savgol_filter(row, window, 2, mode="interp") if len(row) > window else row
        )
        smooth[~self.walled] = np.nan

        return smooth

    @cached_property
    def slope_rad(self) -> Floats:
        """Angle between the surface and the frame's rows, (column,)."""
        ratio = self.scale.depth_m / self.scale.lateral_m
        return np.abs(np.arctan(np.gradient(self.surface_row) * ratio))

    @cached_property
    def below_surface_rows(self) -> Floats:
        """Rows of each pixel below the surface, (row, column)."""
        return np.arange(len(self.pixels), dtype=np.float64)[:, None] - self.surface_row

    @cached_property
    def inside(self) -> Flags:
        """The pixels in the wall, away from its boundaries, (row, column)."""
        inside: Flags = (self.below_surface_rows >= self.edge_rows) & (
            self.below_inner_rows < -self.edge_rows
        )
        if not self.wall.inner_found:
            inside &= self.below_surface_rows * self.row_m < UNSEEN_M
        return inside & (self.pixels > 0).any(axis=0)

    @cached_property
    def below_inner_rows(self) -> Floats:
        """Rows of each pixel below the inner boundary, (row, column)."""
        return (
            np.arange(len(self.pixels), dtype=np.float64)[:, None] - self.wall.inner_row
        )


# blocks of the wall, along the depth and across it: light hardly changes within one,
# speckle does often
BLOCK_M = (
    100e-6,
    3e-3,
)
NARROWEST_SHARE = 0.25  # of a narrow frame a block has at most
LEAST_FILLED = 0.6  # of a block lies in the wall
LEAST_BLOCKS = 10
ONE_DEVIATION = 0.68  # of the slopes between two blocks
QUARTILES = (0.25, 0.5, 0.75)


@dataclass(frozen=True, kw_only=True)
class DisplayKind:
    """A display's law: counts grow with `shown` of an intensity; `level_db` of that is
    the intensity's level.
    """

    name: str
    shown: Callable[[Floats], Floats]
    level_db: Callable[[Floats], Floats]

    @property
    def spread_slope(self) -> float:
        """The growth of one look's interquartile range for each count of its median."""
        low, middle, high = self.shown(-np.log1p(-np.array(QUARTILES)))
        twice = self.shown(-2.0 * np.log1p(-np.array(QUARTILES)))
        return float((twice[2] - twice[0] - (high - low)) / (twice[1] - middle))


LOGARITHMIC = DisplayKind(name="logarithmic", shown=level_db, level_db=np.copy)
ROOT = DisplayKind(
    name="root",
    shown=np.sqrt,
    level_db=lambda shown: level_db(np.maximum(shown, 0.0) ** 2),
)
LINEAR = DisplayKind(name="linear", shown=np.copy, level_db=level_db)
DISPLAY_KINDS = {kind.name: kind for kind in (LOGARITHMIC, ROOT, LINEAR)}
# Misfit of noise: one look has less than 0.1 on its own kind, over 0.6 on others; more
# looks over 0.3.
ONE_LOOK_DB = 0.2
# a third of the way from one kind to the middle of two
MOST_ERROR = ROOT.spread_slope / 6.0


def spread_slope(eye: ImagedEye) -> Measured:
    """Return the growth of the speckle's interquartile range, in counts, for each count
    of its median.

    For one look it is 0 on a logarithmic display, 0.77 on one of roots, 1.58 on a
    linear one.
    """
    blocks = [
        block
        for block in _blocks(eye)
        if np.quantile(block, 0.1) > 0.0 and np.quantile(block, 0.9) < eye.top
    ]
    if len(blocks) < LEAST_BLOCKS:
        return Unmeasured("too little of the wall lies within the display")

    low, middle, high = np.array(
        [np.quantile(dithered(block), QUARTILES) for block in blocks]
    ).T
    slope, _, least, most = theilslopes(high - low, middle, ONE_DEVIATION)

    return estimate_or_reason(
        slope,
        (most - least) / 2.0,
        MOST_ERROR,
        "the wall's light is too even to tell the display's scale",
    )


def display_kind(slopes: Sequence[Measured], eyes: Sequence[ImagedEye]) -> DisplayKind:
    """Return the display's kind by slopes; without any, the one on which the noise has
    one look, else logarithmic.
    """
    known = [slope.value for slope in slopes if isinstance(slope, Estimate)]
    if not known:
        kinds = DISPLAY_KINDS.values()
        misfits_db = {
            np.median([_scale(air_counts(eye), eye, kind)[2] for eye in eyes]): kind
            for kind in kinds
        }

        return (
            misfits_db[least]
            if (least := min(misfits_db)) < ONE_LOOK_DB
            else LOGARITHMIC
        )

    found = float(np.median(known))
    return min(DISPLAY_KINDS.values(), key=lambda kind: abs(kind.spread_slope - found))


def dithered(counts: Floats) -> Floats:
    """Return whole counts spread evenly over half a count to each side, so that their
    quantiles have no steps.
    """
    return counts + (np.arange(len(counts)) % 16 / 16.0 - 0.5 + 1 / 32)


def _blocks(eye: ImagedEye) -> list[Floats]:
    """Return the counts of a frame's wall, block by block, away from its boundaries."""
    inside = eye.inside
    rows = max(4, round(BLOCK_M[0] / eye.scale.depth_m))
    columns = max(
        8,
        min(
            round(BLOCK_M[1] / eye.scale.lateral_m),
            round(NARROWEST_SHARE * inside.shape[1]),
        ),
    )
    row, column = np.nonzero(inside)
    number = (
        np.floor(eye.below_surface_rows[inside] / rows).astype(np.intp)
        * inside.shape[1]
        + column // columns
    )
    order = np.argsort(number, kind="stable")
    starts = np.unique(number[order], return_index=True)[1][1:]
    counts = eye.pixels[row, column].astype(np.float64)[order]

    return [
        block
        for block in np.split(counts, starts)
        if len(block) >= LEAST_FILLED * rows * columns
    ]


# median of an exponential intensity over its mean
MEDIAN_DB = float(10.0 * np.log10(np.log(2.0)))
# between the quartiles of an exponential: 6.8
QUARTILES_DB = float(10.0 * np.log10(np.log(4.0) / np.log(4.0 / 3.0)))
BLOCK = (8, 16)  # rows and columns of the air that are looked at together
CLIPS = (5.0, 3.0)  # standard deviations: darker and brighter blocks are not noise
# quantiles of the noise that tell the scale
LOWEST = 0.1
HIGHEST = 0.95
SHARES = 35
MOST_CUT = 0.8  # of the noise may lie below the display
BLACK_SHARE = 0.98  # of a block is black: it lies outside of the picture
GROUPS = 4  # of columns, whose differences tell how sure the scale is
LEAST_PIXELS = 1000
LOOKS = (0.05, 1e7)  # of the noise: what is looked for
LEAST_COUNTS = 2  # between the quartiles of the noise: less may be rounding
DARKEST_DB = -30.0  # stands for darkness at count 0
# of the root of the mean noise, or of itself: darkness with more has an offset
MOST_OFFSET = 0.3


@dataclass(frozen=True, kw_only=True)
class Display:
    """The scale of a display."""

    kind: DisplayKind
    floor_db: Estimate  # intensity of count 0 over the mean noise
    range_db: Estimate  # from there to the largest count, `top`
    top: int
    # of the noise to an exponential intensity: below about 0.3 the scale is right
    misfit_db: float
    looks: float = 1.0  # that are averaged in the noise

    def levels(self, counts: NDArray[np.generic]) -> Floats:
        """Return counts as levels in dB over the mean noise."""
        ends_db = np.array([self.floor_db.value, self.highest_db])
        least, most = self.kind.shown(10.0 ** (ends_db / 10.0))
        return self.kind.level_db(
            least + counts.astype(np.float64) * ((most - least) / self.top)
        )

    @property
    def highest_db(self) -> float:
        """Level of the largest count."""
        return self.floor_db.value + self.range_db.value


def air_counts(eye: ImagedEye) -> Floats:
    """Return a frame's noise: its counts, (row, column), NaN but in the empty blocks
    above the tissue.
    """
    rows, columns = BLOCK
    left, right = eye.bands
    high = eye.pixels.shape[0] // rows * rows
    width = (eye.pixels.shape[1] - left - right) // columns * columns
    part = slice(left, left + width)
    counts = eye.pixels[:high, part].astype(np.float64)
    above = eye.below_surface_rows[:high, part] < -eye.edge_rows
    blocks, air = (
        each.reshape(high // rows, rows, width // columns, columns).swapaxes(1, 2)
        for each in (counts, above)
    )

    inside = air.all(axis=(2, 3)) & ((blocks == 0).mean(axis=(2, 3)) <= BLACK_SHARE)
    if np.count_nonzero(inside) * rows * columns < LEAST_PIXELS:
        raise FrameError(
            f"{eye.name}: too little noise is seen above the tissue to know the"
            " display's scale; give frames with more room there, or with a lower"
            " display floor"
        )

    middle = blocks.mean(axis=(2, 3))
    _, least, most = sigmaclip(middle[inside], *CLIPS)
    inside &= (middle >= least) & (middle <= most)
    kept = np.repeat(np.repeat(inside, rows, axis=0), columns, axis=1)
    noise = np.full(eye.pixels.shape, np.nan)
    noise[:high, part] = np.where(kept, counts, np.nan)

    return noise


def fit_display(eye: ImagedEye, kind: DisplayKind) -> Display:
    """Find the scale of a frame's display of a kind."""
    noise = air_counts(eye)
    lit = noise[:, np.isfinite(noise).any(axis=0)]
    parts = [
        part
        for part in np.array_split(lit, GROUPS, axis=1)
        if np.isfinite(part).sum() > LEAST_PIXELS
    ]
    groups = [_scale(part, eye, kind) for part in parts]

    per_unit, zero, misfit = _scale(lit, eye, kind)
    if kind is not LOGARITHMIC and zero > MOST_OFFSET * per_unit:
        raise FrameError(
            f"{eye.name}: the wall's speckle spreads as on a {kind.name} display, and"
            " its noise lies above count 0, as if it were averaged: such frames cannot"
            " be measured, nor frames with an offset (subtract it)"
        )

    scatter = np.array(
        [_ends_db(kind, group[0], group[1], eye.top) for group in groups]
    )
    errors = (
        scatter.std(axis=0, ddof=1) / np.sqrt(len(scatter))
        if len(scatter) > 1
        else np.array([1.0, 1.0])
    )
    ends = zip(_ends_db(kind, per_unit, zero, eye.top), errors.tolist(), strict=True)
    floor_db, range_db = (Estimate(value=value, error=error) for value, error in ends)

    return Display(
        kind=kind, floor_db=floor_db, range_db=range_db, top=eye.top, misfit_db=misfit
    )


def display_of_speckle(eye: ImagedEye, display: Display, spread: float) -> Display:
    """Return a logarithmic scale on which the wall's speckle spreads `spread` times
    less, as one look does.
    """
    counts = air_counts(eye)
    range_db = display.range_db.value / spread
    low_db, median_db, high_db = np.quantile(counts[np.isfinite(counts)], QUARTILES) * (
        range_db / eye.top
    )

    def wider_db(
        looks: float,
    ) -> float:
        # the interquartile range of the mean of a number of looks over the noise's
        return float(
            10.0 * np.log10(gamma.ppf(0.75, looks) / gamma.ppf(0.25, looks))
        ) - float(high_db - low_db)

    looks = float(brentq(wider_db, *LOOKS, rtol=1e-6))
    floor_db = float(10.0 * np.log10(gamma.median(looks) / looks) - median_db)
    floor = Estimate(value=floor_db, error=display.floor_db.error / spread)
    wide = Estimate(value=range_db, error=display.range_db.error / spread)

    return replace(
        display,
        floor_db=floor,
        range_db=wide,
        misfit_db=display.misfit_db / spread,
        looks=looks,
    )


def _ends_db(
    kind: DisplayKind, per_unit: float, zero: float, top: int
) -> tuple[float, float]:
    """Return the level of count 0 over the mean noise, and from there to the largest
    count, dB.
    """
    floor_db, top_db = kind.level_db((np.array([0.0, top]) - zero) / per_unit)
    floor_db = max(floor_db, DARKEST_DB) if kind is not LOGARITHMIC else floor_db
    return float(floor_db), float(top_db - floor_db)


def _scale(
    noise: Floats, eye: ImagedEye, kind: DisplayKind
) -> tuple[float, float, float]:
    """Return counts for each unit of shown intensity, the count of darkness, and the
    misfit, dB.
    """
    counts = noise[np.isfinite(noise)]
    cut = float(np.mean(counts <= 0))
    if cut > MOST_CUT:
        raise FrameError(
            f"{eye.name}: {cut:.0%} of the noise above the tissue is black: the"
            " display's floor hides it; show the frames with a lower floor"
        )

    share = np.linspace(max(LOWEST, cut + 0.02), HIGHEST, SHARES)
    expected = kind.shown(-np.log1p(-share))
    found = np.quantile(dithered(counts), share)
    line = linregress(expected, found)

    if np.subtract(*np.quantile(counts, (0.75, 0.25))) < LEAST_COUNTS:
        raise FrameError(
            f"{eye.name}: the air above the tissue is of one colour: there is no noise"
            " in it to measure"
        )

    misfit = np.std(found - line.intercept - line.slope * expected) / line.slope
    misfit_db = misfit * np.std(LOGARITHMIC.shown(-np.log1p(-share))) / np.std(expected)
    return float(line.slope), float(line.intercept), float(misfit_db)


LEAST_SHARE = 0.5  # of the imaged columns must show air in a row that is looked at
# over the noise, in dB and in the other rows' deviations
LINE_DB = 1.5
LINE_SDS = 6.0
REACH = 8  # rows about a line that are fitted
# standard deviation of the amplitude, rows
NARROWEST = 0.4
WIDEST = 4.0


def find_lines(eye: ImagedEye, display: Display) -> tuple[ReflectionLine, ...]:
    """Return the lines across a frame, in rows with enough columns of air."""
    air = (eye.below_surface_rows < -2 * eye.edge_rows) & (eye.pixels > 0).any(axis=0)
    imaged = air.shape[1] - sum(eye.bands)
    rows = np.flatnonzero(air.sum(axis=1) >= LEAST_SHARE * imaged)
    if len(rows) < 2 * REACH:
        return ()

    rows = np.arange(rows[0], rows[-1] + 1)
    levels = np.where(air[rows], display.levels(eye.pixels[rows]), np.nan)
    level_db = np.nanmedian(levels, axis=1) - MEDIAN_DB
    level_db = np.nan_to_num(level_db - np.nanmedian(level_db))
    deviation = robust_spread(np.abs(level_db))
    peaks, _ = find_peaks(
        level_db, height=max(LINE_DB, LINE_SDS * deviation), distance=REACH
    )
    # light over the mean noise, of a median level
    mirrored = np.concatenate([[0.0], np.geomspace(1e-2, 1e5, 400)])
    median_db = 10.0 * np.log10(ncx2.median(2, 2.0 * mirrored) / 2.0) - MEDIAN_DB
    light = np.interp(level_db, median_db, mirrored)
    found = [_fitted_line(eye, rows, light, int(peak)) for peak in peaks]

    return tuple(line for line in found if line is not None)


def _fitted_line(
    eye: ImagedEye, rows: Places, light: Floats, peak: int
) -> ReflectionLine | None:
    """Return the line at a peak of the rows' light over the noise; None if it is too
    wide.
    """
    near = slice(max(peak - REACH, 0), peak + REACH + 1)
    found = fitted_curve(
        lambda row, middle, gain, sigma: (
            gain * np.exp(-(((row - middle) / sigma) ** 2))
        ),
        rows[near],
        light[near],
        (float(rows[peak]), light[peak], 1.0),
        bounds=(
            (rows[peak] - 2.0, 0.0, NARROWEST / 2),
            (rows[peak] + 2.0, np.inf, 2 * WIDEST),
        ),
    )
    if found is None or found[0][2] > WIDEST:
        return None

    row, gain, sigma = map(float, found[0])
    thickness_m = max(sigma, NARROWEST) / amplitude_sigma(1.0) * eye.scale.depth_m
    return ReflectionLine(
        depth_m=(row + 0.5) * eye.scale.depth_m,
        level_db=float(10.0 * np.log10(gain)),
        thickness_m=thickness_m,
    )
