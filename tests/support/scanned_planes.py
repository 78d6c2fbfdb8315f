"""Sections of the made-up eye by planes of a scan, cut in three dimensions: not by the library's rings."""

import numpy as np
from analytic_frames import IOP_PA, MODULUS_PA, THICKNESS_M
from analytic_library import curves

from scleraforce.mechanics.contact import Section
from scleraforce.recording.folder import Plane

CROSS = (Plane("along", 0.0, 0.0), Plane("across", 0.0, np.pi / 2))
PARALLEL = (Plane("low", -0.3e-3, 0.4), Plane("high", 0.3e-3, 0.4))
ACROSS_M = np.linspace(-7.4e-3, 7.4e-3, 600)


def cut_wall(
    plane: Plane, tip_m: float, contact_m: tuple[float, ...], tilt_rad: tuple[float, ...] = (0.0, 0.0)
) -> Section:
    """Cut a dented wall, whose undented contact is at x, y and depth of the scanner, by a plane.

    `tilt_rad`: the wall's normal leans towards x and y on its way up.
    """
    along = np.array([np.cos(plane.direction_rad), np.sin(plane.direction_rad)])
    across = np.array([-along[1], along[0]])
    axis = np.array([*-np.tan(tilt_rad), 1.0])
    axis /= np.linalg.norm(axis)
    found = []
    for curve in curves(THICKNESS_M, IOP_PA / MODULUS_PA, tip_m):
        ground = ACROSS_M[:, None] * along + plane.offset_m * across - np.array(contact_m[:2])
        low, high = np.full(len(ACROSS_M), -3e-3), np.full(len(ACROSS_M), 9e-3)
        for _ in range(60):  # bisection: is the point above the surface?
            down = 0.5 * (low + high)
            points = np.column_stack([ground, down])
            height = points @ axis
            distance = np.linalg.norm(points - height[:, None] * axis, axis=1)
            above = height < np.interp(distance, curve[:, 0], curve[:, 1])
            low, high = np.where(above, down, low), np.where(above, high, down)
        found.append(np.column_stack([ACROSS_M, contact_m[2] + low]))
    return Section(*found)
