"""The fit of the library to boundaries: its derivatives, and walls of known force under
noise and damage.
"""

from dataclasses import replace
from math import exp, log

import numpy as np
import pytest
from analytic_frames import (
    BOTH,
    LATERAL_M,
    LIBRARY,
    RANGES,
    drawn_wall,
    known_eye,
    middling_eye,
    noisy_boundaries,
)
from analytic_library import bulging

from predicted_walls import Walls, force_n, predict_wall
from scleraforce.fit import unknowns
from scleraforce.fit.one_frame import BoundaryFit, fit_boundaries
from scleraforce.fit.prior_of_an_eye import (
    SHINE_MEAN_M,
    SHINE_SD_M,
    form_size,
    prior_of,
)
from scleraforce.records.eye import ForceDiscrepancy
from scleraforce.records.globe import OPEN, UNKNOWN, Globe
from scleraforce.records.needle import Needle
from scleraforce.records.setup import Setup

WALLS = Walls(LIBRARY)
BOTTOM_M = 3.9e-3


def eye(tip_m: float, **changed: float) -> np.ndarray:
    return middling_eye(tip_m, **{"rotation_rad": 0.01} | changed)


def drawn_eye(rng: np.random.Generator) -> np.ndarray:
    unknown = eye(
        rng.uniform(0.05e-3, 3e-3),
        lateral_m=rng.uniform(-1e-3, 1e-3),
        depth_m=rng.uniform(0.3e-3, 0.6e-3),
    )
    drawn_wall(unknown, rng)

    return unknown


def boundaries(
    unknown: np.ndarray, noise_m: float = 0.0, rng: np.random.Generator | None = None
) -> np.ndarray:
    """The boundaries in a frame (2, column), with errors that are correlated over 0.35
    mm; NaN below the window.
    """
    predicted = predict_wall(WALLS, unknown, BOTH)
    depth = noisy_boundaries(predicted, noise_m, rng)
    return np.where(depth < BOTTOM_M, depth, np.nan)


def true_n(unknown: np.ndarray) -> float:
    return float(force_n(WALLS, unknown[None])[0])


def fitted(unknown: np.ndarray, depth: np.ndarray, setup: Setup | None = None):
    fit = fit_boundaries(
        LIBRARY, LATERAL_M, depth, prior_of(setup or known_eye(unknown), RANGES)
    )
    assert fit is not None
    return fit


@pytest.mark.parametrize("globe", [OPEN, UNKNOWN], ids=["open", "unknown"])
@pytest.mark.parametrize("tip_m", [0.3e-3, 2.2e-3])
def test_derivatives_equal_differences(tip_m: float, globe: Globe):
    form = dict(
        zip(unknowns.FORMS, (2e-3, -0.02, 5.0, 3e-3, -0.1, 20.0, 5e-3), strict=True)
    )
    seen = {
        "log_size": 0.01,
        "inner_m": 5e-6,
        "log_pressure": log(420.0),
        "shine_m": 0.0,
    }
    # how the shine turns is left out
    unknown = eye(tip_m, pole_along=-0.3, pole_across=0.4, **seen, **form)
    walls = Walls(bulging(LIBRARY, 3e-3), globe)
    predicted = predict_wall(walls, unknown, BOTH)
    of_wall = (2e-6, 2e-6, 1e-6, 2e-4, 2e-6, 1e-6, 1e-3, 1e-3, 2e-4, 1e-6, 1e-2)
    steps = dict(
        zip(
            unknowns.NAMES,
            (*of_wall, 1e-6, 1e-6, 1e-4, 0.1, 1e-6, 1e-4, 0.1, 1e-4, 1e-3, 1e-3),
            strict=True,
        )
    )

    for number, (name, step) in enumerate(steps.items()):
        ends = []
        for sign in (-1, 1):
            moved = unknown.copy()
            moved[number] += sign * step
            ends.append(predict_wall(walls, moved, BOTH).depth_m)

        difference = (ends[1] - ends[0]) / (2 * step)
        off = np.abs(predicted.jacobian[:, number] - difference)
        scale = np.abs(difference).max()
        # how the motion of the base turns with the gap
        left_out = 0.015 if name == "gap_m" else 0.0
        assert np.quantile(off, 0.9) < 0.03 * scale + left_out + 1e-9, name


def limbus_m(
    truth: np.ndarray, side: float, place_m: float, angle_rad: float
) -> np.ndarray:
    """The change of depth (column,) by a cornea that begins at a place."""
    beyond_m = np.maximum(side * (LATERAL_M - truth[unknowns.LATERAL]) - place_m, 0.0)
    return -np.tan(angle_rad) * beyond_m + 0.5 * (1 / 7.8e-3 - 1 / 12e-3) * beyond_m**2


