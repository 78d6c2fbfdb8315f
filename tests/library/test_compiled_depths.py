"""The loops of the fit and of the library against oracles by arrays."""

from dataclasses import replace
from math import log

import fit_arrays
import library_arrays
import numpy as np
import pytest
from analytic_frames import BOTH, LATERAL_M, LIBRARY
from analytic_library import bulging

from scleraforce.known import OPEN, UNKNOWN, KnownGlobe
from scleraforce.library.placement import Places
from scleraforce.library.prediction import Walls, law_slope, off_the_law, predict_wall
from scleraforce.library.unknowns import DEPTH, GAP, IOP, MODULUS, NAMES, POLE, PRESSURE, ROTATION, SIZE, THICKNESS, TIP
from scleraforce.study.eye import RIGIDITY_LAWS


def drawn(rng: np.random.Generator) -> np.ndarray:
    unknown = np.zeros(len(NAMES))
    unknown[[TIP, DEPTH, ROTATION, SIZE]] = rng.uniform(0.0, 4e-3), 0.5e-3, rng.uniform(-0.1, 0.1), rng.normal(0, 0.02)
    unknown[[GAP, THICKNESS]] = rng.uniform(0.0, 0.9e-3), rng.uniform(0.45e-3, 0.85e-3)
    unknown[[MODULUS, IOP, PRESSURE]] = log(0.3e6), log(rng.uniform(133.0, 533.0)), log(rng.uniform(150.0, 600.0))
    unknown[POLE] = rng.uniform(-0.5, 0.5, 2)
    return unknown


@pytest.mark.parametrize("globe", [OPEN, UNKNOWN], ids=["open", "unknown"])
@pytest.mark.parametrize("smoothing_m", [0.0, 90e-6])
def test_a_predicted_wall_is_the_same(globe: KnownGlobe, smoothing_m: float) -> None:
    rng = np.random.default_rng(3)
    places = replace(BOTH, smoothing_m=smoothing_m)
    walls = Walls(bulging(LIBRARY), globe)
    for _ in range(40):
        unknown = drawn(rng)
        looked_at = walls, unknown, places
        arrays, loops = fit_arrays.predict_wall(*looked_at), predict_wall(*looked_at)
        np.testing.assert_array_equal(loops.seen, arrays.seen)
        np.testing.assert_allclose(loops.depth_m, arrays.depth_m, rtol=0, atol=2e-9)
        np.testing.assert_allclose(loops.slope, arrays.slope, rtol=0, atol=1e-4)
        scale = np.abs(arrays.jacobian).max(axis=0) + 1e-12
        # Differences over 5 um of curves in single precision.
        np.testing.assert_allclose(loops.jacobian / scale, arrays.jacobian / scale, rtol=0, atol=5e-3)


def test_a_wall_that_folds_and_places_beside_it_are_the_same() -> None:
    unknown = drawn(np.random.default_rng(1))
    unknown[[TIP, ROTATION]] = 7e-3, 0.6
    far = Places(np.concatenate([LATERAL_M * 1.8] * 2), BOTH.boundary)
    looked_at = Walls(LIBRARY), unknown, far
    arrays, loops = fit_arrays.predict_wall(*looked_at), predict_wall(*looked_at)
    assert 0 < np.count_nonzero(arrays.seen) < len(arrays.seen)
    np.testing.assert_array_equal(loops.seen, arrays.seen)
    np.testing.assert_allclose(loops.depth_m[loops.seen], arrays.depth_m[arrays.seen], rtol=0, atol=5e-9)


def test_derivatives_at_an_end_of_the_library_agree() -> None:
    inner = drawn(np.random.default_rng(7))
    inner[SIZE], highest = 0.0, LIBRARY.iop_ratio_ends(np.array([inner[THICKNESS]]))[1][0]
    ends = {TIP: LIBRARY.tip_m[-1], THICKNESS: LIBRARY.thickness_m[-1], IOP: inner[MODULUS] + np.log(highest)}
    for which, end in ends.items():
        unknown = inner.copy()
        unknown[which] = end
        looked_at = Walls(LIBRARY), unknown, BOTH
        arrays, loops = fit_arrays.predict_wall(*looked_at), predict_wall(*looked_at)
        assert np.abs(loops.jacobian[:, which]).max() > 0.0
        scale = np.abs(arrays.jacobian).max(axis=0) + 1e-12
        np.testing.assert_allclose(loops.jacobian / scale, arrays.jacobian / scale, rtol=0, atol=5e-3)


@pytest.mark.parametrize("law", RIGIDITY_LAWS)
def test_the_distance_from_the_law_and_its_slope_agree(law: str) -> None:
    rng = np.random.default_rng(9)
    unknown_su = np.stack([drawn(rng) for _ in range(30)])
    walls, unknown = Walls(bulging(LIBRARY), replace(UNKNOWN, law=law)), unknown_su[0]
    off, sd = fit_arrays.off_the_law(walls, unknown_su)
    assert np.abs(off / sd).max() > 0.1
    np.testing.assert_allclose(off_the_law(walls, unknown_su), off / sd, rtol=1e-6, atol=1e-9)
    slope = law_slope(walls, unknown)
    for place in (TIP, THICKNESS, MODULUS, IOP, SIZE, PRESSURE):
        step = 1e-6 if place in (TIP, THICKNESS) else 1e-3
        ends = np.stack([unknown, unknown])
        ends[:, place] += -step, step
        below, above = fit_arrays.off_the_law(walls, ends)[0] / sd[0]
        assert slope[place] == pytest.approx((above - below) / (2.0 * step), rel=1e-3)


def states(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(12)
    thickness_m = rng.uniform(LIBRARY.thickness_m[0], LIBRARY.thickness_m[-1], count)
    low, high = LIBRARY.iop_ratio_ends(thickness_m)
    return thickness_m, rng.uniform(low, high), rng.uniform(0.0, LIBRARY.tip_m[-1], count)


def test_curves_forces_and_volumes_are_products_of_splines() -> None:
    state, tables = states(40), LIBRARY.tables
    curves = library_arrays.values_at(LIBRARY, tables.curves, *state).reshape(40, 2, -1, 2)
    np.testing.assert_allclose(LIBRARY.shapes(*state), curves, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        LIBRARY.forces(*state), library_arrays.values_at(LIBRARY, tables.forces, *state), rtol=1e-12
    )
    np.testing.assert_allclose(
        LIBRARY.displaced_m3(*state), library_arrays.values_at(LIBRARY, tables.volumes, *state), rtol=1e-12
    )
