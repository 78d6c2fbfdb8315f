"""A solid of revolution on its meridian, in 9-node quads: forces and their derivative,
at E = 1 Pa.

The energy is that of `neo_hookean_solid`. The deformation gradient has five entries
that are not zero, in the order F_rr, F_rz, F_zr, F_zz, F_tt (t: around the axis, F_tt =
1 + u_r / R). Every integral is over the undeformed wall. Tissue that stiffens
(`tissue_material`) multiplies its stress by exp(b Q).

The loops are compiled and take one element at a time. A node's radial motion enters
three of the deformation gradient's entries, its motion along the axis two. So they keep
(d/dr, d/dz, N/R) of each shape function instead of the gradient operator with its
zeros, and sum one triangle of each tangent, which is symmetric.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from scleraforce.base.arrays import Floats, Integers
from scleraforce.base.compiled_loops import compiled
from scleraforce.base.errors import InputError
from scleraforce.base.units import from_si
from scleraforce.mechanics.finite_elements import gauss_points
from scleraforce.mechanics.tissue_material import LARGEST_EXPONENT, lame_constants

FIRST_TO_MEAN = 0.2  # size of the first element beyond the needle over the mean


@dataclass(frozen=True)
class MeridianSize:
    """The size of a meridian's mesh: `elements` from the axis to the support, `layers`
    through the wall.
    """

    elements: int = 48
    layers: int = 1


@dataclass(frozen=True, eq=False)
class MeridianMesh:
    """Nodes and 9-node quads of the meridian, in columns across the wall, outer node
    first.

    `points_nc`: nodes (node, [distance from the needle axis, height over the centre])
    in m. `cells_en` (element, 9), along the meridian first: node 3 j + i is the i-th of
    three columns and the j-th of three nodes across. `outer_n`, `inner_n`: nodes of the
    boundaries from the axis to the support; every other one is an element's corner.
    """

    radius_m: float
    points_nc: Floats
    cells_en: Integers
    outer_n: Integers
    inner_n: Integers


def meridian_mesh(
    radius_m: float,
    thickness_m: float,
    needle_radius_m: float,
    support_rad: float,
    size: MeridianSize,
) -> MeridianMesh:
    """Return a mesh from the needle axis to the support, with one element under the
    needle.

    Only one, on purpose. The force keeps its direction and its disc moves with the
    wall, so a pressure of about the modulus itself crushes the wall below it where the
    mesh lets it: with two elements the wall below shrinks to a quarter of its thickness
    between F/E = 0.12 and 0.2 mm^2. Blunt steel does not do that, nor does the 3-D wall
    of the default mesh, and beyond the disc it hardly shows. Outside the needle the
    elements grow in proportion to their number, from a fifth of their mean to twice.
    """
    if not 0.0 < thickness_m < radius_m:
        raise InputError(
            f"thickness: {from_si(thickness_m, 'mm'):g} mm; must be above 0 and below"
            " the radius"
        )
    if not 0.0 < needle_radius_m < radius_m * np.sin(min(support_rad, 0.5 * np.pi)):
        raise InputError(
            f"needle radius: {from_si(needle_radius_m, 'mm'):g} mm; must be above 0 and"
            " below the radius"
        )

    needle_rad = float(np.arcsin(needle_radius_m / radius_m))
    share = np.linspace(0.0, 1.0, size.elements)
    grown = FIRST_TO_MEAN * share + (1.0 - FIRST_TO_MEAN) * share**2
    edges = np.append(0.0, needle_rad + (support_rad - needle_rad) * grown)
    middles = 0.5 * (edges[:-1] + edges[1:])
    angles = np.append(np.stack([edges[:-1], middles], axis=1).ravel(), edges[-1])
    radii = np.linspace(radius_m, radius_m - thickness_m, 2 * size.layers + 1)
    directions = np.stack([np.sin(angles), np.cos(angles)], axis=-1)
    directions[0] = 0.0, 1.0
    points = (directions[:, None] * radii[:, None]).reshape(-1, 2)
    number = np.arange(len(points)).reshape(len(angles), len(radii))

    return MeridianMesh(radius_m, points, _cells(number), number[:, 0], number[:, -1])


def _cells(number: Integers) -> Integers:
    """Quads of a grid of nodes (column, across)."""
    along = (number.shape[0] - 1) // 2
    across = (number.shape[1] - 1) // 2
    corner = number[: 2 * along : 2, : 2 * across : 2].reshape(-1, 1)
    offsets = [number[i, j] - number[0, 0] for j in range(3) for i in range(3)]
    return corner + np.array(offsets)


POINTS = 3  # along each direction of a 9-node quad


def line_shapes(places_p: Floats) -> tuple[Floats, Floats]:
    """Return values and slopes (point, 3) of the quadratic shape functions of nodes at
    -1, 0, 1.

    >>> line_shapes(np.array([-1.0]))[0]
    array([[ 1.,  0., -0.]])
    """
    s = places_p
    values = np.stack([0.5 * s * (s - 1.0), 1.0 - s * s, 0.5 * s * (s + 1.0)], axis=-1)
    return values, np.stack([s - 0.5, -2.0 * s, s + 0.5], axis=-1)


def quad_shapes(places_pk: Floats) -> tuple[Floats, Floats]:
    """Return the shape functions of a 9-node quad (point, 9) and their slopes (point,
    9, [along, across]).
    """
    along, along_slope = line_shapes(places_pk[:, 0])
    across, across_slope = line_shapes(places_pk[:, 1])
    parts = (across, along), (across, along_slope), (across_slope, along)
    values, *slopes = (np.einsum("pj,pi->pji", *both).reshape(-1, 9) for both in parts)
    return values, np.stack(slopes, axis=-1)


class ElementTables(NamedTuple):
    """The loops' view of a solid: shapes and material.

    `shapes_epgn` (element, point, 3, 9): d/dr, d/dz and N/R of the nodes' shape
    functions; `unknowns_en` (element, 18): 2 n + c is node n, component c (from the
    axis, along it); `lambda_ep`, `mu_ep` (element, point): Lamé's constants times the
    point's volume; `stiffening`: b; `lame_ratio`: lambda/mu.
    """

    shapes_epgn: Floats
    unknowns_en: Integers
    lambda_ep: Floats
    mu_ep: Floats
    stiffening: float
    lame_ratio: float


def solid_of_revolution(
    mesh: MeridianMesh, poisson_ratio: float, stiffening: float = 0.0
) -> ElementTables:
    """Return a wall's shapes and material at its Gauss points; b = 0 is the neo-Hookean
    solid.
    """
    places_pk, weights_p = gauss_points(2, POINTS)
    values_pn, slopes_pnk = quad_shapes(places_pk)
    corners_enc = mesh.points_nc[mesh.cells_en]
    jacobian_epck = np.einsum("enc,pnk->epck", corners_enc, slopes_pnk)
    gradients_epnc = slopes_pnk @ np.linalg.inv(jacobian_epck)
    distance_ep = np.einsum("pn,en->ep", values_pn, corners_enc[..., 0])
    around_epn = values_pn / distance_ep[..., None]
    shapes_epgn = np.concatenate(
        [gradients_epnc.transpose(0, 1, 3, 2), around_epn[:, :, None]], axis=2
    )
    volumes_ep = (
        2.0 * np.pi * distance_ep * (np.abs(np.linalg.det(jacobian_epck)) * weights_p)
    )
    lambda_ep, mu_ep = (
        constant * volumes_ep for constant in lame_constants(1.0, poisson_ratio)
    )
    unknowns_en = (2 * mesh.cells_en[:, :, None] + np.arange(2)).reshape(
        len(mesh.cells_en), -1
    )
    ratio = float(lambda_ep[0, 0] / mu_ep[0, 0])

    return ElementTables(
        np.ascontiguousarray(shapes_epgn),
        unknowns_en,
        lambda_ep,
        mu_ep,
        float(stiffening),
        ratio,
    )


@compiled
def nodal_forces(tables: ElementTables, u: Floats) -> Floats:
    """Return the nodal forces that hold a displacement u, both (all unknowns,).

    They are not finite where J <= 0, or where the tissue is stretched too far.
    """
    found = np.zeros(len(u))
    F = np.empty(5)
    H = np.empty(5)
    P = np.empty(5)
    away = np.empty(9)
    along = np.empty(9)
    elements, points = tables.mu_ep.shape

    for element in range(elements):
        unknowns = tables.unknowns_en[element]
        away[:] = 0.0
        along[:] = 0.0

        for point in range(points):
            shapes = tables.shapes_epgn[element, point]
            log_ratio = _deformation(shapes, unknowns, u, F, H)
            factor = _growth(tables, F, log_ratio)
            _stress(
                tables.lambda_ep[element, point],
                tables.mu_ep[element, point],
                F,
                H,
                log_ratio,
                P,
            )

            for node in range(9):
                radial = (
                    P[0] * shapes[0, node]
                    + P[1] * shapes[1, node]
                    + P[4] * shapes[2, node]
                )
                away[node] += factor * radial
                along[node] += factor * (
                    P[2] * shapes[0, node] + P[3] * shapes[1, node]
                )

        for node in range(9):
            found[unknowns[2 * node]] += away[node]
            found[unknowns[2 * node + 1]] += along[node]

    return found


@compiled
def element_tangents(tables: ElementTables, u: Floats) -> Floats:
    """Return the derivative of the forces of every element, (element, 18, 18).

    mu dF:dF + lambda (H:dF)^2 + (mu - lambda ln J) H dF^T:(H dF^T)^T; the first does
    not depend on u. In tissue that stiffens all of it is times exp(b Q), and so is (2
    b/mu) (P:dF)^2 with P of b = 0.
    """
    F = np.empty(5)
    H = np.empty(5)
    P = np.empty(5)
    A = np.empty((5, 5))
    by_motion = np.empty((5, 18))
    triangle = np.empty((18, 18))
    elements, points = tables.mu_ep.shape
    found = np.empty((elements, 18, 18))

    for element in range(elements):
        unknowns = tables.unknowns_en[element]
        triangle[:] = 0.0

        for point in range(points):
            shapes = tables.shapes_epgn[element, point]
            log_ratio = _deformation(shapes, unknowns, u, F, H)
            factor = _growth(tables, F, log_ratio)
            lame_lambda = tables.lambda_ep[element, point]
            lame_mu = tables.mu_ep[element, point]
            _stress(lame_lambda, lame_mu, F, H, log_ratio, P)
            _elasticity(lame_lambda, lame_mu, H, log_ratio, A)
            rise = 2.0 * tables.stiffening / lame_mu

            for i in range(5):
                for j in range(5):
                    A[i, j] = factor * (A[i, j] + rise * P[i] * P[j])

                for node in range(9):
                    radial = (
                        A[i, 0] * shapes[0, node]
                        + A[i, 1] * shapes[1, node]
                        + A[i, 4] * shapes[2, node]
                    )
                    by_motion[i, 2 * node] = radial
                    by_motion[i, 2 * node + 1] = (
                        A[i, 2] * shapes[0, node] + A[i, 3] * shapes[1, node]
                    )

            for node in range(9):
                r = shapes[0, node]
                z = shapes[1, node]
                around = shapes[2, node]

                for other in range(2 * node + 2):
                    radial = (
                        r * by_motion[0, other]
                        + z * by_motion[1, other]
                        + around * by_motion[4, other]
                    )
                    triangle[2 * node, other] += radial
                    triangle[2 * node + 1, other] += (
                        r * by_motion[2, other] + z * by_motion[3, other]
                    )

        for row in range(18):
            for column in range(row + 1):
                found[element, row, column] = found[element, column, row] = triangle[
                    row, column
                ]

    return found


@compiled
def _deformation(
    shapes: Floats, unknowns: Integers, u: Floats, F: Floats, H: Floats
) -> float:
    """Write F and its inverse's transpose H (5,) at a point; return ln J, not a number
    where J <= 0.
    """
    rr = rz = zr = zz = around = 0.0
    for node in range(9):
        away = u[unknowns[2 * node]]
        along = u[unknowns[2 * node + 1]]
        rr += shapes[0, node] * away
        rz += shapes[1, node] * away
        around += shapes[2, node] * away
        zr += shapes[0, node] * along
        zz += shapes[1, node] * along

    rr = rr + 1.0
    zz = zz + 1.0
    around = around + 1.0
    plane = rr * zz - rz * zr
    F[0] = rr
    F[1] = rz
    F[2] = zr
    F[3] = zz
    F[4] = around

    if not (plane > 0.0 and around > 0.0):
        H[:] = np.nan
        return np.nan

    H[0] = zz / plane
    H[1] = -zr / plane
    H[2] = -rz / plane
    H[3] = rr / plane
    H[4] = 1.0 / around

    return float(np.log(plane * around))


@compiled
def _growth(tables: ElementTables, F: Floats, log_ratio: float) -> float:
    """Return the factor of the stiffening on the stress (`tissue_material.growth`)."""
    if tables.stiffening == 0.0:
        return 1.0
    squares = F[0] * F[0] + F[1] * F[1] + F[2] * F[2] + F[3] * F[3] + F[4] * F[4]
    strain = squares - 3.0 - 2.0 * log_ratio + tables.lame_ratio * log_ratio * log_ratio
    exponent = tables.stiffening * strain
    return float(np.exp(exponent)) if exponent <= LARGEST_EXPONENT else np.nan


@compiled
def _stress(
    lame_lambda: float,
    lame_mu: float,
    F: Floats,
    H: Floats,
    log_ratio: float,
    P: Floats,
) -> None:
    """Write the stress of b = 0 times the volume, (5,)."""
    along_H = lame_lambda * log_ratio - lame_mu
    for entry in range(5):
        P[entry] = lame_mu * F[entry] + along_H * H[entry]


@compiled
def _elasticity(
    lame_lambda: float, lame_mu: float, H: Floats, log_ratio: float, A: Floats
) -> None:
    """Write the elasticity of b = 0 times the volume, (5, 5): see
    `element_tangents`.
    """
    exchanged = lame_mu - lame_lambda * log_ratio
    for i in range(5):
        for j in range(5):
            A[i, j] = lame_lambda * H[i] * H[j]
        A[i, i] += lame_mu

    for i in range(2):
        for j in range(2):
            for k in range(2):
                for m in range(2):
                    A[2 * i + j, 2 * k + m] += exchanged * H[2 * i + m] * H[2 * k + j]

    A[4, 4] += exchanged * H[4] * H[4]
