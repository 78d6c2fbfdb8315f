"""A library of tissue that stiffens: between its stiffenings, against walls of just that tissue."""

from dataclasses import replace

import numpy as np
import pytest
from analytic_library import analytic_library, solved_library

from scleraforce.errors import InputError
from scleraforce.library import Library
from scleraforce.library.build import solve_path
from scleraforce.library.plan import plan_library
from scleraforce.library.responses import OTHERS, walls_of
from scleraforce.library.stiffened import StiffenedWalls, WholeCurves
from scleraforce.mechanics.axisymmetric import AxisymmetricPath, axisymmetric_path
from scleraforce.mechanics.meridian import MeridianSize
from scleraforce.study import LibraryStudy, Range, Study

GRID = LibraryStudy(thickness_m=Range(min=0.5e-3, max=0.8e-3), thicknesses=4, tension=Range(min=8e-3, max=6e-2),
                    tensions=4, max_tip_m=3e-3, tips=8, elements=24)  # fmt: skip
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
    wall = PLAN.radius_m, thickness_m, PLAN.poisson_ratio, PLAN.needle_radius_m, iop_ratio
    return axisymmetric_path(*wall, tips_m=PLAN.tip_m[1:], stiffening=stiffening, size=MeridianSize(24, 1))


@pytest.mark.parametrize("stiffening", [0.4, 1.2, 5.0, 15.0])
def test_walls_between_the_stiffenings_agree_with_walls_of_that_tissue(library: Library, stiffening: float) -> None:
    """Dents deeper than 1.3 mm change their form fast from b = 0 on: there the curves are right to 40 um."""
    found = library.for_stiffening(stiffening)
    for wall in WALLS:
        wanted = path_of(*wall, stiffening)
        thickness_m, tip_m = np.full(len(PLAN.tip_m), PLAN.thickness_m[wall[0]]), PLAN.tip_m
        ratio = PLAN.tension[wall[1]] * thickness_m / PLAN.radius_m
        states = found.at_tip(thickness_m, ratio, tip_m)
        off = np.abs(states.force_ratio[1:] / wanted.force_ratio_m2[1:] - 1.0)
        assert off[:SMALL_DENTS].max() < 4e-3
        assert off.max() < (5e-3 if stiffening > 1.0 else 1.5e-2)
        off_m = np.linalg.norm(states.curves_sbnc - wanted.curves_sbnc, axis=-1).max(axis=(1, 2))
        assert off_m[:SMALL_DENTS].max() < 0.6e-6
        assert off_m.max() < (20e-6 if stiffening > 1.0 else 45e-6)
        volumes_m3 = found.displaced_m3(thickness_m, ratio, tip_m)
        assert volumes_m3[1:SMALL_DENTS] == pytest.approx(wanted.displaced_m3[1:SMALL_DENTS], rel=2e-3)
        undented_m = found.undented_tpbnc[wall].astype(np.float64) - wanted.curves_sbnc[0]
        assert np.abs(undented_m).max() < 0.2e-6


def test_walls_of_a_stiffening_that_the_library_holds_are_the_solved_ones(library: Library) -> None:
    for unit in (0, 16 + 6, 2 * 16 + 11, 3 * 16 + 15):
        b, *place = PLAN.place(unit)
        found, solved = library.for_stiffening(float(PLAN.stiffening[b])), solve_path(PLAN, unit)
        np.testing.assert_array_equal(found.force_ratio_tpd[tuple(place)], solved.force_d)
        np.testing.assert_array_equal(found.displaced_tpd[tuple(place)], solved.displaced_d)
        np.testing.assert_array_equal(found.curves_tpdbnc[tuple(place)], solved.curves_dbnc)
        np.testing.assert_array_equal(found.undented_tpbnc[tuple(place)], solved.curves_dbnc[0])
    forces = np.stack([library.for_stiffening(b).force_ratio_tpd[..., -1] for b in (0.0, 0.5, 1.5, 4.0, 12.0, 30.0)])
    assert (np.diff(forces, axis=0) > 0.0).all()


def test_tissue_that_does_not_stiffen_is_the_same_in_a_library_without_other_tissue(library: Library) -> None:
    alone = solved_library(replace(GRID, stiffenings=1))
    assert alone.stiffened is None
    for soft in (library, library.for_stiffening(0.0), library.for_stiffening(7.0).for_stiffening(0.0)):
        assert soft.stiffening == alone.stiffening == 0.0
        for name in ("force_ratio_tpd", "displaced_tpd", "curves_tpdbnc", "undented_tpbnc", "stiffness_atpd"):
            np.testing.assert_array_equal(getattr(soft, name), getattr(alone, name))


