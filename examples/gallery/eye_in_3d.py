"""One eye under one force, in three dimensions.

Left the mesh, cut open; right the slice that the network sees. ParaView turns what
`scleraforce simulate --vtu` writes.
"""

import sys
from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure

import scleraforce as sf
from scleraforce.front.report.figure_files import write_figure
from scleraforce.front.report.model_figures import draw_simulation
from scleraforce.records.study_of_eye import MeshStudy


def draw() -> Figure:
    """Draw the deformed mesh beside the slice."""
    study = replace(sf.Study(), mesh=MeshStudy(core=4, rings=6))
    eye = sf.simulate(
        study, thickness_m=500e-6, force_n=0.02, mechanics="finite-strain"
    )
    return draw_simulation(eye)


if __name__ == "__main__":
    write_figure(draw(), Path(sys.argv[1] if len(sys.argv) > 1 else "eye_in_3d.png"))
