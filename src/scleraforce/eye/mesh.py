"""The wall of the eye as hexahedra: a subdivided half-sphere, extruded inward (paper sec. 2.1)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.eye.locate import SurfaceLocator
from scleraforce.eye.shapes import shape_values
from scleraforce.eye.surface import QuadSurface, catmull_clark, half_cube, project_on_sphere
from scleraforce.units import from_si

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Where VTK's nodes of a hexahedron lie in its radial column: (layer: 0 inner, 1 middle, 2 outer; node of the quad).
COLUMN_NODES = (
    *((0, k) for k in range(4)),
    *((2, k) for k in range(4)),
    *((0, k) for k in range(4, 8)),
    *((2, k) for k in range(4, 8)),
    *((1, k) for k in range(4)),
    *((1, 7), (1, 5), (1, 4), (1, 6), (0, 8), (2, 8), (1, 8)),
)


@dataclass(frozen=True, eq=False, kw_only=True)
class HexMesh:
    """A wall of hexahedra between two spheres, SI units: the half above the base plane z = 0, or all of it.

    `points_nc` (node, 3). `cells_en` (element, 8, 20 or 27): nodes in VTK's order, first local directions along the
    sphere, third outward. `outer_qn`, `inner_qn` (quad, 4, 8 or 9): the two surfaces; quad k of both belongs to one
    radial column and is seen from outside counter-clockwise. Every node lies exactly on its sphere and, through the
    wall, on one ray; so a direction has the same local coordinates on both surfaces. `base_nodes`: those on z = 0 of a
    half-sphere; a whole sphere has none. A wall that was shaped into another form (`eye.form`) keeps the nodes' places
    on the sphere in `shaped_from_nc`: directions are those of the sphere.
    """

    points_nc: Floats
    cells_en: Integers
    outer_qn: Integers
    inner_qn: Integers
    base_nodes: Integers
    radius_m: float
    thickness_m: float
    order: int
    shaped_from_nc: Floats | None = None

    @property
    def sphere_nc(self) -> Floats:
        """Places of the nodes on the sphere from which the wall is made, (node, 3)."""
        return self.points_nc if self.shaped_from_nc is None else self.shaped_from_nc

    @cached_property
    def locator(self) -> SurfaceLocator:
        """Finds directions on the outer surface of the sphere; made on first use."""
        return SurfaceLocator(self.sphere_nc, self.outer_qn)


def build_mesh(
    radius_m: float,
    thickness_m: float,
    divisions: int = 10,
    level: int = 1,
    layers: int = 1,
    order: int = 2,
    *,
    serendipity: bool = False,
) -> HexMesh:
    """Return the wall between the spheres of radius R and R - t, z >= 0.

    Args:
        radius_m: outer radius R.
        thickness_m: wall thickness t.
        divisions: quads along an edge of the half cube, even.
        level: Catmull-Clark subdivisions; each doubles the quads along an edge.
        layers: hexahedra through the wall.
        order: 1 (8 nodes) or 2 (curved, 27 nodes).
        serendipity: with order 2, leave out mid-face and mid-volume nodes (20 nodes).

    Raises:
        InputError: a wall thicker than half the radius, or a mesh that does not exist.

    >>> mesh = build_mesh(12e-3, 0.5e-3, divisions=10, level=2, layers=2, order=1)  # the paper's counts
    >>> len(mesh.cells_en), len(mesh.points_nc)
    (9600, 14643)
    """
    if level < 0 or divisions < 2 or divisions % 2:
        raise InputError(
            f"mesh: level {level}, divisions {divisions}; the level must be 0 or more, divisions even and at least 2"
        )
    surface = half_cube(divisions)
    for _ in range(level):
        surface = catmull_clark(surface)
    return extrude_surface(project_on_sphere(surface), radius_m, thickness_m, layers, order, serendipity=serendipity)


def extrude_surface(
    surface: QuadSurface, radius_m: float, thickness_m: float, layers: int, order: int, *, serendipity: bool = False
) -> HexMesh:
    """Return the wall whose outer surface is a surface of the unit sphere, scaled: a half-sphere or all of it.

    Args:
        surface: vertices on the unit sphere; where it is open, its edge lies on z = 0 exactly.
        radius_m: outer radius R.
        thickness_m: wall thickness t.
        layers: hexahedra through the wall.
        order: 1 (8 nodes) or 2 (curved, 27 nodes).
        serendipity: with order 2, leave out mid-face and mid-volume nodes (20 nodes).

    Raises:
        InputError: a wall thicker than half the radius, no layers, or another order.
    """
    if not 0.0 < thickness_m < 0.5 * radius_m:
        raise InputError(f"thickness: {from_si(thickness_m, 'mm'):g} mm; must be above 0 and below half the radius")
    if order not in (1, 2) or layers < 1:
        raise InputError(f"mesh: order {order}, layers {layers}; must be order 1 or 2 and at least 1 layer")
    directions, quads = _quad_nodes(surface, order)
    sheets = order * layers + 1
    radii = radius_m - thickness_m * np.linspace(0.0, 1.0, sheets)
    points = (radii[:, None, None] * directions).reshape(-1, 3)
    cells = _extrude(quads, len(directions), layers, order)
    inner = quads + (sheets - 1) * len(directions)
    if serendipity and order == 2:
        points, cells, quads, inner = _without_middles(points, cells, quads, inner)
    base = np.flatnonzero(points[:, 2] == 0.0) if surface.is_open else np.empty(0, dtype=np.int64)
    return HexMesh(
        points_nc=points,
        cells_en=cells,
        outer_qn=quads,
        inner_qn=inner,
        base_nodes=base,
        radius_m=radius_m,
        thickness_m=thickness_m,
        order=order,
    )


def _quad_nodes(surface: QuadSurface, order: int) -> tuple[Floats, Integers]:
    """Directions of the surface nodes and the nodes of every quad (quad, 4 or 9)."""
    points, quads = surface.points_vc, surface.quads_qv
    if order == 2:
        edge_middles = points[surface.edges_ev].mean(axis=1)
        face_middles = points[quads].mean(axis=1)
        edge_nodes = len(points) + surface.quad_edges_qe
        face_nodes = len(points) + len(edge_middles) + np.arange(len(quads))
        points = np.concatenate([points, edge_middles, face_middles])
        quads = np.concatenate([quads, edge_nodes, face_nodes[:, None]], axis=1)
    return points / np.linalg.norm(points, axis=1, keepdims=True), quads


def _extrude(quads_qn: Integers, per_sheet: int, layers: int, order: int) -> Integers:
    """Nodes of every hexahedron; layer 0 is the outermost."""
    column = np.array(COLUMN_NODES[: 8 if order == 1 else 27])
    depth = order * (2 - column[:, 0]) // 2  # sheets below the element's outer face
    cells = [quads_qn[:, column[:, 1]] + (depth + order * layer) * per_sheet for layer in range(layers)]
    return np.concatenate(cells)


def _without_middles(
    points: Floats, cells: Integers, outer: Integers, inner: Integers
) -> tuple[Floats, Integers, Integers, Integers]:
    """Drop mid-face and mid-volume nodes and number the rest anew."""
    used, number = np.unique(cells[:, :20], return_inverse=True)
    renumber = np.full(len(points), -1)
    renumber[used] = np.arange(len(used))
    return points[used], number.reshape(-1, 20), renumber[outer[:, :8]], renumber[inner[:, :8]]


def locate(mesh: HexMesh, directions_dc: Floats) -> tuple[Integers, Floats]:
    """Find where rays from the centre pierce the curved outer (and inner) surface.

    Args:
        mesh: the wall.
        directions_dc: directions (direction, 3), of any positive length; z >= 0 where the wall is a half-sphere.

    Returns:
        The quad's row in `outer_qn` (direction,) and the local coordinates in [-1, 1]^2 (direction, 2).

    Raises:
        InputError: a direction below the base plane.
    """
    return mesh.locator.locate(directions_dc)


def surface_weights(mesh: HexMesh, local_pd: Floats) -> Floats:
    """Return the shape functions of the surface quads at local points, shape (point, nodes of a quad)."""
    return shape_values(local_pd, mesh.outer_qn.shape[1])
