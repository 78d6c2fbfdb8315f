"""The same wall in CalculiX, an independent program in its own process."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from scleraforce.eye.contact import Contact
from scleraforce.eye.mesh import HexMesh, build_mesh
from scleraforce.mechanics.linear import LinearWall
from scleraforce.mechanics.loads import needle_loads
from scleraforce.units import STANDARD_GRAVITY_M_S2

pytestmark = pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")

R, T, E, NU = 12e-3, 0.8e-3, 0.25e6, 0.45
IOP_PA, DENSITY_KG_M3, FORCE_N, NEEDLE = 266.0, 1100.0, 0.03, 0.35e-3
CONTACT = Contact(polar_rad=np.radians(35.0), azimuth_rad=0.4)
# CalculiX prints few digits (hence lengths in mm, forces in N, stresses in MPa, mass in t) and reads 20 characters.
MM_PER_M = 1e3


def input_deck(mesh: HexMesh, element: str, loads: str) -> str:
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{n + 1}, {x:.12e}, {y:.12e}, {z:.12e}" for n, (x, y, z) in enumerate(mesh.points_nc * MM_PER_M)]
    lines += [f"*ELEMENT, TYPE={element}, ELSET=WALL"]
    for e, cell in enumerate(mesh.cells_en + 1):
        numbers = [e + 1, *cell]  # VTK's order of 8 and 20 nodes is also CalculiX's
        lines += [", ".join(map(str, part)) + "," for part in (numbers[:15], numbers[15:]) if part]
    lines += ["*NSET, NSET=BASE", *(f"{n + 1}," for n in mesh.base_nodes)]
    lines += ["*MATERIAL, NAME=SCLERA", "*ELASTIC", f"{E * 1e-6}, {NU}", "*DENSITY", f"{DENSITY_KG_M3 * 1e-12:.9e}"]
    lines += ["*SOLID SECTION, ELSET=WALL, MATERIAL=SCLERA", "*BOUNDARY", "BASE, 1, 3", "*STEP", "*STATIC"]
    return "\n".join([*lines, loads, "*NODE PRINT, NSET=ALL", "U", "*END STEP", ""])


def needle_cards(mesh: HexMesh) -> str:
    """Concentrated loads: what CalculiX solves must be the same; its own disc load does not exist."""
    forces = FORCE_N * needle_loads(mesh, [CONTACT], NEEDLE)[0]
    return "*CLOAD\n" + "\n".join(
        f"{n + 1}, {c + 1}, {forces[n, c]:.11e}" for n in np.flatnonzero(forces.any(axis=1)) for c in range(3)
    )


def iop_cards(mesh: HexMesh) -> str:
    """CalculiX's own pressure on face 1 (nodes 1-2-3-4: the inner side of the innermost elements)."""
    inner = set(mesh.inner_qn[:, :4].ravel().tolist())
    elements = [e + 1 for e, cell in enumerate(mesh.cells_en) if set(cell[:4].tolist()) <= inner]
    return "*DLOAD\n" + "\n".join(f"{e}, P1, {IOP_PA * 1e-6:.11e}" for e in elements)


def gravity_cards(mesh: HexMesh) -> str:  # noqa: ARG001 - one of three makers of cards
    return f"*DLOAD\nWALL, GRAV, {STANDARD_GRAVITY_M_S2 * MM_PER_M}, 0., 0., -1."


def calculix(folder: Path, deck: str, nodes: int) -> np.ndarray:
    (folder / "wall.inp").write_text(deck)
    done = subprocess.run(["ccx", "wall"], cwd=folder, capture_output=True, text=True, timeout=300, check=True)
    assert "ERROR" not in done.stdout
    rows = [line.split() for line in (folder / "wall.dat").read_text().splitlines()]
    table = np.array([row for row in rows if len(row) == 4 and row[0].isdigit()], dtype=float)
    assert table.shape == (nodes, 4)
    return table[np.argsort(table[:, 0]), 1:] / MM_PER_M


@pytest.mark.parametrize(
    ("element", "kind"),
    [("C3D20", {"order": 2, "serendipity": True, "divisions": 6}), ("C3D8", {"order": 1, "divisions": 10})],
)
@pytest.mark.parametrize("load", ["iop", "gravity", "needle"])
def test_displacements_are_those_of_calculix(tmp_path: Path, element: str, kind: dict, load: str) -> None:
    mesh = build_mesh(R, T, level=0, layers=2, **kind)
    wall = LinearWall(mesh, NU)
    cards = {"iop": iop_cards, "gravity": gravity_cards, "needle": needle_cards}[load](mesh)
    theirs = calculix(tmp_path, input_deck(mesh, element, cards), len(mesh.points_nc))
    ours = {
        "iop": lambda: IOP_PA * wall.pressure_nc,
        "gravity": lambda: DENSITY_KG_M3 * STANDARD_GRAVITY_M_S2 * wall.gravity_nc,
        "needle": lambda: FORCE_N * wall.needle_cnc([CONTACT], NEEDLE)[0],
    }[load]() / E
    assert np.abs(theirs).max() > 1e-6
    assert np.abs(ours - theirs).max() < 1e-4 * np.abs(theirs).max()
