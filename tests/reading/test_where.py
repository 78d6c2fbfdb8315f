"""The needle's place from one frame: exact without noise, intervals that hold with it,
null where nothing tells.
"""

from dataclasses import replace

import numpy as np
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

from predicted_walls import Walls, formed_wall, predict_wall
from scleraforce.base.units import to_si
from scleraforce.fit import unknowns
from scleraforce.fit.one_frame import fit_boundaries
from scleraforce.fit.prior_of_an_eye import Prior, prior_of
from scleraforce.reading.answer import Answer
from scleraforce.reading.needle_place import NeedlePlace, PlaceValue, places_of
from scleraforce.records.setup import Setup
from scleraforce.wall.needle_in_frame import SeenNeedle

WALLS = Walls(LIBRARY)
SHAFT = SeenNeedle(
    angle_rad=-0.3, tip_m=None, tip=(256.0, 100.0), top=(200.0, -0.5), hidden=(240, 270)
)


def seen(
    unknown: np.ndarray,
    setup: Setup | None = None,
    noise_m: float = 0.0,
    needle: SeenNeedle | None = None,
    seed: int = 0,
) -> NeedlePlace:
    rng = np.random.default_rng(seed)
    depth_bc = noisy_boundaries(predict_wall(WALLS, unknown, BOTH), noise_m, rng)
    setup = setup or known_eye(unknown)
    prior: Prior = prior_of(setup, RANGES)
    fit = fit_boundaries(LIBRARY, LATERAL_M, depth_bc, prior)
    assert fit is not None

    return places_of(fit, prior, LIBRARY, setup, needle)


def drawn(rng: np.random.Generator, least_m: float = 0.4e-3) -> np.ndarray:
    places = {
        "lateral_m": rng.uniform(-1e-3, 1e-3),
        "depth_m": rng.uniform(0.3e-3, 0.6e-3),
    }
    return middling_eye(
        rng.uniform(least_m, 3e-3), rotation_rad=rng.uniform(-0.05, 0.05), **places
    )


def test_without_noise_the_places_are_the_walls_own() -> None:
    turned = middling_eye(2.5e-3, rotation_rad=0.2, lateral_m=0.0, depth_m=0.5e-3)
    for truth in (turned, *(drawn(np.random.default_rng(seed)) for seed in range(4))):
        found = seen(truth, needle=SHAFT)
        on_axis = truth.copy()
        # in a plane through the axis the wall is deepest below the needle
        on_axis[unknowns.GAP] = 1e-7
        wall_m = formed_wall(WALLS, on_axis)[0]
        axis = np.array(
            [np.cos(truth[unknowns.ROTATION]), np.sin(truth[unknowns.ROTATION])]
        )
        contact = wall_m[
            np.argmin(
                np.abs((wall_m - truth[[unknowns.LATERAL, unknowns.DEPTH]]) @ axis)
            )
        ]
        assert found.contact_m.value == pytest.approx(
            truth[unknowns.LATERAL], abs=15e-6
        )
        assert found.dent_m.value == pytest.approx(truth[unknowns.TIP], rel=0.02)
        assert found.gap_m.value == pytest.approx(truth[unknowns.GAP], abs=20e-6)
        assert found.contact_depth_m.value == pytest.approx(contact[1], abs=40e-6)
        assert found.lean_rad.value == pytest.approx(
            -0.3 - truth[unknowns.ROTATION], abs=3e-3
        )


def test_the_contact_is_deeper_than_the_surface_in_a_plane_beside_it() -> None:
    truth = drawn(np.random.default_rng(8), 1.5e-3)
    lateral_m, depth_m = formed_wall(WALLS, truth)[0].T
    in_plane = depth_m[np.abs(lateral_m - truth[unknowns.LATERAL]) < 0.5e-3].max()
    assert seen(truth).contact_depth_m.value > in_plane + 50e-6


def test_intervals_hold_the_truth() -> None:
    inside = {name: [] for name in ("contact_m", "dent_m", "gap_m")}
    for seed in range(30):
        truth = drawn(np.random.default_rng(seed))
        known = replace(
            known_eye(truth), needle=replace(known_eye(truth).needle, gap_m=None)
        )
        found = seen(truth, known, 5e-6, seed=seed)

        for name, which in (
            ("contact_m", unknowns.LATERAL),
            ("dent_m", unknowns.TIP),
            ("gap_m", unknowns.GAP),
        ):
            place = getattr(found, name)
            if place is not None:
                assert 0.0 < place.high - place.low < 0.8e-3
                inside[name].append(place.low <= truth[which] <= place.high)

    counts = {name: (len(of), np.mean(of)) for name, of in inside.items()}
    assert all(count >= 12 and share >= 0.9 for count, share in counts.values()), counts


def test_what_the_picture_does_not_tell_is_null() -> None:
    resting = seen(middling_eye(0.0), noise_m=5e-6, needle=SHAFT)
    assert (
        resting.contact_m,
        resting.contact_depth_m,
        resting.dent_m,
        resting.gap_m,
    ) == (None,) * 4
    assert resting.lean_rad is not None  # the shaft and the wall are seen
    light = middling_eye(0.15e-3)
    unsure = seen(
        light,
        replace(known_eye(light), needle=replace(known_eye(light).needle, gap_m=None)),
        5e-6,
    )
    assert unsure.dent_m is not None
    assert unsure.gap_m is None  # a shallow dent looks alike from everywhere
    stated = seen(light, noise_m=5e-6).gap_m
    assert stated.low < light[unknowns.GAP] < stated.high
    # no wider than it was stated
    assert stated.high - stated.low <= 2 * 1.645 * 30e-6 * 1.001
    # no needle leans so
    assert seen(light, needle=replace(SHAFT, angle_rad=1.5)).lean_rad is None
    assert (
        Answer(predicted=2, probabilities=None, usable=False, reason="dark").to_dict()[
            "dent_mm"
        ]
        is None
    )


def test_the_json_has_each_place_in_human_units_and_an_angle_without_a_sign() -> None:
    at_m = PlaceValue(1.2e-3, 1.1e-3, 1.3e-3)
    lean = PlaceValue(*to_si(np.array([-3.0, -5.0, 1.0]), "deg").tolist())
    places = NeedlePlace(contact_m=at_m, dent_m=at_m, lean_rad=lean)
    answer = Answer(
        predicted=1,
        probabilities=(0.0, 1.0, 0.0),
        usable=True,
        reason=None,
        contact_m=1.2e-3,
        places=places,
        lean_rad=(0.7, 0.7),
    )
    found = answer.to_dict()
    assert found["contact_mm"] == found["dent_mm"] == pytest.approx(1.2)
    assert (
        found["contact_mm_interval"]
        == found["dent_mm_interval"]
        == pytest.approx([1.1, 1.3])
    )
    assert (found["gap_mm"], found["gap_mm_interval"], found["contact_depth_mm"]) == (
        None,
        None,
        None,
    )
    # the picture's, not the declared one
    assert found["lean_deg"] == pytest.approx(3.0)
    assert found["lean_deg_interval"] == pytest.approx([0.0, 5.0])
    declared = replace(answer, places=NeedlePlace()).to_dict()
    assert (declared["lean_deg"], declared["lean_deg_interval"]) == (
        pytest.approx(40.1, abs=0.1),
        None,
    )