def test_other_tissue_is_refused_with_the_range(library: Library) -> None:
    for stiffening in (-1e-6, 30.001, 1e300, np.inf, np.nan):
        with pytest.raises(InputError, match=r"^stiffening: \S+ is outside the library's range, 0 to 30$"):
            library.for_stiffening(stiffening)
    alone = analytic_library(thicknesses=4, ratios=4, tips=5, nodes=9)
    assert alone.for_stiffening(0.0) is alone
    assert alone.stiffenings.tolist() == [0.0]
    for stiffening in (3.0, np.nan):
        with pytest.raises(InputError, match=r"^stiffening: the library only holds tissue of 0, not of (3|nan)$"):
            alone.for_stiffening(stiffening)


def test_without_far_material_the_other_tissue_has_the_same_first_nodes(library: Library) -> None:
    near = library.within(4e-3)
    nodes = near.curves_tpdbnc.shape[4]
    assert 4 < nodes < library.curves_tpdbnc.shape[4]
    for stiffening in (float(PLAN.stiffening[2]), 5.0):
        found, whole = near.for_stiffening(stiffening), library.for_stiffening(stiffening)
        np.testing.assert_array_equal(found.curves_tpdbnc, whole.curves_tpdbnc[..., :nodes, :])
        np.testing.assert_array_equal(found.undented_tpbnc, whole.undented_tpbnc)
        np.testing.assert_array_equal(found.node_angles(), whole.node_angles()[:nodes])
    np.testing.assert_array_equal(walls_of(near).curves_btpdbnc, walls_of(library).curves_btpdbnc[..., :nodes, :])


def test_the_last_few_libraries_are_kept_and_no_more(library: Library) -> None:
    fresh = replace(library)
    asked = [float(b) for b in np.linspace(1.0, 20.0, OTHERS + 3)]
    made = [fresh.for_stiffening(b) for b in asked]
    for b, one in list(zip(asked, made, strict=True))[-OTHERS:]:
        assert fresh.for_stiffening(b) is one
    assert len(fresh._others) == OTHERS
    assert fresh.for_stiffening(asked[0]) is not made[0]
    assert len(fresh._others) == OTHERS


def test_contact_and_tissue_may_be_chosen_in_either_order(library: Library) -> None:
    wall = np.full(3, 0.6e-3), np.full(3, 1.5e-3), np.array([0.3e-3, 0.9e-3, 2e-3])
    one, other = library.for_contact(0.5).for_stiffening(5.0), library.for_stiffening(5.0).for_contact(0.5)
    assert (one.contact_polar_rad, one.stiffening) == (other.contact_polar_rad, other.stiffening) == (0.5, 5.0)
    np.testing.assert_array_equal(one.forces(*wall), other.forces(*wall))
    np.testing.assert_array_equal(one.shapes(*wall), other.shapes(*wall))
    assert (one.forces(*wall) > 1.02 * library.for_contact(0.5).forces(*wall)).any()


def test_too_few_stiffenings_and_such_as_do_not_increase_are_refused() -> None:
    soft = analytic_library(thicknesses=4, ratios=4, tips=5, nodes=9)
    for stiffening in (
        [0.0, 1.0], [0.0, 1.0, 2.0], [0.0, 2.0, 1.0, 3.0], [0.0, 1.0, 1.0, 3.0], [-1.0, 0.0, 1.0, 2.0],
        [0.0, 1.0, 2.0, np.nan], [0.0, 1.0, 2.0, np.inf],
    ):  # fmt: skip
        arrays = (soft.force_ratio_tpd, soft.displaced_tpd, soft.undented_tpbnc, soft.curves_tpdbnc)
        force, displaced, undented, curves = (np.stack([array] * len(stiffening)) for array in arrays)
        with pytest.raises(InputError, match=r"^library: (\d stiffenings of walls|stiffenings that do not increase)"):
            StiffenedWalls(stiffening=np.array(stiffening), force_ratio_btpd=force, displaced_btpd=displaced,
                           undented_btpbnc=undented, curves=WholeCurves(curves))  # fmt: skip
