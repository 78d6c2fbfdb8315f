"""What light meets in each pixel of a scene, filled layer by layer; its levels; and the rays that look into an eye."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.scenes.wall import Curve, Window
from scleraforce.segmentation.grid import Float
from scleraforce.study import SceneTissueStudy

ROUNDS = 5  # of the search for where a ray meets a curve


@dataclass(frozen=True)
class Rays:
    """The rays of a frame's columns below the tissue's first surface; all (column,), NaN where there is none.

    `surface_m`: depth of that surface. A ray goes `sideways` and `downwards` (a unit vector), and what lies at a length
    l along it is seen `stretch` l below the surface. `slope_rad`: the surface's angle against the lateral axis.
    """

    window: Window
    surface_m: Curve
    sideways: Curve
    downwards: Curve
    slope_rad: Curve
    stretch: float

    def apparent(self, height_m: Curve) -> Curve:
        """Return where a curve below the surface is seen, m below the frame's top edge, shape (column,).

        Args:
            height_m: the curve's depth at `window.grid_m`, NaN where it is not.
        """
        length_m = np.interp(self.window.lateral_m, self.window.grid_m, height_m) - self.surface_m
        for _ in range(ROUNDS):
            at_m = self.window.lateral_m + self.sideways * length_m
            length_m = (np.interp(at_m, self.window.grid_m, height_m) - self.surface_m) / self.downwards
        seen: Curve = self.surface_m + self.stretch * length_m
        return seen

    def seen_at(self, values: Curve, depth_m: Curve | float) -> Curve:
        """Return what stands at `window.grid_m` where the rays are so deep below the surface, shape (column,)."""
        at: Curve = np.interp(self.window.lateral_m + self.sideways * depth_m, self.window.grid_m, values)
        return at


def rays_below(height_m: Curve, window: Window, refractive_index: float) -> Rays:
    """Return the rays below a surface; an index of 1 leaves them straight: the scanner has corrected its picture.

    Snell's law: the part of a ray's direction along the surface is divided by the refractive index.
    """
    surface_m = np.interp(window.lateral_m, window.grid_m, height_m)
    slope = np.interp(window.lateral_m, window.grid_m, np.arctan(np.gradient(height_m, window.grid_m)))
    along = np.sin(slope) / refractive_index
    across = np.sqrt(1.0 - along**2)
    sideways = along * np.cos(slope) - across * np.sin(slope)
    downwards = along * np.sin(slope) + across * np.cos(slope)
    return Rays(window, surface_m, sideways, downwards, slope, refractive_index)


def heights(points: NDArray[np.float64], window: Window) -> Curve:
    """Return the depth of a curve from left to right at `window.grid_m`, NaN beyond its ends, shape (point,).

    Where it turns back it is bridged.
    """
    lateral_m = np.maximum.accumulate(points[:, 0])
    depth: Curve = np.interp(window.grid_m, lateral_m, points[:, 1], left=np.nan, right=np.nan)
    return depth


@dataclass(frozen=True)
class Ridge:
    """A thin bright curve: its row in the drawing (column,), NaN where it is not, intensity over the noise (column,).

    `sigma_rows` is its half width; one that is `shadowed` loses what the light has lost down to there.
    """

    row: Curve
    intensity: Curve
    sigma_rows: float
    shadowed: bool = True


@dataclass(frozen=True)
class Picture:
    """A drawing of (rows + above, columns) pixels.

    `scatter`: backscatter over the mean noise; `loss`: of the logarithm of the intensity in each pixel, both ways;
    `ridges` come on top.
    """

    window: Window
    scatter: Float
    loss: Float
    ridges: list[Ridge]

    @property
    def rows(self) -> Float:
        """The middles of the rows, shape (row, 1)."""
        rows: Float = np.arange(len(self.scatter), dtype=np.float32)[:, None] + np.float32(0.5)
        return rows

    def inside(self, top: Curve, bottom: Curve) -> NDArray[np.bool_]:
        """Return which pixels lie between two curves, given as rows (column,); none where one is NaN."""
        rows = self.rows
        within: NDArray[np.bool_] = (rows >= top.astype(np.float32)) & (rows < bottom.astype(np.float32))
        return within

    def fill(
        self, top: Curve, bottom: Curve, intensity: Curve | float, attenuation_per_m: float, stretch: float
    ) -> None:
        """Fill what lies between two curves (rows), in place of what was there.

        Args:
            top: upper edge, (column,).
            bottom: lower edge, (column,).
            intensity: backscatter over the mean noise, one or (column,).
            attenuation_per_m: of the light, one way.
            stretch: of optical over geometric depth.
        """
        within = self.inside(top, bottom)
        np.copyto(self.scatter, np.asarray(intensity, dtype=np.float32), where=within)
        loss = 2.0 * attenuation_per_m * self.window.pixel_m / stretch
        np.copyto(self.loss, np.float32(loss), where=within)

    def brighten(self, top: Curve, bottom: Curve, gain: Curve) -> None:
        """Multiply the backscatter between two curves (rows) by a gain, (column,) or (row, column)."""
        np.multiply(self.scatter, gain, out=self.scatter, where=self.inside(top, bottom), casting="same_kind")

    def shade(self, row: Curve, left: Curve) -> None:
        """Let only a share of the light (column,) pass beyond a row (column,)."""
        at = np.clip(np.nan_to_num(row, nan=0.0), 0, len(self.loss) - 1).astype(np.intp)
        self.loss[at, np.arange(self.loss.shape[1])] -= np.log(np.maximum(left, np.float32(1e-6)))


def empty_picture(window: Window) -> Picture:
    """Return a drawing with nothing in it."""
    shape = (window.rows + window.above, window.columns)
    return Picture(window, np.zeros(shape, dtype=np.float32), np.zeros(shape, dtype=np.float32), [])


def level(decibels: Curve | float) -> Curve:
    """Return ratios of intensities from dB."""
    ratio: Curve = np.power(10.0, np.asarray(decibels) / 10.0)
    return ratio


@dataclass(frozen=True, kw_only=True)
class Light:
    """What is drawn into a scene's tissue.

    `snr_db`: of the sclera at the surface over the mean noise; `stretch`: of optical over geometric depth.
    """

    study: SceneTissueStudy
    snr_db: float
    stretch: float
    rng: np.random.Generator

    def of(self, values_db: float | Curve) -> Curve:
        """Return intensities over the mean noise of levels against the sclera."""
        return level(self.snr_db + values_db)
