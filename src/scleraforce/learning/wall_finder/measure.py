"""How well a wall finder does on drawn scenes that no training saw, through the code that runs it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.scenes.scene import Scene, draw_scene
from scleraforce.learning.wall_finder.samples import VALIDATION_SCENES
from scleraforce.segmentation.wall_finder import SeenWall, WallFinder
from scleraforce.study import ScenesStudy

SDS_OF_90 = 1.645  # standard deviations within which 90 % of a normal distribution lie


@dataclass(frozen=True, kw_only=True)
class FinderMetrics:
    """Of the scenes that show wall, where it can be seen: Dice in the mean, its median and its 5th percentile.

    `outer_rows`, `inner_rows`: median error of the boundaries in rows of the reduced frame, where there is wall;
    `coverage`: share of both boundaries that lie within 1.645 of their standard deviations; `found`: share of columns
    for which it is right whether there is wall.
    """

    dice_mean: float
    dice_median: float
    dice_low: float
    outer_rows: float
    inner_rows: float
    coverage: float
    found: float


def measure_finder(finder: WallFinder, scenes: ScenesStudy, count: int, rows: int) -> FinderMetrics:
    """Compare a wall finder's answers with the truth of scenes.

    Args:
        finder: to measure.
        scenes: what is drawn.
        count: of scenes.
        rows: of its reduced frame.
    """
    shares, errors, right = [], [], []
    for number in range(count):
        scene = draw_scene(scenes, VALIDATION_SCENES + number)
        seen = finder.find(scene.frame)
        errors.append(_errors(scene, seen, rows))
        right.append((_wall_there(scene, seen) == seen.there)[scene.judged[seen.frame_column]])
        if scene.mask.any():
            shares.append(scene_dice(seen_mask(seen, scene.frame.shape), scene))
    error = np.concatenate(errors, axis=1)
    return FinderMetrics(
        dice_mean=float(np.mean(shares)),
        dice_median=float(np.median(shares)),
        dice_low=float(np.quantile(shares, 0.05)),
        outer_rows=float(np.median(np.abs(error[0]))),
        inner_rows=float(np.median(np.abs(error[1]))),
        coverage=float((np.abs(error[2:]) < SDS_OF_90).mean()),
        found=float(np.concatenate(right).mean()),
    )


def seen_mask(seen: SeenWall, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return the pixels of a frame that a network's wall covers, (row, column)."""
    column, row = np.arange(shape[1]), np.arange(shape[0])[:, None]
    outer, inner = (np.interp(column, seen.column, curve) for curve in (seen.outer_row, seen.inner_row))
    mask: NDArray[np.bool_] = (row >= outer) & (row < inner) & seen.there_at(column)
    return mask


def scene_dice(found: NDArray[np.bool_], scene: Scene) -> float:
    """Return `mask_dice` of a mask (row, column) in a scene's judged columns."""
    return mask_dice(found[:, scene.judged], scene.mask[:, scene.judged])


def mask_dice(found: NDArray[np.bool_], true: NDArray[np.uint8]) -> float:
    """Return twice the common area of two masks over the sum of theirs; 1 where both are empty.

    >>> mask_dice(np.array([[True, True]]), np.array([[255, 0]], dtype=np.uint8))
    0.6666666666666666
    """
    wall = true > 0
    total = np.count_nonzero(found) + np.count_nonzero(wall)
    return float(2.0 * np.count_nonzero(found & wall) / total) if total else 1.0


def _wall_there(scene: Scene, seen: SeenWall) -> NDArray[np.bool_]:
    there: NDArray[np.bool_] = np.isfinite(scene.outer_row[seen.frame_column])
    return there


def _errors(scene: Scene, seen: SeenWall, rows: int) -> NDArray[np.float64]:
    """Return the errors of both boundaries in reduced rows, and in their standard deviations, (4, column)."""
    at, last = seen.frame_column, len(scene.frame) - 1.0
    both = _wall_there(scene, seen) & seen.there
    off = [
        (np.clip(curve, 0.0, last) - np.clip(true[at], 0.0, last))[both]
        for curve, true in ((seen.outer_row, scene.outer_row), (seen.inner_row, scene.inner_row))
    ]
    reduced = [each * rows / len(scene.frame) for each in off]
    return np.stack([*reduced, off[0] / seen.outer_sd[both], off[1] / seen.inner_sd[both]])
