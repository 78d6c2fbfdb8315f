"""The wall finder: its network, the drawn scenes that it learns from, its training, and
its metrics.

Encoder and decoder with shortcuts (Ronneberger et al. 2015, U-Net), at half resolution;
rows come back to full resolution in the last step, as two interleaved channels. The
loss of a boundary is the cross-entropy of its row's distribution, plus the ranked
probability score (Epstein 1969), which includes the distance of a wrong row.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Flags, Floats
from scleraforce.calibration.answer_metrics import dice
from scleraforce.lab.scenes.drawn_scenes import Scene, draw_scene
from scleraforce.lab.training.gradient_descent import (
    Losses,
    Progress,
    TrainingResult,
    drawn_ahead,
    onnx_bytes,
    tensor,
    torch,
    train_network,
)
from scleraforce.records.study import Study, WallFinderStudy
from scleraforce.wall import wall_network
from scleraforce.wall.wall import SeenWall

Float = NDArray[np.float32]

INPUTS_OF_PIXEL = 3  # level, its root, and the row
BOUNDARIES = 2  # upper and lower
VALIDATION_SCENES = 2**31  # numbers from here on are never trained on
RANKED_WEIGHT = 0.5
WALL_WEIGHT = 1.0
SECOND_LOOKS = 0.35  # of the scenes
LOOK = 1  # part of the seed of its random numbers
COVERED_WEIGHT = 0.4  # of a column whose wall a lid hides; a judged one has 1
SDS_OF_90 = 1.645  # standard deviations within which 90 % of a normal distribution lie


class WallFinderNetwork(torch.nn.Module):
    """Frames (n, rows, columns) to logits of boundaries (n, 2, rows, columns / 2) and
    of wall (n, columns / 2).
    """

    def __init__(self, study: WallFinderStudy) -> None:
        """Build the network with random weights (from PyTorch's generator)."""
        super().__init__()
        self.rows = study.rows
        self.columns = study.columns
        sizes = study.channels
        self.down = torch.nn.ModuleList()
        self.level = torch.nn.ModuleList()

        for before, size in zip((INPUTS_OF_PIXEL, *sizes), sizes, strict=False):
            self.down.append(_convolution(before, size, stride=2))
            self.level.append(_convolution(size, size))

        self.deepest = torch.nn.ModuleList(
            _convolution(sizes[-1], sizes[-1]) for _ in range(2)
        )
        widening = reversed(list(zip(sizes[1:], sizes, strict=False)))
        self.up = torch.nn.ModuleList(
            _convolution(below + size, size) for below, size in widening
        )
        self.boundaries = torch.nn.Conv2d(sizes[0], 2 * BOUNDARIES, 1)
        self.wall = torch.nn.Conv1d(2 * sizes[0], 1, 1)

    def forward(self, frames: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return both logits."""
        signal = self.inputs(frames)
        shortcuts = []
        for down, level in zip(self.down, self.level, strict=True):
            signal = level(down(signal))
            shortcuts.append(signal)

        for block in self.deepest:
            signal = signal + block(signal)

        for block, shortcut in zip(self.up, reversed(shortcuts[:-1]), strict=True):
            signal = torch.nn.functional.interpolate(
                signal, scale_factor=2, mode="nearest"
            )
            signal = block(torch.cat([signal, shortcut], dim=1))

        pooled = torch.cat([signal.amax(dim=2), signal.mean(dim=2)], dim=1)
        rows = self.rows // 2
        columns = self.columns // 2
        # interleaved rows
        parts = (
            self.boundaries(signal)
            .reshape(-1, BOUNDARIES, 2, rows, columns)
            .transpose(2, 3)
        )

        return parts.reshape(-1, BOUNDARIES, 2 * rows, columns), self.wall(pooled)[:, 0]

    def inputs(self, frames: torch.Tensor) -> torch.Tensor:
        """Return what the first convolution sees, (n, INPUTS_OF_PIXEL, rows,
        columns).
        """
        row = torch.linspace(-1.0, 1.0, self.rows)[:, None].expand_as(frames)
        stacked = torch.stack([frames, frames.clamp(min=0.0).sqrt(), row], dim=1)
        return stacked.contiguous(memory_format=torch.channels_last)  # quicker on a CPU


def _convolution(before: int, size: int, stride: int = 1) -> torch.nn.Sequential:
    """Return a 3 x 3 convolution, normalised over the batch, with a ramp behind it."""
    return torch.nn.Sequential(
        torch.nn.Conv2d(before, size, 3, stride, 1, bias=False),
        torch.nn.BatchNorm2d(size),
        torch.nn.ReLU(),
    )


class _OnnxWallNetwork(torch.nn.Module):
    """The ONNX model: reduced frames to rows of both boundaries and the probability of
    wall.
    """

    def __init__(self, network: WallFinderNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, frames: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        rows, wall = self.network(frames)
        return rows.softmax(dim=2), wall.sigmoid()


def finder_bytes(network: WallFinderNetwork, provenance: Mapping[str, str]) -> bytes:
    """Return the network as an ONNX model; `wall.wall_network` describes its
    inputs and outputs.
    """
    frames = torch.zeros(2, network.rows, network.columns)
    return onnx_bytes(
        _OnnxWallNetwork(network).eval(),
        {wall_network.FINDER_FRAMES: frames},
        [wall_network.FINDER_ROWS, wall_network.FINDER_WALL],
        provenance,
    )


@dataclass(frozen=True)
class SceneBatch:
    """Scenes: `frames` float32 (n, row, column); `boundaries` float32 (n, 2, column /
    2) in rows, NaN without wall.

    `weight` float32 (n, column / 2): of a column's having wall; 0 for an invisible one
    that no lid covers.
    """

    frames: Float
    boundaries: Float
    weight: Float


def scene_batch(study: Study, number: int, first: int = 0) -> SceneBatch:
    """Draw a batch, the same for the same study and number; `first` is the number of
    the first scene of batch 0.
    """
    size = study.wall_finder.batch_size
    samples = [_sample(study, first + number * size + n) for n in range(size)]
    return SceneBatch(*map(np.stack, zip(*samples, strict=True)))


def _sample(study: Study, number: int) -> tuple[Float, Float, Float]:
    """Draw a scene, and return its part of a `SceneBatch`."""
    scene = draw_scene(study.scenes, number)
    finder = study.wall_finder
    top, bottom = _shown_rows(
        scene, np.random.default_rng([study.scenes.seed, number, LOOK])
    )
    own = np.rint(
        wall_network.reduced_columns(scene.frame.shape[1], finder.columns // 2)
    ).astype(np.intp)
    truth = np.stack([scene.outer_row[own], scene.inner_row[own]])
    reduced = (truth - top + 0.5) * finder.rows / (bottom - top) - 0.5
    # kept inside of the reduced frame
    boundaries = np.clip(reduced, 0.0, finder.rows - 1.0).astype(np.float32)
    weight = scene.judged[own] + np.float32(COVERED_WEIGHT) * scene.covered[own]

    return (
        wall_network.reduced_frame(
            scene.frame[top:bottom], finder.rows, finder.columns
        ),
        boundaries,
        weight,
    )


def _shown_rows(scene: Scene, rng: np.random.Generator) -> tuple[int, int]:
    """Return the rows of a scene that are learned from: all of them or, in some, the
    rows of a second look.
    """
    there = np.isfinite(scene.outer_row)
    rows = len(scene.frame)
    share = wall_network.BEYOND_SHARE * rng.uniform(0.5, 2.0)

    chosen = rng.random() < SECOND_LOOKS
    if chosen and there.any():
        return wall_network.rows_about(
            scene.outer_row[there], scene.inner_row[there], rows, share
        ) or (0, rows)

    return 0, rows


def fit_wall_finder(
    study: Study, workers: int, progress: Progress = None, device: str = "cpu"
) -> TrainingResult[WallFinderNetwork]:
    """Train the network; scenes and weights are the same for any number of workers (0:
    none), on the same machine.
    """
    finder = study.wall_finder
    build = partial(WallFinderNetwork, finder)
    losses_of = partial(_losses, finder)
    drawn = drawn_ahead(partial(scene_batch, study), range(finder.batches), workers)

    return train_network(
        build, losses_of, drawn, finder, finder.batches, progress, device=device
    )


def _losses(
    study: WallFinderStudy, network: WallFinderNetwork, _: int, batch: SceneBatch
) -> Losses:
    """Return the mean loss of a draw, which is a batch, a random half of its scenes
    mirrored.
    """
    drawn = tuple(
        tensor(each) for each in (batch.frames, batch.boundaries, batch.weight)
    )
    turned = torch.rand(len(batch.frames)) < 0.5

    for each in drawn:
        each[turned] = each[turned].flip(-1)

    frames, boundaries, weight = drawn
    row_logits, wall_logits = network(frames)
    return (
        (
            finder_loss(row_logits, wall_logits, boundaries, weight, study.target_rows),
            1,
        ),
    )


def finder_loss(
    row_logits: torch.Tensor,
    wall_logits: torch.Tensor,
    boundaries: torch.Tensor,
    weight: torch.Tensor,
    blur: float,
) -> torch.Tensor:
    """Return the mean loss of a batch: of boundaries' rows (n, 2, row, column), and of
    wall, weighted (n, column).

    `boundaries` are the true rows (n, 2, column), NaN without wall; `blur` is a
    standard deviation, in rows.
    """
    there = torch.isfinite(boundaries).all(dim=1)
    wall = torch.nn.functional.binary_cross_entropy_with_logits(
        wall_logits, there.float(), weight
    )

    if not there.any():
        return WALL_WEIGHT * wall

    of_row = row_logits.log_softmax(dim=2).transpose(2, 3)  # (n, 2, column, row)
    seen = there[:, None].expand(-1, of_row.shape[1], -1)
    logs = of_row[seen]
    true = boundaries[seen]
    rows = torch.arange(logs.shape[1], dtype=logs.dtype)
    target = torch.softmax(-((rows - true[:, None]) ** 2) / (2.0 * blur**2), dim=1)
    entropy = -(target * logs).sum(dim=1).mean()
    below = logs.exp().cumsum(dim=1) - target.cumsum(dim=1)

    return (
        entropy + RANKED_WEIGHT * below.square().sum(dim=1).mean() + WALL_WEIGHT * wall
    )


def measure_finder(finder: wall_network.WallFinder, study: Study) -> dict[str, float]:
    """Return `metrics` of `model.json`, of `[wall_finder] validation_scenes` new
    scenes.

    Dice of the scenes that show wall, its 5th percentile too; median errors of the
    boundaries in reduced rows; coverage of 1.645 standard deviations; share of columns
    with the right decision on wall.
    """
    shares = []
    errors = []
    right = []

    for number in range(study.wall_finder.validation_scenes):
        scene = draw_scene(study.scenes, VALIDATION_SCENES + number)
        seen = finder.find(scene.frame)
        errors.append(_errors(scene, seen, study.wall_finder.rows))
        at = seen.frame_column
        right.append((np.isfinite(scene.outer_row[at]) == seen.there)[scene.judged[at]])

        if scene.mask.any():
            shares.append(scene_dice(seen_mask(seen, scene.frame.shape), scene))

    error = np.concatenate(errors, axis=1)
    return {
        "dice_mean": float(np.mean(shares)),
        "dice_median": float(np.median(shares)),
        "dice_low": float(np.quantile(shares, 0.05)),
        "outer_rows": float(np.median(np.abs(error[0]))),
        "inner_rows": float(np.median(np.abs(error[1]))),
        "coverage": float((np.abs(error[2:]) < SDS_OF_90).mean()),
        "found": float(np.concatenate(right).mean()),
    }


def seen_mask(seen: SeenWall, shape: tuple[int, ...]) -> Flags:
    """Return the pixels of a frame that a network's wall covers, (row, column)."""
    column = np.arange(shape[1])
    row = np.arange(shape[0])[:, None]
    outer, inner = (
        np.interp(column, seen.column, curve)
        for curve in (seen.outer_row, seen.inner_row)
    )

    return (row >= outer) & (row < inner) & seen.there_at(column)


def scene_dice(found: Flags, scene: Scene) -> float:
    """Return `dice` of a mask (row, column) in a scene's judged columns."""
    return dice(found[:, scene.judged], scene.mask[:, scene.judged])


def _errors(scene: Scene, seen: SeenWall, rows: int) -> Floats:
    """Return the errors of both boundaries in reduced rows, and in their standard
    deviations, (4, column).
    """
    at = seen.frame_column
    last = len(scene.frame) - 1.0
    both = np.isfinite(scene.outer_row[at]) & seen.there
    off = [
        (np.clip(curve, 0.0, last) - np.clip(true[at], 0.0, last))[both]
        for curve, true in (
            (seen.outer_row, scene.outer_row),
            (seen.inner_row, scene.inner_row),
        )
    ]
    reduced = [each * rows / len(scene.frame) for each in off]

    return np.stack(
        [*reduced, off[0] / seen.outer_sd[both], off[1] / seen.inner_sd[both]]
    )
