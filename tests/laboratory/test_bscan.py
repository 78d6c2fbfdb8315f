from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import stats

from scleraforce.laboratory.bscan import column_crossings, render_bscan
from scleraforce.laboratory.light import (
    BscanOptics,
    Conjunctiva,
    Cover,
    Line,
    Pose,
    Shadow,
    sample_optics,
    sample_pose,
)
from scleraforce.mechanics.contact import Section
from scleraforce.study import OctStudy, Study

# 16 bits over 120 dB: the intensity can be read back from the counts to 0.05 %.
SCANNER = OctStudy(bits=16)
CLEAR = BscanOptics(
    snr_db=70.0,
    attenuation_per_m=0.0,
    axial_resolution_m=1e-6,
    lateral_resolution_m=1e-6,
    reflection_db=-60.0,
    reflection_angle_rad=0.1,
    choroid_level_db=-80.0,
    choroid_attenuation_per_m=0.0,
    choroid_thickness_m=100e-6,
    display_floor_db=-40.0,
    display_range_db=120.0,
    band_m=0.0,
)
FLAT_TOP_M, FLAT_THICKNESS_M = 1e-3, 1.5e-3


def flat_wall(top_m=FLAT_TOP_M, thickness_m=FLAT_THICKNESS_M, slope=0.0):
    lateral = np.array([-20e-3, 20e-3])
    outer = np.stack([lateral, top_m + slope * lateral], axis=1)
    return Section(outer, outer + np.array([0.0, thickness_m]))


def folded_wall():
    """A mushroom-shaped dent: beside its neck, a vertical line passes through the wall three times."""

    def curve(top, neck, radius):
        angle = np.linspace(-np.pi + np.arcsin(neck / radius), np.pi - np.arcsin(neck / radius), 40)
        bulb = np.stack([radius * np.sin(angle), 2.1 + radius * np.cos(angle)], axis=1)
        return np.array([[-20.0, top], [-neck, top], *bulb, [neck, top], [20.0, top]]) * 1e-3

    return Section(curve(0.7, 0.4, 1.0), curve(0.95, 0.65, 1.25))


def intensity(frame, optics=CLEAR, bits=16):
    return 10 ** ((frame / (2**bits - 1) * optics.display_range_db + optics.display_floor_db) / 10)


def render(section, optics, oct_study=SCANNER, seed=0):
    return render_bscan(section, oct_study, optics, np.random.default_rng(seed))


def rows_of(top_m, bottom_m):
    return slice(int(top_m / SCANNER.depth_m * SCANNER.rows) + 2, int(bottom_m / SCANNER.depth_m * SCANNER.rows) - 2)


WALL_ROWS = rows_of(FLAT_TOP_M, FLAT_TOP_M + FLAT_THICKNESS_M)


def test_speckle_intensity_is_exponential_with_contrast_one():
    seen = intensity(render(flat_wall(), CLEAR).frame)[WALL_ROWS]
    assert seen.std() / seen.mean() == pytest.approx(1.0, abs=0.01)
    assert stats.kstest(seen.ravel()[:20_000] / seen.mean(), "expon").pvalue > 0.01


def test_detector_noise_is_exponential_with_mean_one():
    seen = intensity(render(flat_wall(), CLEAR).frame)[: int(0.2 * SCANNER.rows)]
    assert seen.mean() == pytest.approx(1.0, abs=0.02)
    assert seen.std() == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("snr_db", [15.0, 25.0, 35.0])
def test_signal_over_noise_at_the_surface_is_the_one_asked_for(snr_db):
    optics = replace(CLEAR, snr_db=snr_db, attenuation_per_m=1000.0)
    seen = intensity(render(flat_wall(), optics).frame)
    depth_m = (np.arange(SCANNER.rows) + 0.5) * SCANNER.depth_m / SCANNER.rows - FLAT_TOP_M
    rows = slice(WALL_ROWS.start, WALL_ROWS.start + 10)
    at_surface = (seen[rows].mean(axis=1) - 1.0) * np.exp(2 * 1000.0 * depth_m[rows])
    assert 10 * np.log10(at_surface.mean()) == pytest.approx(snr_db, abs=0.15)


