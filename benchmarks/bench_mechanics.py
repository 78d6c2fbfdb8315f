"""Accuracy and speed of the linear mechanics: the tables of docs/physics.md.

    python benchmarks/bench_mechanics.py [--fine] [--rows N] [--quads 20]

R1 is the project's reference problem (`reference_r1.py`).
Times are the least of three, in seconds of one core; on a shared machine only their ratios mean something.
`--rows` keeps the first N rows of each table of meshes.
"""

import argparse
from itertools import islice
from time import process_time
from typing import Any

import numpy as np
from scipy.sparse.linalg import splu

from least_time import least_s
from reference_r1 import CONTACT, CONVERGED_MM, E_PA, FORCE_N, NU, RADIUS_M, SPREAD_M, gaussian_load
from reference_walls import stiffness_matrix, symmetric_base, wall_mesh
from scleraforce.mechanics.contact import Contact
from scleraforce.mechanics.elements import element_stiffness, volume_points
from scleraforce.mechanics.frontal import FrontalFactor, dissect
from scleraforce.mechanics.linear import LinearWall, tip_displacement
from scleraforce.mechanics.loads import needle_loads
from scleraforce.mechanics.material import lame_constants
from scleraforce.mechanics.mesh import HexMesh, build_mesh, locate

NEEDLE_RADIUS_M = 0.35e-3

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
    """Print R1 on several meshes, at the load centre and at the corner nearest to it."""
    print("\nR1: inward displacement along the load [mm], and its ratio to the converged one")
    print(f"{'mesh':38s}{'dofs':>8s}{'t [mm]':>8s}{'centre':>8s}{'ratio':>7s}{'corner':>8s}{'seconds':>9s}")
    for name, kind in islice(meshes.items(), rows):
        for thickness_m, converged in CONVERGED_MM.items():
            start = process_time()
            mesh = wall_mesh(RADIUS_M, thickness_m, **kind)
            wall = LinearWall(mesh, NU)
            u = wall.solve_one(gaussian_load(mesh, CONTACT, SPREAD_M)) * FORCE_N / E_PA
            seconds = process_time() - start
            corners = np.unique(mesh.outer_qn[:, :4])
            distance = np.linalg.norm(mesh.points_nc[corners] - RADIUS_M * CONTACT.normal, axis=1)
            corner = -u[corners[np.argmin(distance)]] @ CONTACT.normal * 1e3
            centre = tip_displacement(mesh, CONTACT, u) * 1e3
            print(
                f"{name:38s}{mesh.points_nc.size:8d}{thickness_m * 1e3:8.1f}{centre:8.3f}{centre / converged:7.3f}"
                f"{corner:8.3f}{seconds:9.2f}"
            )


def convergence(rows: int | None) -> None:
    """Print the order of the strain energy for a smooth load on a whole sphere, and under a clamped base."""
    print("\nOrder of the strain energy from three meshes (2 mm wall, push on the pole)")
    print(f"{'element':12s}{'quads':>14s}{'symmetric base':>16s}{'clamped base':>14s}")
    families: dict[str, tuple[tuple[int, ...], dict[str, Any]]] = {
        "8 nodes": ((8, 16, 32), {"order": 1, "layers": 2}),
        "20 nodes": ((4, 8, 16), {"twenty_nodes": True}),
        "27 nodes": ((4, 8, 16), {}),
    }
    for name, (quads, kind) in islice(families.items(), rows):
        orders = [observed_order(quads, kind, symmetric) for symmetric in (True, False)]
        print(f"{name:12s}{quads!s:>14s}{orders[0]:16.2f}{orders[1]:14.2f}")


def observed_order(quads: tuple[int, ...], kind: dict[str, Any], symmetric: bool) -> float:
    """Return log2 of the ratio of successive differences of the energy."""
    energies = []
    for n in quads:
        mesh = wall_mesh(RADIUS_M, 2e-3, divisions=n, level=0, **kind)
        wall = LinearWall(mesh, NU, symmetric_base(mesh) if symmetric else None)
        load = gaussian_load(mesh, Contact(polar_rad=0.0), 3e-3)
        energies.append(0.5 * float(np.sum(load * wall.solve_one(load))))
    return float(np.log2((energies[1] - energies[0]) / (energies[2] - energies[1])))


