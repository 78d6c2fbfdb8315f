"""Drawn scenes: the truth is where it is said to be, physics is what the study says, and every range matters."""

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

import cv2
import numpy as np
import pytest

from scleraforce.errors import StudyError
from scleraforce.laboratory.scenes.scene import Scene, draw_scene
from scleraforce.study import (
    Range,
    SceneEyeStudy,
    SceneOverStudy,
    SceneScannerStudy,
    ScenesStudy,
    SceneTissueStudy,
    SceneWindowStudy,
    parse_study,
)
from scleraforce.study.fields import field_unit
from scleraforce.study.sampled import Choice, fixed

SHOWN = 0.35  # of the range of counts: tissue is brighter, noise darker, in a plain scene


def only(record: Any, **values: Any) -> Any:
    """A record whose shares and counts are 0, but for the values given."""
    none = {item.name: 0.0 for item in fields(record) if item.name.endswith("_share") and is_share(record, item.name)}
    none |= {item.name: fixed(0) for item in fields(record) if item.name.endswith("_count")}
    return replace(record, **(none | values))


def is_share(record: Any, name: str) -> bool:
    return isinstance(getattr(record, name), float)


PLAIN = ScenesStudy(
    window=only(
        SceneWindowStudy(),
        rows=fixed(200),
        columns=fixed(160),
        width_m=fixed(10e-3),
        depth_share=fixed(0.4),
        view_m=fixed(0.0),
        tilt_rad=fixed(0.0),
        surface_share=fixed(0.1),
    ),
    eye=only(
        SceneEyeStudy(),
        half_sphere_share=1.0,
        sclera_radius_m=fixed(12e-3),
        sclera_thickness_m=fixed(0.6e-3),
        wave_m=fixed(0.0),
    ),
    tissue=only(SceneTissueStudy(), corrected_share=1.0, snr_db=fixed(30.0), attenuation_per_m=fixed(0.3e3)),
    over=only(SceneOverStudy()),
    scanner=only(
        SceneScannerStudy(),
        rolloff_db=fixed(0.0),
        looks=fixed(10.0),
        display_floor_db=fixed(3.0),
        speckle_rows=fixed(0.5),
        speckle_columns=fixed(0.5),
    ),
)


def plain(**parts: dict[str, Any]) -> ScenesStudy:
    """The plain study with other values in some of its parts."""
    return replace(PLAIN, **{name: replace(getattr(PLAIN, name), **values) for name, values in parts.items()})


def rows_m(scene: Scene, rows: np.ndarray) -> np.ndarray:
    """Depths below the upper edge, m, of rows of pixel centres."""
    return (rows + 0.5) * scene.scale.depth_m


def lateral_m(scene: Scene) -> np.ndarray:
    columns = scene.frame.shape[1]
    return (np.arange(columns) + 0.5 - columns / 2) * scene.scale.lateral_m


def lit(scene: Scene) -> np.ndarray:
    """Which pixels are bright, by the mean of their neighbours."""
    counts = scene.frame.astype(np.float32)
    return cv2.blur(counts, (5, 3)) > SHOWN * counts.max()


def test_the_same_number_draws_the_same_scene_and_another_one_another() -> None:
    first, again, other = (draw_scene(ScenesStudy(), number) for number in (7, 7, 8))
    assert np.array_equal(first.frame, again.frame)
    assert np.array_equal(first.outer_row, again.outer_row, equal_nan=True)
    assert first.frame.shape != other.frame.shape or not np.array_equal(first.frame, other.frame)
    assert not np.array_equal(first.frame, draw_scene(ScenesStudy(seed=1), 7).frame)


def test_the_truth_of_a_half_sphere_is_two_circles() -> None:
    scene = draw_scene(PLAIN, 0)
    x = lateral_m(scene)
    top = 0.1 * 4e-3
    outer = top + 12e-3 - np.sqrt(12e-3**2 - x**2)
    inner = top + 12e-3 - np.sqrt((12e-3 - 0.6e-3) ** 2 - x**2)
    assert rows_m(scene, scene.outer_row) == pytest.approx(outer, abs=5e-6)
    assert rows_m(scene, scene.inner_row) == pytest.approx(inner, abs=5e-6)


def test_what_is_bright_is_what_the_truth_calls_wall() -> None:
    for number in range(4):
        scene = draw_scene(PLAIN, number)
        wall = scene.mask > 0
        both = np.count_nonzero(lit(scene) & wall)
        assert 2 * both / (np.count_nonzero(lit(scene)) + np.count_nonzero(wall)) > 0.93


