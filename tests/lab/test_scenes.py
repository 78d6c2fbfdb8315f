"""Drawn scenes: the truth is where it is said to be, physics is what the study says,
and every range matters.
"""

from dataclasses import fields, replace
from typing import Any

import cv2
import numpy as np
import pytest
from scene_studies import only, varied

from scleraforce.base.errors import StudyError
from scleraforce.calibration.answer_metrics import dice
from scleraforce.lab.scenes.drawn_scenes import (
    Scene,
    draw_scene,
    judged_columns,
    seen_columns,
)
from scleraforce.records import study as st
from scleraforce.records.fields import fixed

# of the range of counts: tissue is brighter, noise darker, in a plain scene
SHOWN = 0.35
STUDY = st.ScenesStudy()

SEEN = {
    "rows": 200,
    "columns": 160,
    "width_m": 10e-3,
    "depth_share": 0.4,
    "view_m": 0.0,
    "tilt_rad": 0.0,
}
SPECKLE = {"looks": 10.0, "speckle_rows": 0.5, "speckle_columns": 0.5}
PLAIN = st.ScenesStudy(
    window=only(STUDY.window, surface_share=0.1, **SEEN),
    eye=only(
        STUDY.eye,
        half_sphere_share=1.0,
        sclera_radius_m=12e-3,
        sclera_thickness_m=0.6e-3,
        wave_m=0.0,
    ),
    tissue=only(
        STUDY.tissue, corrected_share=1.0, snr_db=30.0, attenuation_per_m=0.3e3
    ),
    over=only(STUDY.over),
    scanner=only(STUDY.scanner, rolloff_db=0.0, display_floor_db=3.0, **SPECKLE),
)


def plain(**parts: dict[str, Any]) -> st.ScenesStudy:
    """The plain study with other values in some of its parts."""
    return replace(
        PLAIN,
        **{
            name: varied(getattr(PLAIN, name), **values)
            for name, values in parts.items()
        },
    )


def rows_m(scene: Scene, rows: np.ndarray) -> np.ndarray:
    """Depths below the upper edge, m, of rows of pixel centres."""
    return (rows + 0.5) * scene.scale.depth_m


def thickness_m(scene: Scene) -> np.ndarray:
    return (scene.inner_row - scene.outer_row) * scene.scale.depth_m


def lit(scene: Scene) -> np.ndarray:
    """The bright pixels, by the mean of their neighbours."""
    counts = scene.frame.astype(np.float32)
    return cv2.blur(counts, (5, 3)) > SHOWN * counts.max()


def test_the_truth_of_a_half_sphere_is_two_circles():
    scene = draw_scene(PLAIN, 0)
    columns = scene.frame.shape[1]
    top = 0.1 * 4e-3
    x = (np.arange(columns) + 0.5 - columns / 2) * scene.scale.lateral_m
    outer = top + 12e-3 - np.sqrt(12e-3**2 - x**2)
    inner = top + 12e-3 - np.sqrt((12e-3 - 0.6e-3) ** 2 - x**2)
    assert rows_m(scene, scene.outer_row) == pytest.approx(outer, abs=5e-6)
    assert rows_m(scene, scene.inner_row) == pytest.approx(inner, abs=5e-6)

    for number in range(4):  # what is bright is what the truth calls wall
        scene = draw_scene(PLAIN, number)
        assert dice(lit(scene), scene.mask) > 0.93