def timings(quads: int) -> None:
    """Print the parts of a solution on a mesh, and what else could do them."""
    mesh = build_mesh(RADIUS_M, 0.5e-3, quads // 2)
    points = volume_points(mesh)
    element = element_stiffness(points, *lame_constants(1.0, NU))
    wall = LinearWall(mesh, NU)
    dissection = dissect(mesh, wall.held_nc)
    free = np.flatnonzero(~wall.held_nc.ravel())
    K = stiffness_matrix(mesh, element)[free][:, free].tocsc()
    symmetric: dict[str, Any] = {
        "permc_spec": "MMD_AT_PLUS_A",
        "diag_pivot_thresh": 0.0,
        "options": {"SymmetricMode": True},
    }
    random = np.random.default_rng(0)
    contacts = [
        Contact(polar_rad=polar, azimuth_rad=azimuth)
        for polar, azimuth in random.uniform([0.4, -3.0], [0.8, 3.0], (32, 2))
    ]
    directions = random.normal(size=(100_000, 3))
    directions[:, 2] = np.abs(directions[:, 2])
    mesh.locator  # noqa: B018 - made on first use
    loads = needle_loads(mesh, contacts, NEEDLE_RADIUS_M)
    rows: dict[str, float] = {
        "mesh": least_s(lambda: build_mesh(RADIUS_M, 0.5e-3, quads // 2)),
        "Gauss points": least_s(lambda: volume_points(mesh)),
        "element matrices": least_s(lambda: element_stiffness(points, *lame_constants(1.0, NU))),
        "(scikit-fem: all of the matrix)": least_s(lambda: scikit_fem_matrix(mesh), 1),
        "order of elimination": least_s(lambda: dissect(mesh, wall.held_nc)),
        "factorisation": least_s(lambda: FrontalFactor(dissection, element)),
        "(SuperLU, minimum degree)": least_s(lambda: splu(K, **symmetric)),
        "(SuperLU's default ordering)": least_s(lambda: splu(K), 1),
        "one contact's load": least_s(lambda: needle_loads(mesh, contacts, NEEDLE_RADIUS_M)) / len(contacts),
        "one contact, 32 at once": least_s(lambda: wall.solve(loads)) / len(loads),
        "one contact, one at a time": least_s(lambda: wall.solve_one(loads[0])),
        "one direction located": least_s(lambda: locate(mesh, directions)) / len(directions),
    }
    print(f"\nMesh of {quads} quads, {len(free)} free unknowns, {K.nnz / 1e6:.1f} M non-zeros")
    for name, seconds in rows.items():
        print(f"{name:36s}{seconds * 1e3:12.4f} ms{seconds / rows['one contact, 32 at once']:12.4g} contacts")


def scikit_fem_matrix(mesh: HexMesh) -> Any:
    """Assemble a matrix of the same size and quadrature with scikit-fem (straight geometry)."""
    import skfem  # type: ignore[import-untyped]  # comes without types
    from skfem.models.elasticity import linear_elasticity  # type: ignore[import-untyped]  # as above

    corners, vertex_of = np.unique(mesh.cells_en[:, :8], return_inverse=True)
    order = [0, 4, 3, 1, 7, 5, 2, 6]  # scikit-fem's corners in VTK's numbers
    places = np.ascontiguousarray(mesh.points_nc[corners].T)
    straight = skfem.MeshHex1(places, vertex_of.reshape(-1, 8)[:, order].T.astype(np.int32))
    basis = skfem.CellBasis(straight, skfem.ElementVector(skfem.ElementHex2()), intorder=5)
    return linear_elasticity(*lame_constants(1.0, NU)).assemble(basis)


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fine", action="store_true", help="also the meshes of 40 quads (a minute each)")
    parser.add_argument("--rows", type=int, help="only the first N meshes of each table")
    parser.add_argument("--quads", type=int, default=20, help="along an edge of the mesh that is timed; 4, 8, 12, ...")
    given = parser.parse_args()
    reference_problem(MESHES | FINE_MESHES if given.fine else MESHES, given.rows)
    convergence(given.rows)
    timings(given.quads)


if __name__ == "__main__":
    main()
