"""One simulated eye under one force: what `simulate` shows, and the deformed mesh of the paper's Fig. 1b."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.eye.contact import Contact
from scleraforce.eye.mesh import HexMesh
from scleraforce.eye.study_mesh import study_mesh
from scleraforce.imaging.plane import ScanPlane, SliceWindow
from scleraforce.imaging.section import cut_sections
from scleraforce.imaging.slices import fill_section, slice_window
from scleraforce.mechanics.linear import LinearWall, tip_displacement
from scleraforce.study import Study

__all__ = ["SimulatedEye", "simulate_eye"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SimulatedEye:
    """A wall with the needle on it.

    `displacement_nc` (node, 3) in m, from the unloaded wall; `needle_nc` (node, 3) the needle's part of it, from the
    state under IOP and gravity. `slice` (rows, columns): 255 = wall, in `window`.
    """

    mesh: HexMesh
    contact: Contact
    force_n: float
    displacement_nc: Floats
    needle_nc: Floats
    slice: NDArray[np.uint8]
    window: SliceWindow

    @property
    def tip_m(self) -> float:
        """Inward displacement of the outer surface at the contact, from the state without the needle, in m."""
        return tip_displacement(self.mesh, self.contact, self.needle_nc)


def simulate_eye(study: Study, thickness_m: float, force_n: float, contact: Contact) -> SimulatedEye:
    """Bend a wall of the study's material by linear mechanics and cut its slice beside the needle.

    Raises:
        InputError: the needle or the B-scan plane misses the wall.
        SolverError: the wall deforms too much to be cut.
    """
    eye = study.eye
    wall = LinearWall(study_mesh(study, thickness_m, contact), eye.poisson_ratio)
    unit_nc = wall.needle_cnc([contact], 0.5 * study.needle.outer_diameter_m)[0]
    resting_nc, displacement_nc = (
        wall.displacement(
            unit_nc,
            force,
            youngs_modulus_pa=eye.youngs_modulus_pa,
            iop_pa=eye.iop_pa,
            density_kg_m3=eye.density_kg_m3,
        )
        for force in (0.0, force_n)
    )
    plane = ScanPlane(contact, study.needle.gap_m)
    modes_knc = np.stack([resting_nc, displacement_nc])
    resting, loaded = cut_sections(wall.mesh, [plane], modes_knc, np.eye(2)[None])[0]
    window = slice_window(study.slice, top_m=float(resting.outer[:, 1].min()))
    return SimulatedEye(
        mesh=wall.mesh,
        contact=contact,
        force_n=force_n,
        displacement_nc=displacement_nc,
        needle_nc=displacement_nc - resting_nc,
        slice=fill_section(loaded, window),
        window=window,
    )
