"""A library of tissue that stiffens: between its stiffenings, against walls of just
that tissue.
"""

import numpy as np
import pytest
from analytic_library import analytic_library, made_up_library, solved_library

from scleraforce.base.errors import InputError
from scleraforce.library import Library
from scleraforce.library.library_plan import plan_library
from scleraforce.mechanics.axisymmetric_wall import (
    AxisymmetricPath,
    EvenWall,
    axisymmetric_path,
)
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.meridian_elements import MeridianSize
from scleraforce.records.study import LibraryStudy, Range, Study

GRID = LibraryStudy(
    thickness_m=Range(min=0.5e-3, max=0.8e-3),
    thicknesses=4,
    tension=Range(min=8e-3, max=6e-2),
    tensions=4,
    max_tip_m=3e-3,
    tips=8,
    elements=16,
)
PLAN = plan_library(Study(library=GRID))
SMALL_DENTS = 5  # tips, up to 1.3 mm
WALLS = ((0, 0), (1, 2), (3, 3))  # numbers of thickness and tension in the library


@pytest.fixture(scope="module")
def library() -> Library:
    return solved_library(GRID)


def path_of(thickness: int, tension: int, stiffening: float) -> AxisymmetricPath:
    """The load path of a wall of the library, in tissue of any stiffening."""
    thickness_m = float(PLAN.thickness_m[thickness])
    iop_ratio = float(PLAN.tension[tension]) * thickness_m / PLAN.radius_m
    wall = EvenWall(
        PLAN.radius_m,
        thickness_m,
        PLAN.poisson_ratio,
        PLAN.needle_radius_m,
        stiffening=stiffening,
        size=MeridianSize(16, 1),
    )

    return axisymmetric_path(wall, iop_ratio, PathEnd(tips_m=PLAN.tip_m[1:]))


@pytest.mark.parametrize("stiffening", [0.4, 1.2, 5.0, 15.0])
def test_walls_between_the_stiffenings_agree_with_walls_of_that_tissue(
    library, stiffening: float
):
    """Dents deeper than 1.3 mm change their form fast from b = 0 on: there the curves
    are right to 40 um.
    """
    found = library.for_stiffening(stiffening)
    for wall in WALLS:
        wanted = path_of(*wall, stiffening)
        thickness_m = np.full(len(PLAN.tip_m), PLAN.thickness_m[wall[0]])
        tip_m = PLAN.tip_m
        ratio = PLAN.tension[wall[1]] * thickness_m / PLAN.radius_m
        states = found.at_tip(thickness_m, ratio, tip_m)
        off = np.abs(states.force_ratio[1:] / wanted.force_ratio_m2[1:] - 1.0)
        assert off[:SMALL_DENTS].max() < 4e-3
        assert off.max() < (5e-3 if stiffening > 1.0 else 1.5e-2)
        off_m = np.linalg.norm(states.curves_sbnc - wanted.curves_sbnc, axis=-1).max(
            axis=(1, 2)
        )
        assert off_m[:SMALL_DENTS].max() < 0.6e-6
        assert off_m.max() < (20e-6 if stiffening > 1.0 else 45e-6)
        volumes_m3 = found.displaced_m3(thickness_m, ratio, tip_m)
        assert volumes_m3[1:SMALL_DENTS] == pytest.approx(
            wanted.displaced_m3[1:SMALL_DENTS], rel=2e-3
        )
        undented_m = (
            found.undented_tpbnc[wall].astype(np.float64) - wanted.curves_sbnc[0]
        )
        assert np.abs(undented_m).max() < 0.2e-6


def test_tissue_that_does_not_stiffen_is_the_same_in_a_library_without_other_tissue():
    alone = analytic_library(thicknesses=4, ratios=4, tips=5, nodes=9)
    soft = made_up_library().for_stiffening(7.0).for_stiffening(0.0)
    assert soft.stiffening == alone.stiffening == 0.0
    for name in (
        "force_ratio_tpd",
        "displaced_tpd",
        "undented_tpbnc",
        "stiffness_atpd",
    ):
        np.testing.assert_array_equal(getattr(soft, name), getattr(alone, name))


@pytest.mark.parametrize("stiffening", [-1e-6, 30.001, np.inf, np.nan])
def test_other_tissue_is_refused_with_the_range(stiffening: float):
    with pytest.raises(InputError, match=r"outside the library's range, 0 to 30$"):
        made_up_library().for_stiffening(stiffening)


@pytest.mark.parametrize("stiffening", [3.0, np.nan])
def test_a_library_of_one_tissue_refuses_all_others(stiffening: float):
    alone = analytic_library(thicknesses=4, ratios=4, tips=5, nodes=9)
    assert alone.for_stiffening(0.0) is alone
    with pytest.raises(InputError, match="the library only holds tissue of 0"):
        alone.for_stiffening(stiffening)
