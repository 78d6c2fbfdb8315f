"""The fit of the library to boundaries: its derivatives, and walls of known force under noise and damage."""

from dataclasses import replace
from math import exp, log

import numpy as np
import pytest
from analytic_frames import BOTH, LATERAL_M, LIBRARY, RANGES, noisy_boundaries
from analytic_library import RADIUS_M

from scleraforce.known import OPEN, UNKNOWN, ForceDiscrepancy, Known, KnownGlobe, Modulus
from scleraforce.library import Library
from scleraforce.library.fit import POLE_STRIDE, _step, fit_boundaries
from scleraforce.library.prediction import Walls, force_n, predict_wall
from scleraforce.library.prior import SHINE_MEAN_M, SHINE_SD_M, form_size, prior_of
from scleraforce.library.unknowns import (
    DEPTH,
    FORM,
    FORMS,
    GAP,
    INNER_OFFSET,
    IOP,
    LATERAL,
    MODULUS,
    NAMES,
    POLE,
    ROTATION,
    SHINE,
    SIZE,
    THICKNESS,
    TIP,
)

WALLS = Walls(LIBRARY)
BOTTOM_M = 3.9e-3


def eye(tip_m: float, **changed: float) -> np.ndarray:
    """The unknowns of a middling eye."""
    unknown = np.zeros(len(NAMES))
    unknown[[TIP, LATERAL, DEPTH, ROTATION]] = tip_m, 0.4e-3, 0.5e-3, 0.01
    unknown[[GAP, THICKNESS, MODULUS, IOP, SHINE]] = 0.6e-3, 0.65e-3, log(0.3e6), log(270.0), SHINE_MEAN_M
    for name, value in changed.items():
        unknown[NAMES.index(name)] = value
    return unknown


def drawn_eye(rng: np.random.Generator) -> np.ndarray:
    unknown = eye(rng.uniform(0.05e-3, 3e-3), lateral_m=rng.uniform(-1e-3, 1e-3), depth_m=rng.uniform(0.3e-3, 0.6e-3))
    unknown[[GAP, THICKNESS, MODULUS, IOP]] = (
        rng.uniform(0.4e-3, 0.9e-3), rng.uniform(0.45e-3, 0.85e-3), log(rng.uniform(0.2e6, 0.5e6)),
        log(rng.uniform(133.0, 533.0)),
    )  # fmt: skip
    return unknown


def boundaries(unknown: np.ndarray, noise_m: float = 0.0, rng: np.random.Generator | None = None) -> np.ndarray:
    """What a frame would show (2, column), with errors that are correlated over 0.35 mm; NaN below the window."""
    predicted = predict_wall(WALLS, unknown, BOTH)
    depth = noisy_boundaries(predicted, noise_m, rng)
    return np.where(depth < BOTTOM_M, depth, np.nan)


def known_of(unknown: np.ndarray, relative_sd: float = 0.02) -> Known:
    modulus = exp(unknown[MODULUS])
    return Known(
        modulus=Modulus(mean_pa=modulus, sd_pa=relative_sd * modulus, source="own"),
        iop_pa=exp(unknown[IOP]),
        thickness_m=unknown[THICKNESS],
        gap_m=unknown[GAP],
        globe=OPEN,
    )


def fitted(unknown: np.ndarray, depth: np.ndarray, known: Known | None = None):
    fit = fit_boundaries(LIBRARY, LATERAL_M, depth, prior_of(known or known_of(unknown), RANGES))
    assert fit is not None
    return fit


def bulging(library: Library) -> Library:
    """The library of walls that rise more in their middle: by 0.05 mm at the pressure of `eye`."""
    undented = library.undented_tpbnc.copy()
    angle = np.arctan2(undented[0, 0, 0, :, 0], RADIUS_M - undented[0, 0, 0, :, 1])
    undented[..., 1] -= 3e-3 * library.tension[:, None, None] * np.cos(angle) ** 2
    return replace(library, undented_tpbnc=undented)


