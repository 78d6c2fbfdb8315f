"""Drawn scenes as the wall finder learns from them: reduced frames, and where the wall is in them."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.scenes.scene import Scene, draw_scene
from scleraforce.processes import work_in_order
from scleraforce.segmentation.reduced import reduced_columns, reduced_frame
from scleraforce.study import ScenesStudy, WallFinderStudy

AHEAD = 6  # batches for each process that are drawn or wait
VALIDATION_SCENES = 2**31  # numbers from here on are never trained on

Float = NDArray[np.float32]


@dataclass(frozen=True)
class SceneBatch:
    """Scenes: `frames` float32 (n, row, column); `boundaries` float32 (n, 2, column / 2) in rows, NaN without wall.

    `judged` (n, column / 2) is False where a wall is that nobody can see.
    """

    frames: Float
    boundaries: Float
    judged: NDArray[np.bool_]


def scene_batch(scenes: ScenesStudy, study: WallFinderStudy, number: int, first: int = 0) -> SceneBatch:
    """Draw a batch: the same for the same studies and number.

    Args:
        scenes: what is drawn.
        study: size of the reduced frames and of the batch.
        number: of the batch.
        first: number of the first scene of batch 0.
    """
    count = study.batch_size
    drawn = [draw_scene(scenes, first + number * count + n) for n in range(count)]
    frames = np.stack([reduced_frame(scene.frame, study.rows, study.columns) for scene in drawn])
    boundaries = np.stack([_boundaries(scene, study) for scene in drawn])
    return SceneBatch(frames, boundaries, np.stack([scene.judged[_columns(scene, study)] for scene in drawn]))


def batches_ahead(
    scenes: ScenesStudy, study: WallFinderStudy, numbers: Sequence[int], workers: int
) -> Generator[SceneBatch, None, None]:
    """Draw batches in `workers` processes, a few ahead; yield them in the order of `numbers`."""
    return work_in_order(partial(_drawing, scenes, study), numbers, workers, ahead=AHEAD * workers)


def _drawing(scenes: ScenesStudy, study: WallFinderStudy) -> Callable[[int], SceneBatch]:
    """Return what draws a batch, in its process."""
    return partial(scene_batch, scenes, study)


def _columns(scene: Scene, study: WallFinderStudy) -> NDArray[np.intp]:
    """Return the frame's columns that every second column of the reduced frame stands for."""
    return np.rint(reduced_columns(scene.frame.shape[1], study.columns // 2)).astype(np.intp)


def _boundaries(scene: Scene, study: WallFinderStudy) -> Float:
    """Return the truth at every second column of the reduced frame, in its rows, kept inside of it."""
    at = _columns(scene, study)
    truth = np.stack([scene.outer_row[at], scene.inner_row[at]])
    reduced = (truth + 0.5) * study.rows / len(scene.frame) - 0.5
    kept: Float = np.clip(reduced, 0.0, study.rows - 1.0).astype(np.float32)
    return kept
