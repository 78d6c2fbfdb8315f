"""Measure what a soft layer over the sclera costs a reading: the table of
docs/physics.md.

    python benchmarks/bench_layers.py [--rows N] [--core 4] [--rings 8]

3-D walls of 0.6 mm, radius 12 mm, 0.4 MPa, needle at 35 deg, open, with a bonded layer
(conjunctiva and Tenon's capsule). The needle's force acts on the sclera: under 20 mN
its face presses with 52 kPa, which squeezes or pierces a layer of 5 to 20 kPa. Sections
of the sclera's surface, and of the layer's, are read as the force of an elastic wall
without a layer: with the true E, and with the E that reads 20 mN right. No light, no
noise. Two minutes on one core. `--rows` keeps the first N pressures, layers and
surfaces.
"""

import argparse
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elastic_sections import (
    CONTACT,
    NEEDLE_RADIUS_M,
    NU,
    RADIUS_M,
    THICKNESS_M,
    ElasticSections,
    surfaces,
)
from scleraforce.base.units import to_si
from scleraforce.mechanics.finite_strain_wall import FiniteWall, LoadPath
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.hexahedral_mesh import HexMesh
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.loads_and_supports import needle_at

Floats = NDArray[np.float64]

MODULUS_PA = 0.4e6
IOPS_MMHG = (2.0, 15.0)
# m, Pa
LAYERS = (
    (0.2e-3, 5e3),
    (0.2e-3, 20e3),
    (0.4e-3, 5e3),
    (0.4e-3, 20e3),
    (0.6e-3, 20e3),
)
FORCES_N = np.array([10e-3, 20e-3, 30e-3])
CALIBRATED = 1  # of the forces
STEPS = 2  # of the secant method, towards the E that reads it right
END_N = 80e-3


class LayeredWall:
    """A wall of two elements through it: the layer and the sclera, whose outer surface
    keeps its radius.
    """

    def __init__(self, layer_m: float, soft_pa: float, core: int, rings: int) -> None:
        """Build the mesh; the nodes' sheets are moved so that the first element is the
        layer.
        """
        mesh = graded_mesh(
            RADIUS_M + layer_m, THICKNESS_M + layer_m, CONTACT, core, rings, layers=2
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
        path = pushed(wall, self.sclera, MODULUS_PA, iop_pa, 1.05 * FORCES_N[-1])
        return np.stack([path.displacement_nc(force_n) for force_n in FORCES_N])


def pushed(
    wall: FiniteWall, touched: HexMesh, modulus_pa: float, iop_pa: float, force_n: float
) -> LoadPath:
    """Push on the outer surface of `touched`, up to a force."""
    return wall.load_path(
        needle_at(touched, CONTACT, NEEDLE_RADIUS_M),
        PathEnd(max_force=force_n),
        youngs_modulus_pa=modulus_pa,
        iop_pa=iop_pa,
        density_kg_m3=0.0,
    )


class Plain:
    """The elastic wall without a layer, as a reader has it."""

    def __init__(self, iop_pa: float, core: int, rings: int) -> None:
        """Prepare the sections with the true E."""
        self._iop_pa = iop_pa
        self._wall = FiniteWall(
            graded_mesh(RADIUS_M, THICKNESS_M, CONTACT, core, rings), NU
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
        mesh = self._wall.mesh
        return ElasticSections(
            mesh, pushed(self._wall, mesh, over * MODULUS_PA, self._iop_pa, END_N)
        )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parser.add_argument(
        "--rows", type=int, help="only the first N pressures, layers and surfaces"
    )
    parser.add_argument(
        "--core", type=int, default=4, help="quads along the side of the mesh's core"
    )
    parser.add_argument("--rings", type=int, default=8, help="around the core")
    given = parser.parse_args()
    shown = ", ".join(f"{1e3 * force_n:g}" for force_n in FORCES_N)
    print(
        f"| IOP | layer | surface | {shown} mN read with the true E | misfit, um |"
        " calibrated: E over true | read |"
    )
    print("|---|---|---|---|---|---|---|")

    for iop_mmhg in IOPS_MMHG[: given.rows]:
        plain = Plain(to_si(iop_mmhg, "mmhg"), given.core, given.rings)
        for layer_m, soft_pa in LAYERS[: given.rows]:
            layered = LayeredWall(layer_m, soft_pa, given.core, given.rings)
            states_snc = layered.states_snc(to_si(iop_mmhg, "mmhg"))

            for name, mesh in (("sclera's", layered.sclera), ("layer's", layered.top))[
                : given.rows
            ]:
                seen_sn = surfaces(mesh, states_snc)
                read_n, off_m = plain.true.read_n(seen_sn)
                sections, over = plain.calibrated(seen_sn)
                print(
                    f"| {iop_mmhg:g} mmHg | {1e3 * layer_m:g} mm, {1e-3 * soft_pa:g}"
                    f" kPa | {name} | {mn(read_n)} ",
                    end="",
                )
                print(
                    f"| {1e6 * off_m.max():.0f} | {over:.2f} |"
                    f" {mn(sections.read_n(seen_sn)[0])} |",
                    flush=True,
                )


def mn(forces_n: Floats) -> str:
    """Return forces in mN."""
    return ", ".join(f"{1e3 * force_n:.1f}" for force_n in forces_n)


if __name__ == "__main__":
    main()
