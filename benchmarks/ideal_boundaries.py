"""Boundaries as an ideal segmentation would find them in a frame of a virtual eye: for
studies of the filter alone.

`lab.virtual_recording` makes whole frames; where only the filter is in question, its
speckle can be had for less: noise along the boundary's normal, correlated over a few
columns.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from scleraforce.base.units import STANDARD_GRAVITY_M_S2
from scleraforce.lab.tissue_light import Pose
from scleraforce.lab.virtual_eye import scan_plane
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.mechanics.linear_wall import LinearWall
from scleraforce.mechanics.mesh_section import cut_sections
from scleraforce.records.setup import Setup
from scleraforce.records.study import OctStudy, Study
from scleraforce.wall.wall_in_metres import Boundaries
from virtual_eyes import wall_of

Array = NDArray[np.float64]


def virtual_sections(
    wall: LinearWall, setup: Setup, forces_n: Sequence[float], study: Study
) -> list[WallSection]:
    """Return the sections of a virtual eye under needle forces, from a wall that may
    serve several eyes.
    """
    needle_nc = wall.needle_cnc(
        [scan_plane(setup).contact], study.needle.outer_diameter_m / 2
    )[0]
    modes = np.stack([wall.pressure_nc, wall.gravity_nc, needle_nc])
    weight = study.eye.density_kg_m3 * STANDARD_GRAVITY_M_S2
    loads = (
        np.array([[wall_of(setup).iop_pa, weight, force] for force in forces_n])
        / setup.eye.modulus_pa
    )

    return cut_sections(wall.mesh, [scan_plane(setup)], modes, loads[None])[0]


def ideal_boundaries(
    section: WallSection,
    pose: Pose,
    oct_study: OctStudy,
    noise_m: float,
    rng: np.random.Generator,
    smoothing_m: float = 0.0,
    correlation_columns: float = 1.5,
) -> Boundaries:
    """Return the boundaries of a section in a frame, with noise; NaN outside of the
    frame.

    Args:
        section: the wall in the plane's frame.
        pose: where it lies in the frame.
        oct_study: size and pixels of the frame.
        noise_m: standard deviation along the normal.
        rng: source of the noise.
        smoothing_m: over which the surface is smoothed (a Gaussian's standard
            deviation).
        correlation_columns: width of the Gaussian that correlates it.
    """
    placed = pose.place(section)
    step_m = oct_study.width_m / oct_study.columns
    lateral_m = (np.arange(oct_study.columns) + 0.5 - oct_study.columns / 2) * step_m
    depths: list[Array] = []

    for curve, smoothing in ((placed.outer, smoothing_m), (placed.inner, 0.0)):
        ahead = np.concatenate(
            [[True], curve[1:, 0] > np.maximum.accumulate(curve[:, 0])[:-1]]
        )
        depth = np.interp(
            lateral_m, curve[ahead, 0], curve[ahead, 1], left=np.nan, right=np.nan
        )

        if smoothing > 0:
            known = np.isfinite(depth)
            depth[known] = gaussian_filter1d(depth[known], smoothing / step_m)

        noise = gaussian_filter1d(rng.standard_normal(len(depth)), correlation_columns)
        depth = depth + noise_m * noise / noise.std() * np.sqrt(
            1 + np.gradient(depth, step_m) ** 2
        )
        seen = (depth > 0) & (depth < oct_study.depth_m)
        depths.append(np.where(seen, depth, np.nan).astype(np.float64))

    return Boundaries(
        lateral_m.astype(np.float64),
        np.stack(depths),
        oct_study.depth_m / oct_study.rows,
    )
