"""What a soft layer over the sclera costs a reading: the table of docs/physics.md.

3-D walls of 0.6 mm, radius 12 mm, 0.4 MPa, needle at 35 deg, open, with a bonded layer
(conjunctiva and Tenon's capsule). The needle's force acts on the sclera: under 20 mN
its face presses with 52 kPa, which squeezes or pierces a layer of 5 to 20 kPa. Sections
of the sclera's surface, and of the layer's, are read as the force of an elastic wall
without a layer: with the true E, and with the E that reads 20 mN right. No light, no
noise. Two minutes on one core.
"""

from collections.abc import Iterator
from dataclasses import replace

import click
import numpy as np

from figures.printing import ROWS, listed, print_table, whole_number
from figures.pushed_walls import (
    CONTACT,
    NU,
    RADIUS_M,
    THICKNESS_M,
    ElasticSections,
    Floats,
    push,
    surfaces,
)
from scleraforce.base.units import to_si
from scleraforce.mechanics.finite_strain_wall import FiniteWall
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.hexahedral_mesh import HexMesh
from scleraforce.mechanics.load_path_tracing import PathEnd

MODULUS_PA = 0.4e6
CORE = 4  # quads along the side of the mesh's core
# mmHg, and the layers, m and Pa
CASES = (
    *(
        (2.0, *layer)
        for layer in ((0.2e-3, 5e3), (0.4e-3, 5e3), (0.4e-3, 20e3), (0.6e-3, 20e3))
    ),
    *((15.0, *layer) for layer in ((0.4e-3, 20e3), (0.6e-3, 20e3))),
)
FORCES_N = np.array([10e-3, 20e-3, 30e-3])
CALIBRATED = 1  # of the forces
STEPS = 2  # of the secant method, towards the E that reads it right
END_N = 80e-3


class LayeredWall:
    """A wall of two elements through it: the layer and the sclera, whose outer surface
    keeps its radius.
    """

    def __init__(self, layer_m: float, soft_pa: float, rings: int) -> None:
        """Build the mesh; the nodes' sheets are moved so that the first element is the
        layer.
        """
        mesh = graded_mesh(
            RADIUS_M + layer_m, THICKNESS_M + layer_m, CONTACT, CORE, rings, layers=2
        )
        radii_s = (
            RADIUS_M
            + np.array([1.0, 0.5, 0.0, 0.0, 0.0]) * layer_m
            - np.array([0, 0, 0, 0.5, 1]) * THICKNESS_M
        )
        sheet_nc = mesh.points_nc[: len(mesh.points_nc) // len(radii_s)] / mesh.radius_m
        self.top: HexMesh = replace(
            mesh, points_nc=(radii_s[:, None, None] * sheet_nc).reshape(-1, 3)
        )
        below_qn = mesh.outer_qn + 2 * len(sheet_nc)
        self.sclera: HexMesh = replace(
            self.top, outer_qn=below_qn, radius_m=RADIUS_M, thickness_m=THICKNESS_M
        )
        is_layer_e = mesh.cells_en.max(axis=1) < 3 * len(sheet_nc)
        self._factor_ep = np.where(is_layer_e, soft_pa / MODULUS_PA, 1.0)[:, None]

    def states_snc(self, iop_pa: float) -> Floats:
        """Return the displacement under each force, (force, node, 3)."""
        wall = FiniteWall(self.top, NU, modulus_factor_ep=self._factor_ep)
        end = PathEnd(max_force=1.05 * FORCES_N[-1])
        path = push(wall, end, MODULUS_PA, iop_pa, touched=self.sclera)
        return np.stack([path.displacement_nc(force_n) for force_n in FORCES_N])


class PlainWall:
    """The elastic wall without a layer, as a reader has it."""

    def __init__(self, iop_pa: float, rings: int) -> None:
        """Prepare the sections with the true E."""
        self._iop_pa = iop_pa
        self._wall = FiniteWall(
            graded_mesh(RADIUS_M, THICKNESS_M, CONTACT, CORE, rings), NU
        )
        self.true = self._with(1.0)

    def calibrated(self, seen_sn: Floats) -> tuple[ElasticSections, float]:
        """Return the sections with the E that reads the calibrated force right, and
        that E over the true one.
        """
        over = 1.0
        slope = 1.0
        read_n = self._calibrating_n(self.true, seen_sn)

        for _ in range(STEPS):
            before = over
            before_n = read_n
            over *= float((FORCES_N[CALIBRATED] / read_n) ** (1.0 / slope))
            sections = self._with(over)
            read_n = self._calibrating_n(sections, seen_sn)
            slope = np.log(read_n / before_n) / np.log(over / before)

        return sections, over

    @staticmethod
    def _calibrating_n(sections: ElasticSections, seen_sn: Floats) -> float:
        return float(sections.read_n(seen_sn[CALIBRATED, None])[0][0])

    def _with(self, over: float) -> ElasticSections:
        path = push(
            self._wall, PathEnd(max_force=END_N), over * MODULUS_PA, self._iop_pa
        )
        return ElasticSections(self._wall.mesh, path)


def layer_rows(count: int | None, rings: int) -> Iterator[list[str]]:
    """Yield the rows of the table."""
    for iop_mmhg, layer_m, soft_pa in CASES[:count]:
        iop_pa = to_si(iop_mmhg, "mmhg")
        plain = PlainWall(iop_pa, rings)
        layered = LayeredWall(layer_m, soft_pa, rings)
        states_snc = layered.states_snc(iop_pa)

        for name, mesh in (("sclera's", layered.sclera), ("layer's", layered.top)):
            seen_sn = surfaces(mesh, states_snc)
            read_n, off_m = plain.true.read_n(seen_sn)
            sections, over = plain.calibrated(seen_sn)
            yield [
                f"{iop_mmhg:g} mmHg",
                f"{1e3 * layer_m:g} mm, {1e-3 * soft_pa:g} kPa",
                name,
                listed(1e3 * read_n, ".1f"),
                f"{1e6 * off_m.max():.0f}",
                f"{over:.2f}",
                listed(1e3 * sections.read_n(seen_sn)[0], ".1f"),
            ]


@click.command(help=__doc__)
@ROWS
@whole_number("--rings", 8, "Rings of elements around the mesh's core.")
def main(rows: int | None, rings: int) -> None:
    """Print the table."""
    head = ["IOP", "layer", "surface", "10, 20, 30 mN read with the true E"]
    more = ["misfit, um", "calibrated: E over true", "read"]
    print_table([*head, *more], layer_rows(rows, rings))
