"""A simulated eye as a file: the wall for ParaView or 3D Slicer (VTK)."""

from pathlib import Path

import meshio  # type: ignore[import-untyped]  # comes without types

from scleraforce.laboratory.simulation import SimulatedEye
from scleraforce.whole_files import renamed_when_whole

__all__ = ["write_vtu"]

CELLS = {8: "hexahedron", 20: "hexahedron20", 27: "hexahedron27"}


def write_vtu(eye: SimulatedEye, path: Path) -> None:
    """Write the undeformed mesh in m with the node fields `displacement` and `needle_displacement`, in m.

    Nodes of an element are in VTK's order already. "Warp by vector" shows the deformed wall.

    Raises:
        InputError: the file cannot be written.
    """
    fields = {"displacement": eye.displacement_nc, "needle_displacement": eye.needle_nc}
    cells = [(CELLS[eye.mesh.cells_en.shape[1]], eye.mesh.cells_en)]
    with renamed_when_whole(path) as part:
        meshio.Mesh(eye.mesh.points_nc, cells, point_data=fields).write(part, file_format="vtu")
