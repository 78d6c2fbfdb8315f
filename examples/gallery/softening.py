"""A wall softens as it bends.

The same wall under the same needle. Linear mechanics holds for dents of a small part of
the wall's thickness. A real shell gives way further, so a linear model that is fitted
at one force is wrong at another.
"""

import sys
from math import radians
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from scleraforce.front.report.figure_files import (
    BLUE,
    GREY,
    RED,
    inches,
    styled,
    write_figure,
)
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_strain_wall import FiniteWall
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.linear_wall import LinearWall, tip_displacement
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.loads_and_supports import needle_at

CONTACT = Contact(polar_rad=radians(35.0))
THICKNESS_M = 0.8e-3
MODULUS_PA = 0.25e6
NEEDLE_RADIUS_M = 0.35e-3
FORCES_N = np.linspace(0.0, 0.03, 61)


@styled
def draw() -> Figure:
    """Draw the force over the dent, linear and at finite strain."""
    mesh = graded_mesh(12e-3, THICKNESS_M, CONTACT, core=4, rings=6)
    needle = needle_at(mesh, CONTACT, NEEDLE_RADIUS_M)
    path = FiniteWall(mesh, poisson_ratio=0.45).load_path(
        needle,
        PathEnd(max_force=FORCES_N[-1]),
        youngs_modulus_pa=MODULUS_PA,
        iop_pa=266.0,
        density_kg_m3=1100.0,
    )
    bent_mm = [path.tip_m(float(force_n)) * 1e3 for force_n in FORCES_N]
    per_newton_nc = (
        LinearWall(mesh, poisson_ratio=0.45).needle_cnc([CONTACT], NEEDLE_RADIUS_M)[0]
        / MODULUS_PA
    )
    linear_mm = FORCES_N * tip_displacement(mesh, CONTACT, per_newton_nc) * 1e3

    figure = Figure(figsize=inches(120, 75))
    axes = figure.subplots()
    axes.plot(linear_mm, FORCES_N * 1e3, color=BLUE, linestyle="--", label="linear")
    axes.plot(bent_mm, FORCES_N * 1e3, color=RED, label="finite strain")
    axes.axvline(
        THICKNESS_M * 1e3, color=GREY, linewidth=0.6, label="the wall's thickness"
    )
    axes.set_xlabel("the contact sinks in by [mm]")
    axes.set_ylabel("force [mN]")
    axes.legend()

    return figure


if __name__ == "__main__":
    write_figure(draw(), Path(sys.argv[1] if len(sys.argv) > 1 else "softening.png"))
