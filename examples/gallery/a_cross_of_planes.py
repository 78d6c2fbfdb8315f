"""A cross of two B-scans, read in three dimensions.

Both planes show one dent under one force; where they pass is not known. Read together,
they give the gap of each, and the contact and the wall's normal in space.
"""

import sys
import tempfile
from math import cos, pi, radians, sin
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import scleraforce as sf
from scleraforce.front.report.figure_files import (
    AMBER,
    BLUE,
    RED,
    SCAN_COLOURS,
    inches,
    styled,
    write_figure,
)

PLANES = (sf.Plane("along", 0.0, 0.0), sf.Plane("across", 0.0, pi / 2))
NEAR_MM = 4.0


@styled
def draw() -> Figure:
    """Draw the two frames with the fitted wall, and both walls in space with the
    needle's axis.
    """
    with tempfile.TemporaryDirectory() as folder:
        recording = sf.phantom(
            Path(folder) / "eye",
            mechanics="finite-strain",
            globe="open",
            thickness_m=600e-6,
            gap_m=0.5e-3,
            scan=sf.Scan(direction_rad=radians(30.0), planes=PLANES),
            forces_n=[0.025],
        )
        frames = [recording.frame(entry) for entry in recording.frames]
        read = sf.evaluate(sf.load_model("default"), recording).frames

    width_mm = recording.info.scan.width_m * 1e3
    depth_mm = recording.info.scan.depth_m * 1e3
    figure = Figure(figsize=inches(170, 70))
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.2))
    space = figure.add_subplot(grid[:, 1], projection="3d")

    for number, (plane, pixels, one, colour) in enumerate(
        zip(PLANES, frames, read, (BLUE, AMBER), strict=True)
    ):
        assert one.answer.fit is not None
        outer_mm = 1e3 * one.answer.fit.wall_bmc[0]
        axes = figure.add_subplot(grid[number, 0])
        axes.imshow(
            pixels,
            cmap=SCAN_COLOURS,
            extent=(-width_mm / 2, width_mm / 2, depth_mm, 0.0),
        )
        axes.plot(*outer_mm.T, color=colour)
        axes.set(
            xlim=(-width_mm / 2, width_mm / 2),
            ylim=(depth_mm, 0.0),
            ylabel="depth [mm]",
        )
        axes.set_title(
            f"{plane.name}: {abs(float(one.answer.fit.unknown[4])) * 1e3:.2f} mm beside"
            " the needle"
        )
        near = outer_mm[np.abs(outer_mm[:, 0]) < NEAR_MM]
        along = np.array([cos(plane.direction_rad), sin(plane.direction_rad)])
        space.plot(*(near[:, :1] * along).T, near[:, 1], color=colour)

    place = read[0].answer.place
    assert place is not None
    x_mm, y_mm, z_mm = (1e3 * value for value in place.contact_m)
    up = np.array([0.0, 3.5])
    tilt_x, tilt_y = place.tilt_rad
    space.plot(x_mm + tilt_x * up, y_mm + tilt_y * up, z_mm - up, color=RED)
    space.scatter([x_mm], [y_mm], [z_mm], color=RED)
    space.set(
        zlim=(z_mm + 0.5, z_mm - 3.5),
        xlabel="x [mm]",
        ylabel="y [mm]",
        zlabel="depth [mm]",
    )
    space.set_box_aspect(None, zoom=0.85)
    space.set_title(f"contact at {x_mm:.2f}, {y_mm:.2f} mm")

    return figure


if __name__ == "__main__":
    write_figure(
        draw(), Path(sys.argv[1] if len(sys.argv) > 1 else "a_cross_of_planes.png")
    )
