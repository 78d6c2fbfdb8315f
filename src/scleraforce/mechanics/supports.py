"""The supports of the wall: the clamped base, and springs on the outer surface.

The springs are an elastic bed around the lower half and straps where the rectus muscles are inserted. Both are linear
in the displacement, with directions of the undeformed wall, and integrated with the shape functions like the loads.
Insertions lie on the spiral of Tillaux: 5.5, 6.5, 6.9 and 7.7 mm behind the limbus (medial, inferior, lateral,
superior), 9 to 11 mm wide (Apt, Trans. Am. Ophthalmol. Soc. 78, 1980, 365), on an eye of 12 mm radius whose limbus has
a radius of 5.75 mm; on other eyes at the same angles.
"""

from dataclasses import dataclass
from math import asin, pi

import numpy as np

from scleraforce.arrays import Flags, Floats, Integers, Reals
from scleraforce.errors import InputError
from scleraforce.mechanics.contact import Contact
from scleraforce.mechanics.elements import FacePlaces, gauss_points, surface_points
from scleraforce.mechanics.mesh import HexMesh, locate, sum_at
from scleraforce.mechanics.shapes import shape_values
from scleraforce.study import SupportsStudy


def clamped_base(mesh: HexMesh) -> Flags:
    """Clamp the whole base (the paper's Dirichlet condition, sec. 2.1): flags (node, 3), True where held."""
    held = np.zeros(mesh.points_nc.shape, dtype=bool)
    held[mesh.base_nodes] = True
    return held


BED_POINTS = 3
STRAP_POINTS = 16  # Gauss points along the line of an insertion
EYE_RADIUS_MM = 12.0
LIMBUS_RAD = asin(5.75 / EYE_RADIUS_MM)  # its polar angle
# Polar angle, azimuth from the medial rectus, the arc's width, in rad; from mm behind the limbus and mm of width.
INSERTIONS = {
    name: (LIMBUS_RAD + behind_limbus_mm / EYE_RADIUS_MM, 0.5 * pi * quarter_turns, width_mm / EYE_RADIUS_MM)
    for quarter_turns, (name, behind_limbus_mm, width_mm) in enumerate(
        (("medial", 5.5, 10.3), ("superior", 7.7, 10.6), ("lateral", 6.9, 9.2), ("inferior", 6.5, 9.8))
    )
}


@dataclass(frozen=True, eq=False)
class Springs:
    """Springs between the wall and its undeformed place.

    `nodes_qn` (quad, node): the outer quads they act on; `blocks_qnnii` (quad, node, node, 3, 3): their stiffness in
    N/m. A quad may occur more than once.
    """

    nodes_qn: Integers
    blocks_qnnii: Floats

    def __add__(self, other: "Springs") -> "Springs":
        """Return the springs of both."""
        nodes = np.concatenate([self.nodes_qn, other.nodes_qn])
        return Springs(nodes, np.concatenate([self.blocks_qnnii, other.blocks_qnnii]))

    def add_to(self, element_eiajb: Reals, places: FacePlaces, factor: float) -> None:
        """Add `factor` times the stiffness to element matrices, in place; `places` of `nodes_qn`."""
        places.add(element_eiajb, factor * self.blocks_qnnii.transpose(0, 3, 1, 4, 2))

    def forces(self, displacement_nc: Floats) -> Floats:
        """Return the nodal forces (node, 3) that hold a displacement (node, 3) in m against the springs, in N."""
        local_qni = np.einsum("qnmij,qmj->qni", self.blocks_qnnii, displacement_nc[self.nodes_qn], optimize=True)
        return sum_at(self.nodes_qn, local_qni, len(displacement_nc))


def elastic_bed(mesh: HexMesh, stiffness_pa_m: float, shear_stiffness_pa_m: float) -> Springs:
    """Return a Winkler bed under the outer surface of a whole globe's lower half, z < 0 on the sphere.

    The stiffness is the pressure per metre that the wall moves along its normal, either way; the shear stiffness the
    shear per metre that it slides.
    """
    places, _ = gauss_points(2, BED_POINTS)
    heights_qp = mesh.sphere_nc[mesh.outer_qn][..., 2] @ shape_values(places, mesh.outer_qn.shape[1]).T
    quads = mesh.outer_qn[np.any(heights_qp < 0.0, axis=1)]
    if not len(quads):
        raise InputError("bed: this wall has no lower half to lie on it; use a whole globe")
    values_pn, areas_qpc = surface_points(mesh, quads, BED_POINTS)
    amounts_qp = np.linalg.norm(areas_qpc, axis=-1)
    normals_qpc = areas_qpc / amounts_qp[..., None]
    outer_qpii = normals_qpc[..., :, None] * normals_qpc[..., None, :]
    stiffness_qpii = shear_stiffness_pa_m * np.eye(3) + (stiffness_pa_m - shear_stiffness_pa_m) * outer_qpii
    stiffness_qpii *= (amounts_qp * (heights_qp[np.any(heights_qp < 0.0, axis=1)] < 0.0))[..., None, None]
    return Springs(quads, np.einsum("pn,pm,qpij->qnmij", values_pn, values_pn, stiffness_qpii, optimize=True))


def rectus_straps(mesh: HexMesh, stiffness_n_m: float, medial_azimuth_rad: float = 0.0) -> Springs:
    """Return four straps that hold the insertions of the rectus muscles along the meridians, as the muscles run.

    `stiffness_n_m` is the force per metre of one muscle, even over the width of its insertion.
    """
    places, weights = gauss_points(1, STRAP_POINTS)
    contacts = [
        Contact(polar_rad=polar_rad, azimuth_rad=azimuth_rad)
        for polar_rad, from_medial_rad, width_rad in INSERTIONS.values()
        for azimuth_rad in medial_azimuth_rad + from_medial_rad + 0.5 * width_rad * places[:, 0] / np.sin(polar_rad)
    ]
    quads, values_pn = locate(mesh, np.array([contact.normal for contact in contacts]))
    weights_p, along_pc = np.tile(0.5 * weights, len(INSERTIONS)), np.array([contact.meridian for contact in contacts])
    blocks = np.einsum("p,pn,pm,pi,pj->pnmij", weights_p, values_pn, values_pn, along_pc, along_pc, optimize=True)
    return Springs(mesh.outer_qn[quads], stiffness_n_m * blocks)


def study_springs(supports: SupportsStudy, mesh: HexMesh) -> Springs | None:
    """Return the springs of a study's supports; None for the clamped base alone.

    Raises:
        InputError: a bed under a wall without a lower half.
    """
    springs = None
    if supports.has_bed:
        springs = elastic_bed(mesh, supports.bed_stiffness_pa_per_m, supports.bed_shear_stiffness_pa_per_m)
    if supports.has_straps:
        straps = rectus_straps(mesh, supports.strap_stiffness_n_per_m, supports.medial_azimuth_rad)
        springs = straps if springs is None else springs + straps
    return springs
