"""Sections of the made-up eye by planes of a scan, cut in three dimensions: not by the
library's rings.
"""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from analytic_frames import (
    GAP_M,
    IOP_PA,
    MODULUS_PA,
    THICKNESS_M,
    image,
    recording_toml,
    tip_of,
)
from analytic_library import curves

from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.records.scan import Plane

CROSS = (Plane("along", 0.0, 0.0), Plane("across", 0.0, np.pi / 2))
PARALLEL = (Plane("low", -0.3e-3, 0.4), Plane("high", 0.3e-3, 0.4))
ACROSS_M = np.linspace(-7.4e-3, 7.4e-3, 600)


def cut_wall(
    plane: Plane,
    tip_m: float,
    contact_m: tuple[float, ...],
    tilt_rad: tuple[float, ...] = (0.0, 0.0),
) -> WallSection:
    """Cut a dented wall, whose undented contact is at x, y and depth of the scanner, by
    a plane.

    `tilt_rad`: the wall's normal leans towards x and y on its way up.
    """
    along = np.array([np.cos(plane.direction_rad), np.sin(plane.direction_rad)])
    across = np.array([-along[1], along[0]])
    axis = np.array([*-np.tan(tilt_rad), 1.0])
    axis /= np.linalg.norm(axis)
    found = []

    for curve in curves(THICKNESS_M, IOP_PA / MODULUS_PA, tip_m):
        ground = (
            ACROSS_M[:, None] * along
            + plane.offset_m * across
            - np.array(contact_m[:2])
        )
        low = np.full(len(ACROSS_M), -3e-3)
        high = np.full(len(ACROSS_M), 9e-3)

        for _ in range(60):  # bisection: is the point above the surface?
            down = 0.5 * (low + high)
            points = np.column_stack([ground, down])
            height = points @ axis
            distance = np.linalg.norm(points - height[:, None] * axis, axis=1)
            above = height < np.interp(distance, curve[:, 0], curve[:, 1])
            low = np.where(above, down, low)
            high = np.where(above, high, down)

        found.append(np.column_stack([ACROSS_M, contact_m[2] + low]))

    return WallSection(*found)


CONTACT_M = (0.15e-3, -0.5e-3, 0.5e-3)
TILT_RAD = (0.02, -0.01)
FORCE_INFO = '[force]\naxis = "fz"\ncontact_sign = -1'
EVERY_S = 8.0  # a push


def write_moments(
    folder: Path,
    forces_n: Sequence[float],
    planes: Sequence[Plane] = CROSS,
    log: bool = False,
) -> Path:
    """Write a recording of a dent in several planes, or in one of its true gap; `log`:
    with the forces.
    """
    (folder / "frames").mkdir(parents=True)
    listed = "".join(
        f'[[oct.plane]]\nname = "{one.name}"\noffset_m = {one.offset_m}\ndirection_rad'
        f" = {one.direction_rad}\n"
        for one in planes
    )
    text = recording_toml(
        "eye",
        more=listed * (len(planes) > 1) + FORCE_INFO * log,
        globe='globe = "open"\nrelaxation = []',
    )
    gap_m = f"slice_gap_m = {-CONTACT_M[1]}\n" if len(planes) == 1 else ""
    (folder / "recording.toml").write_text(
        text.replace(f"slice_gap_m = {GAP_M}\n", gap_m)
    )
    lines = ["file,time_s,plane" if len(planes) > 1 else "file,time_s"]

    for moment, force_n in enumerate(forces_n):
        for number, plane in enumerate(planes):
            section = cut_wall(plane, tip_of(force_n), CONTACT_M, TILT_RAD)
            file = f"{moment}-{number}.png"
            assert cv2.imwrite(
                str(folder / "frames" / file), image(section, seed=10 * moment + number)
            )
            lines.append(
                f"{file},{EVERY_S * (moment + 1)}"
                + f",{plane.name}" * (len(planes) > 1)
            )

    (folder / "frames.csv").write_text("\n".join(lines) + "\n")
    if log:
        time_s = np.arange(0.0, EVERY_S * (len(forces_n) + 1), 0.01)
        pushed = np.append(0.0, forces_n)[
            np.rint(time_s / EVERY_S).astype(int).clip(max=len(forces_n))
        ]
        held_n = np.where(
            np.abs(time_s / EVERY_S - np.rint(time_s / EVERY_S)) < 0.25, pushed, 0.0
        )
        noisy_n = held_n + 1e-4 * np.random.default_rng(5).standard_normal(len(time_s))
        rows = (f"{t:.2f},{-n:.6f}" for t, n in zip(time_s, noisy_n, strict=True))
        (folder / "forces.csv").write_text("\n".join(["time_s,fz_n", *rows]) + "\n")

    return folder
