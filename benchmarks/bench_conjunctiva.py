"""Count how often the sclera's surface is found below a conjunctiva, and measure its
error, over the phantom's ranges.

    python benchmarks/bench_conjunctiva.py [--frames 40]

Walls of 0.45 to 0.85 mm with dents up to 2 mm are drawn with layers of 50 to 600 um;
the thickness is declared with an error of 2 %. The row of 0 um has five times as many
walls, without a layer, uneven by up to 12 % and declared 2 to 20 % too thin: nothing
should be found there.
"""

import argparse
from dataclasses import replace
from time import perf_counter

import numpy as np

from dented_walls import dented_wall
from scleraforce.lab.drawn_bscan import Bscan, render_bscan
from scleraforce.lab.tissue_light import Pose, sample_conjunctiva, sample_optics
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.records.fields import fixed
from scleraforce.records.scan import PixelScale
from scleraforce.records.study import Study
from scleraforce.wall.conjunctiva import below_conjunctiva
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall import Segmentation

STUDY = Study()
SCALE = PixelScale.of(STUDY.oct)
POINTS = 800  # of each curve
LAYERS_UM = (0, 50, 80, 110, 140, 180, 220, 250, 350, 450, 600)


def drawn(layer_um: int, number: int) -> tuple[Bscan, float]:
    """Return a frame, and the declared thickness of the wall, m."""
    rng = np.random.default_rng((layer_um, number))
    thickness_m = rng.uniform(0.45e-3, 0.85e-3)
    dent_m = rng.uniform(0.0, 2e-3)
    section = waving_wall(
        thickness_m, dent_m, rng.uniform(-0.12, 0.12) if layer_um == 0 else 0.0
    )
    phantom = replace(STUDY.phantom, conjunctiva_thickness_m=fixed(layer_um * 1e-6))
    optics = replace(
        sample_optics(phantom, STUDY.oct, rng),
        conjunctiva=sample_conjunctiva(phantom, rng),
    )
    told_m = thickness_m * (
        rng.uniform(0.8, 0.98) if layer_um == 0 else 1 + 0.02 * rng.standard_normal()
    )

    return (
        render_bscan(
            Pose(lateral_m=0.0, depth_m=0.5e-3).place(section), STUDY.oct, optics, rng
        ),
        told_m,
    )


def waving_wall(thickness_m: float, dent_m: float, wave: float) -> WallSection:
    """Return a wall whose thickness changes by a share `wave` along the picture."""
    uneven = 1 + wave * np.cos(np.linspace(-8.5e-3, 8.5e-3, POINTS) / 2e-3)
    return dented_wall(thickness_m * uneven, dent_m, points=POINTS)


def rows_off(found: Segmentation, bscan: Bscan) -> float:
    """Return the mean distance of the outer boundary from the wall's true first row."""
    wall = bscan.truth_mask > 0
    column = np.flatnonzero(wall.any(axis=0) & np.isfinite(found.outer_row))
    return float(
        np.abs(found.outer_row[column] - (wall.argmax(axis=0)[column] - 0.5)).mean()
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--frames", type=int, default=40, help="of each thickness of the layer"
    )
    frames = parser.parse_args().frames
    print(
        "| layer | frames | found | rows off before | after, where found: mean, worst |"
        " ms, least |"
    )
    print("|---|---|---|---|---|---|")

    for layer_um in LAYERS_UM:
        print(_row(layer_um, frames * (5 if layer_um == 0 else 1)))


def _row(layer_um: int, frames: int) -> str:
    before = []
    after = []
    seconds = []

    for number in range(frames):
        bscan, told_m = drawn(layer_um, number)
        first = find_wall(bscan.frame, SCALE)
        start = perf_counter()
        found = below_conjunctiva(bscan.frame, SCALE, first, told_m)
        seconds.append(perf_counter() - start)
        before.append(rows_off(first, bscan))
        after += [rows_off(found, bscan)] if found is not first else []

    ends = f"{np.mean(after):.1f}, {max(after):.1f}" if after else "-"
    return (
        f"| {layer_um} um | {frames} | {len(after)} | {np.mean(before):.1f} | {ends} |"
        f" {1e3 * min(seconds):.2f} |"
    )


if __name__ == "__main__":
    main()
