"""How a scanner sees what lies below a surface: rays bend there (Snell), and light needs longer in tissue."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.scenes.window import Curve, Window

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
