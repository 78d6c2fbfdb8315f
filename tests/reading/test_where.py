"""The needle's place from one frame: exact without noise, intervals that hold with it,
null where nothing tells.
"""

from dataclasses import replace

import numpy as np
import pytest
from analytic_frames import (
    BOTH,
    COLUMNS,
    LIBRARY,
    known_eye,
    middling_eye,
    noisy_boundaries,
)
from small_models import FIVE_MN, force_reader

from predicted_walls import Walls, formed_wall, predict_wall
from scleraforce.base.units import to_si
from scleraforce.fit import unknowns
from scleraforce.reading.answer import Answer, unusable_answer
from scleraforce.reading.needle_place import NeedlePlace, PlaceValue
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from scleraforce.wall.wall import Segmentation
from virtual_eyes import changed

WALLS = Walls(LIBRARY)
SCALE = PixelScale(lateral_m=15e-3 / COLUMNS, depth_m=1e-5)
EMPTY = np.zeros((512, COLUMNS), dtype=np.uint16)
UNSURE = replace(FIVE_MN, interval_n=(0.0, 0.06))


def seen(
    unknown: np.ndarray,
    setup: Setup | None = None,
    noise_m: float = 0.0,
    seed: int = 0,
) -> NeedlePlace:
    """Return the places in the answer to a frame with these boundaries."""
    rng = np.random.default_rng(seed)
    depth_m = noisy_boundaries(predict_wall(WALLS, unknown, BOTH), noise_m, rng)
    outer, inner = depth_m / SCALE.depth_m - 0.5
    thickness_m = unknown[unknowns.THICKNESS]
    wall = Segmentation(outer, inner, 512, True, "", True, thickness_m=thickness_m)
    reader = force_reader(UNSURE)
    answer = reader.read(EMPTY, SCALE, setup or known_eye(unknown), wall)
    assert answer.usable, answer.reason
    return answer.places


def drawn(seed: int, least_m: float = 0.4e-3) -> np.ndarray:
    rng = np.random.default_rng(seed)
    places = {
        "lateral_m": rng.uniform(-1e-3, 1e-3),
        "depth_m": rng.uniform(0.3e-3, 0.6e-3),
    }
    return middling_eye(
        rng.uniform(least_m, 3e-3), rotation_rad=rng.uniform(-0.05, 0.05), **places
    )


TURNED = middling_eye(2.5e-3, rotation_rad=0.2, lateral_m=0.0, depth_m=0.5e-3)


@pytest.mark.parametrize("truth", [TURNED, *map(drawn, range(4))])
def test_without_noise_the_places_are_the_walls_own(truth):
    found = seen(truth)
    on_axis = truth.copy()
    # in a plane through the axis the wall is deepest below the needle
    on_axis[unknowns.GAP] = 1e-7
    wall_m = formed_wall(WALLS, on_axis)[0]
    turn = truth[unknowns.ROTATION]
    along_m = (wall_m - truth[[unknowns.LATERAL, unknowns.DEPTH]]) @ np.array(
        [np.cos(turn), np.sin(turn)]
    )
    bottom_m = wall_m[np.abs(along_m).argmin(), 1]
    assert found.contact_m.value == pytest.approx(truth[unknowns.LATERAL], abs=15e-6)
    assert found.dent_m.value == pytest.approx(truth[unknowns.TIP], rel=0.02)
    assert found.gap_m.value == pytest.approx(truth[unknowns.GAP], abs=20e-6)
    assert found.contact_depth_m.value == pytest.approx(bottom_m, abs=40e-6)


def test_the_contact_is_deeper_than_the_surface_in_a_plane_beside_it():
    truth = drawn(8, 1.5e-3)
    lateral_m, depth_m = formed_wall(WALLS, truth)[0].T
    in_plane_m = depth_m[np.abs(lateral_m - truth[unknowns.LATERAL]) < 0.5e-3].max()
    assert seen(truth).contact_depth_m.value > in_plane_m + 50e-6


def test_intervals_hold_the_truth():
    of_place = {
        "contact_m": unknowns.LATERAL,
        "dent_m": unknowns.TIP,
        "gap_m": unknowns.GAP,
    }
    inside = {name: list[bool]() for name in of_place}
    for seed in range(30):
        truth = drawn(seed)
        found = seen(truth, changed(known_eye(truth), gap_m=None), 5e-6, seed)
        for name, which in of_place.items():
            place = getattr(found, name)
            if place is not None:
                assert 0.0 < place.high - place.low < 0.8e-3
                inside[name].append(place.low <= truth[which] <= place.high)

    counts = {name: (len(of), np.mean(of)) for name, of in inside.items()}
    assert all(count >= 12 and share >= 0.9 for count, share in counts.values()), counts


def test_what_the_picture_does_not_tell_is_null():
    assert seen(middling_eye(0.0), noise_m=5e-6) == NeedlePlace()
    light = middling_eye(0.15e-3)
    unsure = seen(light, changed(known_eye(light), gap_m=None), 5e-6)
    assert unsure.dent_m is not None
    assert unsure.gap_m is None  # a shallow dent looks alike from everywhere
    stated = seen(light, noise_m=5e-6).gap_m
    assert stated.low < light[unknowns.GAP] < stated.high
    # no wider than it was stated
    assert stated.high - stated.low <= 2 * 1.645 * 30e-6 * 1.001


def test_the_json_has_each_place_in_human_units_and_an_angle_without_a_sign():
    at_m = PlaceValue(1.2e-3, 1.1e-3, 1.3e-3)
    lean = PlaceValue(*to_si(np.array([-3.0, -5.0, 1.0]), "deg").tolist())
    answer = Answer(
        predicted=1,
        probabilities=(0.0, 1.0, 0.0),
        usable=True,
        reason=None,
        places=NeedlePlace(contact_m=at_m, lean_rad=lean),
        lean_rad=(0.7, 0.7),
    )
    found = answer.to_dict()
    assert found["contact_mm_interval"] == pytest.approx([1.1, 1.3])
    # the picture's, not the declared one
    assert found["lean_deg"] == pytest.approx(3.0)
    assert found["lean_deg_interval"] == pytest.approx([0.0, 5.0])
    declared = replace(answer, places=NeedlePlace()).to_dict()
    assert declared["lean_deg"] == pytest.approx(40.1, abs=0.1)
    assert declared["lean_deg_interval"] is None
    assert unusable_answer(3, "dark").to_dict()["dent_mm"] is None
