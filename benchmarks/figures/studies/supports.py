"""The effect of the supports on the slice: docs/images/supports.png and the figures of
docs/physics.md, "Supports".

A wall of 0.6 mm and 0.3 MPa in 3-D, needle at 35 deg.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np
from matplotlib.figure import Figure

from figures.printing import STUDY, listed, picture, print_table
from figures.pushed_walls import CONTACT, THICKNESS_M, Floats
from scleraforce.front.report.figure_files import BLUE, GREY, RED, inches, styled
from scleraforce.mechanics.contact_and_section import ScanPlane, WallSection
from scleraforce.mechanics.finite_strain_wall import bend_eye
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.mesh_section import cut_sections
from scleraforce.records.study import Study, SupportsStudy

FORCES_MN = (0.0, 10.0, 20.0, 40.0)
MODULUS_PA = 0.3e6
CLAMPED = "clamped"
KINDS = {
    CLAMPED: (GREY, "-"),
    "straps": (RED, "--"),
    "bed": (BLUE, "-"),
    "bed-and-straps": ("#009E73", "--"),
}
LATERAL_MM = np.linspace(-6.5, 6.5, 261)


@dataclass(frozen=True)
class SupportedEye:
    """An eye on one kind of supports: its sections and tips, one for each force."""

    sections: list[WallSection]
    tips_mm: list[float]

    def depths_mm(self, number: int) -> Floats:
        """Return the depth of the outer boundary at the columns of the picture."""
        lateral, depth = 1e3 * self.sections[number].outer.T
        near = np.flatnonzero(np.abs(lateral) < 9.0)
        order = near[np.argsort(lateral[near])]
        return np.asarray(np.interp(LATERAL_MM, lateral[order], depth[order]))


def supported_eye(study: Study, kind: str) -> SupportedEye:
    """Compute the eye with one kind of supports."""
    study = replace(study, supports=SupportsStudy(kind=kind))
    path = bend_eye(
        study,
        CONTACT,
        PathEnd(max_force=1e-3 * FORCES_MN[-1]),
        thickness_m=THICKNESS_M,
        youngs_modulus_pa=MODULUS_PA,
        iop_pa=study.eye.iop_pa,
    )
    states_fnc = np.stack([path.displacement_nc(1e-3 * force) for force in FORCES_MN])
    plane = ScanPlane(CONTACT, gap_m=study.needle.gap_m)
    cut = cut_sections(path.mesh, [plane], states_fnc, np.eye(len(FORCES_MN))[None])[0]
    return SupportedEye(cut, [1e3 * path.tip_m(1e-3 * force) for force in FORCES_MN])


@styled
def draw(eyes: dict[str, SupportedEye]) -> Figure:
    """Draw the sections, and how far each lies below that with the clamped base."""
    figure = Figure(figsize=inches(170, 105), layout="constrained")
    grid = figure.subplots(2, len(FORCES_MN), sharex=True, sharey="row")

    for number, force in enumerate(FORCES_MN):
        above, below = grid[:, number]
        for kind, (colour, dashes) in KINDS.items():
            line = {"color": colour, "linestyle": dashes, "linewidth": 1.0}
            section = eyes[kind].sections[number]
            for boundary in (section.outer, section.inner):
                above.plot(*(1e3 * boundary.T), **line)

            deeper_mm = eyes[kind].depths_mm(number) - eyes[CLAMPED].depths_mm(number)
            below.plot(LATERAL_MM, 1e3 * deeper_mm, label=kind, **line)

        above.set(title=f"{force:g} mN", xlim=(-6.5, 6.5))
        below.set_xlabel("lateral [mm]")

    grid[0, 0].set(ylim=(4.5, -0.4), ylabel="depth [mm]")
    grid[1, 0].set_ylabel("deeper than clamped [µm]")
    grid[1, 0].invert_yaxis()
    handles = grid[1, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=4, frameon=False)
    return figure


@click.command(help=__doc__)
@STUDY
@picture("supports.png")
def main(study: Study, out: Path) -> None:
    """Print the tips and draw."""
    eyes = {kind: supported_eye(study, kind) for kind in KINDS}

    def deeper_um(eye: SupportedEye) -> list[float]:
        return [
            1e3
            * float(np.mean(eye.depths_mm(number) - eyes[CLAMPED].depths_mm(number)))
            for number in range(len(FORCES_MN))
        ]

    rows = (
        [kind, listed(eye.tips_mm, ".3f"), listed(deeper_um(eye), ".1f")]
        for kind, eye in eyes.items()
    )
    shown = listed(FORCES_MN, "g")
    head = [f"tip at {shown} mN, mm", "whole section deeper than clamped, um"]
    print_table(["supports", *head], rows)
    draw(eyes).savefig(out, dpi=150)
