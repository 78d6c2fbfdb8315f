"""Whole virtual eyes of a library's walls, and the intervals that they give: drawn,
calibrated, scored.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import log1p
from pathlib import Path

import numpy as np
import pytest
from analytic_library import EXACT_EYES, made_up_library, without_rests
from relaxing_eyes import sensed
from small_recordings import LOGGED_INFO

from scleraforce.fit.one_frame import fit_boundaries
from scleraforce.fit.prior_of_an_eye import prior_of
from scleraforce.lab.needle_pushes import (
    path_of_pushes,
    plan_pushes,
    sample_sensor,
)
from scleraforce.lab.training import interval_measurement
from scleraforce.lab.training.drawn_wall_errors import (
    CORNEA_RADIUS_M,
    BoundaryErrors,
    WallForms,
    added_depths,
    disturb,
    draw_forms,
)
from scleraforce.lab.training.interval_measurement import (
    FRAMES,
    VirtualEye,
    VirtualFrame,
    calibrated,
    draw_eye,
    draw_frames,
)
from scleraforce.library import INNER, OUTER
from scleraforce.mechanics.tissue_material import ELASTIC
from scleraforce.reading.answer import Reading
from scleraforce.reading.interval_widths import IntervalScore
from scleraforce.recordings.force_errors import LABEL_SD_N, FrameForces, frame_forces
from scleraforce.recordings.forces_under_frames import label_frames
from scleraforce.recordings.frame_and_force_tables import (
    FrameEntry,
)
from scleraforce.recordings.recording_folder import Recording
from scleraforce.records.setup import Setup
from scleraforce.records.study import Range, SliceStudy, Study

RADIUS_M = np.array([12e-3])
EXACT = Study(reader=replace(EXACT_EYES, pole_noise_rad=0.0))


@pytest.fixture(scope="module")
def eye(library) -> VirtualEye:
    """An even one, stated open."""
    return draw_eye(EXACT, library, 0, np.random.default_rng(6))


def test_even_walls_have_no_form_and_uneven_ones_are_as_uneven_as_said():
    rng = np.random.default_rng(0)
    thickness_m = np.full(4000, 0.6e-3)
    radius_m = np.full(4000, 12e-3)
    from_contact_m = np.tile(np.linspace(-6e-3, 6e-3, 13), (4000, 1))
    even = draw_forms(thickness_m, radius_m, np.zeros(4000, dtype=bool), rng)
    np.testing.assert_array_equal(added_depths(even, radius_m, from_contact_m), 0.0)
    uneven = draw_forms(thickness_m, radius_m, np.ones(4000, dtype=bool), rng)
    assert np.std(uneven.curvature * radius_m) == pytest.approx(0.08, rel=0.05)
    thickness = np.diff(added_depths(uneven, radius_m, from_contact_m), axis=1)[:, 0]
    assert np.std(thickness[:, 9] / 0.6e-3) == pytest.approx(
        0.12 * 3 / 12 * np.hypot(1.0, 3 / 12), rel=0.05
    )


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_beyond_the_limbus_the_surface_curves_like_the_cornea(side: float):
    nothing = np.zeros(1)
    across_m = np.linspace(-6e-3, 6e-3, 2401)
    at_limbus = {
        "limbus_m": np.array([side * 3e-3]),
        "limbus_rad": np.array([0.2]),
        "soft_m": np.array([0.2e-3]),
    }
    depths = added_depths(
        WallForms(
            curvature=nothing, skew=nothing, wedge=nothing, bow=nothing, **at_limbus
        ),
        RADIUS_M,
        across_m[None],
    )[0]
    np.testing.assert_array_equal(depths[INNER], depths[OUTER])
    outward_m = side * across_m
    slope = np.gradient(depths[OUTER], outward_m)
    curvature = np.gradient(slope, outward_m)[outward_m > 4.5e-3][5:-5]
    np.testing.assert_allclose(curvature, 1 / CORNEA_RADIUS_M - 1 / 12e-3, rtol=0.05)
    assert slope[np.argmin(np.abs(outward_m - 3.6e-3))] == pytest.approx(
        0.6e-3 * 44.9 - np.tan(0.2), abs=0.01
    )
    assert np.abs(depths[OUTER][outward_m < 1e-3]).max() < 2e-6


def test_forces_drift_away_from_the_librarys_with_the_dent(eye):
    exact = replace(EXACT, reader=replace(EXACT.reader, interval_boundary_errors=0.0))
    plain, drifted = (
        draw_frames(replace(eye, drift=drift), exact, 6, np.random.default_rng(6))
        for drift in (0.0, 0.2)
    )

    def depths_m(force_n: float) -> np.ndarray:
        across_m = np.linspace(-2e-3, 2e-3, 401)
        return np.interp(
            across_m,
            *eye.model.curves([replace(eye.wall, force_n=force_n)])[0, OUTER].T,
        )

    for one, other in zip(plain, drifted, strict=True):
        assert one.force_n == other.force_n
        # the force, over the library's of the same dent
        share = 0.2 * (one.force_n / eye.largest_n - 0.5)
        deeper_m = depths_m(one.force_n / (1.0 + share)) - depths_m(one.force_n)
        seen_m = (other.boundaries.depth_m - one.boundaries.depth_m)[OUTER]
        largest_m = deeper_m[np.argmax(np.abs(deeper_m))]
        assert seen_m[np.nanargmax(np.abs(seen_m))] == pytest.approx(
            largest_m, rel=0.05, abs=2e-6
        )


def logged_forces(forces_n: np.ndarray, rng: np.random.Generator) -> FrameForces:
    """Labels of a force log of the virtual laboratory, freed of the sensor's zero."""
    phantom = Study().phantom
    pushes = plan_pushes(tuple(forces_n.tolist()), phantom, rng)
    log = sensed(path_of_pushes(pushes, ELASTIC), sample_sensor(phantom, rng), rng)
    frames = tuple(
        FrameEntry(f"{number}.png", push.frame_s) for number, push in enumerate(pushes)
    )
    recording = Recording(Path(), LOGGED_INFO, frames, log)

    return frame_forces(recording, label_frames(recording, Study().classes))