@pytest.mark.parametrize("globe", [OPEN, UNKNOWN], ids=["open", "unknown"])
@pytest.mark.parametrize("tip_m", [0.3e-3, 2.2e-3])
def test_derivatives_equal_differences(tip_m: float, globe: KnownGlobe) -> None:
    form = dict(zip(FORMS, (2e-3, -0.02, 5.0, 3e-3, -0.1, 20.0, 5e-3), strict=True))
    seen = {"log_size": 0.01, "inner_m": 5e-6, "log_pressure": log(420.0), "shine_m": 0.0}
    unknown = eye(tip_m, pole_along=-0.3, pole_across=0.4, **seen, **form)  # how the shine turns is left out
    walls = Walls(bulging(LIBRARY), globe)
    predicted = predict_wall(walls, unknown, BOTH)
    of_wall = (2e-6, 2e-6, 1e-6, 2e-4, 2e-6, 1e-6, 1e-3, 1e-3, 2e-4, 1e-6, 1e-2)
    steps = dict(zip(NAMES, (*of_wall, 1e-6, 1e-6, 1e-4, 0.1, 1e-6, 1e-4, 0.1, 1e-4, 1e-3, 1e-3), strict=True))
    for number, (name, step) in enumerate(steps.items()):
        ends = []
        for sign in (-1, 1):
            moved = unknown.copy()
            moved[number] += sign * step
            ends.append(predict_wall(walls, moved, BOTH).depth_m)
        difference = (ends[1] - ends[0]) / (2 * step)
        off = np.abs(predicted.jacobian[:, number] - difference)
        scale = np.abs(difference).max()
        left_out = 0.015 if name == "gap_m" else 0.0  # how the motion of the base turns with the gap
        assert np.quantile(off, 0.9) < 0.03 * scale + left_out + 1e-9, name


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_cornea_in_view_does_not_change_the_force(side: float) -> None:
    truth = eye(1.2e-3)
    depths = boundaries(truth)
    beyond_m = np.maximum(side * (LATERAL_M - truth[LATERAL]) - 3.2e-3, 0.0)
    depths += -np.tan(0.33) * beyond_m + 0.5 * (1 / 7.8e-3 - 1 / 12e-3) * beyond_m**2
    fit = fitted(truth, depths)
    assert fit.force_n == pytest.approx(float(force_n(WALLS, truth[None])[0]), rel=0.03)
    assert fit.outliers < 0.05
    assert form_size(fit.unknown) > 20.0
    limbus = dict(zip(FORMS, fit.unknown[FORM], strict=True))
    name = "left" if side < 0 else "right"
    assert limbus[f"{name}_limbus_m"] == pytest.approx(3.2e-3, abs=0.3e-3)
    assert limbus[f"{name}_angle_rad"] == pytest.approx(-0.33, abs=0.06)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("tip_m", [0.05e-3, 0.4e-3])
def test_the_furrow_at_a_limbus_is_not_taken_for_the_dent(side: float, tip_m: float) -> None:
    truth = eye(tip_m, lateral_m=0.1e-3)
    depths = boundaries(truth, noise_m=4e-6, rng=np.random.default_rng(7))
    beyond_m = np.maximum(side * (LATERAL_M - truth[LATERAL]) - 2.4e-3, 0.0)
    depths += -np.tan(0.25) * beyond_m + 0.5 * (1 / 7.8e-3 - 1 / 12e-3) * beyond_m**2
    fit = fitted(truth, depths)
    assert fit.contact_m == pytest.approx(truth[LATERAL], abs=0.6e-3)
    assert fit.force_n == pytest.approx(float(force_n(WALLS, truth[None])[0]), abs=1.5e-3)


def test_a_boundary_without_errors_gives_its_force_and_contact() -> None:
    for tip_m in (0.1e-3, 0.8e-3, 2.5e-3):
        truth = eye(tip_m)
        fit = fitted(truth, boundaries(truth))
        assert fit.force_n == pytest.approx(float(force_n(WALLS, truth[None])[0]), rel=0.01, abs=5e-5)
        assert fit.contact_m == pytest.approx(truth[LATERAL], abs=20e-6)
        assert fit.misfit_m < 2e-6
        assert fit.outliers < 0.02


def test_only_the_surface_shines() -> None:
    even, shining = (predict_wall(WALLS, eye(0.8e-3, shine_m=shine_m), BOTH) for shine_m in (0.0, 6e-6))
    moved = shining.depth_m - even.depth_m
    np.testing.assert_allclose(moved[BOTH.outer :], 0.0, atol=1e-12)
    np.testing.assert_allclose(
        moved[: BOTH.outer], -6e-6 * np.exp(-((even.slope[: BOTH.outer] / 0.115) ** 2)), atol=1e-9
    )


@pytest.mark.parametrize("tip_m", [0.1e-3, 0.8e-3])
def test_a_surface_that_shines_is_not_taken_for_a_shallower_dent(tip_m: float) -> None:
    """Written down once more: the edge lies higher where the surface faces the light. Without, forces were 1 mN off."""
    truth = eye(tip_m, shine_m=0.0)
    force = float(force_n(WALLS, truth[None])[0])
    even, off = boundaries(truth), []
    slope, found = np.gradient(even[0], LATERAL_M), []
    for shine_m in (0.0, SHINE_MEAN_M, SHINE_MEAN_M + 2 * SHINE_SD_M):
        seen = even - np.array([[shine_m], [0.0]]) * np.exp(-((slope / 0.115) ** 2))
        fit = fitted(truth, seen)
        assert fit.interval_n[0] < force < fit.interval_n[1]
        off.append(fit.force_n - force)
        found.append(fit.unknown[SHINE])
    assert found[0] < 0.95 * SHINE_MEAN_M < 1.05 * SHINE_MEAN_M < found[2]  # a dent hides the most of it
    assert abs(off[1]) < 0.02e-3 + 0.01 * force
    assert off[0] > off[1] > off[2]
    assert off[0] - off[2] < 0.6e-3