@pytest.mark.parametrize("attenuation_per_m", [500.0, 1500.0])
@pytest.mark.parametrize("refractive_index", [1.0, 1.38])
def test_intensity_falls_with_twice_the_attenuation_in_geometric_depth(attenuation_per_m, refractive_index):
    oct_study = replace(SCANNER, refractive_index=refractive_index)
    seen = intensity(render(flat_wall(), replace(CLEAR, attenuation_per_m=attenuation_per_m), oct_study).frame)
    geometric_m = np.arange(SCANNER.rows) * SCANNER.depth_m / SCANNER.rows / refractive_index
    slope = np.polyfit(geometric_m[WALL_ROWS], np.log(seen[WALL_ROWS].mean(axis=1)), 1)[0]
    assert slope == pytest.approx(-2 * attenuation_per_m, rel=0.02)


def test_tissue_below_the_surface_is_stretched_by_the_refractive_index():
    for index in (1.0, 1.38, 1.6):
        mask = render(flat_wall(), CLEAR, replace(SCANNER, refractive_index=index)).truth_mask
        filled = np.flatnonzero(mask[:, 100])
        assert filled[0] == round(FLAT_TOP_M / SCANNER.depth_m * SCANNER.rows)
        assert len(filled) == pytest.approx(index * FLAT_THICKNESS_M / SCANNER.depth_m * SCANNER.rows, abs=1)


def test_point_spread_function_correlates_speckle_as_its_width_says_and_keeps_its_mean():
    # A Gaussian amplitude spread s correlates the intensity of speckle as exp(-d^2/(2 s^2)); s = width/(2 sqrt(ln 2)).
    pixel_m = np.array([SCANNER.depth_m / SCANNER.rows, SCANNER.width_m / SCANNER.columns])
    width = np.array([5.0, 8.0])
    optics = replace(CLEAR, axial_resolution_m=width[0] * pixel_m[0], lateral_resolution_m=width[1] * pixel_m[1])
    seen = np.stack([intensity(render(flat_wall(), optics, seed=seed).frame)[80:380] for seed in range(3)])[:, 60:240]
    assert seen.mean() == pytest.approx(10**7.0, rel=0.05)
    for axis, lag in ((1, 3), (2, 5)):
        sigma = width[axis - 1] / (2 * np.sqrt(np.log(2)))
        one, other = np.delete(seen, np.s_[:lag], axis), np.delete(seen, np.s_[-lag:], axis)
        measured = np.corrcoef(one.ravel(), other.ravel())[0, 1]
        assert measured == pytest.approx(np.exp(-(lag**2) / (2 * sigma**2)), abs=0.05)


def test_reflection_line_stands_in_its_row_with_its_level():
    optics = replace(CLEAR, lines=(Line(depth_m=0.2e-3, level_db=20.0, thickness_m=8e-6),))
    mean = intensity(render(flat_wall(), optics).frame).mean(axis=1)
    assert np.argmax(mean[:100]) in (25, 26)  # 0.2 mm is the edge between the rows 25 and 26
    sigma_rows = 8e-6 / (2 * np.sqrt(np.log(2))) / (SCANNER.depth_m / SCANNER.rows)
    assert mean[:100].max() - 1 == pytest.approx(100 * np.exp(-((0.1 / sigma_rows) ** 2)), rel=0.1)


def test_cover_line_lies_its_height_above_the_tissue_and_is_tilted():
    cover = Cover(height_m=0.4e-3, level_db=30.0, thickness_m=8e-6, tilt_rad=0.02)
    rows = intensity(render(flat_wall(), replace(CLEAR, covers=(cover,))).frame)[:120].argmax(axis=0)
    lateral_m = (np.arange(512) + 0.5) / 512 * SCANNER.width_m - SCANNER.width_m / 2
    expected = (FLAT_TOP_M - 0.4e-3 + np.tan(0.02) * lateral_m) / SCANNER.depth_m * SCANNER.rows - 0.5
    assert np.abs(rows - expected).max() <= 1.0


def test_bands_are_black_and_hold_no_truth():
    bscan = render(flat_wall(), replace(CLEAR, band_m=0.5e-3))
    for image in (bscan.frame, bscan.truth_mask):
        assert not image[:, :17].any()
        assert not image[:, -17:].any()
        assert image[:, 17].any()
        assert image[:, -18].any()


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_bright_tissue_saturates_at_the_largest_count_of_the_bits(bits):
    frame = render(flat_wall(), replace(CLEAR, display_range_db=80.0), replace(SCANNER, bits=bits)).frame
    assert frame.dtype == np.uint16
    assert frame.max() == 2**bits - 1
    assert (frame[WALL_ROWS] == frame.max()).mean() > 0.99


