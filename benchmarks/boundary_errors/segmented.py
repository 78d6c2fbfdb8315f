"""Boundaries that the segmentation finds in rendered frames, beside the true ones: to
measure its errors.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scleraforce.lab.virtual_recording import plan_phantom, render_frame
from scleraforce.library import Library
from scleraforce.library.plane_cut import column_laterals, cut_surfaces
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.needle import Needle
from scleraforce.records.scan import PixelScale, Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall import Segmentation
from scleraforce.wall.wall_network import WallFinder
from virtual_eyes import wall_of

Floats = NDArray[np.float64]


def random_eyes(study: Study, count: int, seed: int) -> tuple[Setup, ...]:
    """Draw virtual eyes from the middle of the ranges of `[reader]`."""
    rng = np.random.default_rng(seed)
    reader = study.reader

    def drawn(bounds: tuple[float, float]) -> Floats:
        low, high = bounds
        return rng.uniform(low + 0.1 * (high - low), high - 0.1 * (high - low), count)

    values = zip(
        *(
            drawn(s.bounds)
            for s in (
                reader.thickness_m,
                reader.youngs_modulus_pa,
                reader.iop_pa,
                reader.gap_m,
                study.needle.polar_angle_rad,
                reader.tilt_rad,
            )
        ),
        strict=True,
    )
    return tuple(
        Setup(
            eye=Eye(
                f"eye-{seed}-{number}",
                thickness_m=thickness,
                modulus=Modulus.stated(modulus),
                iop_pa=iop,
            ),
            needle=Needle(gap_m=gap, polar_rad=polar),
            scan=Scan(tilt_rad=tilt),
        )
        for number, (thickness, modulus, iop, gap, polar, tilt) in enumerate(values)
    )


def segmented_boundaries(
    library: Library,
    study: Study,
    setup: Setup,
    forces_n: Sequence[float],
    seed: int,
    finder: WallFinder | None = None,
) -> tuple[Floats, Floats]:
    """Render frames of an eye, segment them, and return its boundaries at the slice's
    columns.

    Args:
        library: that the eye's walls are taken from.
        study: virtual laboratory, scanner and slice.
        setup: the eye, needle and scan.
        forces_n: of the needle, one for each frame, N; those beyond the library are
            left out.
        seed: of the laboratory.
        finder: that checks the walls, as in the commands; None: walls as the control
            loop sees them.

    Returns:
        True and found depths, each (frame, boundary, column), m below the frame's upper
        edge; NaN: no wall.
    """
    one = np.ones(len(forces_n))
    ratios = np.asarray(forces_n) / setup.eye.modulus_pa
    wall = (
        wall_of(setup).thickness_m * one,
        wall_of(setup).iop_pa / setup.eye.modulus_pa * one,
    )
    held = library.covers(*wall, ratios)
    states = library.curves(wall[0][held], wall[1][held], ratios[held])
    plan = plan_phantom(setup, tuple(np.asarray(forces_n)[held]), study, seed)
    scale = PixelScale.of(study.oct)
    true = []
    seen = []

    for frame, curves_bnc in zip(plan.frames, states.curves_sbnc, strict=True):
        section = cut_surfaces(
            curves_bnc, wall_of(setup).gap_m, setup.scan.tilt_rad or 0.0
        )
        found = find_wall(
            render_frame(frame, section, study).frame, scale, finder=finder
        )
        true.append(
            _at_columns(frame.pose.place(section), column_laterals(study.slice))
        )
        seen.append(_depths_at_columns(found, scale, column_laterals(study.slice)))

    return np.array(true), np.array(seen)


def _depths_at_columns(
    found: Segmentation, scale: PixelScale, laterals_m: Floats
) -> Floats:
    """Return the depth of both found boundaries (boundary, column), m; NaN outside the
    frame and where no wall is.
    """
    rows_bc = np.stack([found.outer_row, found.inner_row])
    count = len(found.outer_row)
    there_c = np.isfinite(rows_bc[0]) & np.isfinite(rows_bc[1])
    at = laterals_m / scale.lateral_m + count / 2 - 0.5
    known = (
        there_c[np.rint(at).astype(int).clip(0, count - 1)]
        & (at >= -0.5)
        & (at <= count - 0.5)
    )
    depth_bc = np.full((2, len(at)), np.nan)

    if not known.any():
        return depth_bc

    for depth, rows in zip(depth_bc, rows_bc, strict=True):
        depth[known] = (
            np.interp(at[known], np.flatnonzero(there_c), rows[there_c]) + 0.5
        ) * scale.depth_m

    depth_bc[1] = depth_bc[0] + (depth_bc[1] - depth_bc[0]) / scale.refractive_index
    return depth_bc


def _at_columns(section: WallSection, laterals_m: Floats) -> Floats:
    """Return the depth of both curves (boundary, column), m, where they do not fold
    over; NaN beyond their ends.
    """
    return np.stack(
        [
            np.interp(laterals_m, curve[:, 0], curve[:, 1], left=np.nan, right=np.nan)
            for curve in (section.outer, section.inner)
        ]
    )
