"""Forces from frames, with their 90 % intervals: the whole chain on one virtual eye.

Library, a reader (of the smallest training: its network is of no use, the fit to the library answers), three frames of
known force for the eye's modulus, and the rest read.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure

import scleraforce as sf
from scleraforce.report.files import write_figure
from scleraforce.report.reading_figure import draw_read_forces

QUICK = Path(__file__).parents[2] / "docs" / "quick.toml"
FORCES_N = (0.012, 0.024, 0.036, 0.003, 0.008, 0.015, 0.019, 0.026, 0.033, 0.041, 0.050)


def draw() -> Figure:
    """Draw the read forces over the measured ones."""
    study = sf.read_study(QUICK)
    study = replace(study, reader=replace(study.reader, epochs=1, samples_per_epoch=500, validation_samples=200))
    with tempfile.TemporaryDirectory() as folder:
        recording = sf.phantom(
            Path(folder) / "eye", study, thickness_m=650e-6, youngs_modulus_pa=0.3e6, forces_n=FORCES_N,
            mechanics="finite-strain",
        )  # fmt: skip
        reader = sf.train(sf.library_of(study), Path(folder) / "reader", study)
        calibration = sf.calibrate(recording, study, frames=3)
        evaluation = sf.evaluate(reader, recording, calibration)
    return draw_read_forces(evaluation.scored, evaluation.bounds_n, evaluation.max_force_n)


if __name__ == "__main__":
    write_figure(draw(), Path(sys.argv[1] if len(sys.argv) > 1 else "read_forces.png"))