def test_a_flat_wall_is_stretched_by_its_refractive_index() -> None:
    uncorrected = {"corrected_share": 0.0, "refractive_index": fixed(1.4)}
    flat = {"sclera_radius_m": fixed(50e-3)}
    scene = draw_scene(plain(tissue=uncorrected, eye=flat), 0)
    middle = scene.frame.shape[1] // 2
    thickness = rows_m(scene, scene.inner_row)[middle] - rows_m(scene, scene.outer_row)[middle]
    assert thickness == pytest.approx(1.4 * 0.6e-3, rel=2e-3)
    assert scene.scale.refractive_index == 1.4


def test_a_tilted_wall_is_seen_along_rays_that_snells_law_bends() -> None:
    tilt, index = 0.5, 1.4
    tilted = {"tilt_rad": fixed(tilt), "facing": fixed(0.0), "surface_share": fixed(0.1)}
    uncorrected = {"corrected_share": 0.0, "refractive_index": fixed(index)}
    scene = draw_scene(plain(window=tilted, tissue=uncorrected, eye={"sclera_radius_m": fixed(50e-3)}), 0)
    middle = scene.frame.shape[1] // 2
    seen = rows_m(scene, scene.inner_row)[middle] - rows_m(scene, scene.outer_row)[middle]
    in_tissue = np.arcsin(np.sin(tilt) / index)
    assert seen == pytest.approx(index * 0.6e-3 / np.cos(in_tissue), rel=0.02)


