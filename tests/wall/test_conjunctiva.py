"""The sclera's surface under a conjunctiva: found where it shows and where the given
thickness asks for it.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from bench_conjunctiva import rows_off, waving_wall
from scleraforce.lab.drawn_bscan import Bscan, render_bscan
from scleraforce.lab.tissue_light import (
    Conjunctiva,
    Pose,
    sample_conjunctiva,
    sample_optics,
)
from scleraforce.reading.frame_checks import segment_and_slice
from scleraforce.records.scan import PixelScale
from scleraforce.records.study import PhantomStudy, Study, fixed
from scleraforce.wall.conjunctiva import below_conjunctiva, second_surface_m
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall import Segmentation
from scleraforce.wall.wall_network import WallFinder

STUDY = Study()
SCALE = PixelScale.of(STUDY.oct)
WALL_M = 0.6e-3


def layer(thickness_m: float, seed: int, **changed: float) -> Conjunctiva:
    phantom: PhantomStudy = replace(
        STUDY.phantom, conjunctiva_thickness_m=fixed(thickness_m)
    )
    drawn = sample_conjunctiva(phantom, np.random.default_rng(seed))
    assert drawn is not None
    return replace(drawn, **changed)


def bscan(over: Conjunctiva | None, seed: int, wave: float = 0.0) -> Bscan:
    """A dented wall; `wave`: by which share its own thickness changes along the
    picture.
    """
    rng = np.random.default_rng(seed)
    section = waving_wall(WALL_M, rng.uniform(0.0, 2e-3), wave)
    optics = replace(sample_optics(STUDY.phantom, STUDY.oct, rng), conjunctiva=over)
    return render_bscan(
        Pose(lateral_m=0.0, depth_m=0.5e-3).place(section), STUDY.oct, optics, rng
    )


@pytest.mark.parametrize("thickness_m", [80e-6, 140e-6, 250e-6, 450e-6])
def test_the_walls_surface_is_found_below_a_conjunctiva(thickness_m: float) -> None:
    for seed in range(3):
        made = bscan(layer(thickness_m, seed), seed)
        first = find_wall(made.frame, SCALE)
        found = below_conjunctiva(made.frame, SCALE, first, WALL_M)
        assert rows_off(first, made) > 8.0
        assert rows_off(found, made) < 3.0
        assert found.thickness_m == pytest.approx(WALL_M, rel=0.08)
        np.testing.assert_array_equal(found.inner_row, first.inner_row)
        assert first.conjunctiva_m is None
        assert found.conjunctiva_m == pytest.approx(thickness_m, rel=0.15, abs=10e-6)


@pytest.mark.parametrize("thickness_m", [80e-6, 250e-6, 450e-6])
def test_without_a_known_thickness_a_second_surface_is_a_fault(
    thickness_m: float, shipped: WallFinder
) -> None:
    made = bscan(layer(thickness_m, 2), 2)
    assert second_surface_m(
        made.frame, SCALE, find_wall(made.frame, SCALE)
    ) == pytest.approx(thickness_m, rel=0.15)
    unsure = segment_and_slice(made.frame, SCALE, STUDY.slice, finder=shipped)
    assert "below the first" in str(unsure.reason)
    assert not unsure.cuts[0].any()
    assert (
        segment_and_slice(
            made.frame, SCALE, STUDY.slice, thickness_m=WALL_M, finder=shipped
        ).reason
        is None
    )


@pytest.mark.parametrize("wave", [0.0, 0.12])
def test_a_bare_wall_has_no_second_surface_and_no_conjunctiva_if_it_is_thicker_than_given(
    wave: float,
) -> None:
    for seed in range(6):
        made = bscan(None, seed, wave)
        first = find_wall(made.frame, SCALE)
        assert second_surface_m(made.frame, SCALE, first) is None
        for told_m in (0.8 * WALL_M, 0.9 * WALL_M):
            assert first.thickness_m > told_m + 35e-6
            assert below_conjunctiva(made.frame, SCALE, first, told_m) is first


def test_a_conjunctiva_that_waves_is_followed() -> None:
    wavy = layer(180e-6, 4, wave_fraction=0.2, wave_length_m=3e-3, level_db=-4.0)
    made = bscan(wavy, 4)
    found = below_conjunctiva(made.frame, SCALE, find_wall(made.frame, SCALE), WALL_M)
    assert rows_off(found, made) < 2.5  # its waves are 14 rows high


def layers(*levels_m: tuple[float, float]) -> tuple[np.ndarray, Segmentation]:
    """A flat wall without noise, 0.8 mm thick including the layers: the light below
    each depth, its segmentation.
    """
    tissue_m = SCALE.depth_m / SCALE.refractive_index
    below_m = (np.arange(512)[:, None] - 100.0) * tissue_m
    light = np.full((512, 512), 200.0)
    for depth_m, level in (*levels_m, (0.8e-3, 200.0)):
        light = np.where(below_m >= depth_m, level, light)

    rows = np.full(512, 99.5)
    found = Segmentation(
        rows, rows + 0.8e-3 / tissue_m, 512, True, "", True, thickness_m=0.8e-3
    )

    return light.astype(np.uint16), found


def surface_m(frame: np.ndarray, found: Segmentation, told_m: float) -> float:
    """Return the depth of the wall's surface below the first one, m."""
    below = below_conjunctiva(frame, SCALE, found, told_m)
    return (
        float(np.median(below.outer_row - found.outer_row))
        * SCALE.depth_m
        / SCALE.refractive_index
    )


