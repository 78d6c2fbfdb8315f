"""Hooke's constants in the form that the elements and the neo-Hookean law take (standard library only)."""


def lame_constants(youngs_modulus_pa: float, poisson_ratio: float) -> tuple[float, float]:
    """Return lambda and mu in Pa.

    >>> lame_constants(2.5, 0.25)
    (1.0, 1.0)
    """
    E, nu = youngs_modulus_pa, poisson_ratio
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))
