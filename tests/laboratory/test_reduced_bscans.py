"""Frames that are drawn reduced look as rendered ones do that are reduced afterwards."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from scleraforce.laboratory.bscan import draw_shaft, render_bscan
from scleraforce.laboratory.light import (
    NO_LIGHT_DB,
    BscanOptics,
    Cover,
    Displayed,
    Line,
    NeedleShaft,
    sample_conjunctiva,
    sample_optics,
)
from scleraforce.laboratory.reduced_bscans import DrawnFrames, draw_reduced
from scleraforce.mechanics.contact import Section
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.reduced import FrameWindow
from scleraforce.study import Study, fixed

STUDY = Study()
WINDOW, SCALE = FrameWindow(rows=80, columns=144, row_m=50e-6, column_m=100e-6), PixelScale.of(STUDY.oct)
THICKNESS_M, DENT_M = 0.6e-3, 0.8e-3
FRAMES = 6
NEEDLE = NeedleShaft(
    diameter_m=0.7e-3,
    gap_m=0.1e-3,
    angle_rad=0.3,
    lean_rad=0.0,
    bevel_rad=np.pi / 2,
    above_m=2e-3,
    loss_fraction=1.0,
    level_db=28.0,
    far_edge_db=-6.0,
)


def surface(lateral_m: np.ndarray) -> np.ndarray:
    """Return the depth of a dented wall's surface."""
    return 12e-3 - np.sqrt(144e-6 - lateral_m**2) + 0.5e-3 + DENT_M * np.exp(-((lateral_m / 1.2e-3) ** 2))


def optics(seed: int = 3, **changes: object) -> BscanOptics:
    """Return the optics of a frame: one line, shadows, and what is changed."""
    return replace(sample_optics(STUDY.phantom, STUDY.oct, np.random.default_rng(seed)), **changes)


def rendered(of: BscanOptics, scanner=STUDY.oct) -> np.ndarray:
    """Return rendered frames of the wall, reduced (frame, row, column)."""
    lateral = np.linspace(-9e-3, 9e-3, 3000)
    outer = np.stack([lateral, surface(lateral)], axis=1)
    section = Section(outer, outer + np.array([0.0, THICKNESS_M]))
    shaft = draw_shaft(of.needle, np.array([0.0, surface(np.zeros(1))[0]]), 0.0, scanner) if of.needle else None
    frames = [render_bscan(section, scanner, of, np.random.default_rng(seed), shaft).frame for seed in range(FRAMES)]
    return np.stack([WINDOW.reduced(frame, PixelScale.of(scanner)) for frame in frames])


def drawn(of: BscanOptics, scanner=STUDY.oct, count: int = FRAMES) -> DrawnFrames:
    """Return frames of the wall that are drawn reduced."""
    outer = surface(WINDOW.laterals_m)
    depth = np.repeat(np.stack([outer, outer + THICKNESS_M])[None], count, axis=0)
    cells = replace(
        scanner,
        width_m=WINDOW.columns * WINDOW.column_m,
        depth_m=WINDOW.rows * WINDOW.row_m,
        columns=WINDOW.columns,
        rows=WINDOW.rows,
    )
    tip = np.array([0.0, surface(np.zeros(1))[0]])
    shafts = [draw_shaft(of.needle, tip, 0.0, cells)] * count if of.needle else []
    return draw_reduced(depth, [of] * count, scanner, WINDOW, np.random.default_rng(7), shafts)


def test_a_display_shows_speckle_as_drawn_values_do() -> None:
    drawn_by = [
        optics(1),
        optics(2, display_floor_db=-2.0, display_range_db=20.0),
        optics(3, display="linear"),
        optics(4, display="root"),
    ]
    displayed, rng = Displayed(drawn_by), np.random.default_rng(1)
    for level_db in (NO_LIGHT_DB, 3.0, 14.0, 31.0):
        light = 0.0 if level_db == NO_LIGHT_DB else 10.0 ** (level_db / 10.0)
        seen_db = 10.0 * np.log10((1.0 + light) * rng.exponential(size=200_000))
        mean, variance = displayed.moments(np.full((4, 1, 1), level_db, dtype=np.float32))
        for number, of in enumerate(drawn_by):
            share = (seen_db - of.display_floor_db) / of.display_range_db
            if power := {"linear": 1.0, "root": 0.5}.get(of.display):
                brightest = 10.0 ** (power * of.display_range_db / 10.0)
                share = (brightest**share - 1.0) / (brightest - 1.0)
            counts = np.clip(share, 0.0, 1.0)
            assert mean[number, 0, 0] == pytest.approx(counts.mean(), abs=4e-3)
            assert variance[number, 0, 0] == pytest.approx(counts.var(), rel=0.15, abs=2e-3)


