"""Sealed eyes from a library of open ones, against load paths that solve the globe's
law with their own volumes.
"""

import numpy as np
import pytest
from analytic_library import solved_library

from scleraforce.base.errors import InputError
from scleraforce.base.units import SI_PER_UNIT
from scleraforce.library import Library
from scleraforce.mechanics.axisymmetric_wall import EvenWall, axisymmetric_path
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.meridian_elements import MeridianSize
from scleraforce.records.globe import sealed_law
from scleraforce.records.study import LibraryStudy, Range

pytestmark = pytest.mark.slow

PER_UL = SI_PER_UNIT["mmhg13_per_ul"][1]
RADIUS = 12e-3
NU = 0.45
NEEDLE = 0.35e-3
GRID = LibraryStudy(
    thickness_m=Range(min=0.45e-3, max=0.9e-3),
    thicknesses=5,
    tension=Range(min=4e-3, max=0.2),
    tensions=8,
    max_tip_m=3e-3,
    tips=24,
    stiffenings=1,
)


@pytest.fixture(scope="module")
def library() -> Library:
    return solved_library(GRID)


@pytest.mark.parametrize(
    ("thickness_m", "modulus_pa", "iop_pa", "rigidity", "law"),
    [
        (0.55e-3, 0.4e6, 266.0, 0.03, "cube-root"),
        (0.7e-3, 0.6e6, 530.0, 0.02, "logarithmic"),
        (0.85e-3, 0.25e6, 200.0, 0.01, "cube-root"),
    ],
)
def test_a_sealed_eye_is_that_of_a_path_with_its_own_volumes(
    library,
    thickness_m: float,
    modulus_pa: float,
    iop_pa: float,
    rigidity: float,
    law: str,
):
    dents_m = 1e-3 * np.array([0.3, 0.8, 1.4])
    path = axisymmetric_path(
        EvenWall(RADIUS, thickness_m, NU, NEEDLE, size=MeridianSize(96)),
        iop_pa / modulus_pa,
        PathEnd(tips_m=dents_m),
        sealed_law(rigidity * PER_UL, law).over(modulus_pa),
    )
    eye = library.eye(
        thickness_m=thickness_m,
        youngs_modulus_pa=modulus_pa,
        iop_pa=iop_pa,
        rigidity_pa13_per_m3=rigidity * PER_UL,
        rigidity_law=law,
        polar_angle_rad=0.0,  # the path knows no base beside the pole
    )
    np.testing.assert_allclose(
        eye.pressure_pa(dents_m), path.iop_ratio[1:] * modulus_pa, rtol=2e-3
    )
    np.testing.assert_allclose(
        eye.force_n(dents_m), path.force_ratio_m2[1:] * modulus_pa, rtol=2e-3
    )


def test_a_pressure_that_runs_away_ends_the_range(library):
    wall = {"thickness_m": 0.5e-3, "youngs_modulus_pa": 0.38e6, "iop_pa": 266.0}
    eye = library.eye(**wall, rigidity_pa13_per_m3=0.03 * PER_UL)
    assert 2.1e-3 < eye.max_dent_m < 2.4e-3  # the path ends at 2.2 mm
    assert np.isfinite(eye.force_n(eye.max_dent_m))

    for answer, value in (
        (eye.force_n, 2.4e-3),
        (eye.pressure_pa, 3e-3),
        (eye.dent_m, 1.01 * eye.max_force_n),
    ):
        with pytest.raises(
            InputError, match=r"(dent|force): .* is outside this eye's range, 0 to "
        ):
            answer(value)

    assert library.eye(**wall).max_dent_m == library.tip_m[-1]
