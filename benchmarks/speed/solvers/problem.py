"""R1 on the compared meshes, and the figures that a process prints of its solve."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reference_r1 import (
    CONTACT,
    CONVERGED_MM,
    FORCE_N,
    RADIUS_M,
    SPREAD_M,
    gaussian_load,
)
from reference_walls import wall_mesh
from scleraforce.mechanics.graded_mesh import supported_mesh
from scleraforce.mechanics.hexahedral_mesh import HexMesh
from scleraforce.mechanics.linear_wall import tip_displacement
from scleraforce.records.study import MeshStudy, Study

THICKNESS_M = 0.5e-3
QUICK: dict[str, Any] = {"divisions": 4, "level": 0}
SMALL = Study(mesh=MeshStudy(core=2, rings=6))
MESHES: dict[str, Callable[[bool], HexMesh]] = {
    "default": lambda quick: supported_mesh(
        SMALL if quick else Study(), THICKNESS_M, CONTACT, alone=True
    ),
    "even": lambda quick: _even(**(QUICK if quick else {})),
    "20-node": lambda quick: _even(**(QUICK if quick else {}), twenty_nodes=True),
    "paper's": lambda quick: _even(
        **(QUICK if quick else {"level": 2}), layers=2, order=1
    ),
}


@dataclass(frozen=True, kw_only=True)
class Solved:
    """One solve.

    Attributes:
        seconds: from an empty hand to the displacements, in a process that runs already
            and reads no file.
        unknowns: three a node, held ones included.
        tip_mm: inward displacement along the load at its centre.
        peak_mb: the largest memory of the process.
    """

    seconds: float
    unknowns: int
    tip_mm: float
    peak_mb: float

    def tell(self) -> None:
        """Print it for the process that asks."""
        print(json.dumps(asdict(self)))


def _even(**kind: Any) -> HexMesh:
    return wall_mesh(RADIUS_M, THICKNESS_M, **kind)


def r1_mesh(name: str, quick: bool) -> HexMesh:
    """Return one of the meshes."""
    return MESHES[name](quick)


def r1_forces(mesh: HexMesh) -> NDArray[np.float64]:
    """Return the nodal forces (node, 3), N."""
    return FORCE_N * gaussian_load(mesh, CONTACT, SPREAD_M)


def tip_mm(mesh: HexMesh, displacement_nc: NDArray[np.float64]) -> float:
    """Return the inward displacement at the load's centre, of displacements in m."""
    return 1e3 * tip_displacement(mesh, CONTACT, displacement_nc)


def error_percent(found_mm: float) -> float:
    """Return how far a tip is from the converged one; negative: too stiff."""
    return 100.0 * (found_mm / CONVERGED_MM[THICKNESS_M] - 1.0)


def peak_mb(pid: int | str = "self") -> float:
    """Return the largest resident memory of a process so far; 0 for one that has ended
    and is not waited for yet.

    The system's `ru_maxrss` does not serve for children: it begins with the parent's
    memory at the start.
    """
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    return next(
        (float(line.split()[1]) / 1e3 for line in lines if line.startswith("VmHWM")),
        0.0,
    )
