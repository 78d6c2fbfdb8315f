"""Forces from frames, with 90 % intervals.

Three frames of known force give the eye's modulus; the bundled reader reads the others.
Intervals of 0.3 mN would vanish on an axis of 60 mN, so the plot shows read minus
measured forces.
"""

import sys
import tempfile
from pathlib import Path

from matplotlib.figure import Figure

import scleraforce as sf
from scleraforce.front.report.figure_files import write_figure
from scleraforce.front.report.frame_figures import draw_residuals

# a coarse wall, which is pushed in seconds
QUICK = Path(__file__).parents[2] / "docs" / "quick.toml"
FORCES_N = (0.012, 0.024, 0.036, 0.003, 0.008, 0.015, 0.019, 0.026, 0.033, 0.041, 0.050)


def draw() -> Figure:
    """Draw read minus measured forces over the measured ones."""
    with tempfile.TemporaryDirectory() as folder:
        recording = sf.phantom(
            Path(folder) / "eye",
            sf.read_study(QUICK),
            thickness_m=650e-6,
            youngs_modulus_pa=0.3e6,
            forces_n=FORCES_N,
            mechanics="finite-strain",
        )
        calibration = sf.calibrate(recording, frames=3)
        evaluation = sf.evaluate(sf.load_model("default"), recording, calibration)

    return draw_residuals(evaluation)


if __name__ == "__main__":
    write_figure(draw(), Path(sys.argv[1] if len(sys.argv) > 1 else "read_forces.png"))
