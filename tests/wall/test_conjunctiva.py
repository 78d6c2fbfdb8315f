"""The sclera's surface under a conjunctiva: found where it shows and where the given
thickness asks for it.
"""

from dataclasses import replace

import numpy as np
import pytest

from figures.studies.conjunctiva import rows_off, waving_wall
from scleraforce.lab.drawn_bscan import Bscan, render_bscan
from scleraforce.lab.tissue_light import Pose, sample_conjunctiva, sample_optics
from scleraforce.records.scan import PixelScale
from scleraforce.records.study import Study, fixed
from scleraforce.wall.conjunctiva import second_surface_m
from scleraforce.wall.find_wall import find_wall

STUDY = Study()
SCALE = PixelScale.of(STUDY.oct)
WALL_M = 0.6e-3


def bscan(layer_m: float | None, seed: int, wave: float = 0.0, **layer: float) -> Bscan:
    """A dented wall under a layer; `wave`: by which share its own thickness changes
    along the picture.
    """
    over = None
    if layer_m is not None:
        phantom = replace(STUDY.phantom, conjunctiva_thickness_m=fixed(layer_m))
        over = sample_conjunctiva(phantom, np.random.default_rng(seed))
        over = replace(over, **layer)

    rng = np.random.default_rng(seed)
    section = waving_wall(WALL_M, rng.uniform(0.0, 2e-3), wave)
    optics = replace(sample_optics(STUDY.phantom, STUDY.oct, rng), conjunctiva=over)
    placed = Pose(lateral_m=0.0, depth_m=0.5e-3).place(section)
    return render_bscan(placed, STUDY.oct, optics, rng)


def layer_below(frame: np.ndarray, told_m: float | None) -> float | None:
    """Return the thickness of the layer over a wall that is told to be so thick; None
    if the wall is the one that is found without that.
    """
    first = find_wall(frame, SCALE)
    assert first.conjunctiva_m is None
    found = find_wall(frame, SCALE, told_m)
    np.testing.assert_array_equal(found.inner_row, first.inner_row)
    if found.conjunctiva_m is None:
        np.testing.assert_array_equal(found.outer_row, first.outer_row)
    return found.conjunctiva_m


@pytest.mark.parametrize("layer_m", [80e-6, 140e-6, 250e-6, 450e-6])
@pytest.mark.parametrize("seed", range(3))
def test_the_walls_surface_is_found_below_a_conjunctiva(layer_m, seed, shipped):
    """From 140 um on the shipped network takes it for wall, which does not speak
    against the given thickness.
    """
    made = bscan(layer_m, seed)
    assert rows_off(find_wall(made.frame, SCALE), made) > 8.0
    assert layer_below(made.frame, WALL_M) == pytest.approx(layer_m, rel=0.15, abs=1e-5)
    for finder in (None, shipped)[: 1 if layer_m > 300e-6 else 2]:
        found = find_wall(made.frame, SCALE, WALL_M, finder)
        assert found.usable, found.reason
        assert rows_off(found, made) < 3.0
        assert found.thickness_m == pytest.approx(WALL_M, rel=0.08)


@pytest.mark.parametrize("layer_m", [80e-6, 250e-6, 450e-6])
def test_without_a_known_thickness_a_second_surface_is_seen(layer_m):
    frame = bscan(layer_m, 2).frame
    second_m = second_surface_m(frame, SCALE, find_wall(frame, SCALE))
    assert second_m == pytest.approx(layer_m, rel=0.15)


@pytest.mark.parametrize("wave", [0.0, 0.12])
def test_a_bare_wall_has_no_second_surface_and_no_conjunctiva_if_it_is_thicker_than_given(
    wave,
):
    for seed in range(6):
        frame = bscan(None, seed, wave).frame
        first = find_wall(frame, SCALE)
        assert second_surface_m(frame, SCALE, first) is None
        for told_m in (0.8 * WALL_M, 0.9 * WALL_M):
            assert first.thickness_m > told_m + 35e-6
            assert layer_below(frame, told_m) is None


def test_a_conjunctiva_that_waves_is_followed():
    wave = {"wave_fraction": 0.2, "wave_length_m": 3e-3, "level_db": -4.0}
    made = bscan(180e-6, 4, **wave)
    # its waves are 14 rows high
    assert rows_off(find_wall(made.frame, SCALE, WALL_M), made) < 2.5


@pytest.mark.parametrize(
    ("levels", "told_m", "expected_m"),
    [
        ({0.14e-3: 2200.0}, 0.66e-3, 0.14e-3),
        # it would leave 0.18 mm of 0.32 unexplained
        ({0.14e-3: 2200.0}, 0.48e-3, None),
        # a brighter band lies deeper
        ({0.14e-3: 2200.0, 0.35e-3: 3000.0}, 0.66e-3, 0.14e-3),
        # a hundredth, without noise
        ({0.14e-3: 2020.0}, 0.66e-3, None),
    ],
)
def test_a_step_is_taken_for_the_wall_where_the_given_thickness_asks_for_it_and_it_is_large(
    levels, told_m, expected_m
):
    """In a flat wall without noise, 0.8 mm thick including the layers."""
    tissue_m = SCALE.depth_m / SCALE.refractive_index
    below_m = (np.arange(512)[:, None] - 100.0) * tissue_m
    light = np.full((512, 512), 200.0)
    for depth_m, level in {0.0: 2000.0, **levels, 0.8e-3: 200.0}.items():
        light = np.where(below_m >= depth_m, level, light)

    found_m = layer_below(light.astype(np.uint16), told_m)
    assert found_m == (expected_m and pytest.approx(expected_m, abs=10e-6))


def test_nothing_is_found_where_the_thickness_fits_or_both_surfaces_look_alike():
    frame = bscan(140e-6, 2).frame
    thickness_m = find_wall(frame, SCALE).thickness_m
    for told_m in (None, thickness_m, 2 * thickness_m):
        assert layer_below(frame, told_m) is None
    alike = bscan(140e-6, 1, level_db=0.0, interface_db=-60.0)
    assert layer_below(alike.frame, WALL_M) is None
