"""Closed forms for the stiffness of a thin pressurised sphere under a small force, at E
= 1 Pa.

`point` and `shallow` are of a shallow shell: the dent is small against the globe, and
the wall does not shear. `sphere` is of the whole globe, term by term in Legendre
polynomials, and its wall may shear. Sizes are of the middle surface, in m; pressures
are p/E; a stiffness is F/E over the middle surface's displacement at the force, in m.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.special import j1

Floats = NDArray[np.float64]

# in `shallow`, the integral goes to this wave number over the dent's, in pieces
WAVES = 200
# in `sphere`, the last term's wave number times the smaller of disc and thickness
FINEST = 200.0


def pressure_ratio(
    tension: float, thickness_m: float, radius_m: float, poisson_ratio: float
) -> float:
    """Return p/E for Vella's tension tau = p R^2 / (4 sqrt(E h B))."""
    return float(
        4.0
        * tension
        * np.sqrt(thickness_m * _bending(thickness_m, poisson_ratio))
        / radius_m**2
    )


def point(
    thickness_m: float, radius_m: float, pressure: float, poisson_ratio: float
) -> float:
    """Return the stiffness under a point force (Vella et al., J. R. Soc. Interface 9,
    2012, 448).
    """
    root = np.sqrt(thickness_m * _bending(thickness_m, poisson_ratio))
    tension = pressure * radius_m**2 / (4.0 * root)
    whole = 4.0 * np.pi * root / radius_m
    if tension == 0.0:
        return float(2.0 / np.pi * whole)
    if abs(tension - 1.0) < 1e-6:
        return float(whole)
    if tension < 1.0:
        return float(
            whole * np.sqrt(1.0 - tension**2) / np.arctan(np.sqrt(tension**-2 - 1.0))
        )

    return float(
        whole * np.sqrt(tension**2 - 1.0) / np.arctanh(np.sqrt(1.0 - tension**-2))
    )


def shallow(
    thickness_m: float,
    radius_m: float,
    pressure: float,
    disc_m: float,
    poisson_ratio: float,
) -> float:
    """Return the stiffness of a shallow shell whose force is uniform over a disc of
    radius `disc_m`.

    w(0) = F/(2 pi) int [2 J1(ka)/(ka)] k dk / (B k^4 + p R k^2/2 + E h/R^2), by
    Hankel's transform.
    """
    bending = _bending(thickness_m, poisson_ratio)
    dent = (bending * radius_m**2 / thickness_m) ** 0.25

    def density(wave: float) -> float:
        k = wave / dent
        spread = 2.0 * j1(k * disc_m) / (k * disc_m)
        resists = (
            bending * k**4
            + 0.5 * pressure * radius_m * k**2
            + thickness_m / radius_m**2
        )

        return float(spread * k / resists / dent)

    pieces = np.linspace(0.0, WAVES, WAVES + 1)
    pieces[0] = 1e-9
    compliance = sum(quad(density, start, end)[0] for start, end in pairwise(pieces))
    return float(2.0 * np.pi / compliance)


def sphere(
    thickness_m: float,
    radius_m: float,
    pressure: float,
    disc_m: float,
    poisson_ratio: float,
    *,
    shear: bool = True,
) -> float:
    """Return the stiffness of a whole sphere pressed at both poles, uniformly over
    discs.

    For the degree l, with q = (l - 1)(l + 2), a normal load meets (Koiter's sphere,
    bending after Mindlin)

        K_l = B q^2/R^4 / (1 + s q/R^2) + p q/(2 R) + (E h/R^2) q / (l (l + 1) - 1 + nu)
        s = h^2 / (5 (1 - nu))

    where s = B/(5/6 G h) is left out without shear. Two opposite forces have even
    degrees only, with twice the amplitude of one force.
    """
    edge = float(np.cos(np.arcsin(disc_m / radius_m)))
    values = _legendre(edge, int(FINEST * radius_m / min(disc_m, thickness_m)))
    degree = np.arange(0.0, len(values) - 1, 2.0)
    differences = values[1 : len(values) - 2 : 2] - values[3::2][: len(degree) - 1]
    spread = np.append(1.0, differences / ((2.0 * degree[1:] + 1.0) * (1.0 - edge)))
    q = (degree - 1.0) * (degree + 2.0)
    sheared = thickness_m**2 / (5.0 * (1.0 - poisson_ratio)) if shear else 0.0
    resists = (
        _bending(thickness_m, poisson_ratio)
        * q**2
        / radius_m**4
        / (1.0 + sheared * q / radius_m**2)
    )
    resists += 0.5 * pressure * q / radius_m
    resists += (
        thickness_m / radius_m**2 * q / (degree * (degree + 1.0) - 1.0 + poisson_ratio)
    )

    return float(
        2.0 * np.pi * radius_m**2 / np.sum((2.0 * degree + 1.0) * spread / resists)
    )


def _bending(thickness_m: float, poisson_ratio: float) -> float:
    return thickness_m**3 / (12.0 * (1.0 - poisson_ratio**2))


def _legendre(place: float, highest: int) -> Floats:
    """P_0 to P_highest at a place, by Bonnet's recursion; `highest` is made odd."""
    values = [1.0, place]
    for degree in range(1, highest // 2 * 2 + 1):
        values.append(
            ((2 * degree + 1) * place * values[-1] - degree * values[-2]) / (degree + 1)
        )
    return np.array(values)
