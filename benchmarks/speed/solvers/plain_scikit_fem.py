"""R1 in scikit-fem, as its manual would have it: `python -m
speed.solvers.plain_scikit_fem [--quick]`.

27-node hexahedra on a mesh of straight edges, `linear_elasticity`, a traction on the
outer facets, `condense` and `solve` with the solver that it comes with; but the
quadrature is ours.
"""

import sys
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
import skfem  # type: ignore[import-untyped]  # comes without types
from numpy.typing import NDArray
from skfem.models.elasticity import lame_parameters, linear_elasticity  # type: ignore[import-untyped]  # as above

from reference_r1 import CONTACT, E_PA, FORCE_N, NU, RADIUS_M, SPREAD_M
from scleraforce.mechanics.hexahedral_mesh import HexMesh, build_mesh, locate
from speed.solvers.problem import THICKNESS_M, Solved, peak_mb

CORNERS = [0, 4, 3, 1, 7, 5, 2, 6]  # scikit-fem's corners in VTK's numbers
# three Gauss points along each direction: by itself it takes seven, and minutes
QUADRATURE = 5
ON_SURFACE = 1.0 - 1e-6  # just within the outer elements


@dataclass(frozen=True, eq=False)
class Assembled:
    """R1 in scikit-fem: the straight mesh, its basis, matrix, load of 30 mN, and the
    unknowns that are held.
    """

    mesh: HexMesh
    basis: Any
    stiffness: Any
    load: NDArray[np.float64]
    held: Any


def assemble(quick: bool) -> Assembled:
    """Return R1 assembled."""
    corners = build_mesh(
        RADIUS_M, THICKNESS_M, divisions=4 if quick else 20, level=0, order=1
    )
    mesh = skfem.MeshHex1(
        corners.points_nc.T.copy(), corners.cells_en[:, CORNERS].T.copy()
    )
    element = skfem.ElementVector(skfem.ElementHex2())
    basis = skfem.Basis(mesh, element, intorder=QUADRATURE)
    outer = skfem.FacetBasis(mesh, element, facets=_outer_facets(mesh))

    return Assembled(
        corners,
        basis,
        linear_elasticity(*lame_parameters(E_PA, NU)).assemble(basis),
        _load(outer),
        basis.get_dofs(mesh.facets_satisfying(lambda x: x[2] < 1e-9)),
    )


def solve(quick: bool) -> Solved:
    """Mesh, matrix, load, displacements."""
    start = perf_counter()
    problem = assemble(quick)
    found = skfem.solve(
        *skfem.condense(problem.stiffness, problem.load, D=problem.held)
    )
    seconds = perf_counter() - start

    return Solved(
        seconds=seconds,
        unknowns=int(problem.basis.N),
        tip_mm=_tip_mm(problem, found),
        peak_mb=peak_mb(),
    )


def _outer_facets(mesh: Any) -> NDArray[np.int64]:
    distance_m = np.linalg.norm(mesh.p[:, mesh.facets], axis=0)
    return np.flatnonzero((distance_m > RADIUS_M - 0.1 * THICKNESS_M).all(axis=0))


def _gaussian(x: NDArray[np.float64]) -> Any:
    square = sum((x[c] - RADIUS_M * CONTACT.normal[c]) ** 2 for c in range(3))
    return np.exp(-square / (2 * SPREAD_M**2))


def _load(outer: Any) -> NDArray[np.float64]:
    """Return 30 mN inward along the load's direction, as a traction on the outer
    facets.
    """
    total = skfem.Functional(lambda w: _gaussian(w.x)).assemble(outer)
    pushed = skfem.LinearForm(
        lambda v, w: -_gaussian(w.x) * sum(CONTACT.normal[c] * v[c] for c in range(3))
    )
    load: NDArray[np.float64] = FORCE_N / total * pushed.assemble(outer)
    return load


def _tip_mm(problem: Assembled, found: NDArray[np.float64]) -> float:
    """Read the displacement where the load's axis pierces the outer facets."""
    quads, weights = locate(problem.mesh, CONTACT.normal[None])
    place = weights[0] @ problem.mesh.points_nc[problem.mesh.outer_qn[quads[0]]]
    moved = problem.basis.probes(ON_SURFACE * place[:, None]) @ found
    return float(-1e3 * moved @ CONTACT.normal)


if __name__ == "__main__":
    solve(quick=True)  # a running process has loaded its code
    solve("--quick" in sys.argv).tell()