def test_shadow_takes_its_share_of_the_light_within_its_width():
    shadow = Shadow(centre_m=2e-3, width_m=2e-3, loss_fraction=0.6)
    seen = intensity(render(flat_wall(), replace(CLEAR, shadows=(shadow,))).frame)[WALL_ROWS].mean(axis=0)
    lateral_m = (np.arange(512) + 0.5) / 512 * SCANNER.width_m - SCANNER.width_m / 2
    away = np.abs(lateral_m - 2e-3)
    light = seen[away > 3e-3].mean()
    assert seen[away < 0.5e-3].mean() / light == pytest.approx(0.4, rel=0.07)
    assert seen[np.abs(away - 1e-3) < 0.05e-3].mean() / light == pytest.approx(0.7, rel=0.12)


def test_choroid_is_weaker_by_its_level_and_falls_with_its_own_attenuation():
    optics = replace(
        CLEAR,
        choroid_level_db=-10.0,
        choroid_attenuation_per_m=4000.0,
        choroid_thickness_m=300e-6,
        attenuation_per_m=700.0,
    )
    seen = intensity(render(flat_wall(), optics).frame).mean(axis=1)
    bottom_m = FLAT_TOP_M + FLAT_THICKNESS_M
    rows = np.arange(rows_of(bottom_m, bottom_m).start, rows_of(bottom_m, bottom_m + 300e-6).stop)
    below_m = (rows + 0.5) * SCANNER.depth_m / SCANNER.rows - bottom_m
    slope, start = np.polyfit(below_m, np.log(seen[rows]), 1)
    assert slope == pytest.approx(-8000.0, rel=0.05)
    last_of_wall = 10**7.0 * np.exp(-2 * 700.0 * FLAT_THICKNESS_M)
    assert np.exp(start) / last_of_wall == pytest.approx(0.1, rel=0.08)
    assert seen[rows[-1] + 6 :].max() < 2.0


LAYER = Conjunctiva(
    thickness_m=200e-6, wave_fraction=0.25, wave_length_m=5e-3, phase_rad=0.7, level_db=-6.0, interface_db=-60.0
)


def test_a_conjunctiva_lies_over_the_wall_weaker_by_its_level_and_is_none_of_the_truth():
    optics = replace(CLEAR, conjunctiva=LAYER)
    lateral = np.linspace(-20e-3, 20e-3, 2001)
    outer = np.stack([lateral, np.full(2001, FLAT_TOP_M)], axis=1)
    wall = Section(outer, outer + np.array([0.0, FLAT_THICKNESS_M]))
    bare, under = render(wall, CLEAR), render(wall, optics)
    seen = intensity(under.frame)
    pixel_m = SCANNER.depth_m / SCANNER.rows
    lateral_m = (np.arange(512) + 0.5) / 512 * SCANNER.width_m - SCANNER.width_m / 2
    thick_m = 200e-6 * (1 + 0.25 * np.cos(2 * np.pi * lateral_m / 5e-3 + 0.7))
    first = (seen > 1e4).argmax(axis=0)  # a hundredth of the layer's light
    top = (FLAT_TOP_M - thick_m) / pixel_m
    assert np.abs(first - top).mean() < 0.7
    # From the layer's surface on, tissue is stretched by the refractive index.
    below_row = top + thick_m * SCANNER.refractive_index / pixel_m
    assert np.abs(under.truth_mask.argmax(axis=0) - below_row).max() <= 1.0
    rows = np.arange(512)[:, None]
    within = (rows > top + 2) & (rows < below_row - 2)
    below = (rows > below_row + 2) & (rows < below_row + 100)
    assert seen[within].mean() / seen[below].mean() == pytest.approx(10**-0.6, rel=0.02)
    assert abs(under.truth_mask.sum(axis=0, dtype=int) - bare.truth_mask.sum(axis=0, dtype=int)).max() <= 255