LAYER = sample_conjunctiva(
    replace(STUDY.phantom, conjunctiva_thickness_m=fixed(0.16e-3), conjunctiva_level_db=fixed(-5.0)),
    np.random.default_rng(2),
)
CASES = {
    "plain": optics(),
    "conjunctiva": optics(conjunctiva=LAYER),
    "needle": optics(needle=NEEDLE),
    "coarse speckle": optics(axial_resolution_m=18e-6, lateral_resolution_m=75e-6),
    "noise": optics(snr_db=10.0),
    "linear display": optics(display="linear", snr_db=26.0),
    "cover": optics(
        lines=(Line(depth_m=0.2e-3, level_db=12.0, thickness_m=24e-6),),
        covers=(Cover(height_m=0.2e-3, level_db=18.0, thickness_m=24e-6, tilt_rad=0.01),),
    ),
}


@pytest.mark.parametrize("of", CASES.values(), ids=CASES)
def test_the_mean_picture_is_the_rendered_one(of: BscanOptics) -> None:
    expected, found = rendered(of).mean(axis=0), drawn(of).frames.mean(axis=0)
    blocks = (found - expected).reshape(20, 4, 36, 4).mean(axis=(1, 3))  # over which the speckle averages out
    assert np.abs(blocks).mean() < 0.03
    assert np.quantile(np.abs(blocks), 0.97) < 0.12
    for column in (30, 100):  # beside dent and needle: where the profile passes half its height at both edges
        top = round(float(surface(WINDOW.laterals_m[[column]])[0]) / WINDOW.row_m)
        seen = [picture[top - 3 : top + 10, column] for picture in (expected, found)]
        first, after = ([int(np.argmax(part[::way] > 0.5)) for part in seen] for way in (1, -1))
        slack = 2 if of.display == "linear" else 1  # its speckle varies by as much as it has light
        assert abs(first[0] - first[1]) <= slack
        assert abs(after[0] - after[1]) <= slack


@pytest.mark.parametrize("name", ["plain", "coarse speckle", "noise"])
def test_cells_vary_as_those_of_rendered_frames(name: str) -> None:
    expected, found = (frames.std(axis=0, ddof=1) for frames in (rendered(CASES[name]), drawn(CASES[name]).frames))
    for part in ((slice(60, 80), slice(20, 120)), (slice(16, 22), slice(40, 54))):  # noise, wall
        assert np.median(found[part]) == pytest.approx(np.median(expected[part]), rel=0.25)


def test_a_scanner_that_does_not_correct_its_depth_stretches_the_wall() -> None:
    stretched = replace(STUDY.oct, refractive_index=1.38)
    expected, found = rendered(optics(), stretched).mean(axis=0), drawn(optics(), stretched).frames.mean(axis=0)
    assert np.abs(found - expected).mean() < 0.035
    rows = drawn(optics(), stretched).boundary_rows[0, :, 72]
    assert (rows[1] - rows[0]) * WINDOW.row_m == pytest.approx(1.38 * THICKNESS_M, rel=1e-6)


def test_boundaries_are_the_walls_and_end_with_the_picture() -> None:
    found = drawn(optics(band_m=1.2e-3), count=1).boundary_rows[0]
    lit = np.abs(WINDOW.laterals_m) < 7.5e-3 - 1.2e-3
    assert np.isnan(found[:, ~lit]).all()
    expected = surface(WINDOW.laterals_m[lit]) / WINDOW.row_m - 0.5
    np.testing.assert_allclose(found[0, lit], expected)
    np.testing.assert_allclose(found[1, lit] - found[0, lit], THICKNESS_M / WINDOW.row_m)


def test_the_wall_below_a_conjunctiva_stays_where_it_is() -> None:
    bare, covered = (partial(drawn, count=1)(of).boundary_rows for of in (optics(), optics(conjunctiva=LAYER)))
    np.testing.assert_allclose(covered, bare)


def test_equal_seeds_draw_equal_frames() -> None:
    np.testing.assert_array_equal(drawn(optics()).frames, drawn(optics()).frames)
