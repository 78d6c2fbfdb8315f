"""How far the mechanics depends on its mesh: the figures of docs/physics.md,
"Accuracy".

R2 (`reference_r2.py`) is another program's, at finite strain on equiangular quads.
Graded meshes are compared with an even one under the product's disc, weight and
pressure that follows. Tips are in mm. `make bench` has the linear meshes (R1).
"""

from collections.abc import Iterator
from itertools import islice

import click
import numpy as np

import reference_r2 as r2
from figures.printing import ROWS, listed, print_table, whole_number
from figures.pushed_walls import CONTACT, NU, RADIUS_M, push
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_strain_wall import FiniteWall
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.hexahedral_mesh import build_mesh
from scleraforce.mechanics.load_path_tracing import PathEnd

WALLS = ((0.8e-3, 0.38e6), (0.5e-3, 0.22e6))  # m, Pa
MORE_RINGS = 10  # of the finer graded mesh
DENSITY_KG_M3 = 1100.0


def r2_rows(rows: int | None, forces: int | None, quads: int) -> Iterator[list[object]]:
    """Yield R2's expected tips, ours at the node nearest to the load, and the largest
    difference.
    """
    for (thickness_m, modulus_pa, polar_deg), tips_mm in islice(
        r2.TIPS_MM.items(), rows
    ):
        expected_mm = tips_mm[:forces]
        mesh = build_mesh(RADIUS_M, thickness_m, quads, level=0)
        contact = Contact(polar_rad=np.radians(polar_deg))
        forces_n = 1e-3 * np.array(r2.FORCES_MN[: len(expected_mm)])
        path = r2.reference_path(mesh, modulus_pa, contact, forces_n[-1])
        outer = np.unique(mesh.outer_qn)
        away_m = mesh.points_nc[outer] - RADIUS_M * contact.normal
        node = outer[np.argmin(np.linalg.norm(away_m, axis=1))]
        moved_sc = [
            (path.displacement_nc(force_n) - path.displacement_snc[0])[node]
            for force_n in forces_n
        ]
        found_mm = -1e3 * np.array(moved_sc) @ contact.normal
        worst = 100.0 * np.abs(found_mm / expected_mm - 1.0).max()
        name = f"{1e3 * thickness_m:g} mm, {1e-6 * modulus_pa:g} MPa, {polar_deg:g} deg"
        yield [
            name,
            listed(expected_mm, ".3f"),
            listed(found_mm, ".3f"),
            f"{worst:.2f}",
        ]


def path_rows(
    rows: int | None, forces: int | None, quads: int, core: int, rings: int
) -> Iterator[list[object]]:
    """Yield the tips of the product's paths on an even mesh and two graded ones."""
    forces_n = 1e-3 * np.array(r2.FORCES_MN[:forces])
    for thickness_m, modulus_pa in WALLS[:rows]:
        meshes = {f"even, {quads} quads": build_mesh(RADIUS_M, thickness_m, quads // 2)}
        for more in (rings, rings + MORE_RINGS):
            mesh = graded_mesh(RADIUS_M, thickness_m, CONTACT, core, more)
            meshes[f"graded, {core} core, {more} rings"] = mesh

        for name, mesh in meshes.items():
            end = PathEnd(max_force=forces_n[-1])
            wall = FiniteWall(mesh, NU)
            path = push(wall, end, modulus_pa, r2.IOP_PA, density_kg_m3=DENSITY_KG_M3)
            tips_mm = [1e3 * path.tip_m(force_n) for force_n in forces_n]
            wall_name = f"{1e3 * thickness_m:g} mm, {1e-6 * modulus_pa:g} MPa"
            yield [wall_name, name, len(mesh.cells_en), listed(tips_mm, ".3f")]


@click.command(help=__doc__)
@ROWS
@click.option("--forces", type=int, help="Only the first N forces of a path.")
@whole_number("--quads", 20, "Quads along an edge of even meshes: 4, 8, 12, ...")
@whole_number("--core", 6, "Quads along the core of graded meshes.")
@whole_number("--rings", 14, "Rings around the core.")
def main(
    rows: int | None, forces: int | None, quads: int, core: int, rings: int
) -> None:
    """Print the tables."""
    shown = listed(r2.FORCES_MN[:forces], "g")
    print(f"R2: tips at {shown} mN\n")
    head = ["wall, contact", "expected", "at the node", "worst, %"]
    print_table(head, r2_rows(rows, forces, quads))
    print(f"\nFinite strain: tips at {shown} mN\n")
    head = ["wall", "mesh", "elements", "tips"]
    print_table(head, path_rows(rows, forces, quads, core, rings))
