"""R1, or any load on a wall of ours, in CalculiX: an independent program in its own
process.
"""

import os
import pty
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from scleraforce.mechanics.hexahedral_mesh import HexMesh
from speed.solvers.problem import peak_mb

# CalculiX prints few digits (hence lengths in mm, forces in N, stresses in MPa, mass in
# t) and reads 20 characters.
MM_PER_M = 1e3
# what it says of its own work
FIRST_STEP = "Determining the structure of the matrix"
LAST_STEP = "Job finished"


@dataclass(frozen=True, kw_only=True)
class Calculated:
    """The result of a run of CalculiX.

    Attributes:
        displacement_nc: (node, 3), m.
        seconds: of the whole process, files included.
        own_seconds: from the structure of the matrix to the end; reading and writing
            files is not among them.
        peak_mb: its largest memory.
    """

    displacement_nc: NDArray[np.float64]
    seconds: float
    own_seconds: float
    peak_mb: float


def is_installed() -> bool:
    """Return whether there is a `ccx`."""
    return shutil.which("ccx") is not None


def input_deck(
    mesh: HexMesh,
    element: str,
    loads: str,
    *,
    youngs_modulus_pa: float,
    poisson_ratio: float,
    density_kg_m3: float,
) -> str:
    """Return the input of a static, linear step: the wall of elements of 8 or 20 nodes,
    its base held.
    """
    lines = ["*NODE, NSET=ALL"]
    lines += [
        f"{n + 1}, {x:.12e}, {y:.12e}, {z:.12e}"
        for n, (x, y, z) in enumerate(mesh.points_nc * MM_PER_M)
    ]
    lines += [f"*ELEMENT, TYPE={element}, ELSET=WALL"]

    for e, cell in enumerate(mesh.cells_en + 1):
        numbers = [e + 1, *cell]  # VTK's order of 8 and 20 nodes is also CalculiX's
        lines += [
            ", ".join(map(str, part)) + ","
            for part in (numbers[:15], numbers[15:])
            if part
        ]

    lines += ["*NSET, NSET=BASE", *(f"{n + 1}," for n in mesh.base_nodes)]
    lines += [
        "*MATERIAL, NAME=SCLERA",
        "*ELASTIC",
        f"{youngs_modulus_pa * 1e-6}, {poisson_ratio}",
    ]
    lines += ["*DENSITY", f"{density_kg_m3 * 1e-12:.9e}"]
    lines += [
        "*SOLID SECTION, ELSET=WALL, MATERIAL=SCLERA",
        "*BOUNDARY",
        "BASE, 1, 3",
        "*STEP",
        "*STATIC",
    ]

    return "\n".join([*lines, loads, "*NODE PRINT, NSET=ALL", "U", "*END STEP", ""])


def force_cards(forces_nc: NDArray[np.float64]) -> str:
    """Return concentrated forces (node, 3), N."""
    loaded = np.flatnonzero(forces_nc.any(axis=1))
    return "*CLOAD\n" + "\n".join(
        f"{n + 1}, {c + 1}, {forces_nc[n, c]:.11e}" for n in loaded for c in range(3)
    )


def calculate(folder: Path, deck: str, nodes: int) -> Calculated:
    """Run CalculiX on one thread in a folder.

    Raises:
        RuntimeError: it reports an error, or does not finish.
    """
    (folder / "wall.inp").write_text(deck, encoding="ascii")
    said = ""
    began = 0.0
    seconds = 0.0
    peak = 0.0
    # On a terminal it says each step when it comes to it, and not all of them in the
    # end.
    ours, theirs = pty.openpty()
    start = perf_counter()
    process = subprocess.Popen(
        ["ccx", "wall"],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=theirs,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    os.close(theirs)

    while part := _next_words(ours):
        seconds = perf_counter() - start
        said += part
        if not began and FIRST_STEP in said:
            began = seconds
        # what it said last may be read after its end
        peak = max(peak, peak_mb(process.pid))

    os.close(ours)
    process.wait()
    if process.returncode or "ERROR" in said or LAST_STEP not in said:
        raise RuntimeError(f"ccx ended with code {process.returncode}: {said[-500:]}")

    return Calculated(
        displacement_nc=_read(folder / "wall.dat", nodes),
        seconds=perf_counter() - start,
        own_seconds=seconds - began,
        peak_mb=peak,
    )


def _next_words(terminal: int) -> str:
    """Return what is said next; nothing at the end, which Linux reports as an error."""
    try:
        return os.read(terminal, 65536).decode("ascii", "replace")
    except OSError:
        return ""


def _read(path: Path, nodes: int) -> NDArray[np.float64]:
    rows = [line.split() for line in path.read_text(encoding="ascii").splitlines()]
    table = np.array(
        [row for row in rows if len(row) == 4 and row[0].isdigit()], dtype=float
    )
    if len(table) != nodes:
        raise RuntimeError(f"ccx printed {len(table)} displacements of {nodes} nodes")

    found: NDArray[np.float64] = table[np.argsort(table[:, 0]), 1:] / MM_PER_M
    return found
