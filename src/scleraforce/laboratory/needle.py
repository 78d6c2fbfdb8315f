"""The needle in the picture: what a B-scan plane cuts out of its shaft, and the light that it leaves to the rest.

The shaft is a straight cylinder from its tip, which touches the wall at the contact, up to a height above the frame.
Its skin shines: where it faces the light as strongly as was drawn, elsewhere less. Below it steel leaves no light, and
glass a part. The inside is dark.
"""

from dataclasses import dataclass
from math import ceil, cos, pi, sin, tan

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.optics import NeedleShaft
from scleraforce.laboratory.speckle import decibel
from scleraforce.segmentation.grid import Float
from scleraforce.study import OctStudy

Vector = NDArray[np.float64]

SKIN_M = 10e-6  # thickness of what shines, and at least SKIN_COLUMNS of a column
SKIN_COLUMNS = 0.5


@dataclass(frozen=True, eq=False)
class DrawnShaft:
    """A shaft in a frame, all (rows, columns).

    `inside`: the shaft fills the pixel; `light`: share of the light that arrives there from above; `skin`: intensity of
    what shines, over the mean noise.
    """

    inside: NDArray[np.bool_]
    light: Float
    skin: Float


def draw_shaft(shaft: NeedleShaft, tip_m: Vector, tilt_rad: float, oct_study: OctStudy) -> DrawnShaft:
    """Cut a shaft by the plane of a frame.

    Args:
        shaft: the needle.
        tip_m: where its tip lies in the picture, (2,): lateral from the frame's middle, depth from its top edge, m.
        tilt_rad: by which the eye, with the surface's normal, is turned in the picture (see `Pose`).
        oct_study: size of the frame.
    """
    depth_m, lateral_m = oct_study.depth_m / oct_study.rows, oct_study.width_m / oct_study.columns
    above = ceil(shaft.above_m / depth_m)
    down = (np.arange(-above, oct_study.rows) + 0.5)[:, None] * depth_m - tip_m[1]
    across = (np.arange(oct_study.columns) + 0.5) * lateral_m - oct_study.width_m / 2 - tip_m[0]
    side_m, end_m = _signed_distances(shaft, across, down, tilt_rad)
    within_m = np.minimum(side_m, end_m)
    inside = within_m > 0.0
    covered = np.logical_or.accumulate(inside, axis=0)
    light = np.where(covered, 1.0 - shaft.loss_fraction, 1.0)
    skin_m = max(SKIN_M, SKIN_COLUMNS * lateral_m)
    upward = -np.gradient(within_m, depth_m, axis=0) < 0.0  # the outward normal points up: to the light
    level = decibel(shaft.level_db) * np.where(upward, 1.0, decibel(shaft.far_edge_db))
    skin = level * np.exp(-np.square(within_m / skin_m))
    return DrawnShaft(inside[above:], light[above:].astype(np.float32), skin[above:].astype(np.float32))


def _signed_distances(shaft: NeedleShaft, across: Vector, down: Vector, tilt_rad: float) -> tuple[Vector, Vector]:
    """Return how far pixels lie within the shaft's side and above its end, m, (rows, columns) each; below 0: outside.

    Points of the plane are (across, out of it, up) from the tip's place in the picture; the contact lies `gap_m` behind
    the plane. The longest point of a bevelled end lies at the shaft's lower side.
    """
    angle, radius_m = shaft.angle_rad - tilt_rad, shaft.diameter_m / 2
    axis = np.array([sin(angle) * cos(shaft.lean_rad), -sin(shaft.lean_rad), cos(angle) * cos(shaft.lean_rad)])
    upper = -1.0 if angle > 0.0 else 1.0  # the side that the light falls on: a bevel is held up
    aside = upper * np.array([cos(angle), 0.0, -sin(angle)])
    slope = 1.0 / tan(shaft.bevel_rad) if shaft.bevel_rad < pi / 2 else 0.0
    shift_m = radius_m * aside if slope else np.zeros(3)
    x, y, z = across - shift_m[0], shaft.gap_m, -down - shift_m[2]
    along = x * axis[0] + y * axis[1] + z * axis[2]
    off_x, off_y, off_z = x - along * axis[0], y - along * axis[1], z - along * axis[2]
    in_picture = np.square(off_x) + np.square(off_z)
    # The square of the distance from the axis, over how fast it grows in the picture: exact at the side.
    side_m = (radius_m**2 - in_picture - np.square(off_y)) / (2.0 * np.sqrt(in_picture) + 1e-9)
    off_m = off_x * aside[0] + off_z * aside[2]
    end_m = (along - slope * (off_m + radius_m)) / np.hypot(1.0, slope)
    return side_m, end_m
