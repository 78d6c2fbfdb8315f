"""From a network's distributions to a wall with its uncertainty, and how that and the
other way check each other.
"""

from dataclasses import replace

import numpy as np
import pytest
from analytic_frames import STEEL
from small_models import (
    FINDER_STUDY as STUDY,
    FixedFinder,
    FixedSession,
    distributions,
    fixed_finder,
)

from dented_walls import dented_wall
from scleraforce.base.errors import ModelError
from scleraforce.calibration.answer_metrics import dice
from scleraforce.lab.drawn_bscan import Bscan, draw_shaft, render_bscan
from scleraforce.lab.tissue_light import Pose, sample_optics
from scleraforce.records.scan import PixelScale
from scleraforce.records.study import Study
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.lit_part import lit_part
from scleraforce.wall.two_methods import refined_wall, sharpened_boundary
from scleraforce.wall.wall import SeenWall, Segmentation
from scleraforce.wall.wall_network import (
    FrameWindow,
    WallFinder,
    reduced_columns,
    reduced_frame,
)

OCT = Study().oct
SCALE = PixelScale.of(OCT)
HALF = STUDY.columns // 2
AT = reduced_columns(512, HALF)
FRAME = np.zeros((512, 512), dtype=np.uint16)


def in_frame(rows: np.ndarray | float) -> np.ndarray | float:
    """Rows of the reduced frame as rows of the frame."""
    return (rows + 0.5) * 4 - 0.5


def drawn_wall(
    thickness_m: float = 0.6e-3, dent_m: float = 1.0e-3, needle: bool = False
) -> tuple[Bscan, np.ndarray, np.ndarray]:
    """A frame, and first and last row of its wall at the network's columns, in reduced
    rows; NaN without wall.
    """
    rng = np.random.default_rng(3)
    optics = sample_optics(Study().phantom, OCT, rng)
    section = Pose(lateral_m=0.0, depth_m=0.5e-3).place(
        dented_wall(thickness_m, dent_m)
    )
    tip_m = np.array([0.0, 0.5e-3 + dent_m])
    shaft = draw_shaft(STEEL, tip_m, 0.0, OCT) if needle else None
    bscan = render_bscan(section, OCT, optics, rng, shaft)
    wall = bscan.truth_mask[:, np.rint(AT).astype(int)] > 0
    ends = np.where(
        wall.any(axis=0), [wall.argmax(axis=0), 512 - wall[::-1].argmax(axis=0)], np.nan
    )

    return bscan, *(ends * STUDY.rows / 512 - 0.5)


