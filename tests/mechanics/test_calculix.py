"""The same wall in CalculiX, an independent program in its own process."""

from pathlib import Path

import numpy as np
import pytest

from reference_walls import wall_mesh
from scleraforce.mechanics.contact import Contact
from scleraforce.mechanics.linear import LinearWall
from scleraforce.mechanics.loads import needle_loads
from scleraforce.mechanics.mesh import HexMesh
from scleraforce.units import STANDARD_GRAVITY_M_S2
from speed.solvers.calculix import MM_PER_M, calculate, force_cards, input_deck, is_installed

pytestmark = pytest.mark.skipif(not is_installed(), reason="CalculiX (ccx) is not installed")

R, T, E, NU = 12e-3, 0.8e-3, 0.25e6, 0.45
IOP_PA, DENSITY_KG_M3, FORCE_N, NEEDLE = 266.0, 1100.0, 0.03, 0.35e-3
CONTACT = Contact(polar_rad=np.radians(35.0), azimuth_rad=0.4)


def needle_cards(mesh: HexMesh) -> str:
    """Concentrated loads: what CalculiX solves must be the same; its own disc load does not exist."""
    return force_cards(FORCE_N * needle_loads(mesh, [CONTACT], NEEDLE)[0])


def iop_cards(mesh: HexMesh) -> str:
    """CalculiX's own pressure on face 1 (nodes 1-2-3-4: the inner side of the innermost elements)."""
    inner = set(mesh.inner_qn[:, :4].ravel().tolist())
    elements = [e + 1 for e, cell in enumerate(mesh.cells_en) if set(cell[:4].tolist()) <= inner]
    return "*DLOAD\n" + "\n".join(f"{e}, P1, {IOP_PA * 1e-6:.11e}" for e in elements)


def gravity_cards(mesh: HexMesh) -> str:  # noqa: ARG001 - one of three makers of cards
    return f"*DLOAD\nWALL, GRAV, {STANDARD_GRAVITY_M_S2 * MM_PER_M}, 0., 0., -1."


@pytest.mark.parametrize(
    ("element", "kind"), [("C3D20", {"twenty_nodes": True, "divisions": 6}), ("C3D8", {"order": 1, "divisions": 10})]
)
@pytest.mark.parametrize("load", ["iop", "gravity", "needle"])
def test_displacements_agree_with_calculix(tmp_path: Path, element: str, kind: dict, load: str) -> None:
    mesh = wall_mesh(R, T, level=0, layers=2, **kind)
    wall = LinearWall(mesh, NU)
    cards = {"iop": iop_cards, "gravity": gravity_cards, "needle": needle_cards}[load](mesh)
    deck = input_deck(mesh, element, cards, youngs_modulus_pa=E, poisson_ratio=NU, density_kg_m3=DENSITY_KG_M3)
    theirs = calculate(tmp_path, deck, len(mesh.points_nc)).displacement_nc
    ours = {
        "iop": lambda: IOP_PA * wall.pressure_nc,
        "gravity": lambda: DENSITY_KG_M3 * STANDARD_GRAVITY_M_S2 * wall.gravity_nc,
        "needle": lambda: FORCE_N * wall.needle_cnc([CONTACT], NEEDLE)[0],
    }[load]() / E
    assert np.abs(theirs).max() > 1e-6
    assert np.abs(ours - theirs).max() < 1e-4 * np.abs(theirs).max()
