"""A simulated eye as files: the wall for ParaView or 3D Slicer (VTK), its figure (PNG). Whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import meshio  # type: ignore[import-untyped]  # comes without types
from matplotlib.figure import Figure

from scleraforce.errors import InputError
from scleraforce.report.simulation import SimulatedEye

__all__ = ["write_png", "write_vtu"]

CELLS = {8: "hexahedron", 20: "hexahedron20", 27: "hexahedron27"}


def write_vtu(eye: SimulatedEye, path: Path) -> None:
    """Write the undeformed mesh in m with the node fields `displacement` and `needle_displacement`, in m.

    Nodes of an element are in VTK's order already. "Warp by vector" shows the deformed wall.

    Raises:
        InputError: the file cannot be written.
    """
    fields = {"displacement": eye.displacement_nc, "needle_displacement": eye.needle_nc}
    cells = [(CELLS[eye.mesh.cells_en.shape[1]], eye.mesh.cells_en)]
    with _renamed_when_whole(path) as part:
        meshio.Mesh(eye.mesh.points_nc, cells, point_data=fields).write(part, file_format="vtu")


def write_png(figure: Figure, path: Path) -> None:
    """Write a figure.

    Raises:
        InputError: the file cannot be written.
    """
    with _renamed_when_whole(path) as part:
        figure.savefig(part, format="png", dpi=200, facecolor="white", metadata={"Software": None})


@contextmanager
def _renamed_when_whole(path: Path) -> Iterator[Path]:
    """Give a temporary name beside `path`; the file gets its own name when it is finished."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield part
        part.replace(path)
    except OSError as fault:
        raise InputError(f"{path}: {fault.strerror}") from fault
    finally:
        part.unlink(missing_ok=True)