def test_a_step_is_taken_for_the_wall_where_the_given_thickness_asks_for_it_and_it_is_large():
    frame, found = layers((0.0, 2000.0), (0.14e-3, 2200.0))
    assert surface_m(frame, found, 0.66e-3) == pytest.approx(0.14e-3, abs=10e-6)
    # it would leave 0.18 mm of 0.32 unexplained
    assert below_conjunctiva(frame, SCALE, found, 0.48e-3) is found
    frame, found = layers((0.0, 2000.0), (0.14e-3, 2200.0), (0.35e-3, 3000.0))
    # a brighter band lies deeper
    assert surface_m(frame, found, 0.66e-3) == pytest.approx(0.14e-3, abs=10e-6)
    # a hundredth, without noise
    frame, found = layers((0.0, 2000.0), (0.14e-3, 2020.0))
    assert below_conjunctiva(frame, SCALE, found, 0.66e-3) is found


def test_nothing_is_found_where_the_thickness_is_untold_or_fits_both_surfaces_look_alike_or_no_wall_was_found():
    made = bscan(layer(140e-6, 2), 2)
    first = find_wall(made.frame, SCALE)
    for told_m in (None, first.thickness_m, 2 * first.thickness_m):
        assert below_conjunctiva(made.frame, SCALE, first, told_m) is first

    lost = replace(first, usable=False, reason="nothing")
    assert below_conjunctiva(made.frame, SCALE, lost, WALL_M) is lost
    made = bscan(layer(140e-6, 1, level_db=0.0, interface_db=-60.0), 1)
    first = find_wall(made.frame, SCALE)
    assert below_conjunctiva(made.frame, SCALE, first, WALL_M) is first


def test_a_network_that_takes_the_conjunctiva_for_wall_does_not_speak_against_the_given_thickness(
    shipped: WallFinder,
) -> None:
    """From 140 um on the shipped one does so; read and segmented is the sclera all the
    same.
    """
    for thickness_m, seed in product((80e-6, 140e-6, 250e-6), range(3)):
        made = bscan(layer(thickness_m, seed), seed)
        found = find_wall(made.frame, SCALE, WALL_M, shipped)
        assert found.usable, found.reason
        assert rows_off(found, made) < 3.0
