"""The frame of a scene: its pixels and their size, and the rows above it that a scanner folds into it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scleraforce.study import SceneWindowStudy, draw
from scleraforce.study.fields import Sampled

Curve = NDArray[np.float64]

ABOVE_SHARE = 0.25  # of the frame's rows that are drawn above the zero delay, for what is mirrored from there
BEYOND_SHARE, GRID_POINTS = 0.35, 512  # of the frame's width that curves are known beyond it, at so many places


@dataclass(frozen=True, kw_only=True)
class Window:
    """A frame of `rows` x `columns` pixels, with `above` more rows over it.

    Lateral positions count from the frame's middle, depths from its top edge, both in m.
    """

    rows: int
    columns: int
    above: int
    width_m: float
    depth_m: float

    @property
    def pixel_m(self) -> float:
        """Size of a pixel along the depth, m."""
        return self.depth_m / self.rows

    @property
    def step_m(self) -> float:
        """Size of a pixel across, m."""
        return self.width_m / self.columns

    @cached_property
    def lateral_m(self) -> Curve:
        """Lateral position of each column, m."""
        column = np.arange(self.columns, dtype=np.float64)
        lateral_m: Curve = (column + 0.5) * self.step_m - self.width_m / 2
        return lateral_m

    @cached_property
    def grid_m(self) -> Curve:
        """Evenly spaced lateral positions that curves are kept at, m; they reach beyond the frame."""
        half_m = self.width_m * (0.5 + BEYOND_SHARE)
        grid_m: Curve = np.linspace(-half_m, half_m, GRID_POINTS)
        return grid_m

    def row(self, depth_m: Curve) -> Curve:
        """Return depths as rows of the drawing, those above the frame included; pixel r covers r to r + 1."""
        rows: Curve = depth_m / self.pixel_m + self.above
        return rows


def draw_window(study: SceneWindowStudy, rng: np.random.Generator) -> Window:
    """Draw a frame's size and pixels."""
    width_m = draw(study.width_m, rng)
    depth_m = width_m * draw_even_logarithm(study.depth_share, rng)
    finest_m, coarsest_m = study.pixel_m.bounds
    rows = round(min(max(draw(study.rows, rng), depth_m / coarsest_m), depth_m / finest_m))
    return Window(
        rows=rows,
        columns=round(draw(study.columns, rng)),
        above=round(ABOVE_SHARE * rows),
        width_m=width_m,
        depth_m=depth_m,
    )


def draw_even_logarithm(values: Sampled, rng: np.random.Generator) -> float:
    """Draw between the bounds of positive values, the logarithm even."""
    low, high = values.bounds
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