@pytest.mark.slow
def test_intervals_cover_the_force_where_the_noise_is_as_stated() -> None:
    rng = np.random.default_rng(3)
    inside, off = [], []
    for _ in range(60):
        truth = drawn_eye(rng)
        known = known_of(truth)
        spread = known.modulus.sd_pa
        known = replace(known, modulus=replace(known.modulus, mean_pa=known.modulus.mean_pa + spread * rng.normal()))
        force = float(force_n(WALLS, truth[None])[0])
        fit = fitted(truth, boundaries(truth, 12e-6, rng), known)
        inside.append(fit.interval_n[0] <= force <= fit.interval_n[1])
        off.append(abs(fit.force_n - force) / force**0.5)
    assert np.mean(inside) >= 0.88
    assert np.median(off) < 3e-3


def test_what_is_not_known_of_the_eye_widens_the_interval() -> None:
    rng = np.random.default_rng(5)
    truth = eye(1.2e-3)
    depth = boundaries(truth, 8e-6, rng)
    all_known = known_of(truth)
    width = {}
    for missing in ("nothing", "modulus", "iop_pa", "thickness_m", "gap_m"):
        known = all_known if missing == "nothing" else replace(all_known, **{missing: None})
        low, high = fitted(truth, depth, known).interval_n
        assert low < float(force_n(WALLS, truth[None])[0]) < high, missing
        width[missing] = high - low
    assert min(width.values()) > 0.995 * width["nothing"]
    assert width["modulus"] > 3 * width["nothing"]


def test_an_eyes_discrepancy_moves_its_force_and_what_is_not_known_of_it_widens_the_interval() -> None:
    truth = eye(1.5e-3)
    depth = boundaries(truth, 4e-6, np.random.default_rng(12))
    exact = ForceDiscrepancy(level=0.1, growth=0.0, level_sd=0.0, growth_sd=0.0, correlation=0.0)
    found = {}
    for name, discrepancy in (("none", None), ("exact", exact), ("unsure", replace(exact, level_sd=0.1))):
        fit = fitted(truth, depth, replace(known_of(truth, 0.001), discrepancy=discrepancy))
        found[name] = fit.force_n, float(np.diff(np.log(fit.interval_n))[0])
    assert found["exact"][0] == pytest.approx(exp(0.1) * found["none"][0], rel=1e-3)
    assert found["unsure"][0] == pytest.approx(found["exact"][0], rel=0.01)
    assert found["unsure"][1] == pytest.approx(np.hypot(found["exact"][1], 2 * 1.645 * 0.1), rel=0.06)


def test_a_discrepancy_that_goes_with_the_modulus_takes_its_uncertainty_back() -> None:
    """Frames that told forces, not E: an E that is too high goes with forces that lie below the library's."""
    truth = eye(1.5e-3)
    depth = boundaries(truth, 4e-6, np.random.default_rng(12))
    none = ForceDiscrepancy(level=0.0, growth=0.0, level_sd=0.0, growth_sd=0.0, correlation=0.0)
    stiffer = eye(1.5e-3, log_modulus=truth[MODULUS] + 0.05)
    slope = log(fitted(truth, depth, known_of(stiffer, 0.0)).force_n / fitted(truth, depth).force_n) / 0.05
    width = {}
    for name, relative_sd, by in (("sure", 0.01, 0.0), ("unsure", 0.2, 0.0), ("together", 0.2, -0.2 * slope)):
        known = replace(known_of(truth, relative_sd), discrepancy=replace(none, level_by=(by, 0.0)))
        width[name] = float(np.diff(np.log(fitted(truth, depth, known).interval_n))[0])
    assert width["together"] < 1.1 * width["sure"] < 0.5 * width["unsure"]


def test_the_pole_strides_no_farther_than_its_effect_is_straight() -> None:
    """The rest of a step is that which is best for a pole that goes so far."""
    rng = np.random.default_rng(3)
    half = rng.standard_normal((40, len(NAMES)))
    normal, gradient = half.T @ half + np.eye(len(NAMES)), 30.0 * rng.standard_normal(len(NAMES))
    whole, step = np.linalg.solve(normal, gradient), _step(normal, gradient)
    assert np.hypot(*whole[POLE]) > POLE_STRIDE
    np.testing.assert_allclose(step[POLE], POLE_STRIDE * whole[POLE] / np.hypot(*whole[POLE]))
    np.testing.assert_allclose((normal @ step - gradient)[: POLE.start], 0.0, atol=1e-9)
    np.testing.assert_allclose(_step(normal, 1e-3 * gradient), 1e-3 * whole)


