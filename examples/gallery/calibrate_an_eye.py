"""Young's modulus, frame by frame.

The paper's Kalman filter, with linear mechanics, starts from a wide prior (0.49 ± 0.34
MPa); a few frames of known force suffice.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure

import scleraforce as sf
from scleraforce.front.report.figure_files import write_figure
from scleraforce.front.report.recording_figures import draw_modulus_over_frames
from scleraforce.records.study_of_eye import MeshStudy

MODULUS_PA = 0.27e6
FORCES_N = (0.012, 0.030, 0.020, 0.008, 0.040)


def draw() -> Figure:
    """Draw mean and standard deviation of E over the frames, and the truth."""
    study = replace(sf.Study(), mesh=MeshStudy(divisions=6, level=0))
    with tempfile.TemporaryDirectory() as folder:
        recording = sf.phantom(
            Path(folder) / "eye",
            study,
            thickness_m=800e-6,
            youngs_modulus_pa=MODULUS_PA,
            forces_n=FORCES_N,
        )
        calibration = sf.calibrate(recording, study, estimator="roukf")

    (eye,) = calibration.eyes.values()
    return draw_modulus_over_frames(eye, truth_pa=MODULUS_PA)


if __name__ == "__main__":
    write_figure(
        draw(), Path(sys.argv[1] if len(sys.argv) > 1 else "calibrate_an_eye.png")
    )