@pytest.mark.slow
def test_labels_have_the_errors_of_a_force_log_and_their_size():
    rng = np.random.default_rng(11)
    shared = []
    own = []
    stated = []

    for labels, eyes in (
        (interval_measurement.label_forces, 1000),
        (logged_forces, 100),
    ):
        forces_n = rng.uniform(0.0, 60e-3, (eyes, FRAMES))
        found = [labels(of_eye, rng) for of_eye in forces_n]
        off_n = np.array([each.force_n for each in found]) - forces_n
        shared.append(off_n.mean(axis=1).std())
        own.append((off_n - off_n.mean(axis=1, keepdims=True)).std())
        middle = [np.array([1.0, each.since_start_s.mean()]) for each in found]
        variances = [
            row @ each.zero_covariance @ row
            for row, each in zip(middle, found, strict=True)
        ]
        stated.append(np.sqrt(np.mean(variances)))

    for made, logged in (shared, own, stated):
        assert made == pytest.approx(logged, rel=0.25)

    assert shared[0] == pytest.approx(
        np.hypot(stated[0], LABEL_SD_N / np.sqrt(FRAMES)), rel=0.15
    )


def test_an_even_eye_is_calibrated_and_three_frames_are_used_up(eye, library):
    frames = draw_frames(eye, EXACT, 8, np.random.default_rng(6))
    again = draw_frames(eye, EXACT, 8, np.random.default_rng(6))
    np.testing.assert_array_equal(frames[3].cuts, again[3].cuts)
    known, left = calibrated(eye, frames, EXACT, library, np.random.default_rng(7))
    assert (len(left), known.eye.modulus.source) == (5, "own")
    assert known.eye.modulus.mean_pa == pytest.approx(
        eye.wall.youngs_modulus_pa, rel=0.05
    )


