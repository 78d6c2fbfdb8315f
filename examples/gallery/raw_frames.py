"""Raw frames and their walls: harmless, considerable, dangerous.

A virtual laboratory pushes one eye three times and images it. `sf.segment` finds the
surface and the inner boundary of the wall in each frame.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import scleraforce as sf
from scleraforce.front.report.figure_files import (
    SCAN_COLOURS,
    inches,
    styled,
    write_figure,
)
from scleraforce.records.study_of_eye import MeshStudy

FORCES_N = (0.003, 0.018, 0.045)


@styled
def draw() -> Figure:
    """Draw the frames above, the same with their walls below."""
    study = replace(sf.Study(), mesh=MeshStudy(divisions=8, level=0))
    with tempfile.TemporaryDirectory() as folder:
        recording = sf.phantom(
            Path(folder) / "eye",
            study,
            thickness_m=700e-6,
            youngs_modulus_pa=0.27e6,
            forces_n=FORCES_N,
            seed=3,
        )
        frames = [recording.frame(entry) for entry in recording.frames]
        walls = [sf.segment(recording.frame_path(entry)) for entry in recording.frames]

    oct_info = recording.info.scan
    width_mm = oct_info.width_m * 1e3
    depth_mm = oct_info.depth_m * 1e3
    lateral_mm = (np.arange(oct_info.columns) + 0.5) * width_mm / oct_info.columns
    figure = Figure(figsize=inches(170, 62))
    grid = figure.subplots(2, len(frames), sharex=True, sharey=True)

    for column, (frame, wall, force_n) in enumerate(
        zip(frames, walls, FORCES_N, strict=True)
    ):
        for axes in grid[:, column]:
            axes.imshow(frame, cmap=SCAN_COLOURS, extent=(0.0, width_mm, depth_mm, 0.0))

        for row, colour in ((wall.outer_row, "#56B4E9"), (wall.inner_row, "#E69F00")):
            grid[1, column].plot(
                lateral_mm,
                (row + 0.5) * depth_mm / oct_info.rows,
                color=colour,
                linewidth=0.9,
            )

        thickness_m = wall.thickness_m
        grid[0, column].set_title(f"{force_n * 1e3:g} mN")
        grid[1, column].set_title(
            "no wall" if thickness_m is None else f"wall of {thickness_m * 1e6:.0f} µm"
        )
        grid[1, column].set_xlabel("lateral [mm]")

    for axes in grid[:, 0]:
        axes.set_ylabel("depth [mm]")

    return figure


if __name__ == "__main__":
    write_figure(draw(), Path(sys.argv[1] if len(sys.argv) > 1 else "raw_frames.png"))