def test_a_conjunctiva_ends_where_its_wall_ends():
    """Columns beside the wall have neither; nothing is computed with them that is no number."""
    lateral = np.linspace(-3e-3, 3e-3, 301)
    outer = np.stack([lateral, np.full(301, FLAT_TOP_M)], axis=1)
    small = Section(outer, outer + np.array([0.0, FLAT_THICKNESS_M]))
    frame = render(small, replace(CLEAR, conjunctiva=LAYER))
    seen = intensity(frame.frame) > 1e4
    beside = np.abs((np.arange(512) + 0.5) / 512 * SCANNER.width_m - SCANNER.width_m / 2) > 3.05e-3
    assert not seen[:, beside].any()
    assert seen[:, ~beside].any(axis=0).mean() > 0.97
    assert (render(Section(outer + 1.0, outer + 1.1), replace(CLEAR, conjunctiva=LAYER)).truth_mask == 0).all()


def test_light_is_attenuated_in_the_conjunctiva_as_in_the_wall():
    optics = replace(CLEAR, attenuation_per_m=800.0)
    even = replace(LAYER, wave_fraction=0.0, level_db=0.0)
    bare = intensity(render(flat_wall(), optics).frame)
    under = intensity(render(flat_wall(), replace(optics, conjunctiva=even)).frame)
    rows = rows_of(FLAT_TOP_M + 0.6e-3, FLAT_TOP_M + 1.2e-3)
    # The wall is seen deeper by the layer's optical over its geometric thickness.
    shift = (SCANNER.refractive_index - 1) * 200e-6 / SCANNER.refractive_index
    expected = np.exp(-2 * 800.0 * (200e-6 - shift))
    assert under[rows].mean() / bare[rows].mean() == pytest.approx(expected, rel=0.03)


def test_the_walls_surface_below_a_conjunctiva_reflects_as_stated():
    optics = replace(CLEAR, snr_db=40.0, conjunctiva=replace(LAYER, wave_fraction=0.0, interface_db=20.0))
    seen = intensity(render(flat_wall(), optics).frame).mean(axis=1)
    row = (FLAT_TOP_M + (SCANNER.refractive_index - 1) * 200e-6) / (SCANNER.depth_m / SCANNER.rows)
    assert abs(seen.argmax() + 0.5 - row) <= 1.0
    assert seen.max() > 20 * 1e4


def test_mirror_reflection_is_seen_at_normal_incidence_and_lost_on_a_slope():
    optics = replace(CLEAR, snr_db=40.0, reflection_db=20.0)
    surface_row = round(FLAT_TOP_M / SCANNER.depth_m * SCANNER.rows)

    def brightest(slope):
        seen = intensity(render(flat_wall(slope=slope), optics).frame)
        return seen[surface_row - 3 : surface_row + 3, 250:262].max(axis=0).mean() / seen[WALL_ROWS].mean()

    assert brightest(0.0) > 20.0
    assert brightest(np.tan(0.35)) < 8.0


def test_wall_that_folds_over_is_filled_as_a_naive_winding_number_says():
    section = folded_wall()
    oct_study = OctStudy(columns=96, rows=64)
    mask = render(section, CLEAR, oct_study).truth_mask
    fine = 8
    lateral_m = (np.arange(96) + 0.5) / 96 * oct_study.width_m - oct_study.width_m / 2
    depth_m = (np.arange(64 * fine) + 0.5) / (64 * fine) * oct_study.depth_m
    closed = np.concatenate([section.contour, section.contour[:1]])
    to = closed[None, None] - np.stack(np.meshgrid(lateral_m, depth_m), axis=-1)[:, :, None]
    angle = np.arctan2(to[..., 1], to[..., 0])
    turns = np.rint(((np.diff(angle, axis=-1) + np.pi) % (2 * np.pi) - np.pi).sum(axis=-1) / (2 * np.pi))
    coverage = (turns != 0).reshape(64, fine, 96).mean(axis=1)
    crossings = column_crossings(closed, lateral_m)
    assert np.isfinite(crossings).sum(axis=0).max() == 6  # the fold is there
    clear = np.abs(coverage - 0.5) > 2 / fine
    assert (mask[clear] == 255 * (coverage[clear] > 0.5)).all()
    assert clear.mean() > 0.9