def test_a_wrong_stretch_does_not_pull_the_fit() -> None:
    rng = np.random.default_rng(6)
    truth = eye(1.5e-3)
    depth = boundaries(truth, 8e-6, rng)
    clean = fitted(truth, depth)
    depth[0, 40:70] -= 0.4e-3
    depth[1, 150:180] += 0.3e-3
    damaged = fitted(truth, depth)
    assert abs(damaged.force_n - clean.force_n) < 0.5 * (clean.interval_n[1] - clean.interval_n[0])
    assert damaged.outliers > 0.05 > clean.outliers


@pytest.mark.parametrize(
    ("boundary", "off_m", "outliers"),
    [(1, 0.13e-3, 0.0), (1, 0.5e-3, 0.12), (1, -0.13e-3, 0.12), (0, 0.13e-3, 0.12), (0, -0.13e-3, 0.12)],
    ids=["choroid", "deeper than that", "inner above", "outer below", "outer above"],
)
def test_stretches_where_the_choroid_is_taken_for_the_walls_end_say_nothing_against_an_eye(
    boundary: int, off_m: float, outliers: float
) -> None:
    truth = eye(0.1e-3)
    depth = boundaries(truth, 3e-6, np.random.default_rng(7))
    clean = fitted(truth, depth.copy())
    for stretch in (slice(20, 50), slice(200, 232)):
        depth[boundary, stretch] += off_m
    found = fitted(truth, depth)
    assert found.force_n == pytest.approx(clean.force_n, abs=3e-4)
    assert found.outliers == pytest.approx(outliers, abs=0.01)


def test_a_dent_that_leaves_the_window_is_read_from_its_flanks() -> None:
    rng = np.random.default_rng(7)
    truth = eye(4.2e-3, depth_m=0.6e-3)
    depth = boundaries(truth, 8e-6, rng)
    assert np.isnan(depth[0, 110:150]).any()
    fit = fitted(truth, depth)
    force = float(force_n(WALLS, truth[None])[0])
    assert fit.interval_n[0] < force < fit.interval_n[1]
    assert fit.tip_m == pytest.approx(4.2e-3, abs=0.3e-3)


def test_an_eye_of_another_size_is_the_same_eye_at_another_unit_of_length() -> None:
    truth = eye(1.5e-3, log_size=0.03)
    fit = fitted(truth, boundaries(truth))
    assert fit.force_n == pytest.approx(float(force_n(WALLS, truth[None])[0]), rel=0.01)
    assert fit.unknown[SIZE] == pytest.approx(0.03, abs=0.004)


def test_class_probabilities_are_the_shares_of_the_posterior() -> None:
    truth = eye(1.2e-3)
    fit = fitted(truth, boundaries(truth))
    low, high = fit.interval_n
    shares = fit.probabilities((low, high))
    np.testing.assert_allclose(shares, (0.05, 0.9, 0.05), atol=0.01)
    assert sum(shares) == pytest.approx(1.0)
    assert min(fit.probabilities((0.0, 1.0))) > 0.0


def test_too_few_columns_are_no_fit() -> None:
    depth = np.full((2, 256), np.nan)
    depth[0, :12] = 1e-3
    assert fit_boundaries(LIBRARY, LATERAL_M, depth, prior_of(Known(), RANGES)) is None


def test_without_the_inner_boundary_the_outer_one_is_enough() -> None:
    rng = np.random.default_rng(8)
    truth = eye(1.5e-3)
    depth = boundaries(truth, 6e-6, rng)
    depth[1] = np.nan
    fit = fitted(truth, depth)
    assert fit.interval_n[0] < float(force_n(WALLS, truth[None])[0]) < fit.interval_n[1]


def test_an_inner_boundary_that_is_another_layers_does_not_change_what_is_known_of_the_thickness() -> None:
    rng = np.random.default_rng(9)
    truth = eye(1.5e-3)
    depth = boundaries(truth, 6e-6, rng)
    sound = fitted(truth, depth)
    depth[1] += 0.15e-3
    fit = fitted(truth, depth)
    assert abs(fit.force_n - sound.force_n) < 0.25 * (sound.interval_n[1] - sound.interval_n[0])
    assert fit.unknown[THICKNESS] == pytest.approx(truth[THICKNESS], abs=15e-6)
    assert fit.unknown[INNER_OFFSET] == pytest.approx(0.15e-3, abs=20e-6)