@pytest.mark.slow
@pytest.mark.parametrize("drift", [-0.25, 0.25])
def test_forces_that_drift_from_the_librarys_are_read_as_three_frames_of_known_force_show(
    eye, library, drift: float, monkeypatch
):
    """A few percent of drift is expected; of more than that as much is learnt as the
    forces' zero leaves open.
    """
    monkeypatch.setattr(interval_measurement, "label_forces", without_rests)
    drifting = replace(eye, drift=drift)
    near = library.for_contact(eye.wall.polar_rad)
    smoothing_m = EXACT.calibration.surface_smoothing_m

    def error_n(stated: Setup, frames: Sequence[VirtualFrame]) -> float:
        prior = prior_of(stated, EXACT.reader)
        boundaries = [frame.boundaries for frame in frames]
        fits = (
            fit_boundaries(near, seen.lateral_m, seen.depth_m, prior, smoothing_m)
            for seen in boundaries
        )
        pairs = zip(fits, frames, strict=True)

        return float(
            np.mean([abs(fit.force_n - frame.force_n) for fit, frame in pairs if fit])
        )

    errors_n = []
    growths = []

    for seed in (6, 7):
        frames = draw_frames(drifting, EXACT, 12, np.random.default_rng(seed))
        known, left = calibrated(
            drifting, frames, EXACT, library, np.random.default_rng(7)
        )
        growths.append(known.eye.discrepancy.growth)
        errors_n.append(
            [
                error_n(known, left),
                error_n(replace(known, eye=replace(known.eye, discrepancy=None)), left),
            ]
        )

    # E takes a part of it: deep dents feel E less
    assert np.mean(growths) == pytest.approx(drift, abs=0.15)
    learned_n, unlearned_n = np.mean(errors_n, axis=0)
    assert learned_n < 0.6 * unlearned_n


def stiffenings_of_others(eye: VirtualEye, count: int) -> np.ndarray:
    """ln(1 + b) that is stated where an eye is read with the tissue of other eyes."""
    rng = np.random.default_rng(2)
    setups = (interval_measurement.of_population(eye, EXACT, rng) for _ in range(count))
    return np.log1p([setup.eye.stiffening or 0.0 for setup in setups])


def test_tissue_stiffens_as_often_as_stated_and_other_eyes_stiffen_otherwise(
    monkeypatch,
):
    # the base's motion takes 0.3 s an eye and decides no drawn or stated value
    monkeypatch.setattr(
        "scleraforce.lab.training.library_sections.base_moves",
        lambda *arguments: np.zeros((2, len(arguments[-1]), 3)),
    )
    library = made_up_library()
    study = replace(EXACT, reader=replace(EXACT.reader, stiffening_share=0.4))
    eyes = [
        draw_eye(study, library, 0, np.random.default_rng(seed)) for seed in range(60)
    ]
    own = np.log1p([eye.model.library.stiffening for eye in eyes])
    assert 15 <= np.count_nonzero(own) <= 34
    assert not stiffenings_of_others(eyes[own.argmin()], 20).any()
    middle = np.abs(own - 1.7).argmin()
    stated = stiffenings_of_others(eyes[middle], 2000)
    assert stated.mean() == pytest.approx(own[middle], abs=0.04)
    assert stated.std() == pytest.approx(0.5, abs=0.03)
    # no more than the library holds
    most = stiffenings_of_others(eyes[own.argmax()], 200).max()
    assert most == pytest.approx(log1p(30.0))


def test_the_modulus_of_other_eyes_is_off_as_eyes_differ(eye):
    wide = replace(EXACT.reader, youngs_modulus_pa=Range(min=1e4, max=1e7))
    study = replace(EXACT, reader=wide)
    rng = np.random.default_rng(1)
    stated_pa = [
        interval_measurement.of_population(eye, study, rng).eye.modulus_pa
        for _ in range(2000)
    ]
    assert np.std(stated_pa) / eye.wall.youngs_modulus_pa == pytest.approx(
        0.12, rel=0.06
    )


