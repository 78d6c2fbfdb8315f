"""How often the sclera's surface is found below a conjunctiva, and its error in rows,
over the phantom's ranges: the table of docs/segmentation.md.

Walls of 0.45 to 0.85 mm with dents up to 2 mm are drawn with layers of 50 to 600 um;
the thickness is declared with an error of 2 %. The row of 0 um has five times as many
walls, without a layer, uneven by up to 12 % and declared 2 to 20 % too thin: nothing
should be found there.
"""

from collections.abc import Iterator
from dataclasses import replace

import click
import numpy as np

from dented_walls import dented_wall
from figures.printing import print_table, whole_number
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
BARE = 5  # times as many walls without a layer


def drawn(layer_um: int, number: int) -> tuple[Bscan, float]:
    """Return a frame, and the declared thickness of the wall, m."""
    rng = np.random.default_rng((layer_um, number))
    bare = layer_um == 0
    thickness_m = rng.uniform(0.45e-3, 0.85e-3)
    dent_m = rng.uniform(0.0, 2e-3)
    section = waving_wall(
        thickness_m, dent_m, rng.uniform(-0.12, 0.12) if bare else 0.0
    )
    phantom = replace(STUDY.phantom, conjunctiva_thickness_m=fixed(layer_um * 1e-6))
    optics = replace(
        sample_optics(phantom, STUDY.oct, rng),
        conjunctiva=sample_conjunctiva(phantom, rng),
    )
    share = rng.uniform(0.8, 0.98) if bare else 1 + 0.02 * rng.standard_normal()
    placed = Pose(lateral_m=0.0, depth_m=0.5e-3).place(section)
    return render_bscan(placed, STUDY.oct, optics, rng), thickness_m * share


def waving_wall(thickness_m: float, dent_m: float, wave: float) -> WallSection:
    """Return a wall whose thickness changes by a share `wave` along the picture."""
    uneven = 1 + wave * np.cos(np.linspace(-8.5e-3, 8.5e-3, POINTS) / 2e-3)
    return dented_wall(thickness_m * uneven, dent_m, points=POINTS)


def rows_off(found: Segmentation, bscan: Bscan) -> float:
    """Return the mean distance of the outer boundary from the wall's true first row."""
    wall = bscan.truth_mask > 0
    column = np.flatnonzero(wall.any(axis=0) & np.isfinite(found.outer_row))
    true_row = wall.argmax(axis=0)[column] - 0.5
    return float(np.abs(found.outer_row[column] - true_row).mean())


def layer_rows(frames: int) -> Iterator[list[object]]:
    """Yield a row for each thickness of the layer."""
    for layer_um in LAYERS_UM:
        before = []
        after = []
        for number in range(frames * (BARE if layer_um == 0 else 1)):
            bscan, declared_m = drawn(layer_um, number)
            first = find_wall(bscan.frame, SCALE)
            found = below_conjunctiva(bscan.frame, SCALE, first, declared_m)
            before.append(rows_off(first, bscan))
            if found is not first:
                after.append(rows_off(found, bscan))

        ends = f"{np.mean(after):.1f}, {max(after):.1f}" if after else "-"
        mean = f"{np.mean(before):.1f}"
        yield [f"{layer_um} um", len(before), len(after), mean, ends]


@click.command(help=__doc__)
@whole_number("--frames", 40, "Frames of each thickness of the layer.")
def main(frames: int) -> None:
    """Print the table."""
    head = ["layer", "frames", "found", "rows off before", "after: mean, worst"]
    print_table(head, layer_rows(frames))
