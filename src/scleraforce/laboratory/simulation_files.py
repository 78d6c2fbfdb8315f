"""A simulated eye as a file: the wall for ParaView or 3D Slicer (VTK, XDMF)."""

from pathlib import Path

import meshio  # type: ignore[import-untyped]  # comes without types
import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.simulation import SimulatedEye
from scleraforce.whole_files import renamed_when_whole

CELLS = {8: "hexahedron", 20: "hexahedron20", 27: "hexahedron27"}


def write_vtu(eye: SimulatedEye, path: Path) -> None:
    """Write the undeformed mesh in m with the node fields `displacement` and `needle_displacement`, in m.

    Nodes of an element are in VTK's order already. "Warp by vector" shows the deformed wall.

    Raises:
        InputError: the file cannot be written.
    """
    fields = {"displacement": eye.displacement_nc, "needle_displacement": eye.needle_nc}
    with renamed_when_whole(path) as part:
        meshio.Mesh(eye.mesh.points_nc, _cells(eye), point_data=fields).write(part, file_format="vtu")


def write_xdmf(eye: SimulatedEye, path: Path) -> None:
    """Write the same mesh as a series of two states for ParaView: without the needle, and under its force.

    The times of the series are the force in N; the fields are those of `write_vtu`. Numbers stand in the file as text,
    so that it needs no HDF5.

    Raises:
        InputError: the file cannot be written.
    """
    resting_nc = eye.displacement_nc - eye.needle_nc
    with renamed_when_whole(path) as part, meshio.xdmf.TimeSeriesWriter(part, data_format="XML") as series:
        series.write_points_cells(eye.mesh.points_nc, _cells(eye))
        for force_n, displacement_nc in ((0.0, resting_nc), (eye.force_n, eye.displacement_nc)):
            fields = {"displacement": displacement_nc, "needle_displacement": displacement_nc - resting_nc}
            series.write_data(force_n, point_data=fields)


def _cells(eye: SimulatedEye) -> list[tuple[str, NDArray[np.int64]]]:
    return [(CELLS[eye.mesh.cells_en.shape[1]], eye.mesh.cells_en)]
