"""Quadrilateral surfaces: the half cube, Catmull-Clark subdivision, projection on the sphere (paper sec. 2.1)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class QuadSurface:
    """A surface of quadrilaterals, counter-clockwise as seen from outside.

    `points_vc` (vertex, 3); `quads_qv` (quad, 4) vertex numbers. Edge k of a quad joins its corners k and k + 1.
    """

    points_vc: Floats
    quads_qv: Integers

    @cached_property
    def _edges(self) -> tuple[Integers, Integers]:
        pairs = np.stack([self.quads_qv, np.roll(self.quads_qv, -1, axis=1)], axis=-1).reshape(-1, 2)
        edges_ev, edge_of_side = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
        return edges_ev, edge_of_side.reshape(-1, 4)

    @property
    def edges_ev(self) -> Integers:
        """Vertices of every edge, each edge once, shape (edge, 2)."""
        return self._edges[0]

    @property
    def quad_edges_qe(self) -> Integers:
        """Edge numbers of every quad's four sides, shape (quad, 4)."""
        return self._edges[1]

    @property
    def edge_quads_count(self) -> Integers:
        """How many quads meet at every edge (1 on the boundary), shape (edge,)."""
        return np.bincount(self.quad_edges_qe.ravel(), minlength=len(self.edges_ev))

    @property
    def is_open(self) -> bool:
        """Whether the surface has a boundary."""
        return bool(np.any(self.edge_quads_count == 1))


def half_cube(divisions: int) -> QuadSurface:
    """Return the upper half (z >= 0) of the cube [-1, 1]^3, open at the base.

    `divisions` quads along an edge of the top, half as many down the sides. The grid lines are equiangular (tangents
    of equal angles), so that projection on the sphere keeps the quads nearly alike: uniform lines would make those at
    a corner five times smaller than those in the middle of a face.

    Raises:
        ValueError: `divisions` is odd or below 2.

    >>> half_cube(2).quads_qv.shape
    (12, 4)
    """
    if divisions < 2 or divisions % 2:
        raise ValueError(f"divisions: {divisions} is not an even number of at least 2")
    half = divisions // 2
    corners_qkc = np.concatenate([_top_quads(half), *(_side_quads(half, turns) for turns in range(4))])
    grid_vc, quads = np.unique(corners_qkc.reshape(-1, 3), axis=0, return_inverse=True)
    return QuadSurface(np.tan(grid_vc / half * (np.pi / 4.0)), quads.reshape(-1, 4))


def _grid_quads(columns: Integers, rows: Integers) -> Integers:
    """Corners of the unit squares at (column, row), shape (quad, 4, 2)."""
    start = np.stack(np.meshgrid(columns, rows, indexing="ij"), axis=-1).reshape(-1, 1, 2)
    corners: Integers = start + np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    return corners


def _top_quads(half: int) -> Integers:
    flat = _grid_quads(np.arange(-half, half), np.arange(-half, half))
    return np.concatenate([flat, np.full((*flat.shape[:2], 1), half)], axis=-1)


def _side_quads(half: int, turns: int) -> Integers:
    """The side x = half, turned by `turns` right angles about z."""
    flat = _grid_quads(np.arange(-half, half), np.arange(half))
    corners = np.concatenate([np.full((*flat.shape[:2], 1), half), flat], axis=-1)
    for _ in range(turns):
        corners = np.stack([-corners[..., 1], corners[..., 0], corners[..., 2]], axis=-1)
    return corners


def catmull_clark(surface: QuadSurface) -> QuadSurface:
    """Return the surface after one Catmull-Clark subdivision: four quads for each.

    Inside: Catmull and Clark, Computer-Aided Design 10 (1978) 350. On the boundary: the cubic B-spline curve of the
    boundary vertices (DeRose, Kass and Truong, SIGGRAPH 1998), so a plane boundary stays in its plane. Vertices of the
    old surface keep their numbers; edge points follow, then face points.
    """
    points, quads, edges = surface.points_vc, surface.quads_qv, surface.edges_ev
    vertices = len(points)
    boundary = surface.edge_quads_count == 1
    face_points = points[quads].mean(axis=1)
    middles = points[edges].mean(axis=1)
    edge_points = np.where(boundary[:, None], middles, _edge_points(surface, middles, face_points))
    moved = _vertex_points(surface, middles, face_points)
    _move_boundary(moved, surface, edges[boundary])

    edge_of = vertices + surface.quad_edges_qe
    middle_of = vertices + len(edges) + np.arange(len(quads))
    children = [np.stack([quads[:, k], edge_of[:, k], middle_of, edge_of[:, k - 1]], axis=1) for k in range(4)]
    return QuadSurface(np.concatenate([moved, edge_points, face_points]), np.stack(children, axis=1).reshape(-1, 4))


def _edge_points(surface: QuadSurface, middles: Floats, face_points: Floats) -> Floats:
    """Mean of an edge's ends and its two face points."""
    beside = _sum_at(surface.quad_edges_qe, np.repeat(face_points, 4, axis=0), len(middles))
    return 0.5 * middles + 0.25 * beside


def _vertex_points(surface: QuadSurface, middles: Floats, face_points: Floats) -> Floats:
    """(F + 2 M + (n - 3) P) / n with the means F of face points and M of edge middles around a vertex of valence n."""
    points, count = surface.points_vc, len(surface.points_vc)
    faces = np.bincount(surface.quads_qv.ravel(), minlength=count)[:, None]
    valence = np.bincount(surface.edges_ev.ravel(), minlength=count)[:, None]
    face_mean = _sum_at(surface.quads_qv, np.repeat(face_points, 4, axis=0), count) / faces
    edge_mean = _sum_at(surface.edges_ev, np.repeat(middles, 2, axis=0), count) / valence
    return (face_mean + 2.0 * edge_mean + (valence - 3.0) * points) / valence


def _move_boundary(moved: Floats, surface: QuadSurface, boundary_edges: Integers) -> None:
    """Put boundary vertices at 3/4 of themselves and 1/8 of each neighbour on the boundary (in place)."""
    points = surface.points_vc
    neighbours = _sum_at(boundary_edges, points[boundary_edges[:, ::-1]].reshape(-1, 3), len(points))
    on_boundary = np.unique(boundary_edges)
    moved[on_boundary] = 0.75 * points[on_boundary] + 0.125 * neighbours[on_boundary]


def _sum_at(index: Integers, values: Floats, count: int) -> Floats:
    """Sum rows of `values` that share an index, shape (count, 3)."""
    flat = index.ravel()
    return np.stack([np.bincount(flat, values[:, c], minlength=count) for c in range(3)], axis=1)


def project_on_sphere(surface: QuadSurface) -> QuadSurface:
    """Return the surface with its vertices moved radially on the unit sphere."""
    points = surface.points_vc
    return QuadSurface(points / np.linalg.norm(points, axis=1, keepdims=True), surface.quads_qv)
