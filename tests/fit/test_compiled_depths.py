"""The loops of the fit and of the library against oracles by arrays."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from math import log
from typing import Any

import fit_arrays
import library_arrays
import numpy as np
import plain_fit
import pytest
from analytic_frames import (
    BOTH,
    LATERAL_M,
    LIBRARY,
    RANGES,
    known_eye,
    middling_eye,
    noisy_boundaries,
)
from analytic_library import bulging

from predicted_walls import Walls, predict_wall
from scleraforce.fit.curve_placement import PlacesOnFrame
from scleraforce.fit.one_frame import fit_boundaries
from scleraforce.fit.prior_of_an_eye import prior_of
from scleraforce.fit.unknowns import MODULUS, NAMES, THICKNESS
from scleraforce.records.eye import ForceDiscrepancy
from scleraforce.records.globe import OPEN, SEALED, UNKNOWN, Globe
from scleraforce.records.study_of_eye import RIGIDITY_LAWS


def drawn(rng: np.random.Generator, **changed: float) -> np.ndarray:
    values = {
        "tip_m": rng.uniform(0.0, 4e-3),
        "lateral_m": 0.0,
        "rotation_rad": rng.uniform(-0.1, 0.1),
        "log_size": rng.normal(0, 0.02),
        "gap_m": rng.uniform(0.0, 0.9e-3),
        "thickness_m": rng.uniform(0.45e-3, 0.85e-3),
        "log_iop": log(rng.uniform(133.0, 533.0)),
        "log_pressure": log(rng.uniform(150.0, 600.0)),
        "pole_along": rng.uniform(-0.5, 0.5),
        "pole_across": rng.uniform(-0.5, 0.5),
    }
    return middling_eye(**values | changed)


@pytest.mark.parametrize("globe", [OPEN, UNKNOWN], ids=["open", "unknown"])
@pytest.mark.parametrize("smoothing_m", [0.0, 90e-6])
def test_a_predicted_wall_is_the_same(globe: Globe, smoothing_m: float):
    rng = np.random.default_rng(3)
    places = replace(BOTH, smoothing_m=smoothing_m)
    walls = Walls(bulging(LIBRARY), globe)

    for _ in range(40):
        unknown = drawn(rng)
        looked_at = walls, unknown, places
        arrays = fit_arrays.predict_wall(*looked_at)
        loops = predict_wall(*looked_at)
        np.testing.assert_array_equal(loops.seen, arrays.seen)
        np.testing.assert_allclose(loops.depth_m, arrays.depth_m, rtol=0, atol=2e-9)
        np.testing.assert_allclose(loops.slope, arrays.slope, rtol=0, atol=1e-4)


def test_a_wall_that_folds_and_places_beside_it_are_the_same():
    unknown = drawn(np.random.default_rng(1), tip_m=7e-3, rotation_rad=0.6)
    far = PlacesOnFrame(np.concatenate([LATERAL_M * 1.8] * 2), BOTH.boundary)
    looked_at = Walls(LIBRARY), unknown, far
    arrays = fit_arrays.predict_wall(*looked_at)
    loops = predict_wall(*looked_at)
    assert 0 < np.count_nonzero(arrays.seen) < len(arrays.seen)
    np.testing.assert_array_equal(loops.seen, arrays.seen)
    np.testing.assert_allclose(
        loops.depth_m[loops.seen], arrays.depth_m[arrays.seen], rtol=0, atol=5e-9
    )


@pytest.mark.parametrize(
    ("name", "step"), [("tip_m", 2e-6), ("thickness_m", 1e-6), ("log_iop", 1e-3)]
)
def test_derivatives_at_an_end_of_the_library_are_differences_inwards(
    name: str, step: float
):
    inner = drawn(np.random.default_rng(7), log_size=0.0)
    highest = LIBRARY.iop_ratio_ends(np.array([inner[THICKNESS]]))[1][0]
    ends = {
        "tip_m": LIBRARY.tip_m[-1],
        "thickness_m": LIBRARY.thickness_m[-1],
        "log_iop": inner[MODULUS] + np.log(highest),
    }
    number = NAMES.index(name)
    found = []
    for back in (0.0, step):
        inner[number] = ends[name] - back
        found.append(predict_wall(Walls(LIBRARY), inner, BOTH))

    difference = (found[0].depth_m - found[1].depth_m) / step
    off = np.abs(found[0].jacobian[:, number] - difference)
    assert np.quantile(off, 0.9) < 0.03 * np.abs(difference).max()


LOGARITHMIC = replace(SEALED, law=RIGIDITY_LAWS[1])
DISCREPANCY = ForceDiscrepancy(
    level=0.05,
    growth=0.1,
    level_sd=0.02,
    growth_sd=0.1,
    correlation=0.5,
    level_by=(0.1, 0.05),
    growth_by=(0.0, 0.1),
)


@pytest.mark.parametrize(
    "globe", [OPEN, UNKNOWN, LOGARITHMIC], ids=["open", "unknown", "logarithmic"]
)
def test_the_fit_of_a_frame_is_a_minimum_as_good_as_the_truth_with_its_posterior(
    globe: Globe,
):
    rng = np.random.default_rng(5)
    library = bulging(LIBRARY)

    for tip_m in (0.2e-3, 1.2e-3, 3.5e-3):
        truth = middling_eye(
            tip_m,
            log_pressure=log(270.0 + 60e3 * tip_m),
            pole_along=-0.3,
            pole_across=0.2,
        )
        depth = noisy_boundaries(
            predict_wall(Walls(library, globe), truth, BOTH), 5e-6, rng
        )
        depth[1, rng.random(len(LATERAL_M)) < 0.4] = np.nan
        known = known_eye(truth, globe)
        known = replace(known, eye=replace(known.eye, discrepancy=DISCREPANCY))
        # along a bent valley the search of a sealed globe ends early
        left = 0.01 if globe is OPEN else 0.5
        check_fit(
            truth, left, library, LATERAL_M, depth, prior_of(known, RANGES), 90e-6
        )


def test_fits_in_several_threads_are_the_same_to_the_last_bit():
    frames = [
        middling_eye(1e-3 * tip, pole_along=-0.1 * tip) for tip in (0.3, 0.8, 1.4, 2.0)
    ]
    depths = [
        predict_wall(Walls(LIBRARY, UNKNOWN), frame, BOTH).depth_m.reshape(2, -1)
        for frame in frames
    ]

    def fitted(number: int) -> list[np.ndarray]:
        fit = fit_boundaries(
            LIBRARY,
            LATERAL_M,
            depths[number],
            prior_of(known_eye(frames[number], UNKNOWN), RANGES),
        )
        assert fit is not None

        return [fit.unknown, fit.sd, fit.draws_n, fit.wall_bmc]

    alone = [fitted(number) for number in range(4)]
    with ThreadPoolExecutor(4) as threads:
        for number, together in enumerate(threads.map(fitted, [0, 1, 2, 3] * 5)):
            for one, other in zip(alone[number % 4], together, strict=True):
                np.testing.assert_array_equal(one, other)


def check_fit(truth: np.ndarray, left: float, *frame: Any) -> None:
    """Check a fit: no wall near it, and not the true one, has a cost that is lower by
    more than `left`.
    """
    problem = plain_fit.problem_of(*frame)
    loops = fit_boundaries(*frame)
    assert loops is not None
    assert loops.loss <= problem.evaluate(truth)[1]
    near = (
        loops.unknown
        + 0.03
        * np.random.default_rng(0).standard_normal((40, len(truth)))
        @ loops.spread
    )
    assert min(problem.evaluate(one)[1] for one in near) > loops.loss - left
    arrays = plain_fit.fit_at(problem, loops.unknown)

    for name, value in {**vars(arrays), "sd": arrays.sd}.items():
        # single rows of it are small differences
        rtol = 1e-3 if name == "spread" else 2e-5
        np.testing.assert_allclose(
            getattr(loops, name), value, rtol=rtol, atol=1e-8, err_msg=name
        )


def states(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(12)
    thickness_m = rng.uniform(LIBRARY.thickness_m[0], LIBRARY.thickness_m[-1], count)
    low, high = LIBRARY.iop_ratio_ends(thickness_m)
    return (
        thickness_m,
        rng.uniform(low, high),
        rng.uniform(0.0, LIBRARY.tip_m[-1], count),
    )


def test_curves_forces_and_volumes_are_products_of_splines():
    state = states(40)
    tables = LIBRARY.tables
    curves = library_arrays.values_at(LIBRARY, tables.curves, *state).reshape(
        40, 2, -1, 2
    )
    np.testing.assert_allclose(LIBRARY.shapes(*state), curves, rtol=0, atol=1e-9)
    forces = library_arrays.values_at(LIBRARY, tables.forces, *state)
    np.testing.assert_allclose(LIBRARY.forces(*state), forces, rtol=1e-12)
    volumes = library_arrays.values_at(LIBRARY, tables.volumes, *state)
    np.testing.assert_allclose(LIBRARY.displaced_m3(*state), volumes, rtol=1e-12)
