"""What a display shows of the light: its logarithm, its root, or itself; from how speckle spreads where it is brighter.

The intensity of fully developed speckle, noise included, is exponential: light of twice the mean is the same
distribution, stretched (Goodman, Speckle Phenomena in Optics, ch. 3). On a logarithmic display that is a shift, and the
counts spread alike wherever they lie; on one of roots or of the intensity itself their spread grows in proportion to
the count, by a slope that neither gain nor offset of the display changes. Quartiles and medians, of blocks of the wall,
stand for standard deviations and means: they do not see what the display cuts off.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import theilslopes

from scleraforce.scanner.estimate import Estimate, Unmeasured, fitted, level_db
from scleraforce.scanner.imaged_eye import ImagedEye

BLOCK_M = (100e-6, 3e-3)  # of the wall, along the depth and across it: light hardly changes, speckle does often
NARROWEST_SHARE = 0.25  # of a narrow frame a block has at most
LEAST_FILLED = 0.6  # of a block lies in the wall
LEAST_BLOCKS = 10
ONE_DEVIATION = 0.68  # of the slopes between two blocks
QUARTILES = (0.25, 0.5, 0.75)


@dataclass(frozen=True, kw_only=True)
class DisplayKind:
    """What counts grow with: `shown` of an intensity, and `level_db` of what is shown, the intensity's level."""

    name: str
    shown: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    level_db: Callable[[NDArray[np.float64]], NDArray[np.float64]]

    @property
    def spread_slope(self) -> float:
        """By how much the quartiles of one look part where its median grows by one count."""
        low, middle, high = self.shown(-np.log1p(-np.array(QUARTILES)))
        twice = self.shown(-2.0 * np.log1p(-np.array(QUARTILES)))
        return float((twice[2] - twice[0] - (high - low)) / (twice[1] - middle))


LOGARITHMIC = DisplayKind(name="logarithmic", shown=level_db, level_db=np.copy)
DISPLAY_KINDS: Mapping[str, DisplayKind] = {
    kind.name: kind
    for kind in (
        LOGARITHMIC,
        DisplayKind(name="root", shown=np.sqrt, level_db=lambda shown: level_db(np.maximum(shown, 0.0) ** 2)),
        DisplayKind(name="linear", shown=np.copy, level_db=level_db),
    )
}
MOST_ERROR = DISPLAY_KINDS["root"].spread_slope / 6.0  # a third of the way from one kind to the middle of two


def spread_slope(eye: ImagedEye) -> Estimate | Unmeasured:
    """Return how much farther the quartiles of a frame's speckle part, in counts, where its median is one count higher.

    Of one look it is 0 on a logarithmic display, 0.77 on one of roots, 1.58 on a linear one.
    """
    blocks = [block for block in _blocks(eye) if np.quantile(block, 0.1) > 0.0 and np.quantile(block, 0.9) < eye.top]
    if len(blocks) < LEAST_BLOCKS:
        return Unmeasured("too little of the wall lies within the display")
    low, middle, high = np.array([np.quantile(dithered(block), QUARTILES) for block in blocks]).T
    slope, _, least, most = theilslopes(high - low, middle, ONE_DEVIATION)
    return fitted(slope, (most - least) / 2.0, MOST_ERROR, "the wall's light is too even to tell the display's scale")


def display_kind(slopes: Sequence[Estimate | Unmeasured]) -> DisplayKind:
    """Return the kind of the display whose frames have these slopes: a logarithmic one where none could be told."""
    known = [slope.value for slope in slopes if isinstance(slope, Estimate)]
    if not known:
        return LOGARITHMIC
    found = float(np.median(known))
    return min(DISPLAY_KINDS.values(), key=lambda kind: abs(kind.spread_slope - found))


def dithered(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return whole counts, half a count spread evenly about each: their quantiles are no steps."""
    spread: NDArray[np.float64] = counts + (np.arange(len(counts)) % 16 / 16.0 - 0.5 + 1 / 32)
    return spread


def _blocks(eye: ImagedEye) -> list[NDArray[np.float64]]:
    """Return the counts of a frame's wall, block by block, away from its boundaries."""
    inside = eye.inside
    rows = max(4, round(BLOCK_M[0] / eye.scale.depth_m))
    columns = max(8, min(round(BLOCK_M[1] / eye.scale.lateral_m), round(NARROWEST_SHARE * inside.shape[1])))
    row, column = np.nonzero(inside)
    number = np.floor(eye.below_surface_rows[inside] / rows).astype(np.intp) * inside.shape[1] + column // columns
    order = np.argsort(number, kind="stable")
    starts = np.unique(number[order], return_index=True)[1][1:]
    counts = eye.pixels[row, column].astype(np.float64)[order]
    return [block for block in np.split(counts, starts) if len(block) >= LEAST_FILLED * rows * columns]