@pytest.mark.parametrize(("name", "side"), [("left", -1.0), ("right", 1.0)])
def test_a_cornea_in_view_does_not_change_the_force(name: str, side: float):
    truth = eye(1.2e-3)
    fit = fitted(truth, boundaries(truth) + limbus_m(truth, side, 3.2e-3, 0.33))
    assert fit.force_n == pytest.approx(true_n(truth), rel=0.03)
    assert fit.outliers < 0.05
    assert form_size(fit.unknown) > 20.0
    limbus = dict(zip(unknowns.FORMS, fit.unknown[unknowns.FORM], strict=True))
    assert limbus[f"{name}_limbus_m"] == pytest.approx(3.2e-3, abs=0.3e-3)
    assert limbus[f"{name}_angle_rad"] == pytest.approx(-0.33, abs=0.06)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("tip_m", [0.05e-3, 0.4e-3])
def test_the_furrow_at_a_limbus_is_not_taken_for_the_dent(side: float, tip_m: float):
    truth = eye(tip_m, lateral_m=0.1e-3)
    depths = boundaries(truth, noise_m=4e-6, rng=np.random.default_rng(7))
    fit = fitted(truth, depths + limbus_m(truth, side, 2.4e-3, 0.25))
    assert fit.contact_m == pytest.approx(truth[unknowns.LATERAL], abs=0.6e-3)
    assert fit.force_n == pytest.approx(true_n(truth), abs=1.5e-3)


@pytest.mark.parametrize(
    ("tip_m", "log_size"),
    [(0.1e-3, 0.0), (0.8e-3, 0.0), (2.5e-3, 0.0), (1.5e-3, 0.03)],
)
def test_a_boundary_without_errors_gives_force_contact_size_and_class_probabilities(
    tip_m: float, log_size: float
):
    truth = eye(tip_m, log_size=log_size)
    fit = fitted(truth, boundaries(truth))
    assert fit.force_n == pytest.approx(true_n(truth), rel=0.01, abs=5e-5)
    assert fit.contact_m == pytest.approx(truth[unknowns.LATERAL], abs=20e-6)
    assert fit.unknown[unknowns.SIZE] == pytest.approx(log_size, abs=0.004)
    assert fit.misfit_m < 2e-6
    assert fit.outliers < 0.02
    shares = fit.probabilities(fit.interval_n)
    np.testing.assert_allclose(shares, (0.05, 0.9, 0.05), atol=0.01)
    assert sum(shares) == pytest.approx(1.0)
    assert min(fit.probabilities((0.0, 1.0))) > 0.0


@pytest.mark.parametrize("tip_m", [0.1e-3, 0.8e-3])
def test_a_surface_that_shines_is_not_taken_for_a_shallower_dent(tip_m: float):
    """Repeated here: the edge lies higher where the surface faces the light. Without,
    forces were 1 mN off.
    """
    truth = eye(tip_m, shine_m=0.0)
    force = true_n(truth)
    even = boundaries(truth)
    off = []
    slope = np.gradient(even[0], LATERAL_M)
    found = []

    for shine_m in (0.0, SHINE_MEAN_M, SHINE_MEAN_M + 2 * SHINE_SD_M):
        seen = even - np.array([[shine_m], [0.0]]) * np.exp(-((slope / 0.115) ** 2))
        fit = fitted(truth, seen)
        assert fit.interval_n[0] < force < fit.interval_n[1]
        off.append(fit.force_n - force)
        found.append(fit.unknown[unknowns.NAMES.index("shine_m")])

    # a dent hides the most of it
    assert found[0] < 0.95 * SHINE_MEAN_M < 1.05 * SHINE_MEAN_M < found[2]
    assert abs(off[1]) < 0.02e-3 + 0.01 * force
    assert off[0] > off[1] > off[2]
    assert off[0] - off[2] < 0.6e-3


@pytest.mark.slow
def test_intervals_cover_the_force_where_the_noise_is_as_stated():
    rng = np.random.default_rng(3)
    inside = []
    off = []

    for _ in range(60):
        truth = drawn_eye(rng)
        known = known_eye(truth)
        found_pa = known.eye.modulus.mean_pa + known.eye.modulus.sd_pa * rng.normal()
        known = replace(
            known,
            eye=replace(
                known.eye, modulus=replace(known.eye.modulus, mean_pa=found_pa)
            ),
        )
        force = true_n(truth)
        fit = fitted(truth, boundaries(truth, 12e-6, rng), known)
        inside.append(fit.interval_n[0] <= force <= fit.interval_n[1])
        off.append(abs(fit.force_n - force) / force**0.5)

    assert np.mean(inside) >= 0.88
    assert np.median(off) < 3e-3


