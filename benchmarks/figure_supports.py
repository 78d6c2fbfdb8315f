"""The effect of the supports on the slice: docs/images/supports.png and the table in
docs/physics.md.

python benchmarks/figure_supports.py [--out FILE] [--study FILE]
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from scleraforce.front.report.figure_files import BLUE, GREY, RED, inches, styled
from scleraforce.mechanics.contact_and_section import Contact, ScanPlane, WallSection
from scleraforce.mechanics.finite_strain_wall import bend_eye
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.mesh_section import cut_sections
from scleraforce.records.study import Study, SupportsStudy, read_study

Floats = NDArray[np.float64]

IMAGE = Path(__file__).parent.parent / "docs" / "images" / "supports.png"
FORCES_MN = (0.0, 10.0, 20.0, 40.0)
THICKNESS_M = 0.6e-3
MODULUS_PA = 0.3e6
KINDS = {
    "clamped": (GREY, "-"),
    "straps": (RED, "--"),
    "bed": (BLUE, "-"),
    "bed-and-straps": ("#009E73", "--"),
}
LATERAL_MM = np.linspace(-6.5, 6.5, 261)


def sections(given: Study, kind: str) -> tuple[list[WallSection], list[float]]:
    """Return an eye's sections at all forces with one kind of supports, and its tips in
    mm.
    """
    study = replace(given, supports=SupportsStudy(kind=kind))
    contact = Contact(polar_rad=np.radians(35.0))
    bent = bend_eye(
        study,
        contact,
        PathEnd(max_force=1e-3 * FORCES_MN[-1]),
        thickness_m=THICKNESS_M,
        youngs_modulus_pa=MODULUS_PA,
        iop_pa=study.eye.iop_pa,
    )
    states_fnc = np.stack([bent.displacement_nc(1e-3 * force) for force in FORCES_MN])
    plane = ScanPlane(contact, gap_m=study.needle.gap_m)
    cut = cut_sections(bent.mesh, [plane], states_fnc, np.eye(len(FORCES_MN))[None])[0]

    return cut, [1e3 * bent.tip_m(1e-3 * force) for force in FORCES_MN]


def depths_mm(section: WallSection) -> Floats:
    """Depth of the outer boundary at the columns of the figure."""
    lateral, depth = 1e3 * section.outer.T
    near = np.flatnonzero(np.abs(lateral) < 9.0)
    order = near[np.argsort(lateral[near])]
    depths: Floats = np.interp(LATERAL_MM, lateral[order], depth[order])
    return depths


@styled
def draw(found: dict[str, list[WallSection]]) -> Figure:
    """Draw the sections, and how far each lies below that with the clamped base."""
    figure = Figure(figsize=inches(170, 105))
    grid = figure.subplots(2, len(FORCES_MN), sharex=True, sharey="row")

    for column, force in enumerate(FORCES_MN):
        above, below = grid[:, column]
        reference_mm = depths_mm(found["clamped"][column])

        for kind, (colour, dashes) in KINDS.items():
            draw_section(above, found[kind][column], colour, dashes)
            below_um = 1e3 * (depths_mm(found[kind][column]) - reference_mm)
            below.plot(
                LATERAL_MM,
                below_um,
                color=colour,
                linestyle=dashes,
                linewidth=1.0,
                label=kind,
            )

        above.set_title(f"{force:g} mN")
        above.set_xlim(-6.5, 6.5)
        below.set_xlabel("lateral [mm]")

    grid[0, 0].set_ylim(4.5, -0.4)
    grid[0, 0].set_ylabel("depth [mm]")
    grid[1, 0].set_ylabel("deeper than clamped [µm]")
    grid[1, 0].invert_yaxis()
    figure.legend(
        *grid[1, 0].get_legend_handles_labels(),
        loc="outside upper center",
        ncols=4,
        frameon=False,
    )
    figure.set_layout_engine("constrained")

    return figure


def draw_section(axes: Axes, section: WallSection, colour: str, dashes: str) -> None:
    """Draw both boundaries of a section, in mm."""
    for boundary in (section.outer, section.inner):
        axes.plot(*(1e3 * boundary.T), color=colour, linestyle=dashes, linewidth=1.0)


def main() -> None:
    """Compute, print the tips and draw."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parser.add_argument("--out", type=Path, default=IMAGE, help="the picture")
    parser.add_argument("--study", type=Path, help="the paper's where none is given")
    given = parser.parse_args()
    study = read_study(given.study) if given.study else Study()
    found: dict[str, list[WallSection]] = {}
    print(
        f"tip [mm] at {', '.join(f'{force:g}' for force in FORCES_MN[1:])} mN; whole"
        " section deeper than clamped [um]"
    )

    for kind in KINDS:
        found[kind], tips_mm = sections(study, kind)
        shifts = [
            1e3 * np.mean(depths_mm(own) - depths_mm(reference))
            for own, reference in zip(found[kind], found["clamped"], strict=True)
        ]
        print(
            f"{kind:16s}"
            + "".join(f"{tip:8.3f}" for tip in tips_mm)
            + "   "
            + "".join(f"{shift:8.1f}" for shift in shifts),
            flush=True,
        )

    given.out.parent.mkdir(exist_ok=True)
    draw(found).savefig(given.out, dpi=150)


if __name__ == "__main__":
    main()
