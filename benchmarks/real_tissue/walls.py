"""The product's wall of revolution, on a mesh that is fine under the load, and its
stiffness for small loads.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reference_walls import spread_needle
from scleraforce.mechanics.axisymmetric_wall import AxisymmetricWall
from scleraforce.mechanics.load_path_tracing import pressurise
from scleraforce.mechanics.meridian_elements import MeridianMesh

Floats = NDArray[np.float64]

# size of the first element beyond the disc over the mean; then they grow with their
# number squared
FIRST_SHARE = 0.05


@dataclass(frozen=True)
class PressedWall:
    """A wall under pressure, and how stiff it is for a small force; lengths in m, at E
    = 1 Pa.

    Attributes:
        stiffness_m: F/E over the displacement of the middle surface on the axis.
        outer_stiffness_m: the same of the outer surface.
        radius_m: of the middle surface, under the pressure.
        thickness_m: under the pressure.
    """

    stiffness_m: float
    outer_stiffness_m: float
    radius_m: float
    thickness_m: float


def fine_meridian(
    radius_m: float,
    thickness_m: float,
    disc_m: float,
    *,
    inside: int = 6,
    outside: int = 80,
    layers: int = 2,
    support_rad: float = 0.5 * np.pi,
) -> MeridianMesh:
    """Return a meridian of outer radius `radius_m` with `inside` equal elements under a
    disc, `outside` beyond it.
    """
    rim_rad = float(np.arcsin(disc_m / radius_m))
    share = np.linspace(0.0, 1.0, outside + 1)[1:]
    beyond = rim_rad + (support_rad - rim_rad) * (
        FIRST_SHARE * share + (1.0 - FIRST_SHARE) * share**3
    )
    edges = np.append(np.linspace(0.0, rim_rad, inside + 1), beyond)
    angles = np.append(
        np.stack([edges[:-1], 0.5 * (edges[:-1] + edges[1:])], axis=1).ravel(),
        edges[-1],
    )
    radii = np.linspace(radius_m, radius_m - thickness_m, 2 * layers + 1)
    points_nc = (
        np.stack([np.sin(angles), np.cos(angles)], axis=-1)[:, None] * radii[:, None]
    ).reshape(-1, 2)
    points_nc[: len(radii), 0] = 0.0
    number = np.arange(len(points_nc)).reshape(len(angles), len(radii))
    corners = number[:-2:2, :-2:2].reshape(-1, 1)
    cells_en = corners + np.array([number[i, j] for j in range(3) for i in range(3)])

    return MeridianMesh(radius_m, points_nc, cells_en, number[:, 0], number[:, -1])


def disc_wall(
    mesh: MeridianMesh, disc_m: float, poisson_ratio: float, *, symmetric: bool
) -> AxisymmetricWall:
    """Return the wall whose needle presses uniformly over a disc, whose rim is an edge
    of elements.
    """
    rim_m = _distance_m(mesh, disc_m) * (1.0 + 1e-9)
    wall = AxisymmetricWall(mesh, poisson_ratio, symmetric=symmetric)
    spread_needle(wall, lambda distance: np.where(distance < rim_m, 1.0, 0.0))
    return wall


def pressed_wall(wall: AxisymmetricWall, pressure: float) -> PressedWall:
    """Return how a wall under pressure meets a small force: by its tangent, without a
    step.
    """
    u = pressurise(wall, pressure)
    moved, rest = (
        _on_axis(wall, field) for field in (wall.factor(u, pressure)(wall.needle), u)
    )
    across = wall.mesh.points_nc[: len(rest), 1] + rest
    middle = len(rest) // 2

    return PressedWall(
        -1.0 / moved[middle],
        -1.0 / moved[0],
        float(across[middle]),
        float(across[0] - across[-1]),
    )


def bonded_stiffness(wall: AxisymmetricWall, pressure: float, disc_m: float) -> float:
    """Return F/E over the displacement of a rigid disc that is bonded to the outer
    surface along the axis, in m.

    With C the compliance of the nodes below the disc, their forces at equal
    displacement are C^-1 1.
    """
    mesh = wall.mesh
    under = mesh.outer_n[mesh.points_nc[mesh.outer_n, 0] <= disc_m * (1.0 + 1e-9)]
    places = np.searchsorted(wall.free, 2 * under + 1)
    forces = np.zeros((len(wall.free), len(places)), order="F")
    forces[places, np.arange(len(places))] = 1.0
    compliance = wall.factor(pressurise(wall, pressure), pressure)(forces)[places]

    return float(np.linalg.solve(compliance, np.ones(len(places))).sum())


def _distance_m(mesh: MeridianMesh, disc_m: float) -> float:
    """Distance of the disc's rim from the contact, on the outer surface."""
    return 2.0 * mesh.radius_m * float(np.sin(0.5 * np.arcsin(disc_m / mesh.radius_m)))


def _on_axis(wall: AxisymmetricWall, u: Floats) -> Floats:
    """Displacement along the axis of the nodes on it, outer first, in m."""
    everywhere = np.zeros(wall.mesh.points_nc.size)
    everywhere[wall.free] = u
    across = int(wall.mesh.outer_n[1])
    return everywhere.reshape(-1, 2)[:across, 1]
