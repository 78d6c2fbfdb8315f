"""R1 in this package: `python -m speed.solvers.ours MESH [--quick]`."""

import sys
from time import perf_counter

from reference_r1 import E_PA, NU
from scleraforce.mechanics.linear_wall import LinearWall
from speed.solvers.problem import Solved, peak_mb, r1_forces, r1_mesh, tip_mm


def solve(name: str, quick: bool) -> Solved:
    """Mesh, matrix, factor, load, displacements."""
    start = perf_counter()
    mesh = r1_mesh(name, quick)
    displacement_nc = LinearWall(mesh, NU).solve_one(r1_forces(mesh)) / E_PA
    seconds = perf_counter() - start

    return Solved(
        seconds=seconds,
        unknowns=mesh.points_nc.size,
        tip_mm=tip_mm(mesh, displacement_nc),
        peak_mb=peak_mb(),
    )


if __name__ == "__main__":
    solve(sys.argv[1], True)  # a running process has loaded its code
    solve(sys.argv[1], "--quick" in sys.argv).tell()
