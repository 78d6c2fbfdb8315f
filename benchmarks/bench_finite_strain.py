"""Accuracy of finite-strain mechanics in 3-D: the tables of docs/physics.md.

    python benchmarks/bench_finite_strain.py [--fine] [--rows N] [--loads N]
        [--quads 20] [--core 6] [--rings 14]

R2 is the project's reference problem (`reference_r2.py`), on 20 equiangular quads.
`--rows` and `--loads` keep the first N walls and the first N forces or dents of each
table.
"""

import argparse
import resource
from dataclasses import dataclass
from itertools import islice
from time import process_time
from typing import Any

import numpy as np

from reference_r2 import (
    FORCES_MN,
    IOP_PA,
    NEEDLE_RADIUS_M,
    NU,
    RADIUS_M,
    TIPS_MM,
    reference_path,
)
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_strain_wall import FiniteWall
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.hexahedral_mesh import HexMesh, build_mesh
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.loads_and_supports import needle_at, study_springs
from scleraforce.records.globe import CONSTANT_PRESSURE, study_law
from scleraforce.records.study import GlobeStudy, SupportsStudy

WALLS = ((0.8e-3, 0.38e6), (0.5e-3, 0.22e6))


@dataclass(frozen=True)
class Sizes:
    """Extent of the tables: also a fine mesh, the first `rows` walls and `loads` loads.

    `quads` counts along an edge of even meshes; `core` and `rings` are sizes of graded
    meshes.
    """

    fine: bool
    rows: int | None
    loads: int | None
    quads: int
    core: int
    rings: int


def row(values: list[float], digits: int = 3) -> str:
    """Return numbers in columns of eight."""
    return "".join(f"{value:8.{digits}f}" for value in values)


def reference_problem(sizes: Sizes) -> None:
    """Print every row of R2: expected, at the node and at the load's centre."""
    forces = row([float(force) for force in FORCES_MN[: sizes.loads]], 0)
    print(f"\nR2 on its own mesh and loads: tip [mm]{forces} mN   worst")

    for (thickness_m, modulus_pa, polar_deg), all_mm in islice(
        TIPS_MM.items(), sizes.rows
    ):
        expected_mm = all_mm[: sizes.loads]
        mesh = build_mesh(RADIUS_M, thickness_m, sizes.quads, level=0)
        contact = Contact(polar_rad=np.radians(polar_deg))
        forces_n = np.array(FORCES_MN[: len(expected_mm)]) * 1e-3
        start = process_time()
        path = reference_path(mesh, modulus_pa, contact, forces_n[-1])
        seconds = process_time() - start
        outer = np.unique(mesh.outer_qn)
        node = outer[
            np.argmin(
                np.linalg.norm(
                    mesh.points_nc[outer] - RADIUS_M * contact.normal, axis=1
                )
            )
        ]
        moved_sc = np.array(
            [
                (path.displacement_nc(force) - path.displacement_snc[0])[node]
                for force in forces_n
            ]
        )
        at_node_mm = -1e3 * moved_sc @ contact.normal
        worst = 100.0 * np.abs(at_node_mm / expected_mm - 1.0).max()
        name = (
            f"{thickness_m * 1e3:.1f} mm {modulus_pa / 1e6:.2f} MPa"
            f" {polar_deg:2.0f} deg"
        )
        print(f"{name:22s}{'expected':16s}" + row(list(expected_mm)))
        print(
            f"{'':22s}{'at the node':16s}"
            + row(list(at_node_mm))
            + f"{worst:9.2f} %  {seconds:.0f} s"
        )
        print(
            f"{'':22s}{'at the centre':16s}"
            + row([1e3 * path.tip_m(force) for force in forces_n]),
            flush=True,
        )


def meshes(contact: Contact, thickness_m: float, sizes: Sizes) -> dict[str, HexMesh]:
    """Return the meshes to compare; the last is the finest."""
    kinds: dict[str, dict[str, Any]] = {
        f"graded, {sizes.core} core, {rings} rings": {
            "core": sizes.core,
            "rings": rings,
        }
        for rings in (sizes.rings, sizes.rings + 10)
    }
    if sizes.fine:
        kinds["graded, 8 core, 32 rings, 2 layers"] = {
            "core": 8,
            "rings": 32,
            "layers": 2,
        }

    graded = {
        name: graded_mesh(RADIUS_M, thickness_m, contact, **kind)
        for name, kind in kinds.items()
    }
    return {
        f"even, {sizes.quads} quads": build_mesh(
            RADIUS_M, thickness_m, sizes.quads // 2
        )
    } | graded


