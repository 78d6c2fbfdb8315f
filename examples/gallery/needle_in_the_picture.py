"""A needle in the picture.

The shaft shadows the wall, and shows that the B-scan passes through it. The wall below
the shaft cannot be seen; the frame is judged on both sides of it. `[phantom]
needle_count = [1]` of a study draws such frames.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure

import scleraforce as sf
from scleraforce.front.report.figure_files import (
    SCAN_COLOURS,
    inches,
    styled,
    write_figure,
)
from scleraforce.records.study import fixed
from scleraforce.records.study_of_eye import MeshStudy
from scleraforce.wall.wall import draw_overlay


@styled
def draw() -> Figure:
    """Draw a frame with a needle, and what was found in it: surface orange, inner
    boundary blue, the shaft purple.
    """
    study = replace(
        sf.Study(),
        mesh=MeshStudy(divisions=8, level=0),
        phantom=replace(sf.Study().phantom, needle_count=fixed(1)),
    )
    with tempfile.TemporaryDirectory() as folder:
        recording = sf.phantom(
            Path(folder) / "eye",
            study,
            thickness_m=700e-6,
            youngs_modulus_pa=0.3e6,
            gap_m=0.2e-3,
            forces_n=[0.02],
        )
        frame = recording.frame(recording.frames[0])
        found = sf.segment(recording.frame_path(recording.frames[0]))

    width_mm = recording.info.scan.width_m * 1e3
    depth_mm = recording.info.scan.depth_m * 1e3
    figure = Figure(figsize=inches(170, 45))
    raw, seen = figure.subplots(1, 2, sharex=True, sharey=True)
    raw.imshow(frame, cmap=SCAN_COLOURS, extent=(0.0, width_mm, depth_mm, 0.0))
    seen.imshow(
        draw_overlay(frame, found)[..., ::-1], extent=(0.0, width_mm, depth_mm, 0.0)
    )
    raw.set_title("raw frame")
    raw.set_ylabel("depth [mm]")
    seen.set_title(
        "no needle was found" if found.needle is None else "wall and needle found"
    )

    for axes in (raw, seen):
        axes.set_xlabel("lateral [mm]")

    return figure


if __name__ == "__main__":
    write_figure(
        draw(), Path(sys.argv[1] if len(sys.argv) > 1 else "needle_in_the_picture.png")
    )