@pytest.mark.parametrize(("tilt", "within"), [(0.0, 2e-3), (0.5, 0.02)])
def test_a_wall_is_stretched_by_its_refractive_index_along_rays_that_snells_law_bends(
    tilt: float, within: float
):
    uncorrected = {"corrected_share": 0.0, "refractive_index": 1.4}
    tilted = {"tilt_rad": tilt, "facing": 0.0, "surface_share": 0.1}
    scene = draw_scene(
        plain(window=tilted, tissue=uncorrected, eye={"sclera_radius_m": 50e-3}), 0
    )
    seen = thickness_m(scene)[scene.frame.shape[1] // 2]
    assert seen == pytest.approx(
        1.4 * 0.6e-3 / np.cos(np.arcsin(np.sin(tilt) / 1.4)), rel=within
    )
    assert scene.scale.refractive_index == 1.4


def test_the_conjunctiva_lies_over_the_wall_and_outside_of_it():
    covered = {"conjunctiva_share": 1.0, "conjunctiva_m": 200e-6, "conjunctiva_db": 0.0}
    scene = draw_scene(plain(tissue=covered), 0)
    bare = draw_scene(PLAIN, 0)
    middle = scene.frame.shape[1] // 2
    bright = np.flatnonzero(lit(scene)[:, middle])[0]
    assert scene.outer_row[middle] - bright > 100e-6 / scene.scale.depth_m
    assert thickness_m(scene) == pytest.approx(thickness_m(bare), rel=0.05)


def test_an_invisible_wall_does_not_exist_or_is_covered():
    """It does not exist in noise; behind a lid it is not judged but covered."""
    dark = {"attenuation_per_m": 20e3, "snr_db": 0.0, "reflection_db": -30.0}
    weak = draw_scene(
        plain(tissue=dark, scanner={"display_floor_db": -3.0, "looks": 1.0}), 0
    )
    assert not weak.mask.any()
    assert weak.judged.all()
    lid = {"lid_share": 1.0, "lid_reach": 0.2, "lid_m": 2.5e-3, "lid_gap_m": 0.8e-3}
    covered = draw_scene(
        plain(
            over={**lid, "lid_attenuation_per_m": 9e3}, window={"surface_share": 0.4}
        ),
        0,
    )
    hidden = ~covered.judged
    assert np.array_equal(hidden, covered.covered)
    assert not weak.covered.any()
    assert 0.2 < hidden.mean() < 0.4
    assert np.isnan(covered.outer_row[hidden]).all()
    assert np.isfinite(covered.outer_row[covered.judged]).all()


def test_a_steel_needle_shades_the_wall_that_continues_below_it():
    upright = {"needle_angle_rad": 0.0, "needle_m": 0.7e-3, "tip_gap_m": 0.05e-3}
    scene = draw_scene(plain(over={"needle_share": 1.0, **upright}), 3)
    dark = (
        np.nanmean(
            np.where(scene.mask > 0, scene.frame / scene.frame.max(), np.nan), axis=0
        )
        < 0.1
    )
    assert 0.6e-3 < np.count_nonzero(dark) * scene.scale.lateral_m < 0.9e-3
    assert np.isfinite(scene.outer_row).all()


def test_a_wall_above_the_zero_delay_is_mirrored_into_the_frame():
    above = {"surface_share": -0.15}
    there = draw_scene(plain(window=above, scanner={"mirrored_share": 1.0}), 0)
    middle = there.frame.shape[1] // 2
    assert there.inner_row[middle] < 1.0 or np.isnan(there.inner_row[middle])
    mirrored = (
        0.15 * 4e-3 - 0.5 * 0.6e-3
    ) / there.scale.depth_m  # the wall's middle, as far below as it lies above
    assert lit(there)[int(mirrored), middle]
    without = draw_scene(plain(window=above, scanner={"mirrored_share": 0.0}), 0)
    assert not lit(without)[int(mirrored), middle]


def test_black_bands_and_a_pages_sides_show_no_wall_nor_do_columns_where_it_leaves_the_frame():
    scene = draw_scene(plain(scanner={"band_share": 1.0, "band_fraction": 0.1}), 0)
    band = round(0.1 * scene.frame.shape[1])
    assert not scene.frame[:, :band].any()
    assert np.isnan(scene.outer_row[:band]).all()
    assert np.isfinite(scene.outer_row[band:-band]).all()
    low = draw_scene(plain(window={"surface_share": 0.8}), 0)
    gone = np.isnan(low.outer_row)
    assert gone[[0, len(gone) // 2, -1]].tolist() == [True, False, True]
    assert not low.mask[:, gone].any()
    page = plain(
        scanner={"margin_share": 1.0, "margin_fraction": 0.1, "margin_level": 1.0}
    )
    scenes = [draw_scene(page, number) for number in range(6)]
    white = [(scene.frame == scene.frame.max()).all(axis=0) for scene in scenes]
    assert np.concatenate(white).any()
    assert all(
        np.isnan(scene.outer_row[columns]).all()
        for scene, columns in zip(scenes, white, strict=True)
    )


# A study in which everything is there.
PIXELS = st.Range(min=1e-6, max=200e-6)
FULL = st.ScenesStudy(
    window=varied(
        STUDY.window,
        rows=64,
        columns=72,
        pixel_m=PIXELS,
        width_m=15e-3,
        depth_share=0.45,
        centred_share=1.0,
        deep_share=0.0,
    ),
    eye=only(STUDY.eye, 1.0, half_sphere_share=0.0),
    tissue=only(STUDY.tissue, 1.0, 2, corrected_share=0.0),
    over=only(STUDY.over, 1.0, 2, speck_count=100, vessel_count=3, glass_share=0.0),
    scanner=only(
        STUDY.scanner, 1.0, 2, averaged_share=0.0, linear_share=0.0, root_share=0.0
    ),
)


# what must be there for a range to show
NEEDS = {
    "glass_pass": {"glass_share": 1.0},
    "averaged_": {"averaged_share": 1.0},
    "sclera_thickness_m": {"half_sphere_share": 1.0},
    "deep_": {"deep_share": 1.0},
}
# a line thinner than a pixel is drawn as one of a pixel, a gap as one of two
NEAR = {"width_m": 4e-3}
SMALL_WINDOWS = {
    "line_m": NEAR,
    "speckle_rows": NEAR,
    "axial_m": NEAR,
    "gap_m": {**NEAR, "view_m": 9e-3, "centred_share": 0.0},
}


@pytest.mark.parametrize(
    ("part", "name"),
    [
        (part, item.name)
        for part in ("window", "eye", "tissue", "over", "scanner")
        for item in fields(getattr(FULL, part))
    ],
)
def test_both_ends_of_each_range_differ_in_one_of_twelve_scenes(part: str, name: str):
    default = getattr(getattr(STUDY, part), name)
    ends = (0.0, 1.0) if isinstance(default, float) else default.bounds
    if name == "pixel_m":
        ends = (PIXELS, st.Range(min=1e-6, max=50e-6))

    needs = {}
    for start, things in NEEDS.items():
        needs |= things if name.startswith(start) else {}

    window = varied(FULL.window, **SMALL_WINDOWS.get(name, {}))
    near = replace(FULL, window=window)
    record = getattr(near, part)
    studies = [
        replace(near, **{part: varied(record, **(needs | {name: end}))}) for end in ends
    ]
    pairs = (
        [draw_scene(study, number).frame for study in studies] for number in range(12)
    )
    assert any(not np.array_equal(low, high) for low, high in pairs)


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("[scenes.over]\nbubble_count = [0.5]", "scenes.over.bubble_count"),
        (
            "[scenes.scanner]\nlinear_share = 0.6\nroot_share = 0.6",
            "scenes.scanner.root_share: with linear_share more than 1",
        ),
    ],
)
def test_counts_are_whole_numbers_and_shares_do_not_exceed_the_whole(
    text: str, key: str
):
    with pytest.raises(StudyError, match=key):
        st.parse_study(text)


def test_averaged_frames_have_smooth_noise_and_in_part_smooth_tissue():
    """The tissue moves less than the noise between the frames, by a share that is
    drawn.
    """
    many = {"averaged_share": 1.0, "averaged_frames": 100.0, "averaged_floor_db": -3.0}
    studies = [
        plain(scanner=scanner)
        for scanner in ({"looks": 1.0, "display_floor_db": -3.0}, many)
    ]
    spread = np.array(
        [
            [changes(draw_scene(study, number)) for number in range(6)]
            for study in studies
        ]
    )
    tissue, noise = np.moveaxis(spread[1] / spread[0], 1, 0)
    assert (noise < 0.3).all()
    assert 2.0 * tissue.min() < tissue.max() < 0.5


def changes(scene: Scene) -> tuple[float, float]:
    """Mean difference of counts from the next ones below, within the wall and above
    it.
    """
    steps = np.diff(scene.frame / scene.frame.max(), axis=0)
    row = np.arange(1, len(scene.frame))[:, None]
    inside = (row > scene.outer_row + 6) & (row < scene.inner_row - 6)
    above = row < scene.outer_row - 6
    return float(np.std(steps[inside])), float(np.std(steps[above]))


def test_an_eye_with_a_cornea_has_a_sclera_as_thick_as_its_cornea_demands_and_a_deep_view_its_own_size():
    eye = {
        "half_sphere_share": 0.0,
        "cornea_thickness_m": 0.5e-3,
        "sclera_ratio": 1.6,
        "spur_bump_m": 0.0,
    }
    scene = draw_scene(
        plain(eye=eye, window={"view_m": 11e-3, "width_m": 4e-3, "facing": 1.0}), 0
    )
    assert thickness_m(scene)[scene.frame.shape[1] // 2] == pytest.approx(
        0.8e-3, rel=0.04
    )
    study = plain(window={"deep_share": 1.0, "deep_width_m": 15e-3}).of_one(
        np.random.default_rng(0)
    )
    assert (study.eye.half_sphere_share, study.window.width_m) == (0.0, fixed(15e-3))


ROWS = 200
COLUMNS = 160
SURFACE = np.full(COLUMNS, 60.0)
INNER = np.full(COLUMNS, 110.0)


def banded(level: float, first: int = 60, last: int = 110) -> np.ndarray:
    """Noise, and a band that is brighter."""
    counts = np.random.default_rng(0).exponential(20.0, (ROWS, COLUMNS))
    counts[first:last] += level
    return counts.astype(np.uint16)


@pytest.mark.parametrize(
    ("band", "surface", "inner", "low", "high"),
    [
        # from half a standard deviation of the noise on
        ((20.0,), 60.0, 110.0, 0.9, 1.0),
        ((2.0,), 60.0, 110.0, 0.0, 0.2),
        # at one of its boundaries
        ((40.0, 60, ROWS), 60.0, 110.0, 1.0, 1.0),
        ((40.0, 0, 110), 60.0, 110.0, 1.0, 1.0),
        ((40.0, 0, ROWS), 60.0, 110.0, 0.0, 0.03),
        # below something bright, or outside of the frame
        ((300.0, 20, 60), 60.0, 190.0, 0.0, 0.0),
        ((60.0, 0, 110), -20.0, 300.0, 0.0, 0.0),
    ],
)
def test_a_wall_is_seen_by_a_step_of_light_at_one_of_its_boundaries_in_the_frame(
    band: tuple[float, ...], surface: float, inner: float, low: float, high: float
):
    boundaries = (np.full(COLUMNS, row) for row in (surface, inner))
    assert low <= seen_columns(banded(*band), *boundaries).mean() <= high


def test_narrow_shadows_are_bridged_and_wide_ones_are_not_judged():
    counts = banded(60.0)
    counts[60:110, 40:55] -= 60
    counts[60:110, 100:140] -= 60
    seen, judged = judged_columns(counts, SURFACE, SURFACE, INNER)
    assert seen[:95].all()
    assert not seen[105:135].any()
    assert np.array_equal(seen, judged)
