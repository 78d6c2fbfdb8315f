"""The burst of a thin sphere, against the wall of revolution and a closed form."""

import numpy as np
import pytest

from scleraforce.errors import SolverError
from scleraforce.mechanics.axisymmetric import AxisymmetricWall
from scleraforce.mechanics.continuation import pressurise
from scleraforce.mechanics.material import burst_tension
from scleraforce.mechanics.meridian import MeridianSize, meridian_mesh


def test_a_thin_sphere_holds_a_little_less_than_its_burst_and_no_more() -> None:
    thickness_m, radius_m = 60e-6, 12e-3
    mesh = meridian_mesh(radius_m, thickness_m, 0.35e-3, 0.5 * np.pi, MeridianSize(24))
    wall = AxisymmetricWall(mesh, 0.45, symmetric=True)
    per_tension = thickness_m / (radius_m - 0.5 * thickness_m)  # of the middle surface
    pressurise(wall, 0.98 * burst_tension(0.45) * per_tension)
    with pytest.raises(SolverError, match="equilibrium found up to"):
        pressurise(wall, 1.02 * burst_tension(0.45) * per_tension)


def test_an_almost_incompressible_sphere_bursts_where_the_closed_form_says() -> None:
    # J = 1: p R/(mu t) = 2 (1/L - 1/L^7), largest at L^6 = 7; E = 3 mu.
    stretch = 7.0 ** (1.0 / 6.0)
    assert burst_tension(0.499999) == pytest.approx(2.0 / 3.0 * (1.0 / stretch - stretch**-7), rel=1e-4)
