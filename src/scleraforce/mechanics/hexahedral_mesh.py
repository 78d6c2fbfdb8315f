"""The wall of the eye as hexahedra: a subdivided half-sphere of quads, extruded inward
(paper sec. 2.1).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scleraforce.base.arrays import Flags, Floats, Integers
from scleraforce.base.errors import InputError, SolverError
from scleraforce.base.units import from_si
from scleraforce.mechanics.shape_functions import shape_monomials, shape_values


@dataclass(frozen=True, eq=False)
class QuadSurface:
    """A surface of quadrilaterals, counter-clockwise as seen from outside.

    `points_vc` (vertex, 3); `quads_qv` (quad, 4) vertex numbers. Edge k of a quad joins
    its corners k and k + 1.
    """

    points_vc: Floats
    quads_qv: Integers

    @cached_property
    def edges(self) -> tuple[Integers, Integers, Flags]:
        """Vertices of every edge, (edge, 2), edges of every quad's sides, (quad, 4),
        and which are the boundary's.
        """
        pairs = np.stack(
            [self.quads_qv, np.roll(self.quads_qv, -1, axis=1)], axis=-1
        ).reshape(-1, 2)
        edges_ev, edge_of_side = np.unique(
            np.sort(pairs, axis=1), axis=0, return_inverse=True
        )

        return (
            edges_ev,
            edge_of_side.reshape(-1, 4),
            np.bincount(edge_of_side.ravel(), minlength=len(edges_ev)) == 1,
        )


def half_cube(divisions: int) -> QuadSurface:
    """Return the upper half (z >= 0) of the cube [-1, 1]^3, open at the base.

    `divisions` quads along an edge of the top, half as many down the sides. The grid
    lines are equiangular (tangents of equal angles), so that projection on the sphere
    keeps the quads nearly alike: uniform lines would make quads at a corner five times
    smaller than in the middle of a face.
    """
    half = divisions // 2
    along = np.arange(-half, half)
    sides = [_grid_quads(along, np.arange(half), half)[..., [2, 0, 1]]]
    for _ in range(3):  # each is the one before, turned by a right angle about z
        x, y, z = np.moveaxis(sides[-1], -1, 0)
        sides.append(np.stack([-y, x, z], axis=-1))

    corners_qkc = np.concatenate([_grid_quads(along, along, half), *sides])
    grid_vc, quads = np.unique(corners_qkc.reshape(-1, 3), axis=0, return_inverse=True)
    return QuadSurface(np.tan(grid_vc / half * (np.pi / 4.0)), quads.reshape(-1, 4))


def _grid_quads(columns: Integers, rows: Integers, height: int) -> Integers:
    """Corners of the unit squares at (column, row, height), shape (quad, 4, 3)."""
    start = np.stack(
        np.meshgrid(columns, rows, height, indexing="ij"), axis=-1
    ).reshape(-1, 1, 3)
    return start + np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def catmull_clark(surface: QuadSurface) -> QuadSurface:
    """Return the surface after one Catmull-Clark subdivision: four quads for each.

    Inside: Catmull and Clark, Computer-Aided Design 10 (1978) 350. On the boundary: the
    cubic B-spline curve of the boundary vertices (DeRose, Kass and Truong, SIGGRAPH
    1998), so a plane boundary stays in its plane. Vertices of the old surface keep
    their numbers; edge points follow, then face points.
    """
    points = surface.points_vc
    quads = surface.quads_qv
    edges, quad_edges_qe, boundary = surface.edges
    vertices = len(points)
    face_points = points[quads].mean(axis=1)
    middles = points[edges].mean(axis=1)
    beside = sum_at(quad_edges_qe, np.repeat(face_points, 4, axis=0), len(edges))
    edge_points = np.where(boundary[:, None], middles, 0.5 * middles + 0.25 * beside)
    moved = _vertex_points(surface, middles, face_points)
    rim_ev = edges[boundary]
    neighbours = sum_at(rim_ev, points[rim_ev[:, ::-1]], vertices)
    rim = np.unique(rim_ev)
    moved[rim] = 0.75 * points[rim] + 0.125 * neighbours[rim]
    edge_of = vertices + quad_edges_qe
    middle_of = vertices + len(edges) + np.arange(len(quads))
    children = [
        np.stack([quads[:, k], edge_of[:, k], middle_of, edge_of[:, k - 1]], axis=1)
        for k in range(4)
    ]

    return QuadSurface(
        np.concatenate([moved, edge_points, face_points]),
        np.stack(children, axis=1).reshape(-1, 4),
    )


def _vertex_points(
    surface: QuadSurface, middles: Floats, face_points: Floats
) -> Floats:
    """(F + 2 M + (n - 3) P) / n with the means F of face points and M of edge middles
    around a vertex of valence n.
    """
    points = surface.points_vc
    count = len(surface.points_vc)
    faces = np.bincount(surface.quads_qv.ravel(), minlength=count)[:, None]
    valence = np.bincount(surface.edges[0].ravel(), minlength=count)[:, None]
    face_mean = (
        sum_at(surface.quads_qv, np.repeat(face_points, 4, axis=0), count) / faces
    )
    edge_mean = sum_at(surface.edges[0], np.repeat(middles, 2, axis=0), count) / valence

    return (face_mean + 2.0 * edge_mean + (valence - 3.0) * points) / valence


def sum_at(index: Integers, values: Floats, count: int) -> Floats:
    """Sum the vectors `values` (*shape of `index`, 3) that share an index, shape
    (count, 3).
    """
    flat = index.ravel()
    vectors = values.reshape(-1, 3)
    return np.stack(
        [np.bincount(flat, vectors[:, c], minlength=count) for c in range(3)], axis=1
    )


def project_on_sphere(surface: QuadSurface) -> QuadSurface:
    """Return the surface with its vertices moved radially on the unit sphere."""
    points = surface.points_vc
    return QuadSurface(
        points / np.linalg.norm(points, axis=1, keepdims=True), surface.quads_qv
    )


BATCH = 16384  # directions at a time: the working arrays stay in the processor's cache
BELOW_BASE = 1e-9  # how far below z = 0 a unit direction may lie by rounding
SEEDS_PER_QUAD = 4.0  # cells of the seed table along a quad
FEW = 400  # quads: comparing all of them is quicker than to import a tree


class SurfaceLocator:
    """Finds directions on a sphere of quads (4, 8 or 9 nodes), or on its upper half
    with all nodes on z >= 0.

    A table over the stereographic disc (two for a whole sphere, one from either pole)
    gives the quad whose middle is nearest; Newton's method then solves for the local
    coordinates where the surface point is parallel to the direction, and crosses to a
    neighbour when they leave the quad. In a quad's own frame (a, b, c), c through its
    middle, parallel
    means  x.a - (d.a/d.c) x.c = 0  and the same for b: two biquadratic polynomials.
    """

    def __init__(self, points_nc: Floats, quad_qn: Integers) -> None:
        corners = points_nc[quad_qn[:, :4]]
        # Orthonormal frames (a, b, c) of the quads, c through their middles, shape
        # (quad, 3, 3).
        c = corners.mean(axis=1)
        c /= np.linalg.norm(c, axis=1, keepdims=True)
        a = corners[:, 1] - corners[:, 0]
        a -= np.sum(a * c, axis=1, keepdims=True) * c
        a /= np.linalg.norm(a, axis=1, keepdims=True)
        self._frames_qkc = np.stack([a, np.cross(c, a), c], axis=1)
        exponents_md, coefficients_mn = shape_monomials(2, quad_qn.shape[1])
        # Each quad's surface in its frame, shape (power of x, power of y, axis, quad).
        self._polynomials = np.zeros((3, 3, 3, len(quad_qn)))
        surfaces = np.einsum(
            "mn,qnc,qkc->mkq", coefficients_mn, points_nc[quad_qn], self._frames_qkc
        )
        self._polynomials[*exponents_md.T] = surfaces
        self._neighbours_qe = _neighbours(quad_qn)
        self._whole = bool(np.all(self._neighbours_qe >= 0))
        side = np.sqrt(2.0 * np.pi / len(quad_qn))
        self._table_cells = int(np.ceil(2.0 * SEEDS_PER_QUAD / side))
        self._seeds = self._seed_table(self._frames_qkc[:, 2])

    def locate(self, directions_dc: Floats) -> tuple[Integers, Floats]:
        """Return the quad (direction,) and local coordinates in [-1, 1]^2 (direction,
        2) of every direction.
        """
        # 160 ms: Numba, not before something is solved
        from scleraforce.mechanics.surface_crossings import cross_quads

        lengths = np.linalg.norm(directions_dc, axis=1)

        above = np.full(len(lengths), self._whole) | (
            directions_dc[:, 2] >= -BELOW_BASE * lengths
        )
        if not np.all(above & (lengths > 0.0) & np.isfinite(lengths)):
            raise InputError(
                "direction: it does not pierce the half-sphere; must have z >= 0 and a"
                " positive length"
            )

        quads = np.empty(len(directions_dc), dtype=np.int64)
        local = np.empty((len(directions_dc), 2))

        for start in range(0, len(directions_dc), BATCH):
            part = slice(start, start + BATCH)
            unit_dc = directions_dc[part] / lengths[part, None]
            seeds = self._seeds[self._cell(unit_dc)]

            found, crossed = cross_quads(
                self._polynomials, self._frames_qkc, self._neighbours_qe, seeds, unit_dc
            )
            if not crossed:
                raise SolverError("locate: a direction was not found on the surface")

            quads[part] = seeds
            local[part] = np.clip(found, -1.0, 1.0)

        return quads, local

    def _seed_table(self, middles_qc: Floats) -> Integers:
        """Quad with the nearest middle for every cell around the stereographic disc,
        flat; then those for z < 0.
        """
        middles = (np.arange(self._table_cells) + 0.5) * 2.0 / self._table_cells - 1.0
        p, q = np.meshgrid(middles, middles, indexing="ij")
        square = p**2 + q**2
        cells = (
            np.stack([2.0 * p, 2.0 * q, 1.0 - square], axis=-1)
            / (1.0 + square)[..., None]
        )
        sides = np.concatenate(
            [cells, cells * (1.0, 1.0, -1.0)] if self._whole else [cells]
        ).reshape(-1, 3)

        if len(middles_qc) <= FEW:
            return np.asarray(np.argmax(sides @ middles_qc.T, axis=1), dtype=np.int64)

        # 200 ms: not for a mesh of few quads
        from scipy.spatial import cKDTree

        return np.asarray(cKDTree(middles_qc).query(sides)[1], dtype=np.int64)

    def _cell(self, directions_dc: Floats) -> Integers:
        """Cell of the seed table: stereographic projection from the far pole maps a
        half-sphere to a disc.
        """
        disc = directions_dc[:, :2] / (1.0 + np.abs(directions_dc[:, 2:]))
        cell = np.clip(
            ((disc + 1.0) * (0.5 * self._table_cells)).astype(np.int64),
            0,
            self._table_cells - 1,
        )
        below = self._whole & (directions_dc[:, 2] < 0.0)

        return (
            below * self._table_cells**2 + cell[:, 0] * self._table_cells + cell[:, 1]
        )


def _neighbours(quad_qn: Integers) -> Integers:
    """The quad across each of the four edges, -1 at the boundary, shape (quad, 4)."""
    sides = np.sort(
        np.stack([quad_qn[:, :4], np.roll(quad_qn[:, :4], -1, axis=1)], axis=-1),
        axis=-1,
    ).reshape(-1, 2)
    edge_of_side = np.unique(sides, axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(edge_of_side, kind="stable")
    pair = np.flatnonzero(np.diff(edge_of_side[order]) == 0)
    neighbours = np.full(len(sides), -1)
    neighbours[order[pair]] = order[pair + 1] // 4
    neighbours[order[pair + 1]] = order[pair] // 4

    return neighbours.reshape(-1, 4)


# Where VTK's nodes of a hexahedron lie in its radial column: (layer: 0 inner, 1 middle,
# 2 outer; node of the quad).
COLUMN_NODES = (
    *((0, k) for k in range(4)),
    *((2, k) for k in range(4)),
    *((0, k) for k in range(4, 8)),
    *((2, k) for k in range(4, 8)),
    *((1, k) for k in range(4)),
    *((1, 7), (1, 5), (1, 4), (1, 6), (0, 8), (2, 8), (1, 8)),
)


@dataclass(frozen=True, eq=False)
class HexMesh:
    """A wall of hexahedra between two spheres, SI units: the half above the base plane
    z = 0, or all of it.

    `points_nc` (node, 3). `cells_en` (element, 8 or 27): nodes in VTK's order, first
    local directions along the sphere, third outward. `outer_qn`, `inner_qn` (quad, 4 or
    9): the two surfaces; quad k of both belongs to one radial column and is seen from
    outside counter-clockwise. Every node lies exactly on its sphere and, through the
    wall, on one ray; so a direction has the same local coordinates on both surfaces.
    `base_nodes`: the nodes on z = 0 of a half-sphere; empty for a whole sphere. A wall
    of another form (`mechanics.uneven_form`) keeps its nodes' places on the sphere in
    `shaped_from_nc`; directions refer to the sphere.
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
        """Finds directions on the outer surface of the sphere; computed lazily."""
        return SurfaceLocator(self.sphere_nc, self.outer_qn)


