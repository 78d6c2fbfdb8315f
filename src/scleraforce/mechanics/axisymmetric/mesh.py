"""A wall of revolution about the needle axis: its meridian cut into 9-node quads, graded towards the needle."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.units import from_si

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

FIRST_TO_MEAN = 0.2  # size of the first element beyond the needle over the mean


@dataclass(frozen=True)
class MeridianSize:
    """The size of a meridian's mesh: `elements` from the axis to the support, `layers` through the wall."""

    elements: int = 48
    layers: int = 1


@dataclass(frozen=True, eq=False)
class MeridianMesh:
    """Nodes and 9-node quads of the meridian, in columns across the wall, outer node first.

    Attributes:
        radius_m: outer radius.
        points_nc: nodes (node, [distance from the needle axis, height over the centre]) in m.
        cells_en: nodes of each quad, (element, 9), along the meridian first: node 3 j + i is the i-th of three columns
            and the j-th of three nodes across.
        outer_n: nodes of the outer boundary from the axis to the support; every other one is an element's corner.
        inner_n: the same of the inner boundary.
    """

    radius_m: float
    points_nc: Floats
    cells_en: Integers
    outer_n: Integers
    inner_n: Integers


def meridian_mesh(
    radius_m: float, thickness_m: float, needle_radius_m: float, support_rad: float, size: MeridianSize
) -> MeridianMesh:
    """Return a mesh from the needle axis to the support, with one element under the needle.

    Only one, on purpose. The force keeps its direction and its disc moves with the wall, so a pressure of about the
    modulus itself crushes what lies under it where the mesh lets it: with two elements the wall below shrinks
    to a quarter of its thickness between F/E = 0.12 and 0.2 mm^2. Blunt steel does not do that to it, nor does the 3-D
    wall of the default mesh, and beyond the disc it hardly shows. Outside the needle the elements grow in proportion to
    their number, from a fifth of their mean to twice.

    Raises:
        InputError: the needle is wider than the eye, or the wall thicker than its radius.
    """
    if not 0.0 < thickness_m < radius_m:
        raise InputError(f"thickness: {from_si(thickness_m, 'mm'):g} mm; must be above 0 and below the radius")
    if not 0.0 < needle_radius_m < radius_m * np.sin(min(support_rad, 0.5 * np.pi)):
        raise InputError(f"needle radius: {from_si(needle_radius_m, 'mm'):g} mm; must be above 0 and below the radius")
    angles = _with_middles(_edges(float(np.arcsin(needle_radius_m / radius_m)), support_rad, size.elements))
    radii = np.linspace(radius_m, radius_m - thickness_m, 2 * size.layers + 1)
    directions = np.stack([np.sin(angles), np.cos(angles)], axis=-1)
    directions[0] = 0.0, 1.0
    points = (directions[:, None] * radii[:, None]).reshape(-1, 2)
    number = np.arange(len(points)).reshape(len(angles), len(radii))
    return MeridianMesh(radius_m, points, _cells(number), number[:, 0], number[:, -1])


def _edges(needle_rad: float, support_rad: float, elements: int) -> Floats:
    """Angles of the element edges, (element + 1,)."""
    share = np.linspace(0.0, 1.0, elements)
    grown = FIRST_TO_MEAN * share + (1.0 - FIRST_TO_MEAN) * share**2
    return np.append(0.0, needle_rad + (support_rad - needle_rad) * grown)


def _with_middles(edges: Floats) -> Floats:
    middles = 0.5 * (edges[:-1] + edges[1:])
    return np.append(np.stack([edges[:-1], middles], axis=1).ravel(), edges[-1])


def _cells(number: Integers) -> Integers:
    """Quads of a grid of nodes (column, across)."""
    along, across = (number.shape[0] - 1) // 2, (number.shape[1] - 1) // 2
    corner = number[: 2 * along : 2, : 2 * across : 2].reshape(-1, 1)
    offsets = [number[i, j] - number[0, 0] for j in range(3) for i in range(3)]
    cells: Integers = corner + np.array(offsets)
    return cells