def test_wall_that_overlaps_itself_stays_filled():
    loop = np.array(
        [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0], [0.0, 1.0], [4.0, 1.0], [4.0, 3.0], [0.0, 3.0], [0.0, 0.0]]
    )
    crossings = column_crossings(loop, np.array([1.0, 2.0, 3.0]))
    assert crossings.tolist() == [[0.0] * 3, [3.0] * 3]


def test_dent_that_leaves_the_window_is_cut_at_its_edge():
    mask = render(flat_wall(top_m=3.9e-3), CLEAR).truth_mask
    filled = np.flatnonzero(mask[:, 10])
    assert filled[0] == round(3.9 / 4 * 512)
    assert filled[-1] == 511


def test_wall_that_begins_above_the_window_still_shadows_what_is_in_it():
    seen = intensity(render(flat_wall(top_m=-0.5e-3), replace(CLEAR, attenuation_per_m=1000.0)).frame)
    assert seen[:5].mean() == pytest.approx(10**7.0 * np.exp(-2 * 1000.0 * 0.52e-3), rel=0.06)


def test_frame_without_tissue_is_noise_only():
    bscan = render(
        flat_wall(top_m=9e-3),
        replace(CLEAR, covers=(Cover(height_m=0.1e-3, level_db=10.0, thickness_m=8e-6, tilt_rad=0.0),)),
    )
    assert not bscan.truth_mask.any()
    aside = np.array([[50e-3, 0.0], [60e-3, 0.0]])
    assert intensity(render(Section(aside, aside + 1e-3), CLEAR).frame).mean() == pytest.approx(1.0, abs=0.02)


def test_pose_moves_and_turns_the_section():
    placed = Pose(lateral_m=1e-3, depth_m=2e-3, tilt_rad=np.pi / 2).place(
        Section(np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]]))
    )
    assert placed.outer == pytest.approx(np.array([[1e-3, 1.002]]))
    assert placed.inner == pytest.approx(np.array([[-0.999, 2e-3]]))


def test_same_seed_gives_the_same_frame_and_another_seed_another():
    optics = sample_optics(Study().phantom, OctStudy(), np.random.default_rng(3))
    frames = [render(flat_wall(), optics, OctStudy(), seed).frame for seed in (1, 1, 2)]
    assert (frames[0] == frames[1]).all()
    assert (frames[0] != frames[2]).any()


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_any_optics_of_the_study_are_within_its_ranges_and_give_a_frame(seed):
    study, rng = Study(), np.random.default_rng(seed)
    optics, pose = sample_optics(study.phantom, study.oct, rng), sample_pose(study.phantom, rng)
    assert 15.0 <= optics.snr_db <= 35.0
    assert 500.0 <= optics.attenuation_per_m <= 1500.0
    assert len(optics.shadows) <= 3
    assert all(0.2 <= shadow.loss_fraction <= 0.6 for shadow in optics.shadows)
    assert len(optics.lines) == 1
    assert abs(pose.lateral_m) <= 0.2e-3
    oct_study = OctStudy(columns=64, rows=64)
    bscan = render_bscan(pose.place(folded_wall()), oct_study, optics, rng)
    assert bscan.frame.shape == (64, 64)
    assert bscan.frame.max() < 2**12


@pytest.mark.parametrize(("display", "shown"), [("linear", lambda light: light), ("root", np.sqrt)])
def test_a_linear_display_shows_the_intensity_itself_and_one_of_roots_its_root(display: str, shown) -> None:
    scales = replace(CLEAR, snr_db=20.0, display_floor_db=-10.0, display_range_db=50.0)
    logarithmic, found = (
        render(flat_wall(), replace(scales, display=name)).frame / (2**SCANNER.bits - 1)
        for name in ("logarithmic", display)
    )
    intensity = 10.0 ** ((50.0 * logarithmic - 10.0) / 10.0)
    lit = (logarithmic > 0.0) & (logarithmic < 1.0)
    expected = (shown(intensity) - shown(0.1)) / (shown(1e4) - shown(0.1))
    np.testing.assert_allclose(found[lit], expected[lit], rtol=2e-3, atol=2e-5)
    wall = {"linear": 0.01, "root": 0.086}[display]  # light of 100 times the noise, of 10,000
    assert found[300, 200:300].mean() == pytest.approx(wall, rel=0.3)
