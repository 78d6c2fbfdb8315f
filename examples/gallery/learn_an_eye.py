"""Young's modulus without a force, frame by frame.

The shape of a dent tells the pressure over E, and the pressure is known. Shallow dents
hardly narrow the prior; deep ones do.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import scleraforce as sf
from scleraforce.front.report.figure_files import (
    AMBER,
    BLUE,
    inches,
    styled,
    write_figure,
)

MODULUS_PA = 0.27e6
FORCES_N = np.linspace(0.005, 0.060, 12)


@styled
def draw() -> Figure:
    """Draw mean and standard deviation of E after each frame, over the force of the
    deepest dent, and the truth.
    """
    with tempfile.TemporaryDirectory() as folder:
        recording = sf.phantom(
            Path(folder) / "eye",
            mechanics="finite-strain",
            globe="open",
            thickness_m=600e-6,
            youngs_modulus_pa=MODULUS_PA,
            forces_n=FORCES_N.tolist(),
        )
        learned = []

        for count in range(1, len(FORCES_N) + 1):
            shown = replace(recording, frames=recording.frames[:count])
            (eye,) = sf.calibrate(shown, without_force=True).eyes.values()
            learned.append((eye.mean_pa, eye.sd_pa))

    prior = sf.Study().calibration
    mean_mpa, sd_mpa = (
        1e-6 * np.array([(prior.prior_mean_pa, prior.prior_sd_pa), *learned]).T
    )
    force_mn = 1e3 * np.array([0.0, *FORCES_N])
    figure = Figure(figsize=inches(120, 70))
    axes = figure.subplots()
    axes.errorbar(
        force_mn,
        mean_mpa,
        sd_mpa,
        fmt="o",
        color=BLUE,
        capsize=3,
        label="mean and sd after each frame",
    )
    axes.axhline(1e-6 * MODULUS_PA, color=AMBER, linestyle="--", label="the eye's")
    axes.set(
        xlabel="true force of the last frame [mN] (0: the prior)",
        ylabel="E [MPa]",
        ylim=(0.0, None),
    )
    axes.legend()

    return figure


if __name__ == "__main__":
    write_figure(draw(), Path(sys.argv[1] if len(sys.argv) > 1 else "learn_an_eye.png"))
