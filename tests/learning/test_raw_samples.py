"""Samples of the raw reader: frames show the walls of their eyes, and more of them changes nothing of the others."""

from dataclasses import replace

import numpy as np
import pytest
from analytic_library import analytic_library

from scleraforce.learning.descent import drawn_ahead
from scleraforce.learning.raw_reader import (
    FRAMES_TOGETHER,
    RawSource,
    draw_optics,
    draw_shafts,
    largest_needle_gap,
    pair_rows,
)
from scleraforce.reader.networks import GIVEN
from scleraforce.segmentation.reduced import FrameWindow
from scleraforce.study import RawReaderStudy, Study, fixed

STUDY = Study(raw_reader=RawReaderStudy(rows=80, columns=144, row_m=50e-6, column_m=100e-6))
COUNT = 60


@pytest.fixture(scope="module")
def source() -> RawSource:
    return RawSource.of(analytic_library(thicknesses=5, ratios=5, tips=24), STUDY)


def study_with(**raw: object) -> Study:
    """Return a study whose raw reader sees frames without needle or conjunctiva by the scanner of [phantom] alone."""
    none = {"needle_share": 0.0, "conjunctiva_share": 0.0, "snr_loss_db": fixed(0.0), "speckle_factor": fixed(1.0)}
    return replace(STUDY, raw_reader=replace(STUDY.raw_reader, **{**none, **raw}))


@pytest.mark.slow
def test_a_chunk_is_the_same_wherever_it_is_drawn(source: RawSource) -> None:
    here = source.chunk(3, FRAMES_TOGETHER)
    (there,) = drawn_ahead(source.chunk, [3], workers=1)
    assert len(here) == FRAMES_TOGETHER
    for name in ("frames", "boundary_rows", "given", "force_n", "modulus_pa", "lateral_m"):
        np.testing.assert_array_equal(getattr(here, name), getattr(there, name))
    assert not np.array_equal(source.chunk(4, 8).frames, source.chunk(5, 8).frames)


def test_frames_are_bright_between_their_boundaries_and_dark_above(source: RawSource) -> None:
    plain = RawSource(source.library, study_with()).chunk(1, COUNT)
    row, pairs = np.arange(80)[:, None], plain.frames.reshape(COUNT, 80, 72, 2).mean(axis=3)
    outer, inner = plain.boundary_rows[:, :1], plain.boundary_rows[:, 1:]
    inside, above = (row > outer + 1.0) & (row < inner - 1.0), (row < outer - 1.5) & (row > 8)  # below the line
    assert np.nanmean(pairs[inside]) > 0.6
    assert abs(pairs[above].mean()) < 0.05


@pytest.mark.slow
def test_a_needle_crosses_its_share_and_lies_within_its_diameter(source: RawSource) -> None:
    gap = GIVEN.index("gap")
    many = RawSource(source.library, study_with(needle_share=0.5)).chunk(2, 400)
    trained = STUDY.reader.gap_m.bounds[1]
    gap_m = 0.5 * trained * (1.0 + many.given[:, gap])
    told = many.given[:, GIVEN.index("gap known")] > 0.0
    nearest = STUDY.reader.gap_m.bounds[0]
    assert (gap_m[told] < 0.85 * nearest).mean() == pytest.approx(
        0.5 * 0.85 * nearest / largest_needle_gap(STUDY.raw_reader), abs=0.1
    )
    rng = np.random.default_rng(1)
    for gap_m in (0.0, 0.1e-3, largest_needle_gap(STUDY.raw_reader)):
        needle = draw_optics(STUDY, gap_m, rng).needle
        assert needle.gap_m == gap_m
        assert gap_m <= (1.0 + 1e-9) * STUDY.raw_reader.needle_gap_fraction * needle.diameter_m
    assert draw_optics(STUDY, None, rng).needle is None


def test_the_tip_touches_the_wall() -> None:
    window, rng = FrameWindow.of(STUDY.raw_reader), np.random.default_rng(4)
    depth = np.full((1, 2, window.columns), 1.5e-3)
    optics = [draw_optics(STUDY, 0.0, rng)]
    (shaft,) = draw_shafts(optics, depth, np.array([0.4e-3]), np.zeros(1), STUDY, window)
    rows, columns = np.nonzero(shaft.inside)
    lowest = columns[rows == rows.max()] - window.columns / 2
    assert rows.max() * window.row_m == pytest.approx(1.45e-3, abs=0.06e-3)
    assert abs(lowest.mean() * window.column_m - 0.4e-3) < 0.6e-3


@pytest.mark.parametrize(("loss_db", "factor"), [(0.0, 1.0), (6.0, 3.0)])
def test_the_scanner_is_that_of_the_phantom_or_as_much_worse_as_told(loss_db: float, factor: float) -> None:
    study = study_with(snr_loss_db=fixed(loss_db), speckle_factor=fixed(factor))
    drawn = [draw_optics(study, None, np.random.default_rng(seed)) for seed in range(200)]
    for values, expected in (
        ([each.snr_db + loss_db for each in drawn], study.phantom.snr_db),
        ([each.lateral_resolution_m / factor for each in drawn], study.phantom.lateral_resolution_m),
        ([each.axial_resolution_m / factor for each in drawn], study.phantom.axial_resolution_m),
    ):
        low, high = expected.bounds
        assert low <= min(values) < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < max(values) <= high
    assert all(each.conjunctiva is None for each in drawn)


def test_a_share_of_the_frames_has_a_conjunctiva_of_the_range() -> None:
    study = study_with(conjunctiva_share=0.3)
    drawn = [draw_optics(study, None, np.random.default_rng(seed)).conjunctiva for seed in range(400)]
    thick = [layer.thickness_m for layer in drawn if layer is not None]
    assert 0.22 < len(thick) / 400 < 0.38
    low, high = study.raw_reader.conjunctiva_thickness_m.bounds
    assert low <= min(thick) < max(thick) <= high
    everywhere = replace(study, phantom=replace(study.phantom, conjunctiva_thickness_m=fixed(1e-4)))
    assert draw_optics(everywhere, None, np.random.default_rng(1)).conjunctiva is not None


def test_boundaries_are_taken_between_two_columns_and_kept_inside() -> None:
    window = FrameWindow(rows=8, columns=4, row_m=1e-4, column_m=1e-4)
    rows = np.array([[[-3.0, 1.0, 2.0, np.nan], [3.0, 4.0, 20.0, 30.0]]])
    np.testing.assert_array_equal(pair_rows(rows, window), np.array([[[0.0, np.nan], [3.5, 7.0]]], dtype=np.float32))
