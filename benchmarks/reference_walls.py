"""Walls, supports and readings that no command needs: references for the mechanics, of
benchmarks and tests.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array

from scleraforce.library.moving_base import DIRECTIONS, SHARE, base_angle
from scleraforce.mechanics.axisymmetric_wall import (
    AxisymmetricPath,
    AxisymmetricWall,
    BaseShift,
    EvenWall,
    axisymmetric_path,
    boundary_shapes,
    inward_forces,
)
from scleraforce.mechanics.contact_and_section import ScanPlane, WallSection
from scleraforce.mechanics.equilibrium import Solve
from scleraforce.mechanics.hexahedral_mesh import HexMesh, build_mesh
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.mesh_section import cut_sections

Floats = NDArray[np.float64]


def wall_mesh(
    radius_m: float, thickness_m: float, *, twenty_nodes: bool = False, **kind: Any
) -> HexMesh:
    """Return a mesh of `build_mesh`, of 20-node elements if asked."""
    mesh = build_mesh(radius_m, thickness_m, **kind)
    return _twenty_node_mesh(mesh) if twenty_nodes else mesh


def _twenty_node_mesh(mesh: HexMesh) -> HexMesh:
    """Return a mesh of 27-node elements without mid-face and mid-volume nodes:
    quadratic serendipity elements.
    """
    used, cells = np.unique(mesh.cells_en[:, :20], return_inverse=True)
    renumber = np.full(len(mesh.points_nc), -1)
    renumber[used] = np.arange(len(used))
    base = renumber[mesh.base_nodes]

    return replace(
        mesh,
        points_nc=mesh.points_nc[used],
        cells_en=cells.reshape(-1, 20),
        outer_qn=renumber[mesh.outer_qn[:, :8]],
        inner_qn=renumber[mesh.inner_qn[:, :8]],
        base_nodes=base[base >= 0],
    )


def stiffness_matrix(mesh: HexMesh, element_eiajb: NDArray[np.floating[Any]]) -> Any:
    """Sum element matrices (element, 3, node, 3, node) to a sparse one; unknown 3 n + c
    is node n, component c.
    """
    size = element_eiajb.shape[1] * element_eiajb.shape[2]
    unknown_eN = (3 * mesh.cells_en[:, None, :] + np.arange(3)[:, None]).reshape(
        -1, size
    )
    places = (
        np.repeat(unknown_eN, size, axis=1).ravel(),
        np.tile(unknown_eN, (1, size)).ravel(),
    )
    entries = element_eiajb.astype(np.float64).ravel()

    return coo_array(
        (entries, places), shape=(mesh.points_nc.size, mesh.points_nc.size)
    ).tocsr()


def symmetric_base(mesh: HexMesh) -> NDArray[np.bool_]:
    """Make the base a plane of symmetry: the half-sphere stands for a whole sphere;
    flags (node, 3).

    Beside u_z on the base, three components are held against motion as a rigid body in
    the plane: u_y of the nodes at largest and smallest x, u_x of the one at largest y.
    They carry no force where the loads in the plane balance.
    """
    held = np.zeros(mesh.points_nc.shape, dtype=bool)
    base = mesh.points_nc[mesh.base_nodes]
    held[mesh.base_nodes, 2] = True
    held[mesh.base_nodes[[np.argmax(base[:, 0]), np.argmin(base[:, 0])]], 1] = True
    held[mesh.base_nodes[np.argmax(base[:, 1])], 0] = True
    return held


def cut_section(
    mesh: HexMesh, plane: ScanPlane, displacement_nc: Floats
) -> WallSection:
    """Cut one wall with one displacement (node, 3)."""
    return cut_sections(mesh, [plane], displacement_nc[None], np.ones((1, 1, 1)))[0][0]


def polar_path(
    wall: EvenWall, iop_ratio: float, polar_rad: float, tips_m: Floats
) -> AxisymmetricPath:
    """Return the path of `axisymmetric_path` with the forces of a needle at a polar
    angle, in an open globe.
    """

    def path_to(support_rad: float) -> AxisymmetricPath:
        supported = replace(wall, support_rad=support_rad)
        return axisymmetric_path(supported, iop_ratio, PathEnd(tips_m=tips_m))

    even = path_to(0.5 * np.pi)
    if polar_rad == 0.0:
        return even

    around = np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    forces = [
        path_to(float(angle)).force_ratio_m2 for angle in base_angle(polar_rad, around)
    ]
    stiffer = SHARE * (np.mean(forces, axis=0) - even.force_ratio_m2)

    return replace(even, force_ratio_m2=even.force_ratio_m2 + stiffer)


def shift_in_plane(
    shift: BaseShift,
    iop_ratio: float,
    force_ratio_m2: float,
    lateral_bn: Floats,
    gap_m: float,
    direction_rad: float,
) -> Floats:
    """Return the motion of the points of a section, (boundary, node, [lateral, depth])
    in m.

    Args:
        shift: by the base.
        iop_ratio: p/E.
        force_ratio_m2: F/E in m^2.
        lateral_bn: where the plane meets the ring of each node, (boundary, node) in m.
        gap_m: distance of the plane from the needle axis.
        direction_rad: of the plane's lateral axis from the meridian.
    """
    field_mbnc = iop_ratio * shift.pressure_mbnc + force_ratio_m2 * shift.needle_mbnc
    inside_bn = np.arctan2(gap_m, lateral_bn)  # from the lateral axis
    phase_mbn = np.arange(len(field_mbnc))[:, None, None] * (inside_bn + direction_rad)
    cosine = np.cos(phase_mbn)
    sine = np.sin(phase_mbn)
    away = np.sum(field_mbnc[..., 0] * cosine, axis=0)
    depth = np.sum(field_mbnc[..., 2] * cosine, axis=0)
    around = np.sum(field_mbnc[..., 1] * sine, axis=0)

    return np.stack(
        [away * np.cos(inside_bn) - around * np.sin(inside_bn), depth], axis=-1
    )


SPREAD_POINTS = 6


def spread_needle(wall: AxisymmetricWall, spread: Callable[[Floats], Floats]) -> None:
    """Spread the needle's force over the outer surface: by area, times a function of
    the distance from the contact.
    """
    mesh = wall.mesh
    nodes_en, values_pn, slopes_pn, weights_p = boundary_shapes(
        mesh.outer_n, SPREAD_POINTS
    )
    points_enc = mesh.points_nc[nodes_en]
    positions_epc = np.einsum("pn,enc->epc", values_pn, points_enc)
    length_ep = np.linalg.norm(np.einsum("pn,enc->epc", slopes_pn, points_enc), axis=-1)
    weight_ep = positions_epc[..., 0] * length_ep * weights_p
    weight_ep *= spread(
        np.linalg.norm(positions_epc - mesh.points_nc[mesh.outer_n[0]], axis=-1)
    )
    wall.needle = inward_forces(
        mesh, nodes_en, (weight_ep / weight_ep.sum()) @ values_pn
    )[wall.free]


class DeadPressureWall:
    """A wall of revolution whose pressure stays normal to the undeformed wall."""

    def __init__(self, wall: AxisymmetricWall) -> None:
        self._wall = wall
        self.needle = wall.needle
        self.tip = wall.tip
        self._pressed = wall.volume(np.zeros_like(wall.needle))[1]

    def residual(self, u: Floats, pressure: float) -> Floats:
        """Return internal forces minus the forces of the pressure, (unknown,)."""
        return self._wall.residual(u, 0.0) - pressure * self._pressed

    def factor(self, u: Floats, pressure: float) -> Solve:  # noqa: ARG002 (its part of the tangent is 0)
        """Factor the tangent."""
        return self._wall.factor(u, 0.0)

    def volume(self, u: Floats) -> tuple[float, Floats]:
        """Return the volume inside in m^3 and the forces of 1 Pa, (unknown,)."""
        return self._wall.volume(u)[0], self._pressed
