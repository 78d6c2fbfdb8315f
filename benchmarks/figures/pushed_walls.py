"""Walls of radius 12 mm under the needle of 0.7 mm, and forces read from their outer
surface in the slice: a reader without light and noise.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from scleraforce.mechanics.contact_and_section import Contact, ScanPlane
from scleraforce.mechanics.finite_strain_wall import FiniteWall, LoadPath
from scleraforce.mechanics.hexahedral_mesh import HexMesh
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.loads_and_supports import needle_at
from scleraforce.mechanics.mesh_section import cut_sections

Floats = NDArray[np.float64]

RADIUS_M = 12e-3
THICKNESS_M = 0.6e-3
NU = 0.45
NEEDLE_RADIUS_M = 0.35e-3
CONTACT = Contact(polar_rad=np.radians(35.0))
PLANE = ScanPlane(CONTACT, gap_m=0.5e-3)
SEEN_M = np.linspace(-3.5e-3, 3.5e-3, 141)
FINE_N = 1e-5


def push(
    wall: FiniteWall,
    end: PathEnd,
    modulus_pa: float,
    iop_pa: float,
    *,
    contact: Contact = CONTACT,
    touched: HexMesh | None = None,
    density_kg_m3: float = 0.0,
) -> LoadPath:
    """Return the path of a wall under the needle, which pushes on the outer surface of
    `touched`, by default the wall's own.
    """
    return wall.load_path(
        needle_at(touched or wall.mesh, contact, NEEDLE_RADIUS_M),
        end,
        youngs_modulus_pa=modulus_pa,
        iop_pa=iop_pa,
        density_kg_m3=density_kg_m3,
    )


def surfaces(mesh: HexMesh, displacement_snc: Floats) -> Floats:
    """Return the outer surface of states in the slice, moved in depth to a mean of 0,
    (state, place) in m.
    """
    cut = cut_sections(
        mesh, [PLANE], displacement_snc, np.eye(len(displacement_snc))[None]
    )[0]
    near = [section.outer[section.outer[:, 1] < 0.5 * RADIUS_M] for section in cut]
    depths_sn = np.array(
        [np.interp(SEEN_M, *curve[np.argsort(curve[:, 0])].T) for curve in near]
    )

    return np.asarray(
        depths_sn - depths_sn.mean(axis=1, keepdims=True), dtype=np.float64
    )


class ElasticSections:
    """The outer surface of an elastic wall at every force."""

    def __init__(self, mesh: HexMesh, path: LoadPath) -> None:
        """Cut the path's states."""
        self._forces_n = np.arange(0.0, path.max_force_n, FINE_N)
        surface = CubicSpline(path.tips_m, surfaces(mesh, path.displacement_snc))
        self._surface = surface([path.tip_m(force_n) for force_n in self._forces_n])

    def read_n(self, seen_sn: Floats) -> tuple[Floats, Floats]:
        """Return the forces whose surfaces are nearest, (state,) in N, and their root
        mean square distances, m.
        """
        apart = [np.square(self._surface - seen).mean(axis=1) for seen in seen_sn]
        nearest = [int(one.argmin()) for one in apart]
        return self._forces_n[nearest], np.sqrt(
            [one[at] for one, at in zip(apart, nearest, strict=True)]
        )
