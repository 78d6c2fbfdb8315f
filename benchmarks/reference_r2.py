"""R2, the project's reference problem for finite strain: a half-sphere on its own mesh
and loads, by another program.

12 mm, nu 0.45, 266 Pa as a dead load by Voronoi areas, a Gaussian of 0.35 mm as nodal
weights, no weight; tips were read at the node nearest to the load.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import SphericalVoronoi

from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_strain_wall import FiniteWall, LoadPath
from scleraforce.mechanics.hexahedral_mesh import HexMesh
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.loads_and_supports import NeedleLoad, tip_at

Floats = NDArray[np.float64]

RADIUS_M = 12e-3
NU = 0.45
IOP_PA = 266.0
NEEDLE_RADIUS_M = 0.35e-3
FORCES_MN = (5, 10, 15, 20, 25, 30, 40, 50, 60)
# Tips at these forces, by thickness in m, Young's modulus in Pa and polar angle of the
# contact in degrees.
TIPS_MM = {
    (0.8e-3, 0.27e6, 35.0): (
        0.144,
        0.309,
        0.505,
        0.750,
        1.073,
        1.502,
        2.541,
        3.503,
        4.379,
    ),
    (0.8e-3, 0.38e6, 35.0): (
        0.102,
        0.215,
        0.342,
        0.488,
        0.660,
        0.872,
        1.484,
        2.319,
        3.125,
    ),
    (0.5e-3, 0.22e6, 35.0): (0.422, 1.141, 1.941, 2.663, 3.343, 4.001, 5.289, 6.562),
    (0.8e-3, 0.38e6, 0.0): (
        0.106,
        0.222,
        0.353,
        0.503,
        0.680,
        0.897,
        1.528,
        2.393,
        3.233,
    ),
    (0.8e-3, 0.38e6, 50.0): (
        0.102,
        0.215,
        0.342,
        0.487,
        0.657,
        0.865,
        1.456,
        2.265,
        3.057,
    ),
}


def reference_path(
    mesh: HexMesh, youngs_modulus_pa: float, contact: Contact, max_force_n: float
) -> LoadPath:
    """Return R2's load path."""
    wall = FiniteWall(mesh, NU, dead_pressure_nc=_voronoi_pressure(mesh))
    needle = NeedleLoad(
        _nodal_gaussian(mesh, contact), tip_at(mesh, contact, -contact.normal)
    )

    return wall.load_path(
        needle,
        PathEnd(max_force=max_force_n),
        youngs_modulus_pa=youngs_modulus_pa,
        iop_pa=IOP_PA,
        density_kg_m3=0.0,
    )


def _voronoi_pressure(mesh: HexMesh) -> Floats:
    """Return the nodal forces of 1 Pa: normals of the undeformed inner sphere times the
    nodes' spherical areas.
    """
    inner = np.unique(mesh.inner_qn)
    radius = RADIUS_M - mesh.thickness_m
    directions = mesh.points_nc[inner] / radius
    load = np.zeros_like(mesh.points_nc)
    load[inner] = (
        SphericalVoronoi(directions).calculate_areas()[:, None] * radius**2 * directions
    )

    return load


def _nodal_gaussian(mesh: HexMesh, contact: Contact) -> Floats:
    """Return the nodal forces of 1 N, in proportion to a Gaussian, not integrated."""
    outer = np.unique(mesh.outer_qn)
    square = np.sum((mesh.points_nc[outer] - RADIUS_M * contact.normal) ** 2, axis=1)
    weights = np.exp(-square / (2 * NEEDLE_RADIUS_M**2))
    load = np.zeros_like(mesh.points_nc)
    load[outer] = -(weights / weights.sum())[:, None] * contact.normal
    return load
