"""Shape functions of quadrilaterals and hexahedra on [-1, 1]^d, nodes in VTK's order.

Elements: 4, 8 or 9 nodes in the plane, 8, 20 or 27 in space (bilinear, quadratic
serendipity, quadratic Lagrange). In VTK's order the nodes of a smaller element are the
first ones of the larger (corners, mid-edges, mid-faces, middle), so one table of node
positions serves a family. Source: Hughes, The Finite Element Method, sec. 3.4-3.7.
"""

from functools import cache
from itertools import product

import numpy as np

from scleraforce.base.arrays import Floats, Integers

QUAD_NODES = (
    (-1, -1),
    (1, -1),
    (1, 1),
    (-1, 1),
    (0, -1),
    (1, 0),
    (0, 1),
    (-1, 0),
    (0, 0),
)
HEX_NODES = (
    *(
        (-1, -1, -1),
        (1, -1, -1),
        (1, 1, -1),
        (-1, 1, -1),
        (-1, -1, 1),
        (1, -1, 1),
        (1, 1, 1),
        (-1, 1, 1),
    ),
    *(
        (0, -1, -1),
        (1, 0, -1),
        (0, 1, -1),
        (-1, 0, -1),
        (0, -1, 1),
        (1, 0, 1),
        (0, 1, 1),
        (-1, 0, 1),
    ),
    *((-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)),
    *((-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1)),
    (0, 0, 0),
)


def node_positions(dimension: int, nodes: int) -> Floats:
    """Return the nodes' places on [-1, 1]^d, shape (node, d).

    >>> node_positions(2, 4)[2]
    array([1., 1.])
    """
    return np.array(QUAD_NODES if dimension == 2 else HEX_NODES, dtype=np.float64)[
        :nodes
    ]


@cache
def shape_monomials(dimension: int, nodes: int) -> tuple[Integers, Floats]:
    """Return exponents_md and coefficients_mn of the shape functions of `nodes` nodes
    in `dimension` 2 or 3.

    N_n = sum over m of coefficients_mn[m, n] prod_d x_d ** exponents_md[m, d].
    """
    if nodes not in {2: (4, 8, 9), 3: (8, 20, 27)}.get(dimension, ()):
        raise ValueError(f"no element with {nodes} nodes in {dimension} dimensions")

    order = 1 if nodes == 2**dimension else 2
    serendipity = nodes in {2: (8,), 3: (20,)}[dimension]
    # Serendipity: at most one variable enters as a square (superlinear degree 2; Arnold
    # and Awanou, 2011).
    exponents = [
        e
        for e in product(range(order + 1), repeat=dimension)
        if not serendipity or e.count(2) <= 1
    ]
    exponents_md = np.array(exponents, dtype=np.int64)
    places = node_positions(dimension, nodes)
    vandermonde_nm = np.prod(places[:, None, :] ** exponents_md, axis=-1)

    # The coefficients are multiples of 1/8: rounding makes them exact.
    return exponents_md, np.round(np.linalg.inv(vandermonde_nm) * 8.0) / 8.0


def shape_values(local_pd: Floats, nodes: int) -> Floats:
    """Return the shape functions at local points (point, d), shape (point, node).

    >>> shape_values(np.zeros((1, 2)), 4)
    array([[0.25, 0.25, 0.25, 0.25]])
    """
    exponents_md, coefficients_mn = shape_monomials(local_pd.shape[1], nodes)
    powers = _powers(local_pd)
    value_mp = _product(
        [powers[exponents_md[:, d], :, d] for d in range(local_pd.shape[1])]
    )
    return value_mp.T @ coefficients_mn


def shape_gradients(local_pd: Floats, nodes: int) -> Floats:
    """Return the derivatives of the shape functions by the local coordinates, shape
    (point, node, d).
    """
    dimension = local_pd.shape[1]
    exponents_md, coefficients_mn = shape_monomials(dimension, nodes)
    powers = _powers(local_pd)
    slopes = np.stack([np.zeros_like(local_pd), np.ones_like(local_pd), 2.0 * local_pd])
    gradients = [
        _product(
            [
                (slopes if d == k else powers)[exponents_md[:, d], :, d]
                for d in range(dimension)
            ]
        ).T
        @ coefficients_mn
        for k in range(dimension)
    ]

    return np.stack(gradients, axis=-1)


def _powers(local_pd: Floats) -> Floats:
    """Return 1, x, x^2, shape (power, point, d)."""
    return np.stack([np.ones_like(local_pd), local_pd, local_pd**2])


def _product(factors: list[Floats]) -> Floats:
    return np.prod(np.stack(factors), axis=0)
