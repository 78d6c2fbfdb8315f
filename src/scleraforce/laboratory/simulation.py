"""One simulated eye under one force, as `simulate` shows it, and the deformed mesh of the paper's Fig. 1b."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.virtual_eye import linear_wall
from scleraforce.mechanics.contact import Contact, ScanPlane, SliceWindow
from scleraforce.mechanics.finite_strain import bend_eye
from scleraforce.mechanics.linear import tip_displacement
from scleraforce.mechanics.mesh import HexMesh
from scleraforce.mechanics.section import cut_sections
from scleraforce.mechanics.slices import fill_section, slice_window
from scleraforce.study import Study
from scleraforce.whole_files import renamed_when_whole

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedEye:
    """A wall with the needle on it.

    `displacement_nc` (node, 3) in m, from the unloaded wall; `needle_nc` (node, 3) the needle's part of it, from the
    state under IOP and gravity. `tip_m`: inward displacement of the outer surface at the contact along the needle axis
    from that state. `dent_m`: the same from the undented wall at `pressure_pa`, the pressure under the needle; in a
    sealed globe it is the larger one. `slice` (rows, columns): 255 = wall, in `window`.
    """

    mesh: HexMesh
    contact: Contact
    force_n: float
    displacement_nc: Floats
    needle_nc: Floats
    tip_m: float
    dent_m: float
    pressure_pa: float
    slice: NDArray[np.uint8]
    window: SliceWindow


def simulate_eye(
    study: Study,
    thickness_m: float,
    force_n: float,
    contact: Contact,
    progress: Callable[[float], object] | None = None,
) -> SimulatedEye:
    """Bend a wall by the study's `[mechanics]` and `[globe]` and cut its slice beside the needle.

    `progress` is called with the finished share of a load path.

    Raises:
        InputError: the needle or the B-scan plane misses the wall, or linear mechanics does not support such an eye.
        SolverError: the wall deforms too much to be cut, or no equilibrium was found.
    """
    if study.mechanics.kind == "linear":
        return _bent_linearly(study, thickness_m, force_n, contact)
    eye = study.eye
    modulus_pa, iop_pa = eye.youngs_modulus_pa, eye.iop_pa
    bent = bend_eye(
        study, contact, thickness_m=thickness_m, youngs_modulus_pa=modulus_pa, iop_pa=iop_pa, max_force_n=force_n,
        progress=progress,
    )  # fmt: skip
    path = bent.path
    states = path.displacement_nc(0.0), path.displacement_nc(force_n)
    dents = path.travel_m(force_n), path.tip_m(force_n)
    return _sliced(study, contact, force_n, bent.mesh, states, dents, path.pressure_pa(force_n))


def _sliced(
    study: Study,
    contact: Contact,
    force_n: float,
    mesh: HexMesh,
    states_nc: tuple[Floats, Floats],
    dents_m: tuple[float, float],
    pressure_pa: float,
) -> SimulatedEye:
    """Return an eye with its slice, from displacements (node, 3) without and with the needle, `tip_m` and `dent_m`."""
    plane = ScanPlane(contact, gap_m=study.needle.gap_m)
    resting, loaded = cut_sections(mesh, [plane], np.stack(states_nc), np.eye(2)[None])[0]
    window = slice_window(study.slice, top_m=float(resting.outer[:, 1].min()))
    return SimulatedEye(
        mesh=mesh,
        contact=contact,
        force_n=force_n,
        displacement_nc=states_nc[1],
        needle_nc=states_nc[1] - states_nc[0],
        tip_m=dents_m[0],
        dent_m=dents_m[1],
        pressure_pa=pressure_pa,
        slice=fill_section(loaded, window),
        window=window,
    )


def _bent_linearly(study: Study, thickness_m: float, force_n: float, contact: Contact) -> SimulatedEye:
    eye, wall = study.eye, linear_wall(study, "simulate", thickness_m, contact, study.eye.youngs_modulus_pa)
    unit_nc = wall.needle_cnc([contact], 0.5 * study.needle.outer_diameter_m)[0]
    loads = {
        "youngs_modulus_pa": eye.youngs_modulus_pa, "iop_pa": eye.iop_pa, "density_kg_m3": eye.density_kg_m3,
    }  # fmt: skip
    states = wall.displacement(unit_nc, 0.0, **loads), wall.displacement(unit_nc, force_n, **loads)
    tip_m = tip_displacement(wall.mesh, contact, states[1] - states[0])
    return _sliced(study, contact, force_n, wall.mesh, states, (tip_m, tip_m), eye.iop_pa)


CELLS = {8: "hexahedron", 20: "hexahedron20", 27: "hexahedron27"}


def write_vtu(eye: SimulatedEye, path: Path) -> None:
    """Write the undeformed mesh in m with the node fields `displacement` and `needle_displacement`, in m.

    "Warp by vector" shows the deformed wall.
    """
    import meshio  # type: ignore[import-untyped]  # comes without types; imported here: it takes 0.15 s

    fields = {"displacement": eye.displacement_nc, "needle_displacement": eye.needle_nc}
    with renamed_when_whole(path) as part:
        meshio.Mesh(eye.mesh.points_nc, _cells(eye), point_data=fields).write(part, file_format="vtu")


def write_xdmf(eye: SimulatedEye, path: Path) -> None:
    """Write mesh and fields as a series of two states for ParaView, at rest and under the force (times, in N)."""
    import meshio  # imported here, as above

    resting_nc = eye.displacement_nc - eye.needle_nc
    with renamed_when_whole(path) as part, meshio.xdmf.TimeSeriesWriter(part, data_format="XML") as series:
        series.write_points_cells(eye.mesh.points_nc, _cells(eye))
        for force_n, displacement_nc in ((0.0, resting_nc), (eye.force_n, eye.displacement_nc)):
            fields = {"displacement": displacement_nc, "needle_displacement": displacement_nc - resting_nc}
            series.write_data(force_n, point_data=fields)


def _cells(eye: SimulatedEye) -> list[tuple[str, NDArray[np.int64]]]:
    return [(CELLS[eye.mesh.cells_en.shape[1]], eye.mesh.cells_en)]