def product_paths(sizes: Sizes) -> None:
    """Print paths under the product's own needle, pressure and weight on several
    meshes, sealed and not.
    """
    contact = Contact(polar_rad=np.radians(35.0))
    print("\nDisc of 0.7 mm, pressure that follows, weight; 35 deg: tip [mm]")
    forces_mn = FORCES_MN[: sizes.loads]
    forces = row([float(force) for force in forces_mn], 0)
    print(f"{'wall, mesh':58s}{'elements':>9s}{'seconds':>8s}{'states':>7s}{forces} mN")

    for thickness_m, modulus_pa in WALLS[: sizes.rows]:
        loads: dict[str, Any] = {
            "youngs_modulus_pa": modulus_pa,
            "iop_pa": IOP_PA,
            "density_kg_m3": 1100.0,
        }
        for name, mesh in meshes(contact, thickness_m, sizes).items():
            wall = FiniteWall(mesh, NU)
            needle = needle_at(mesh, contact, NEEDLE_RADIUS_M)
            start = process_time()
            path = wall.load_path(
                needle, PathEnd(max_force=1e-3 * forces_mn[-1]), **loads
            )
            seconds = process_time() - start
            tips = row([1e3 * path.tip_m(force * 1e-3) for force in forces_mn])
            name = f"{thickness_m * 1e3:.1f} mm, {modulus_pa / 1e6:.2f} MPa, {name}"
            print(
                f"{name:58s}{len(mesh.cells_en):9d}{seconds:8.1f}{len(path.tips_m):7d}{tips}",
                flush=True,
            )

    print(
        "largest memory of this process:"
        f" {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB"
    )


def sealed_globes(sizes: Sizes) -> None:
    """Print how the pressure rises in a sealed eye of the default rigidity, and its
    forces beside an open one's.
    """
    contact = Contact(polar_rad=np.radians(35.0))
    dents_mm = np.array([0.5, 1.0, 1.5])[: sizes.loads]
    supports = SupportsStudy(kind="bed")
    print(
        "\nSealed and open eyes, 2 mmHg at rest: by dent [mm]" + row(list(dents_mm), 1)
    )

    for thickness_m, modulus_pa in WALLS[: sizes.rows]:
        half = graded_mesh(RADIUS_M, thickness_m, contact, sizes.core, sizes.rings)
        globe = graded_mesh(
            RADIUS_M, thickness_m, contact, sizes.core, sizes.rings, whole=True
        )

        for name, wall in (
            ("half, clamped", FiniteWall(half, NU)),
            (
                "globe, bed",
                FiniteWall(globe, NU, springs=study_springs(supports, globe)),
            ),
        ):
            needle = needle_at(wall.mesh, contact, NEEDLE_RADIUS_M)
            loads: dict[str, Any] = {
                "youngs_modulus_pa": modulus_pa,
                "iop_pa": IOP_PA,
                "density_kg_m3": 1100.0,
            }
            end = PathEnd(max_tip_m=1e-3 * float(dents_mm[-1]))
            kinds = {
                "open": CONSTANT_PRESSURE,
                "sealed": study_law(GlobeStudy("sealed")),
            }
            paths = {
                kind: wall.load_path(needle, end, **loads, globe=globe)
                for kind, globe in kinds.items()
            }
            rise = (
                np.interp(
                    dents_mm, 1e3 * paths["sealed"].tips_m, paths["sealed"].pressures_pa
                )
                / IOP_PA
                - 1.0
            )
            title = f"{thickness_m * 1e3:.1f} mm, {modulus_pa / 1e6:.2f} MPa, {name}"
            print(f"{title:36s}{'pressure rise [%]':22s}" + row(list(100.0 * rise), 1))

            for kind, path in paths.items():
                forces_mn = 1e3 * np.interp(dents_mm, 1e3 * path.tips_m, path.forces_n)
                print(
                    f"{'':36s}{f'force, {kind} [mN]':22s}" + row(list(forces_mn), 2),
                    flush=True,
                )


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument(
        "--fine", action="store_true", help="also a fine mesh of two layers (minutes)"
    )
    parser.add_argument("--rows", type=int, help="only the first N walls of each table")
    parser.add_argument("--loads", type=int, help="only the first N forces or dents")
    parser.add_argument(
        "--quads",
        type=int,
        default=20,
        help="along an edge of the even meshes; 4, 8, 12, ...",
    )
    parser.add_argument(
        "--core",
        type=int,
        default=6,
        help="quads along the side of the graded meshes' core",
    )
    parser.add_argument(
        "--rings",
        type=int,
        default=14,
        help="around the core; the second mesh has ten more",
    )
    given = parser.parse_args()
    sizes = Sizes(
        given.fine, given.rows, given.loads, given.quads, given.core, given.rings
    )
    product_paths(sizes)
    sealed_globes(sizes)
    reference_problem(sizes)


if __name__ == "__main__":
    main()