def off_rows(boundary: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return how many rows a boundary of the frame lies below rows of the reduced
    frame, (column,).
    """
    return boundary - np.interp(np.arange(512), AT, in_frame(rows))


def finder_of(
    outer_rc: np.ndarray, inner_rc: np.ndarray, wall: np.ndarray | None = None
) -> WallFinder:
    """A finder whose network answers with these distributions."""
    there = np.ones(HALF) if wall is None else np.isfinite(wall).astype(float)
    session = FixedSession(np.stack([outer_rc, inner_rc]), there)
    return FixedFinder(session, STUDY, "drawn")


def test_the_boundary_is_the_mean_of_its_rows_and_the_uncertainty_their_spread():
    outer = np.linspace(20.3, 40.7, HALF)
    inner = np.linspace(60.2, 70.9, HALF)
    seen = fixed_finder(outer, inner, sd=1.5).find(FRAME)
    assert seen.outer_row == pytest.approx(in_frame(outer), abs=0.4)
    assert seen.inner_row == pytest.approx(in_frame(inner), abs=0.4)
    assert seen.outer_sd == pytest.approx(4 * 1.5, rel=0.05)
    assert seen.column == pytest.approx(AT)
    assert seen.there.all()


def test_two_places_that_are_both_likely_make_it_unsure_and_the_path_stays_on_one():
    """In five columns the other place is a little likelier."""
    outer = np.full(HALF, 30.0)
    share = np.full(HALF, 0.9)
    share[40:45] = 0.45
    rows = share * distributions(outer) + (1 - share) * distributions(outer + 40)
    seen = finder_of(rows, distributions(outer + 60)).find(FRAME)
    assert seen.outer_row == pytest.approx(in_frame(30.0), abs=0.5)
    assert (seen.outer_sd[40:45] > 4 * 18).all()
    assert seen.outer_sd[50] < seen.outer_sd[42]


def test_the_thickness_does_not_jump_where_another_place_is_a_little_likelier():
    """Over 20 columns; the upper boundary may be as steep as it likes."""
    outer = 20.0 + 30.0 * np.abs(np.linspace(-1.0, 1.0, HALF)) ** 0.5
    share = np.full(HALF, 0.9)
    share[30:50] = 0.45
    inner = share * distributions(outer + 15) + (1 - share) * distributions(outer + 55)
    seen = finder_of(distributions(outer), inner).find(FRAME)
    assert seen.inner_row - seen.outer_row == pytest.approx(60.0, abs=4.0)
    assert (seen.inner_sd[30:50] > 4 * 15).all()


def test_columns_may_show_no_wall_a_wall_at_an_edge_continues_and_a_spike_is_none():
    outer = np.where(np.arange(HALF) < 30, np.nan, 30.0)
    seen = fixed_finder(outer, outer + 20).find(FRAME)
    assert np.array_equal(seen.there, np.arange(HALF) >= 30)
    assert seen.outer_row[30:] == pytest.approx(in_frame(30.0), abs=0.2)

    below = fixed_finder(np.full(HALF, 50.0), np.full(HALF, 40.0))
    assert not below.find(FRAME).there.any()

    last = STUDY.rows - 1.0
    seen = fixed_finder(np.full(HALF, 0.0), np.full(HALF, last), sd=0.3).find(FRAME)
    assert (seen.outer_row < -0.5).all()
    assert (seen.inner_row > 511.0).all()

    spike = np.where(np.arange(HALF) == 40, 52.0, 40.0)
    seen = fixed_finder(spike, spike + 20.0).find(FRAME)
    assert seen.outer_row == pytest.approx(in_frame(40.0), abs=0.5)


def test_a_network_with_other_outputs_or_answers_that_are_not_finite_is_refused():
    session = FixedSession(np.full((2, STUDY.rows, HALF), np.nan), np.ones(HALF))
    with pytest.raises(ModelError, match="drawn: inputs: found"):
        WallFinder(session, replace(STUDY, rows=64), "drawn")
    with pytest.raises(ModelError, match="numbers that are not finite"):
        FixedFinder(session, STUDY, "drawn").find(FRAME)


class LookedAt(FixedFinder):
    """A finder whose second look, at the rows that it asks for, sees another wall."""

    def __init__(self, *looks: WallFinder) -> None:
        self.looks = iter(looks)
        self.rows = list[tuple[int, int]]()

    def _look(self, frame: np.ndarray, *rows: int) -> SeenWall:
        self.rows.append(rows)
        return next(self.looks)._look(frame, *rows)


@pytest.mark.parametrize(
    ("moved", "columns", "believed"),
    [(2.0, HALF, True), (12.0, HALF, False), (2.0, 60, False)],
)
def test_a_second_look_at_the_rows_about_a_wall_corrects_it_a_little(
    moved: float, columns: int, believed: bool
):
    outer = np.full(HALF, 40.0)
    other = np.where(np.arange(HALF) < columns, outer + moved, np.nan)
    finder = LookedAt(
        fixed_finder(outer, outer + 20.0), fixed_finder(other, other + 20.0)
    )
    seen = finder.find(FRAME)
    top, bottom = finder.rows[1]
    assert 4 * 40 - 0.3 * 80 < top < 4 * 40 < 4 * 61 < bottom < 4 * 61 + 0.3 * 80
    assert seen.outer_row == pytest.approx(in_frame(40.0 + moved * believed), abs=0.5)


@pytest.mark.parametrize("outer", [5.0, np.nan])
def test_a_wall_that_fills_the_frame_or_none_is_looked_at_once(outer: float):
    row = np.full(HALF, outer)
    finder = LookedAt(fixed_finder(row, row + 115.0), fixed_finder(row, row + 20.0))
    finder.find(FRAME)
    assert finder.rows == [(0, 512)]


def test_a_wall_at_the_edge_of_a_second_look_is_there():
    rows = [distributions(np.full(HALF, row), 0.3) for row in (0.0, 40.0)]
    finder = WallFinder(FixedSession(np.stack(rows), np.ones(HALF)), STUDY, "drawn")
    assert finder._look(FRAME, 128, 384).outer_row == pytest.approx(128.5, abs=0.5)


@pytest.mark.parametrize(
    ("outer", "inner", "reason"),
    [
        (20.0, 20.0, "two methods to find the wall differ: its surface lies up to"),
        (-3.0, 0.0, "two methods to find the wall differ: its surface lies up to"),
    ],
)
def test_a_network_that_sees_another_wall_makes_the_frame_unusable(
    outer: float, inner: float, reason: str
):
    bscan, *wall = drawn_wall()
    finder = fixed_finder(wall[0] + outer, wall[1] + inner, sd=0.5)
    checked = find_wall(bscan.frame, SCALE, finder=finder)
    assert not checked.usable
    assert checked.reason.startswith(reason)
    assert checked.methods.disagreement > 1.0
    # shown is the network's, whose edge would be another thing's
    off = np.nanmedian(off_rows(checked.outer_row, wall[0])[60:450])
    assert off == pytest.approx(4.0 * outer, abs=3.0)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize(("inner", "sd"), [(14.0, 0.5), (-8.0, 0.5), (-8.0, 9.0)])
def test_where_both_differ_about_the_end_alone_the_surface_is_used(
    inner: float, sd: float, known: bool
):
    """Unless the wall is as thick as it is known to be."""
    bscan, *wall = drawn_wall(0.6e-3)
    finder = fixed_finder(wall[0], wall[1] + inner, sd=sd)
    thickness_m = 0.6e-3 if known else None
    checked = find_wall(bscan.frame, SCALE, thickness_m, finder)
    assert checked.usable
    assert checked.boundaries == ("both" if known else "surface")
    if known:
        assert checked.thickness_m == pytest.approx(0.6e-3, abs=15e-6)
    off = np.nanmedian(off_rows(checked.outer_row, wall[0])[60:450])
    assert off == pytest.approx(0.0, abs=1.0)


def test_a_network_that_sees_the_wall_agrees_to_a_tenth_of_the_limit():
    bscan, *wall = drawn_wall()
    found = find_wall(bscan.frame, SCALE, finder=fixed_finder(*wall))
    assert found.usable
    assert found.methods.disagreement < 0.1


@pytest.mark.parametrize(
    ("columns", "sd", "reason"),
    [
        (slice(0), 4.0, ""),
        (slice(HALF // 2), 0.6, "one sees wall where the other does not"),
        (slice(None), 0.6, "the network sees no wall where the other method finds one"),
    ],
    ids=["unsure", "half", "blind"],
)
def test_an_unsure_network_does_not_contradict_and_one_that_sees_half_or_nothing_does(
    columns: slice, sd: float, reason: str
):
    bscan, outer, inner = drawn_wall()
    outer[columns] = np.nan
    below = inner + 6.0 * (not reason)
    checked = find_wall(bscan.frame, SCALE, finder=fixed_finder(outer, below, sd))
    assert checked.usable == (not reason)
    assert reason in checked.reason

    if np.isnan(outer).all():
        alone = find_wall(bscan.frame, SCALE)
        np.testing.assert_array_equal(checked.outer_row, alone.outer_row)
    elif reason:
        assert np.isnan(checked.outer_row[100])
        right = slice(270, None)
        assert dice(checked.mask[:, right], bscan.truth_mask[:, right]) > 0.97


@pytest.mark.parametrize("below", [5.0, 0.0])
def test_an_end_that_the_network_does_not_know_has_to_be_seen_by_the_other_method(
    below: float,
):
    bscan, outer, inner = drawn_wall(0.6e-3, 0.0)
    sd = 0.4 * np.nanmedian(inner - outer)
    finder = finder_of(distributions(outer), distributions(inner + below, sd), outer)
    checked = find_wall(bscan.frame, SCALE, finder=finder)
    assert checked.usable
    assert checked.boundaries == ("surface" if below else "both")


@pytest.mark.parametrize("row", [20.0, np.nan])
def test_an_empty_frame_stays_one_without_wall(row: float):
    wall = np.full(HALF, row)
    checked = find_wall(FRAME, SCALE, finder=fixed_finder(wall, wall + 20))
    assert not checked.usable
    assert checked.reason == "the frame is empty: all pixels are alike"
    assert not checked.mask.any()


@pytest.mark.parametrize("shift", [0.0, 12.0])
def test_a_needle_is_kept_and_what_it_hides_speaks_against_nothing(
    shift: float,
):
    """The network sees the wall in the shadow, too, or another wall."""
    bscan, outer, inner = drawn_wall(dent_m=0.4e-3, needle=True)
    finder = fixed_finder(outer + shift, inner + shift)
    alone = find_wall(bscan.frame, SCALE)
    checked = find_wall(bscan.frame, SCALE, finder=finder)
    assert checked.needle == alone.needle is not None
    assert checked.usable == (not shift), checked.reason


def refined(frame: np.ndarray, finder: WallFinder) -> Segmentation:
    """The network's wall, moved to the edges of the frame."""
    part = lit_part(frame, SCALE)
    assert part is not None
    return refined_wall(part, finder.find(frame))


def test_the_networks_boundary_moves_to_an_edge_within_a_row_of_its_frame_alone():
    """It is given 0.8 rows too high on the left, and 3 too low on the right: too
    far.
    """
    bscan, outer, inner = drawn_wall(0.6e-3, 0.0)
    left = np.arange(HALF) < HALF // 2
    shown = np.where(left, inner - 0.8, inner + 3.0)
    checked = refined(bscan.frame, fixed_finder(outer, shown, sd=1.0))
    off = off_rows(checked.inner_row, inner)
    assert np.nanmedian(np.abs(off[60:220])) < 2.0
    assert np.nanmedian(off[300:450]) == pytest.approx(12.0, abs=3.0)


def test_where_no_edge_is_near_the_networks_own_boundary_stays():
    """The wall's lower part is noise: the network says where its end is."""
    bscan, outer, inner = drawn_wall(0.8e-3, 0.0)
    below = off_rows(np.arange(512)[:, None], outer) > 0.3e-3 / SCALE.depth_m
    noise = np.random.default_rng(0).integers(0, 400, (512, 512), dtype=np.uint16)
    frame = np.where(below, noise, bscan.frame)
    checked = refined(frame, fixed_finder(outer, inner, sd=0.6))
    assert np.nanmedian(np.abs(off_rows(checked.inner_row, inner))) < 6.0


def test_a_wall_beyond_the_frame_ends_1_mm_below_its_surface_and_one_that_leaves_it_keeps_its_thickness():
    bscan, outer, inner = drawn_wall(0.6e-3, 0.0)
    below = np.full(HALF, STUDY.rows - 1.0)
    checked = find_wall(bscan.frame, SCALE, finder=fixed_finder(outer, below))
    assert not checked.inner_found
    assert np.isnan(checked.thickness_m)
    deep_m = (checked.inner_row - checked.outer_row) * SCALE.depth_m
    assert deep_m[checked.inner_row < 500] == pytest.approx(1e-3, rel=1e-3)

    middle = np.abs(np.arange(HALF) - HALF / 2) < HALF / 4
    leaving = fixed_finder(outer, np.where(middle, inner, below))
    checked = find_wall(bscan.frame, SCALE, finder=leaving)
    assert np.nanmedian(np.abs(off_rows(checked.inner_row, inner))) < 3.0
    assert checked.thickness_m == pytest.approx(0.6e-3, rel=0.1)


@pytest.mark.parametrize("scale", [0.25, 1.0, 4.0])
def test_a_wall_is_refined_whatever_scale_a_frame_is_said_to_have(scale: float):
    """As a quarter of it is hidden from the network, the wall is the network's."""
    bscan, outer, inner = drawn_wall(0.6e-3, 0.0)
    outer[:25] = np.nan
    size = PixelScale(lateral_m=SCALE.lateral_m * scale, depth_m=SCALE.depth_m * scale)
    checked = find_wall(bscan.frame, size, finder=fixed_finder(outer, inner, sd=1.0))
    seen = slice(150, None)
    assert dice(checked.mask[:, seen], bscan.truth_mask[:, seen]) > 0.95
    assert checked.thickness_m == pytest.approx(0.6e-3 * scale, rel=0.1)


def test_an_unsure_network_that_takes_the_choroid_for_wall_leaves_its_end_to_the_other_way():
    """The light falls more where the choroid ends."""
    column = np.arange(512)
    top = 100.0 + 4e-4 * (column - 256) ** 2
    row = column[:, None]
    level = np.select(
        [row < top, row < top + 80, row < top + 104], [600.0, 2600.0, 1800.0], 600.0
    )
    noisy = np.random.default_rng(2).normal(level, 200.0)
    frame = np.clip(noisy, 0, 4095).astype(np.uint16)
    outer = (np.interp(AT, column, top) + 0.5) / 4 - 0.5
    checked = find_wall(frame, SCALE, finder=fixed_finder(outer, outer + 26.0, sd=2.0))
    assert checked.usable, checked.reason
    assert np.nanmedian(np.abs(checked.inner_row - top - 79.5)) < 2.0


def test_an_inner_boundary_moves_to_the_edge_near_it_and_stays_where_none_is():
    rng = np.random.default_rng(3)
    # too fast for the wide means of the first search
    edge = 300.0 + 8.0 * np.sin(np.linspace(0.0, 12.0, 512))
    level = np.where(np.arange(512)[:, None] < edge, 300.0, 60.0)
    frame = np.rint(level * rng.exponential(1.0, level.shape)).astype(np.uint16)
    first = np.where(np.arange(512) < 30, np.nan, 300.0)
    found = sharpened_boundary(frame, first, SCALE)
    assert np.isnan(found[:30]).all()
    assert np.abs(found - edge)[40:].mean() < 2.0  # 5 before

    even = rng.exponential(300.0, level.shape).astype(np.uint16)
    found = sharpened_boundary(even, np.full(512, 300.0), SCALE)
    assert np.abs(found - 300.0).mean() < 3.0


@pytest.mark.parametrize("grey", [400, 4095])
def test_the_margins_of_a_page_are_black_to_the_search_and_saturate_nothing(
    grey: int,
):
    bscan = drawn_wall()[0]
    page = np.full((592, 572), grey, dtype=np.uint16)
    page[30:542, 20:532] = bscan.frame
    wall = find_wall(page, SCALE)
    alone = find_wall(bscan.frame, SCALE)
    assert wall.usable
    assert np.isnan(wall.outer_row[:20]).all()
    assert np.nanmedian(np.abs(wall.outer_row[20:532] - 30 - alone.outer_row)) < 1.0


def test_a_reduced_frame_has_its_noise_at_zero_and_its_tissue_at_one():
    small = reduced_frame(drawn_wall()[0].frame, 128, 176)
    assert small.shape == (128, 176)
    assert abs(np.median(small)) < 0.2
    assert 0.9 < np.quantile(small, 0.99) < 1.1
    assert not reduced_frame(FRAME, 128, 176).any()
    assert not reduced_frame(FRAME + 7, 128, 176).any()


@pytest.mark.parametrize("halves", [1, 5, 8])
def test_cells_are_means_over_their_part_of_the_frame(halves):
    """Of half a pixel, of two and a half, and of four."""
    frame = np.random.default_rng(1).integers(0, 4096, (20, 40)).astype(np.uint16)
    rows, columns = 40 // halves, 80 // halves
    size = {"row_m": halves * 0.5e-6, "column_m": halves * 1e-6}
    window = FrameWindow(rows=rows + 1, columns=columns, **size)
    found = window.means(frame, PixelScale(lateral_m=2e-6, depth_m=1e-6))
    parts = np.kron(frame, np.ones((2, 2))).reshape(rows, halves, columns, halves)
    np.testing.assert_allclose(found[:-1], parts.mean(axis=(1, 3)), rtol=1e-5)
    assert not found[-1].any()  # below the frame