def without(setup: Setup, missing: str) -> Setup:
    """Return what is known of an experiment but for one value of eye or needle."""
    parts = {"nothing": setup, "gap_m": replace(setup, needle=Needle())}
    if missing in parts:
        return parts[missing]
    return replace(setup, eye=replace(setup.eye, **{missing: None}))


def test_unknown_values_of_the_eye_widen_the_interval():
    truth = eye(1.2e-3)
    depth = boundaries(truth, 8e-6, np.random.default_rng(5))
    all_known = known_eye(truth)
    width = {}

    for missing in ("nothing", "modulus", "iop_pa", "thickness_m", "gap_m"):
        known = without(all_known, missing)
        low, high = fitted(truth, depth, known).interval_n
        assert low < true_n(truth) < high, missing
        width[missing] = high - low

    assert min(width.values()) > 0.995 * width["nothing"]
    assert width["modulus"] > 3 * width["nothing"]


def log_width(fit: BoundaryFit) -> float:
    return float(np.diff(np.log(fit.interval_n))[0])


def test_an_eyes_discrepancy_moves_its_force_and_its_uncertainty_widens_the_interval():
    truth = eye(1.5e-3)
    depth = boundaries(truth, 4e-6, np.random.default_rng(12))
    known = known_eye(truth, relative_sd=0.001)
    exact = ForceDiscrepancy(
        level=0.1, growth=0.0, level_sd=0.0, growth_sd=0.0, correlation=0.0
    )
    none, moved, unsure = (
        fitted(truth, depth, replace(known, eye=replace(known.eye, discrepancy=each)))
        for each in (None, exact, replace(exact, level_sd=0.1))
    )
    assert moved.force_n == pytest.approx(exp(0.1) * none.force_n, rel=1e-3)
    assert unsure.force_n == pytest.approx(moved.force_n, rel=0.01)
    assert log_width(unsure) == pytest.approx(
        np.hypot(log_width(moved), 2 * 1.645 * 0.1), rel=0.06
    )


def test_stretches_where_the_choroid_is_taken_for_the_walls_end_are_not_outliers():
    truth = eye(0.1e-3)
    depth = boundaries(truth, 3e-6, np.random.default_rng(7))
    clean = fitted(truth, depth.copy())

    for boundary, off_m, outliers in (
        (1, 0.13e-3, 0.0),
        (1, 0.5e-3, 0.12),
        (1, -0.13e-3, 0.12),
        (0, 0.13e-3, 0.12),
        (0, -0.13e-3, 0.12),
    ):
        wrong = depth.copy()
        wrong[boundary, np.r_[20:50, 200:232]] += off_m
        found = fitted(truth, wrong)
        assert found.force_n == pytest.approx(clean.force_n, abs=3e-4)
        assert found.outliers == pytest.approx(outliers, abs=0.01)


def test_a_dent_that_leaves_the_window_is_read_from_its_flanks():
    truth = eye(4.2e-3, depth_m=0.6e-3)
    depth = boundaries(truth, 8e-6, np.random.default_rng(7))
    assert np.isnan(depth[0, 110:150]).any()
    fit = fitted(truth, depth)
    assert fit.interval_n[0] < true_n(truth) < fit.interval_n[1]
    assert fit.tip_m == pytest.approx(4.2e-3, abs=0.3e-3)


def test_the_outer_boundary_is_enough_and_a_few_columns_are_not():
    truth = eye(1.5e-3)
    depth = boundaries(truth, 6e-6, np.random.default_rng(8))
    depth[1] = np.nan
    fit = fitted(truth, depth)
    assert fit.interval_n[0] < true_n(truth) < fit.interval_n[1]
    depth[0, 12:] = np.nan
    assert fit_boundaries(LIBRARY, LATERAL_M, depth, prior_of(Setup(), RANGES)) is None


def test_an_inner_boundary_of_another_layer_does_not_change_the_known_thickness():
    truth = eye(1.5e-3)
    depth = boundaries(truth, 6e-6, np.random.default_rng(9))
    sound = fitted(truth, depth)
    depth[1] += 0.15e-3
    fit = fitted(truth, depth)
    assert abs(fit.force_n - sound.force_n) < 0.25 * (
        sound.interval_n[1] - sound.interval_n[0]
    )
    assert fit.unknown[unknowns.THICKNESS] == pytest.approx(
        truth[unknowns.THICKNESS], abs=15e-6
    )
    assert fit.unknown[unknowns.INNER_OFFSET] == pytest.approx(0.15e-3, abs=20e-6)