def build_mesh(
    radius_m: float,
    thickness_m: float,
    divisions: int = 10,
    level: int = 1,
    layers: int = 1,
    order: int = 2,
) -> HexMesh:
    """Return the wall between the spheres of radius R and R - t, z >= 0.

    `divisions`: quads along an edge of the half cube, even; each Catmull-Clark
    subdivision (`level`) doubles them. `layers`: hexahedra through the wall; `order`: 1
    (8 nodes) or 2 (curved, 27 nodes).

    >>> counts = dict(divisions=10, level=2, layers=2, order=1)  # the paper's
    >>> mesh = build_mesh(12e-3, 0.5e-3, **counts)
    >>> len(mesh.cells_en), len(mesh.points_nc)
    (9600, 14643)
    """
    if level < 0 or divisions < 2 or divisions % 2:
        raise InputError(
            f"mesh: level {level}, divisions {divisions}; the level must be 0 or more,"
            " divisions even and at least 2"
        )

    surface = half_cube(divisions)
    for _ in range(level):
        surface = catmull_clark(surface)

    return extrude_surface(
        project_on_sphere(surface), radius_m, thickness_m, layers, order
    )


def extrude_surface(
    surface: QuadSurface, radius_m: float, thickness_m: float, layers: int, order: int
) -> HexMesh:
    """Return the wall under a surface of the unit sphere, scaled; an open one has its
    edge on z = 0 exactly.
    """
    if not 0.0 < thickness_m < 0.5 * radius_m:
        raise InputError(
            f"thickness: {from_si(thickness_m, 'mm'):g} mm; must be above 0 and below"
            " half the radius"
        )
    if order not in (1, 2) or layers < 1:
        raise InputError(
            f"mesh: order {order}, layers {layers}; must be order 1 or 2 and at least 1"
            " layer"
        )

    directions, quads = _quad_nodes(surface, order)
    sheets = order * layers + 1
    radii = radius_m - thickness_m * np.linspace(0.0, 1.0, sheets)
    points = (radii[:, None, None] * directions).reshape(-1, 3)
    column = np.array(COLUMN_NODES[: 8 if order == 1 else 27])
    # (layer, node); 0 is the outermost
    sheet = order * np.arange(layers)[:, None] + order * (2 - column[:, 0]) // 2
    cells = (quads[:, column[:, 1]] + sheet[:, None] * len(directions)).reshape(
        -1, len(column)
    )
    inner = quads + (sheets - 1) * len(directions)
    base = (
        np.flatnonzero(points[:, 2] == 0.0)
        if surface.edges[2].any()
        else np.empty(0, dtype=np.int64)
    )

    return HexMesh(points, cells, quads, inner, base, radius_m, thickness_m, order)


def _quad_nodes(surface: QuadSurface, order: int) -> tuple[Floats, Integers]:
    """Directions of the surface nodes and the nodes of every quad (quad, 4 or 9)."""
    points = surface.points_vc
    quads = surface.quads_qv

    if order == 2:
        edges_ev, quad_edges_qe, _ = surface.edges
        edge_middles = points[edges_ev].mean(axis=1)
        face_middles = points[quads].mean(axis=1)
        edge_nodes = len(points) + quad_edges_qe
        face_nodes = len(points) + len(edge_middles) + np.arange(len(quads))
        points = np.concatenate([points, edge_middles, face_middles])
        quads = np.concatenate([quads, edge_nodes, face_nodes[:, None]], axis=1)

    return points / np.linalg.norm(points, axis=1, keepdims=True), quads


def locate(mesh: HexMesh, directions_dc: Floats) -> tuple[Integers, Floats]:
    """Return the quads that rays from the centre pierce, (direction,), and shape
    functions there (direction, node).

    Directions (direction, 3) have any positive length; below the base plane of a
    half-sphere they are an `InputError`.
    """
    quads, local_dk = mesh.locator.locate(directions_dc)
    return quads, shape_values(local_dk, mesh.outer_qn.shape[1])
