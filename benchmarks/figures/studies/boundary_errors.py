"""Errors of the segmentation's boundaries on rendered frames, beside the errors that
`lab.training.drawn_wall_errors` draws: the table of docs/reader_training.md.

Eyes are drawn from the middle of the ranges of `[reader]`. Each has frames with even
forces from 0 to 60 mN, from the user's library of the study.
"""

from collections.abc import Iterator, Sequence
from dataclasses import fields

import click
import numpy as np

from figures.boundary_statistics import BoundaryStatistics, boundary_statistics
from figures.printing import STUDY, listed, print_table, whole_number
from figures.pushed_walls import Floats
from scleraforce.lab.training.drawn_wall_errors import disturb
from scleraforce.lab.virtual_recording import plan_phantom, render_frame
from scleraforce.library import Library
from scleraforce.library.library_store import cached_library
from scleraforce.library.plane_cut import column_laterals, cut_surfaces
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall import Segmentation
from virtual_eyes import changed, wall_of

LARGEST_N = 60e-3


def random_eyes(study: Study, count: int, seed: int) -> Iterator[Setup]:
    """Draw virtual eyes from the middle of the ranges of `[reader]`."""
    rng = np.random.default_rng(seed)
    reader = study.reader
    ranges = {
        "thickness_m": reader.thickness_m,
        "youngs_modulus_pa": reader.youngs_modulus_pa,
        "iop_pa": reader.iop_pa,
        "gap_m": reader.gap_m,
        "polar_rad": study.needle.polar_angle_rad,
        "tilt_rad": reader.tilt_rad,
    }
    drawn = {}
    for name, sampled in ranges.items():
        low, high = sampled.bounds
        edge = 0.1 * (high - low)
        drawn[name] = rng.uniform(low + edge, high - edge, count)

    for eye in range(count):
        values = {name: float(column[eye]) for name, column in drawn.items()}
        yield changed(Setup(), name=f"eye-{seed}-{eye}", **values)


def segmented_boundaries(
    library: Library, study: Study, setup: Setup, forces_n: Sequence[float], seed: int
) -> tuple[Floats, Floats]:
    """Render frames of an eye and segment them as the control loop does.

    Returns:
        True and found depths at the slice's columns, each (frame, boundary, column), m
        below the frame's upper edge; NaN: no wall. Forces beyond the library are left
        out.
    """
    wall = wall_of(setup)
    ratios = np.asarray(forces_n) / setup.eye.modulus_pa
    thickness_m = np.full(len(ratios), wall.thickness_m)
    iop_ratio = np.full(len(ratios), wall.iop_pa / setup.eye.modulus_pa)
    held = library.covers(thickness_m, iop_ratio, ratios)
    states = library.curves(thickness_m[held], iop_ratio[held], ratios[held])
    plan = plan_phantom(setup, tuple(np.asarray(forces_n)[held]), study, seed)
    scale = PixelScale.of(study.oct)
    laterals_m = column_laterals(study.slice)
    true = []
    seen = []

    for frame, curves_bnc in zip(plan.frames, states.curves_sbnc, strict=True):
        section = cut_surfaces(curves_bnc, wall.gap_m, setup.scan.tilt_rad or 0.0)
        found = find_wall(render_frame(frame, section, study).frame, scale)
        true.append(depths_of_section(frame.pose.place(section), laterals_m))
        seen.append(depths_of_segmentation(found, scale, laterals_m))

    return np.array(true), np.array(seen)


def depths_of_segmentation(
    found: Segmentation, scale: PixelScale, laterals_m: Floats
) -> Floats:
    """Return the depth of both found boundaries (boundary, column), m; NaN outside the
    frame and where no wall is.
    """
    rows_bc = np.stack([found.outer_row, found.inner_row])
    count = len(found.outer_row)
    there_c = np.isfinite(rows_bc[0] + rows_bc[1])
    column = laterals_m / scale.lateral_m + count / 2 - 0.5
    known = (
        there_c[np.rint(column).astype(int).clip(0, count - 1)]
        & (column >= -0.5)
        & (column <= count - 0.5)
    )
    depth_bc = np.full((2, len(column)), np.nan)
    if not known.any():
        return depth_bc

    for depth, rows in zip(depth_bc, rows_bc, strict=True):
        row = np.interp(column[known], np.flatnonzero(there_c), rows[there_c])
        depth[known] = (row + 0.5) * scale.depth_m

    depth_bc[1] = depth_bc[0] + (depth_bc[1] - depth_bc[0]) / scale.refractive_index
    return depth_bc


def depths_of_section(section: WallSection, laterals_m: Floats) -> Floats:
    """Return the depth of both curves (boundary, column), m, where they do not fold
    over; NaN beyond their ends.
    """
    return np.stack(
        [
            np.interp(laterals_m, curve[:, 0], curve[:, 1], left=np.nan, right=np.nan)
            for curve in (section.outer, section.inner)
        ]
    )


def _text(name: str, value: float | tuple[float, ...]) -> str:
    if isinstance(value, tuple):
        return listed(value, ".2f")
    if name.endswith("_m2"):
        return f"{value * 1e6:.4f} mm2"
    return f"{value * 1e6:.1f} um" if name.endswith("_m") else f"{value:.2%}"


@click.command(help=__doc__)
@whole_number("--eyes", 16)
@whole_number("--seed", 1)
@whole_number("--frames", 12, "Frames of each eye.")
@STUDY
def main(eyes: int, seed: int, frames: int, study: Study) -> None:
    """Print the table."""
    forces_n = np.linspace(0.0, LARGEST_N, frames).tolist()
    library = cached_library(study)
    pairs = [
        segmented_boundaries(library, study, eye, forces_n, seed)
        for eye in random_eyes(study, eyes, seed)
    ]
    true, seen = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    made = disturb(true, study.slice, np.random.default_rng(seed))
    found = [boundary_statistics(true, sbc, study.slice) for sbc in (seen, made)]
    print_table(
        [f"{len(true)} frames", "segmented", "drawn"],
        (
            [item.name, *(_text(item.name, getattr(one, item.name)) for one in found)]
            for item in fields(BoundaryStatistics)
        ),
    )
