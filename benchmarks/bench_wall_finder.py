"""The wall finder: Dice on drawn scenes and phantom frames beside the classical method,
latency, and a sheet of scenes.

    python benchmarks/bench_wall_finder.py [MODEL] [--scenes 200] [--seed 2]
        [--phantoms 60] [--drawn FILE]
    python benchmarks/bench_wall_finder.py [MODEL] --study benchmarks/far_scanner.toml

MODEL is a folder of `scleraforce train --kind wall-finder`, the bundled one by default.
Scenes are drawn from its study with another seed, and judged in the columns where the
wall can be seen or is absent; phantoms are frames of `render_bscan` over the paper's
phantom ranges, or over the scanner's of `--study`. "together" is what `segment` writes;
its row "usable" has the frames that it lets pass. `--drawn` writes a picture of scenes:
alone, with the true wall, and with the network's. `scleraforce segment FOLDER --sheet
FILE` shows scans of one's own.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from time import perf_counter, process_time

import cv2
import numpy as np
from numpy.typing import NDArray

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
from scleraforce.records.study import (
    ScenesStudy,
    Study,
    WallFinderStudy,
    draw,
    read_study,
)
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall import Segmentation, draw_overlay
from scleraforce.wall.wall_network import (
    FINDER_FRAMES,
    FINDER_ROWS,
    FINDER_WALL,
    WallFinder,
    reduced_frame,
)

STUDY = Study()
# of an eye in a frame
PLACED = (
    "surface_depth_m",
    "eye_shift_m",
    "eye_shift_m",
    "eye_tilt_rad",
)
# of the scenes: the rules of `two_methods` were chosen on seed 1, the training drew
# seed 0
SEED = 2
# Dice from which on a wall is right, below which it is wrong
RIGHT = 0.9
WRONG = 0.75
CELL = (110, 140)  # rows and columns of a picture in the sheet
# scenes on it, in all and side by side; pixels between them
DRAWN = 40
ACROSS = 4
GAP = 6

# ... true mask, and its columns that count
Case = tuple[Pixels, PixelScale, NDArray[np.uint8], NDArray[np.bool_]]


def scenes(study: ScenesStudy, count: int) -> Iterator[Case]:
    """Yield drawn scenes that show a wall, with their truth."""
    for number in range(count):
        scene = draw_scene(study, number)
        if scene.mask.any():
            yield scene.frame, scene.scale, scene.mask, scene.judged


def phantoms(count: int, study: Study) -> Iterator[Case]:
    """Yield phantom frames of a study's scanner, of spherical walls with dents of 0 to
    3 mm, with their truth.
    """
    rng = np.random.default_rng(5)
    lateral = np.linspace(-8.5e-3, 8.5e-3, 800)

    for dent_m in np.linspace(0.0, 3e-3, count):
        depth = (
            12e-3
            - np.sqrt(12e-3**2 - lateral**2)
            + dent_m * np.exp(-(lateral**2) / (2 * 1.6e-3**2))
        )
        outer = np.stack([lateral, depth], axis=1)
        section = WallSection(
            outer, outer + np.array([0.0, rng.uniform(0.4e-3, 0.9e-3)])
        )
        optics = sample_optics(study.phantom, study.oct, rng)
        surface_m, down_m, aside_m, tilt_rad = (
            draw(getattr(study.phantom, name), rng) for name in PLACED
        )
        pose = Pose(lateral_m=aside_m, depth_m=surface_m + down_m, tilt_rad=tilt_rad)
        bscan = render_bscan(pose.place(section), study.oct, optics, rng)
        yield (
            bscan.frame,
            PixelScale.of(study.oct),
            bscan.truth_mask,
            np.ones(bscan.frame.shape[1], dtype=np.bool_),
        )


def print_dice(name: str, cases: Iterator[Case], finder: WallFinder) -> None:
    """Print the Dice of each way on the same frames, and how far off the boundaries
    are.
    """
    shares: dict[str, list[float]] = {"find_wall": [], "network": [], "together": []}
    errors: dict[str, list[tuple[float, float]]] = {"find_wall": [], "together": []}
    usable = []

    for frame, scale, true, judged in cases:
        classical = find_wall(frame, scale)
        checked = find_wall(frame, scale, finder=finder)
        masks = (
            classical.mask > 0,
            seen_mask(finder.find(frame), frame.shape),
            checked.mask > 0,
        )

        for key, mask in zip(shares, masks, strict=True):
            shares[key].append(dice(mask[:, judged], true[:, judged]))

        for key, wall in (("find_wall", classical), ("together", checked)):
            errors[key].append(row_errors(wall, true))

        usable.append(checked.usable)

    if not usable:
        return

    print_rows(name, shares, np.array(usable, dtype=np.bool_))
    for key, off in errors.items():
        outer, inner = np.nanmean(np.array(off), axis=0)
        print(
            f"{name:10}{key:12}mean error of the boundaries: outer {outer:.2f} rows,"
            f" inner {inner:.2f} rows"
        )


def row_errors(wall: Segmentation, true: NDArray[np.uint8]) -> tuple[float, float]:
    """Return the mean errors of both boundaries, rows, where the wall is found and lies
    inside the frame; NaN: nowhere.

    The truth is a mask: its boundaries are whole rows.
    """
    outer = true.argmax(axis=0) - 0.5
    inner = len(true) - 0.5 - true[::-1].argmax(axis=0)

    at = (
        true.any(axis=0)
        & np.isfinite(wall.outer_row)
        & (outer > 0)
        & (inner < len(true) - 1)
    )
    if not at.any():
        return float("nan"), float("nan")

    return float(np.abs(wall.outer_row - outer)[at].mean()), float(
        np.abs(wall.inner_row - inner)[at].mean()
    )


def print_rows(
    name: str, shares: dict[str, list[float]], usable: NDArray[np.bool_]
) -> None:
    """Print the Dice of each way, and how many frames are usable by which way is right
    in them.
    """
    rows = {**shares, "usable": np.array(shares["together"])[usable].tolist()}
    for key, found in rows.items():
        if found:
            low, middle = np.quantile(found, [0.05, 0.5])
            print(
                f"{name:10}{key:12}{len(found):8}{np.mean(found):8.3f}{middle:8.3f}{low:8.3f}{min(found):8.3f}"
            )

    classical, together = (np.array(shares[key]) for key in ("find_wall", "together"))
    for words, among in (
        ("both methods are right", (classical >= RIGHT) & (together >= RIGHT)),
        ("only together", (classical < WRONG) & (together >= RIGHT)),
        ("neither", (classical < WRONG) & (together < WRONG)),
    ):
        print(
            f"{name:10}{words:22}{np.count_nonzero(among):5} frames, usable"
            f" {np.count_nonzero(among & usable):5}"
        )


def print_latency(finder: WallFinder, study: WallFinderStudy, readings: int) -> None:
    """Print how long each part takes for a frame of 512 x 512 pixels of 16 bits: passed
    time, and the processor's.
    """
    frame, scale, *_ = next(phantoms(1, STUDY))
    rows = study.rows
    columns = study.columns
    small = reduced_frame(frame, rows, columns)[None]
    parts: dict[str, Callable[[], object]] = {
        "find_wall": lambda: find_wall(frame, scale),
        "reduced_frame": lambda: reduced_frame(frame, rows, columns),
        "network alone": lambda: finder.session.run(
            [FINDER_ROWS, FINDER_WALL], {FINDER_FRAMES: small}
        ),
        "WallFinder.find": lambda: finder.find(frame),
        "find_wall, checked": lambda: find_wall(frame, scale, finder=finder),
    }
    print(f"\n{'':22}{'least':>8}{'median':>8}{'CPU':>8}  ms")

    for name, part in parts.items():
        taken = []
        worked = process_time()

        for _ in range(readings):
            start = perf_counter()
            part()
            taken.append((perf_counter() - start) * 1e3)

        worked = (process_time() - worked) / readings * 1e3
        print(f"{name:22}{min(taken):8.2f}{np.median(taken):8.2f}{worked:8.2f}")


def write_drawn(path: Path, study: ScenesStudy, finder: WallFinder) -> None:
    """Write drawn scenes: alone, with the true wall, and with the network's."""
    cells = []
    for number in range(DRAWN):
        scene = draw_scene(study, number)
        seen = finder.find(scene.frame)
        shape = scene.frame.shape
        empty = np.full(shape[1], np.nan)
        outer, inner = (
            np.where(
                seen.there_at(np.arange(shape[1])),
                np.interp(np.arange(shape[1]), seen.column, curve),
                np.nan,
            )
            for curve in (seen.outer_row, seen.inner_row)
        )
        curves = (empty, empty), (scene.outer_row, scene.inner_row), (outer, inner)
        walls = (
            Segmentation(top, end, shape[0], True, "", True, thickness_m=np.nan)
            for top, end in curves
        )
        pictures = [draw_overlay(scene.frame, wall, CELL) for wall in walls]
        cells.append(np.hstack([*pictures, np.zeros((CELL[0], GAP, 3), np.uint8)]))

    rows = [np.hstack(cells[n : n + ACROSS]) for n in range(0, DRAWN, ACROSS)]
    sheet = np.vstack(
        [cv2.copyMakeBorder(row, 0, GAP, 0, 0, cv2.BORDER_CONSTANT) for row in rows]
    )
    cv2.imwrite(str(path), sheet, [cv2.IMWRITE_JPEG_QUALITY, 60])


def main() -> None:
    """Print the tables; write the sheet with `--drawn`."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parser.add_argument(
        "model",
        type=Path,
        nargs="?",
        default=SHIPPED_WALL_FINDER,
        help='of kind "wall-finder"',
    )
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--phantoms", type=int, default=60)
    parser.add_argument("--readings", type=int, default=100)
    parser.add_argument(
        "--study", type=read_study, default=STUDY, help="of the phantoms' scanner"
    )
    parser.add_argument("--drawn", type=Path, help="picture of drawn scenes")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    finder = load_wall_finder(given.model)
    print(f"{'Dice of':22}{'frames':>8}{'mean':>8}{'median':>8}{'5 %':>8}{'least':>8}")
    study = folder_study(read_folder(given.model))
    print_dice(
        "scenes", scenes(replace(study.scenes, seed=given.seed), given.scenes), finder
    )
    print_dice("phantoms", phantoms(given.phantoms, given.study), finder)
    print_latency(finder, study.wall_finder, given.readings)

    if given.drawn:
        write_drawn(given.drawn, replace(study.scenes, seed=given.seed), finder)


if __name__ == "__main__":
    main()