@pytest.mark.slow
def test_an_eye_is_calibrated_otherwise_on_a_few_frames_of_any_forces_and_read_at_others(
    eye, library
):
    found = []
    for seed in range(6):
        known, left = interval_measurement.calibrated_otherwise(
            eye, EXACT, library, np.random.default_rng(seed)
        )
        assert len(left) == FRAMES - interval_measurement.CALIBRATED
        found.append(known.eye.discrepancy)

    largest_n = [each.largest_n for each in found]
    assert 11e-3 < min(largest_n) < 0.5 * eye.largest_n < max(largest_n)
    assert max(largest_n) <= 1.05 * eye.largest_n
    gaps = [each.widest_gap for each in found]
    assert min(gaps) < 0.45 < max(gaps) <= 1.0

    by_network = Reading(
        probabilities=(0.0, 0.0, 1.0), force_n=0.2, interval_n=(0.1, 0.3), contact_m=0.0
    )

    def scores(scatter: float) -> list[IntervalScore]:
        discrepancy = replace(known.eye.discrepancy, scatter=scatter)
        setup = replace(known, eye=replace(known.eye, discrepancy=discrepancy))
        return interval_measurement._scores(
            EXACT, library, eye.wall.polar_rad, lambda *_: by_network, "0", setup, left
        )

    for once, twice in zip(scores(1.0), scores(2.0), strict=True):
        wider = 1.0 if once.method == "network" else 2.0
        assert twice.score == pytest.approx(once.score / wider, rel=1e-9)
        if once.method == "network":
            assert (once.traits[0], once.traits[-1]) == ("own E", "far beyond")

    gentle = replace(eye, largest_n=11e-3)  # it bears gentle forces only
    assert not interval_measurement.calibrated_otherwise(
        gentle, EXACT, library, np.random.default_rng(0)
    )


TRAITS = {"sealed": 0.6, "taut": 0.9, "uneven": 1.5, "light": 2.0, "sparse": 1.0}


def drawn(rng: np.random.Generator, eyes: int, frames: int) -> list[IntervalScore]:
    """Scores of eyes with traits that multiply: sealed or taut, and each of the others
    of a half.
    """
    found = []
    for eye in range(eyes):
        of_eye = [name for name in ("uneven", "sparse") if rng.random() < 0.5]
        own = abs(rng.standard_normal())

        for _ in range(frames):
            traits = [
                "taut" if rng.random() < 0.3 else "sealed",
                *of_eye,
                *["light"] * (rng.random() < 0.4),
            ]
            size = np.prod([TRAITS[trait] for trait in traits])
            found.append(
                IntervalScore(
                    "fit",
                    ("own E", *traits),
                    str(eye),
                    float(size * abs(own + rng.normal(0.0, 0.4))),
                )
            )

    return found


def test_traits_that_multiply_are_found():
    factors = interval_measurement.trait_factors(
        drawn(np.random.default_rng(1), 1000, 6)
    )["fit"]["own E"]
    # what 90 % of the eyes' own errors stay below
    held = factors["sealed"] / TRAITS["sealed"]
    assert held == pytest.approx(1.75, rel=0.05)

    for trait, size in TRAITS.items():
        wanted = size * (held if trait in ("sealed", "taut") else 1.0)
        assert factors[trait] == pytest.approx(wanted, rel=0.08), trait


@pytest.mark.slow
def test_of_each_trait_90_percent_are_held_and_of_new_eyes_too():
    rng = np.random.default_rng(2)
    of_new = []

    for _ in range(12):
        scores = drawn(rng, 200, 6)
        others = drawn(rng, 200, 6)
        factors = interval_measurement.trait_factors(scores)["fit"]["own E"]

        def held(
            entries: list[IntervalScore], trait: str, given: dict[str, float]
        ) -> float:
            having = [entry for entry in entries if trait in entry.traits]
            limits = [
                np.prod([given[name] for name in entry.traits[1:]]) for entry in having
            ]
            return float(np.mean(np.array([entry.score for entry in having]) <= limits))

        for trait in ("sealed", "uneven", "light"):
            assert held(scores, trait, factors) == pytest.approx(0.905, abs=0.02), trait

        of_new.append([held(others, trait, factors) for trait in TRAITS])

    np.testing.assert_allclose(np.mean(of_new, axis=0), 0.90, atol=0.02)


def scores_of(method: str, *traits: str, score: float, count: int, eyes: int = 0):
    return [
        IntervalScore(method, traits, str(number if eyes else "long"), score)
        for number in range(count)
    ]


