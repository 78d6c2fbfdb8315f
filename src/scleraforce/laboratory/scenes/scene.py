"""One scene by its number: a raw frame of a front eye, its scale, and where the wall truly is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.scenes.over import draw_over
from scleraforce.laboratory.scenes.picture import empty_picture
from scleraforce.laboratory.scenes.scanner import scanned
from scleraforce.laboratory.scenes.tissue import Tissue, draw_tissue
from scleraforce.laboratory.scenes.visible import judged_columns
from scleraforce.laboratory.scenes.wall import draw_wall
from scleraforce.laboratory.scenes.window import Window, draw_window
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.study import ScenesStudy

LEVEL_RAD = 0.03  # a surface that lies so nearly across the light reflects into the scanner


@dataclass(frozen=True)
class Scene:
    """A drawn frame and its truth.

    `frame`: counts (row, column), uint8 or uint16. `outer_row`, `inner_row` (column,): the wall's boundaries in rows of
    pixel centres, as `segmentation` counts them; they may lie outside of the frame, and are NaN where a column shows
    no wall. Behind a narrow shadow, or in a lost column, the wall goes on. `judged` (column,) is False where there is
    wall that nobody can see: such columns are neither right nor wrong.
    """

    frame: Pixels
    scale: PixelScale
    outer_row: NDArray[np.float64]
    inner_row: NDArray[np.float64]
    judged: NDArray[np.bool_]

    @property
    def mask(self) -> NDArray[np.uint8]:
        """255 in the rows whose centre lies in the wall, else 0, shape (row, column)."""
        row = np.arange(len(self.frame))[:, None]
        inside = (row >= self.outer_row) & (row < self.inner_row)
        return np.where(inside, 255, 0).astype(np.uint8)


def draw_scene(study: ScenesStudy, number: int) -> Scene:
    """Draw a scene: the same for the same study and number.

    Args:
        study: ranges of all that is drawn, and the seed.
        number: of the scene, not negative.

    >>> scene = draw_scene(ScenesStudy(), 3)
    >>> scene.outer_row.shape == scene.frame.shape[1:]
    True
    """
    rng = np.random.default_rng([study.seed, number])
    window = draw_window(study.window, rng)
    wall = draw_wall(study.eye, study.window, window, rng)
    picture = empty_picture(window)
    tissue = draw_tissue(study.tissue, wall, picture, rng)
    draw_over(study.over, tissue, wall.dent_m, picture, rng)
    shown = scanned(study.scanner, picture, _apex(tissue), rng)
    outer_row, inner_row = _truth(tissue, window, shown.imaged)
    surface_row = tissue.surface - window.above - 0.5
    seen, judged = judged_columns(shown.frame, surface_row, outer_row, inner_row)
    outer_row, inner_row = np.where(seen, outer_row, np.nan), np.where(seen, inner_row, np.nan)
    scale = PixelScale(lateral_m=window.step_m, depth_m=window.pixel_m, refractive_index=tissue.refractive_index)
    return Scene(shown.frame, scale, outer_row, inner_row, judged)


def _apex(tissue: Tissue) -> float | None:
    """Return the column where the surface lies across the light, None where it does nowhere."""
    slope = np.abs(tissue.rays.slope_rad)
    if not np.isfinite(slope).any() or np.nanmin(slope) > LEVEL_RAD:
        return None
    return float(np.nanargmin(slope))


def _truth(
    tissue: Tissue, window: Window, imaged: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the wall's boundaries in rows of pixel centres, NaN where a column shows none."""
    outer, inner = tissue.outer - window.above - 0.5, tissue.inner - window.above - 0.5
    shown = imaged & (outer < window.rows - 1) & (inner > 0.0) & (inner > outer)
    return np.where(shown, outer, np.nan), np.where(shown, inner, np.nan)
