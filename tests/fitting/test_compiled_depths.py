"""Compiled loops against the arrays that they stand for: the same walls, seen at the same places, and their forces."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from math import log

import numpy as np
import pytest
from analytic_library import bulging
from analytic_walls import BOTH, LATERAL_M, LIBRARY, RANGES
from machine_code import by_arrays_and_loops, compiled_again

from scleraforce.errors import InputError
from scleraforce.fitting import compiled_depths, compiled_prediction
from scleraforce.fitting.fit_prediction import Walls, predict_wall
from scleraforce.fitting.globe_term import law_slope, off_the_law
from scleraforce.fitting.library_fit import fit_boundaries
from scleraforce.fitting.placement import Places
from scleraforce.fitting.prior import prior_of
from scleraforce.fitting.unknowns import DEPTH, GAP, IOP, MODULUS, NAMES, POLE, PRESSURE, ROTATION, SIZE, THICKNESS, TIP
from scleraforce.known.eye import OPEN, SEALED, UNKNOWN, Known, KnownGlobe, Modulus
from scleraforce.library import compiled_pressures, compiled_states
from scleraforce.study.eye import RIGIDITY_LAWS


@pytest.fixture(scope="module", autouse=True)
def machine_code() -> Iterator[None]:
    with compiled_again(compiled_states, compiled_pressures, compiled_depths, compiled_prediction):
        yield


def drawn(rng: np.random.Generator) -> np.ndarray:
    unknown = np.zeros(len(NAMES))
    unknown[[TIP, DEPTH, ROTATION, SIZE]] = rng.uniform(0.0, 4e-3), 0.5e-3, rng.uniform(-0.1, 0.1), rng.normal(0, 0.02)
    unknown[[GAP, THICKNESS]] = rng.uniform(0.0, 0.9e-3), rng.uniform(0.45e-3, 0.85e-3)
    unknown[[MODULUS, IOP, PRESSURE]] = log(0.3e6), log(rng.uniform(133.0, 533.0)), log(rng.uniform(150.0, 600.0))
    unknown[POLE] = rng.uniform(-0.5, 0.5, 2)
    return unknown


def refusal(values: Callable[..., np.ndarray], state: list[np.ndarray]) -> str:
    with pytest.raises(InputError) as refused:
        values(*state)
    return str(refused.value)


@pytest.mark.parametrize("globe", [OPEN, UNKNOWN], ids=["open", "unknown"])
@pytest.mark.parametrize("smoothing_m", [0.0, 90e-6])
def test_a_predicted_wall_is_the_same(globe: KnownGlobe, smoothing_m: float) -> None:
    rng = np.random.default_rng(3)
    places = replace(BOTH, smoothing_m=smoothing_m)
    walls = Walls(bulging(LIBRARY), globe)
    for _ in range(40):
        unknown = drawn(rng)
        arrays, loops = by_arrays_and_loops(lambda unknown=unknown: predict_wall(walls, unknown, places))
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
    arrays, loops = by_arrays_and_loops(lambda: predict_wall(Walls(LIBRARY), unknown, far))
    assert 0 < np.count_nonzero(arrays.seen) < len(arrays.seen)
    np.testing.assert_array_equal(loops.seen, arrays.seen)
    np.testing.assert_allclose(loops.depth_m[loops.seen], arrays.depth_m[arrays.seen], rtol=0, atol=5e-9)


def test_a_wall_that_only_runs_back_is_the_same() -> None:
    unknown = drawn(np.random.default_rng(1))
    unknown[[TIP, ROTATION]] = 1e-3, np.pi
    arrays, loops = by_arrays_and_loops(lambda: predict_wall(Walls(LIBRARY), unknown, replace(BOTH, smoothing_m=90e-6)))
    assert not arrays.seen.any()
    assert not loops.seen.any()
    np.testing.assert_allclose(loops.depth_m, arrays.depth_m, rtol=0, atol=2e-9)
    np.testing.assert_allclose(loops.slope, arrays.slope, rtol=0, atol=1e-9)


@pytest.mark.parametrize("place", ["deepest", "thickest", "at the highest pressure"])
def test_a_wall_at_an_end_of_the_library_turns_as_it_does_inwards(place: str) -> None:
    unknown = drawn(np.random.default_rng(7))
    unknown[SIZE], highest = 0.0, LIBRARY.iop_ratio_ends(np.array([unknown[THICKNESS]]))[1][0]
    ends = {TIP: LIBRARY.tip_m[-1], THICKNESS: LIBRARY.thickness_m[-1], IOP: unknown[MODULUS] + np.log(highest)}
    which = dict(zip(("deepest", "thickest", "at the highest pressure"), ends, strict=True))[place]
    unknown[which] = ends[which]
    arrays, loops = by_arrays_and_loops(lambda: predict_wall(Walls(LIBRARY), unknown, BOTH))
    assert np.abs(loops.jacobian[:, which]).max() > 0.0
    scale = np.abs(arrays.jacobian).max(axis=0) + 1e-12
    np.testing.assert_allclose(loops.jacobian / scale, arrays.jacobian / scale, rtol=0, atol=5e-3)


@pytest.mark.parametrize("law", RIGIDITY_LAWS)
def test_a_pressure_is_as_far_off_the_law_of_its_globe(law: str) -> None:
    rng = np.random.default_rng(9)
    unknown_su = np.stack([drawn(rng) for _ in range(30)])
    walls = Walls(bulging(LIBRARY), replace(UNKNOWN, law=law))
    for term in (lambda: off_the_law(walls, unknown_su), lambda: law_slope(walls, unknown_su[0])):
        arrays, loops = by_arrays_and_loops(term)
        assert np.abs(arrays).max() > 0.1
        np.testing.assert_allclose(loops, arrays, rtol=1e-6, atol=1e-9)


def test_curves_are_the_same_and_refused_alike() -> None:
    rng = np.random.default_rng(12)
    thickness_m = rng.uniform(LIBRARY.thickness_m[0], LIBRARY.thickness_m[-1], 40)
    low, high = LIBRARY.iop_ratio_ends(thickness_m)
    state = thickness_m, rng.uniform(low, high), rng.uniform(0.0, LIBRARY.tip_m[-1], 40)
    arrays, loops = by_arrays_and_loops(lambda: LIBRARY.shapes(*state))
    np.testing.assert_allclose(loops, arrays, rtol=0, atol=5e-9)  # sums in single precision, of up to 12 mm
    for place, outside in enumerate((2e-3, 1.0, 9e-3)):
        wrong = list(state)
        wrong[place] = np.full(40, outside)
        messages = by_arrays_and_loops(lambda wrong=wrong: refusal(LIBRARY.shapes, wrong))
        assert messages[0] == messages[1]


def test_forces_and_volumes_are_the_same_and_refused_alike() -> None:
    rng = np.random.default_rng(2)
    thickness_m = rng.uniform(LIBRARY.thickness_m[0], LIBRARY.thickness_m[-1], 50)
    low, high = LIBRARY.iop_ratio_ends(thickness_m)
    state = thickness_m, rng.uniform(low, high), rng.uniform(0.0, LIBRARY.tip_m[-1], 50)
    for values in (LIBRARY.forces, LIBRARY.displaced_m3):
        arrays, loops = by_arrays_and_loops(lambda values=values: values(*state))
        np.testing.assert_allclose(loops, arrays, rtol=1e-12)
        for place, outside in enumerate((2e-3, 1.0, 9e-3)):
            wrong = list(state)
            wrong[place] = np.full(50, outside)
            messages = by_arrays_and_loops(lambda values=values, wrong=wrong: refusal(values, wrong))
            assert messages[0] == messages[1]


@pytest.mark.parametrize("globe", [OPEN, replace(SEALED, sd=0.08 * SEALED.mean)], ids=["open", "sealed"])
def test_a_fit_is_the_same(globe: KnownGlobe) -> None:
    unknown = drawn(np.random.default_rng(4))
    unknown[[TIP, PRESSURE, ROTATION]] = 1.1e-3, unknown[IOP] + 0.4 * globe.can_be_sealed, 0.01
    depth_bc = predict_wall(Walls(LIBRARY, globe), unknown, BOTH).depth_m.reshape(2, -1)
    modulus = Modulus(mean_pa=0.3e6, sd_pa=6e3, source="own")
    known = Known(modulus=modulus, iop_pa=float(np.exp(unknown[IOP])), thickness_m=unknown[THICKNESS], globe=globe)
    prior = prior_of(replace(known, gap_m=unknown[GAP]), RANGES)
    arrays, loops = by_arrays_and_loops(lambda: fit_boundaries(LIBRARY, LATERAL_M, depth_bc, prior))
    assert loops.force_n == pytest.approx(arrays.force_n, rel=1e-3)
    assert loops.interval_n == pytest.approx(arrays.interval_n, rel=2e-3)