def test_the_cornea_is_dim_beside_its_apex() -> None:
    eye = {"half_sphere_share": 0.0, "cornea_thickness_m": fixed(0.6e-3)}
    falls = {"angle_fall_db": fixed(20.0), "angle_width_rad": fixed(0.15), "cornea_db": fixed(0.0)}
    scene = draw_scene(plain(eye=eye, tissue=falls, window={"width_m": fixed(8e-3)}), 0)
    wall = np.where(scene.mask > 0, scene.frame, np.nan).astype(float)
    columns = scene.frame.shape[1]
    apex, beside = (np.nanmean(wall[:, at : at + 10]) for at in (columns // 2 - 5, columns // 8))
    assert beside < 0.6 * apex


def test_the_conjunctiva_lies_over_the_wall_and_is_none_of_it() -> None:
    covered = {"conjunctiva_share": 1.0, "conjunctiva_m": fixed(200e-6), "conjunctiva_db": fixed(0.0)}
    scene, bare = draw_scene(plain(tissue=covered), 0), draw_scene(PLAIN, 0)
    middle = scene.frame.shape[1] // 2
    bright = np.flatnonzero(lit(scene)[:, middle])[0]
    assert scene.outer_row[middle] - bright > 100e-6 / scene.scale.depth_m
    assert rows_m(scene, scene.inner_row - scene.outer_row) == pytest.approx(
        rows_m(bare, bare.inner_row - bare.outer_row), rel=0.05
    )


def test_a_steel_needle_shades_the_wall_that_goes_on_below_it() -> None:
    upright = {"needle_angle_rad": fixed(0.0), "needle_m": fixed(0.7e-3), "tip_gap_m": fixed(0.05e-3)}
    scene = draw_scene(plain(over={"needle_share": 1.0, **upright}), 3)
    wall = np.where(scene.mask > 0, scene.frame / scene.frame.max(), np.nan)
    level = np.nanmean(wall, axis=0)
    dark = level < 0.1
    assert 0.6e-3 < np.count_nonzero(dark) * scene.scale.lateral_m < 0.9e-3
    assert np.isfinite(scene.outer_row).all()


def test_a_wall_above_the_zero_delay_is_mirrored_into_the_frame() -> None:
    above = {"surface_share": fixed(-0.15)}
    there = draw_scene(plain(window=above, scanner={"mirrored_share": 1.0}), 0)
    middle = there.frame.shape[1] // 2
    assert there.inner_row[middle] < 1.0 or np.isnan(there.inner_row[middle])
    mirrored = (0.15 * 4e-3 - 0.5 * 0.6e-3) / there.scale.depth_m  # the wall's middle, as far below as it lies above
    assert lit(there)[int(mirrored), middle]
    without = draw_scene(plain(window=above, scanner={"mirrored_share": 0.0}), 0)
    assert not lit(without)[int(mirrored), middle]


def test_black_bands_show_no_wall() -> None:
    scene = draw_scene(plain(scanner={"band_share": 1.0, "band_fraction": fixed(0.1)}), 0)
    band = round(0.1 * scene.frame.shape[1])
    assert not scene.frame[:, :band].any()
    assert np.isnan(scene.outer_row[:band]).all()
    assert np.isfinite(scene.outer_row[band:-band]).all()


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_counts_use_the_bits_that_were_drawn(bits: int) -> None:
    scene = draw_scene(plain(scanner={"bits": fixed(bits)}), 0)
    assert scene.frame.dtype == (np.uint8 if bits == 8 else np.uint16)
    assert scene.frame.max() == 2**bits - 1


def test_a_scene_says_no_wall_where_it_leaves_the_frame() -> None:
    low = draw_scene(plain(window={"surface_share": fixed(0.8)}), 0)
    gone = np.isnan(low.outer_row)
    assert gone[0]
    assert gone[-1]
    assert not gone[len(gone) // 2]
    assert not low.mask[:, gone].any()


# A study in which everything is there: what each range does can be seen.
FULL = ScenesStudy(
    window=replace(
        SceneWindowStudy(),
        rows=fixed(64),
        columns=fixed(72),
        pixel_m=Range(min=1e-6, max=200e-6),
        width_m=fixed(15e-3),
        depth_share=fixed(0.45),
        centred_share=1.0,
    ),
    eye=replace(SceneEyeStudy(), half_sphere_share=0.0, dent_share=1.0),
    tissue=replace(
        SceneTissueStudy(),
        corrected_share=0.0,
        conjunctiva_share=1.0,
        uvea_share=1.0,
        iris_share=1.0,
        lens_share=1.0,
        haze_share=1.0,
    ),
    over=replace(
        SceneOverStudy(),
        lid_share=1.0,
        lash_count=fixed(2),
        contact_lens_share=1.0,
        speck_count=fixed(100),
        coverslip_share=1.0,
        drape_share=1.0,
        bubble_count=fixed(2),
        vessel_count=fixed(3),
        air_share=1.0,
        needle_share=1.0,
        glass_share=0.0,
    ),
    scanner=replace(
        SceneScannerStudy(),
        flare_share=1.0,
        line_count=fixed(2),
        streak_count=fixed(2),
        mirrored_share=1.0,
        linear_share=0.0,
        root_share=0.0,
        lost_share=1.0,
        band_share=1.0,
        arc_share=1.0,
        mark_count=fixed(2),
    ),
)


RANGES = [
    pytest.param(part, item.name, id=f"{part}.{item.name}")
    for part in ("window", "eye", "tissue", "over", "scanner")
    for item in fields(getattr(FULL, part))
]


def at_ends(part: str, name: str) -> Iterator[ScenesStudy]:
    """The full study with a range narrowed to each of its ends; a share, a single value: 0 and 1."""
    record, default = getattr(FULL, part), getattr(getattr(ScenesStudy(), part), name)
    glass = {"glass_share": 1.0} if name.startswith("glass_pass") else {}
    if isinstance(default, float):
        values: list[Any] = [0.0, 1.0]
    else:
        low, high = default.bounds
        kind = fixed if isinstance(default, Choice) else lambda value: Range(min=value, max=value)
        values = [kind(low), kind(high)]
    if name == "pixel_m":
        values = [Range(min=1e-6, max=200e-6), Range(min=1e-6, max=50e-6)]
    # A line thinner than a pixel is drawn as one of a pixel: only small ones tell.
    window = {"window": replace(FULL.window, width_m=fixed(4e-3))} if name == "line_m" else {}
    for value in values:
        yield replace(FULL, **window, **{part: replace(record, **glass, **{name: value})})


@pytest.mark.parametrize(("part", "name"), RANGES)
def test_every_range_changes_what_is_drawn(part: str, name: str) -> None:
    low, high = at_ends(part, name)
    for number in range(12):
        first, second = draw_scene(low, number), draw_scene(high, number)
        if first.frame.shape != second.frame.shape or not np.array_equal(first.frame, second.frame):
            return
    pytest.fail("it changes none of twelve scenes")


def test_counts_are_whole_numbers_and_shares_do_not_exceed_the_whole() -> None:
    with pytest.raises(StudyError, match=r"scenes\.over\.bubble_count: give a list of whole numbers"):
        parse_study("[scenes.over]\nbubble_count = [0.5]")
    with pytest.raises(StudyError, match=r"scenes\.scanner\.root_share: with linear_share more than 1"):
        parse_study("[scenes.scanner]\nlinear_share = 0.6\nroot_share = 0.6")
    assert field_unit(next(item for item in fields(SceneEyeStudy) if item.name == "wave_m")).name == "um"