def test_no_trait_makes_intervals_narrower_and_every_eye_has_the_same_weight():
    eyes = {"count": 50, "eyes": 50}
    scores = [
        *scores_of("network", "other E", "open", score=1.0, **eyes),
        *scores_of("network", "other E", "open", "sparse", score=0.1, **eyes),
        *scores_of("fit", "own E", "open", score=0.5, count=99, eyes=99),
        *scores_of("fit", "own E", "open", score=9.0, count=2000),
    ]
    factors = interval_measurement.trait_factors(scores)
    assert factors["network"]["other E"]["sparse"] == 1.0
    assert factors["fit"]["own E"]["open"] == pytest.approx(0.5)


SLICE = SliceStudy()
NONE = BoundaryErrors(
    surface_smoothing_m=1e-9,
    shine_m=0.0,
    shine_sd_m=0.0,
    outer_sd_m=0.0,
    thickness_scale_sd=0.0,
    thickness_sd_m=0.0,
    bumps=0.0,
    layer_share=0.0,
    side_loss_share=0.0,
    bottom_knee_m=1e-12,
)


LATERAL_M = (np.arange(SLICE.columns) + 0.5 - SLICE.columns / 2) * SLICE.pixel_m


def walls(count: int, bend_per_m: float = 80.0) -> np.ndarray:
    """Parabolic walls of 0.6 mm, (sample, boundary, column), m."""
    outer = 0.5e-3 + 0.5 * bend_per_m * LATERAL_M**2
    return np.repeat(np.stack([outer, outer + 0.6e-3])[None], count, axis=0)


def test_smoothing_moves_a_bent_surface_by_half_its_variance_times_the_curvature():
    smoothing_m = 0.18e-3
    seen = disturb(
        walls(1, 200.0),
        SLICE,
        np.random.default_rng(0),
        replace(NONE, surface_smoothing_m=smoothing_m),
    )
    moved = (seen - walls(1, 200.0))[0, OUTER, 45:95]
    np.testing.assert_allclose(moved, 0.5 * smoothing_m**2 * 200.0, rtol=0.01)


def test_a_surface_that_leaves_at_the_bottom_is_seen_too_high_and_then_lost():
    outer = 4.6e-3 - 0.3 * np.abs(LATERAL_M)
    true = np.repeat(np.stack([outer, outer + 0.6e-3])[None], 300, axis=0)
    seen = disturb(
        true, SLICE, np.random.default_rng(6), replace(NONE, bottom_knee_m=0.02e-3)
    )[:, OUTER]
    assert np.isnan(seen[:, outer > 4.5e-3]).all()
    assert np.isfinite(seen[:, outer < 3.94e-3]).all()
    assert np.nanmax(seen) <= 3.945e-3
    reached = np.nanmax(np.where(np.isfinite(seen), outer, np.nan), axis=1) - 3.945e-3
    assert 0.05e-3 < reached.mean() < 0.12e-3


def test_the_surface_lies_higher_where_it_faces_the_light_and_the_wall_ends_where_it_did():
    true = walls(3000)
    shining = (
        disturb(
            true,
            SLICE,
            np.random.default_rng(2),
            replace(NONE, shine_m=8e-6, shine_sd_m=2e-6),
        )
        - true
    )
    slope = np.gradient(true[0, OUTER], SLICE.pixel_m)
    expected = -8e-6 * np.exp(-((slope / 0.115) ** 2))
    inside = np.abs(LATERAL_M) < 5e-3
    np.testing.assert_allclose(
        shining[:, OUTER].mean(axis=0)[inside], expected[inside], atol=0.15e-6
    )
    middle = np.abs(slope).argmin()
    assert shining[:, OUTER, middle].std() == pytest.approx(2e-6, rel=0.05)
    np.testing.assert_allclose(shining[:, INNER][:, inside], 0.0, atol=1e-12)
    none = (
        disturb(true, SLICE, np.random.default_rng(2), replace(NONE, shine_m=-1.0))
        - true
    )
    np.testing.assert_allclose(none[:, OUTER][:, inside], 0.0, atol=1e-12)
