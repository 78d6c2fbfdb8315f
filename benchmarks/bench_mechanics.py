"""Accuracy of the linear mechanics: the tables of docs/physics.md.

    python benchmarks/bench_mechanics.py [--fine] [--rows N]

R1 is the project's reference problem (`reference_r1.py`). `--rows` keeps the first N
rows of each table of meshes.
"""

import argparse
from itertools import islice
from time import process_time
from typing import Any

import numpy as np

from reference_r1 import (
    CONTACT,
    CONVERGED_MM,
    E_PA,
    FORCE_N,
    NU,
    RADIUS_M,
    SPREAD_M,
    gaussian_load,
)
from reference_walls import symmetric_base, wall_mesh
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.linear_wall import LinearWall, tip_displacement

MESHES: dict[str, dict[str, Any]] = {
    "10 quads, 27 nodes": {"divisions": 10, "level": 0},
    "default: 20 quads, 27 nodes": {},
    "20 quads, 20 nodes": {"twenty_nodes": True},
    "20 quads, 27 nodes, 2 layers": {"layers": 2},
    "paper: 40 quads, 8 nodes, 2 layers": {"level": 2, "order": 1, "layers": 2},
    "40 quads, 8 nodes, 3 layers": {"level": 2, "order": 1, "layers": 3},
}
FINE_MESHES: dict[str, dict[str, Any]] = {
    "40 quads, 20 nodes": {"level": 2, "twenty_nodes": True},
    "40 quads, 27 nodes": {"level": 2},
}


def reference_problem(meshes: dict[str, dict[str, Any]], rows: int | None) -> None:
    """Print R1 on several meshes, at the load centre and at the nearest corner."""
    print(
        "\nR1: inward displacement along the load [mm], and its ratio to the"
        " converged one"
    )
    print(
        f"{'mesh':38s}{'dofs':>8s}{'t [mm]':>8s}{'centre':>8s}{'ratio':>7s}"
        f"{'corner':>8s}{'seconds':>9s}"
    )

    for name, kind in islice(meshes.items(), rows):
        for thickness_m, converged in CONVERGED_MM.items():
            start = process_time()
            mesh = wall_mesh(RADIUS_M, thickness_m, **kind)
            wall = LinearWall(mesh, NU)
            u = wall.solve_one(gaussian_load(mesh, CONTACT, SPREAD_M)) * FORCE_N / E_PA
            seconds = process_time() - start
            corners = np.unique(mesh.outer_qn[:, :4])
            distance = np.linalg.norm(
                mesh.points_nc[corners] - RADIUS_M * CONTACT.normal, axis=1
            )
            corner = -u[corners[np.argmin(distance)]] @ CONTACT.normal * 1e3
            centre = tip_displacement(mesh, CONTACT, u) * 1e3
            print(
                f"{name:38s}{mesh.points_nc.size:8d}{thickness_m * 1e3:8.1f}"
                f"{centre:8.3f}{centre / converged:7.3f}{corner:8.3f}{seconds:9.2f}"
            )


def convergence(rows: int | None) -> None:
    """Print the order of the strain energy for a smooth load on a whole sphere, and
    under a clamped base.
    """
    print(
        "\nOrder of the strain energy from three meshes (2 mm wall, push on the pole)"
    )
    print(f"{'element':12s}{'quads':>14s}{'symmetric base':>16s}{'clamped base':>14s}")
    families: dict[str, tuple[tuple[int, ...], dict[str, Any]]] = {
        "8 nodes": ((8, 16, 32), {"order": 1, "layers": 2}),
        "20 nodes": ((4, 8, 16), {"twenty_nodes": True}),
        "27 nodes": ((4, 8, 16), {}),
    }

    for name, (quads, kind) in islice(families.items(), rows):
        orders = [observed_order(quads, kind, symmetric) for symmetric in (True, False)]
        print(f"{name:12s}{quads!s:>14s}{orders[0]:16.2f}{orders[1]:14.2f}")


def observed_order(
    quads: tuple[int, ...], kind: dict[str, Any], symmetric: bool
) -> float:
    """Return log2 of the ratio of successive differences of the energy."""
    energies = []
    for n in quads:
        mesh = wall_mesh(RADIUS_M, 2e-3, divisions=n, level=0, **kind)
        wall = LinearWall(mesh, NU, symmetric_base(mesh) if symmetric else None)
        load = gaussian_load(mesh, Contact(polar_rad=0.0), 3e-3)
        energies.append(0.5 * float(np.sum(load * wall.solve_one(load))))

    return float(np.log2((energies[1] - energies[0]) / (energies[2] - energies[1])))


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument(
        "--fine",
        action="store_true",
        help="also the meshes of 40 quads (a minute each)",
    )
    parser.add_argument(
        "--rows", type=int, help="only the first N meshes of each table"
    )
    given = parser.parse_args()
    reference_problem(MESHES | FINE_MESHES if given.fine else MESHES, given.rows)
    convergence(given.rows)


if __name__ == "__main__":
    main()
