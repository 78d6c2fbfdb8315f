"""Dice of the wall finder beside the classical method, on drawn scenes and phantom
frames: the tables of docs/wall_finder.md and docs/scanner.md.

MODEL is a folder of `scleraforce train --kind wall-finder`, the bundled one by default.
Scenes are drawn from its study with another seed, and judged in the columns where the
wall can be seen or is absent; phantoms are frames of `render_bscan` over the paper's
phantom ranges, or over the scanner's of `--study`, such as
benchmarks/far_scanner.toml. "Combined" is what `segment` writes; its row "usable" has
the frames that it lets pass.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from figures.printing import PATH, STUDY, listed, print_table, whole_number
from scleraforce.calibration.answer_metrics import dice
from scleraforce.lab.drawn_bscan import render_bscan
from scleraforce.lab.scenes.drawn_scenes import draw_scene
from scleraforce.lab.tissue_light import Pose, sample_optics
from scleraforce.lab.training.wall_network_training import seen_mask
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.reading.load_model import load_wall_finder
from scleraforce.records.frame import Pixels
from scleraforce.records.model_folder import (
    SHIPPED_WALL_FINDER,
    folder_study,
    read_folder,
)
from scleraforce.records.scan import PixelScale
from scleraforce.records.study import ScenesStudy, Study, draw
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall_network import WallFinder

# of the scenes: the rules that combine both methods were chosen on seed 1, the training
# drew seed 0
SEED = 2
WRONG = 0.75  # Dice below which a wall is wrong

# a frame, its scale, the true mask, and the columns that count
Case = tuple[Pixels, PixelScale, NDArray[np.uint8], NDArray[np.bool_]]


def scenes(study: ScenesStudy, count: int) -> Iterator[Case]:
    """Yield drawn scenes that show a wall, with their truth."""
    for scene in (draw_scene(study, index) for index in range(count)):
        if scene.mask.any():
            yield scene.frame, scene.scale, scene.mask, scene.judged


def phantoms(count: int, study: Study) -> Iterator[Case]:
    """Yield phantom frames of a study's scanner, of spherical walls with dents of 0 to
    3 mm, with their truth.
    """
    rng = np.random.default_rng(5)
    phantom = study.phantom
    lateral = np.linspace(-8.5e-3, 8.5e-3, 800)
    sphere = 12e-3 - np.sqrt(12e-3**2 - lateral**2)

    for dent_m in np.linspace(0.0, 3e-3, count):
        depth = sphere + dent_m * np.exp(-(lateral**2) / (2 * 1.6e-3**2))
        outer = np.stack([lateral, depth], axis=1)
        inner = outer + np.array([0.0, rng.uniform(0.4e-3, 0.9e-3)])
        optics = sample_optics(phantom, study.oct, rng)
        surface_m = draw(phantom.surface_depth_m, rng)
        down_m = draw(phantom.eye_shift_m, rng)
        aside_m = draw(phantom.eye_shift_m, rng)
        tilt_rad = draw(phantom.eye_tilt_rad, rng)
        pose = Pose(lateral_m=aside_m, depth_m=surface_m + down_m, tilt_rad=tilt_rad)
        placed = pose.place(WallSection(outer, inner))
        bscan = render_bscan(placed, study.oct, optics, rng)
        judged = np.ones(bscan.frame.shape[1], dtype=np.bool_)
        yield bscan.frame, PixelScale.of(study.oct), bscan.truth_mask, judged


def dice_rows(
    name: str, cases: Iterable[Case], finder: WallFinder
) -> Iterator[list[object]]:
    """Yield the Dice of each way of finding the wall on the same frames."""
    shares: dict[str, list[float]] = {
        way: [] for way in ("classical", "network", "combined", "combined, usable")
    }
    for frame, scale, true, judged in cases:
        checked = find_wall(frame, scale, finder=finder)
        masks = {
            "classical": find_wall(frame, scale).mask > 0,
            "network": seen_mask(finder.find(frame), frame.shape),
            "combined": checked.mask > 0,
        }
        if checked.usable:
            masks["combined, usable"] = masks["combined"]
        for way, mask in masks.items():
            shares[way].append(dice(mask[:, judged], true[:, judged]))

    for way, values in shares.items():
        if values:
            low, middle = np.quantile(values, [0.05, 0.5])
            cells = listed([float(np.mean(values)), middle, low, min(values)], ".3f")
            wrong = sum(value < WRONG for value in values)
            yield [name, way, len(values), cells, wrong]


@click.command(help=__doc__)
@click.argument("model", type=PATH, default=SHIPPED_WALL_FINDER)
@whole_number("--scenes", 200)
@whole_number("--seed", SEED)
@whole_number("--phantoms", 60)
@STUDY
def main(model: Path, study: Study, **sizes: int) -> None:
    """Print the table."""
    cv2.setNumThreads(1)
    finder = load_wall_finder(model)
    drawn_from = replace(folder_study(read_folder(model)).scenes, seed=sizes["seed"])
    frames = {
        "scenes": scenes(drawn_from, sizes["scenes"]),
        "phantoms": phantoms(sizes["phantoms"], study),
    }
    head = ["frames of", "way", "frames", "mean, median, 5 %, least", "below 0.75"]
    rows = (
        row for name, cases in frames.items() for row in dice_rows(name, cases, finder)
    )
    print_table(head, rows)
