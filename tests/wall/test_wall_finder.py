"""From a network's distributions to a wall with its uncertainty, and how that and the
other way check each other.
"""

from dataclasses import replace

import numpy as np
import pytest
from small_models import (
    FINDER_STUDY as STUDY,
    FixedFinder,
    FixedSession,
    distributions,
    fixed_finder,
)

from scleraforce.base.errors import ModelError
from scleraforce.calibration.answer_metrics import dice
from scleraforce.lab.drawn_bscan import Bscan, render_bscan
from scleraforce.lab.tissue_light import Pose, sample_optics
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.records.scan import PixelScale
from scleraforce.records.study import Study
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.frame_light import without_page
from scleraforce.wall.lit_part import lit_part
from scleraforce.wall.needle_in_frame import SeenNeedle
from scleraforce.wall.two_methods import checked_by, refined_wall, sharpened_boundary
from scleraforce.wall.wall import Segmentation, without_wall
from scleraforce.wall.wall_network import (
    FrameWindow,
    SeenWall,
    WallFinder,
    reduced_columns,
    reduced_frame,
)

STUDY_OF_FRAMES = Study()
OCT = STUDY_OF_FRAMES.oct
SCALE = PixelScale.of(OCT)
HALF = STUDY.columns // 2
FRAME = np.zeros((512, 512), dtype=np.uint16)


def seen_wall(
    thickness_m: float = 0.6e-3, dent_m: float = 1.0e-3, seed: int = 0
) -> tuple[Bscan, np.ndarray, np.ndarray]:
    """A frame, and first and last row of its wall at the network's columns, in reduced
    rows; NaN without wall.
    """
    rng = np.random.default_rng(seed)
    lateral = np.linspace(-8.5e-3, 8.5e-3, 800)
    depth = (
        12e-3
        - np.sqrt(12e-3**2 - lateral**2)
        + dent_m * np.exp(-(lateral**2) / (2 * 1.6e-3**2))
    )
    outer = np.stack([lateral, depth], axis=1)
    section = WallSection(outer, outer + np.array([0.0, thickness_m]))
    optics = sample_optics(STUDY_OF_FRAMES.phantom, OCT, rng)
    bscan = render_bscan(
        Pose(lateral_m=0.0, depth_m=0.5e-3).place(section), OCT, optics, rng
    )
    wall = bscan.truth_mask[:, np.rint(reduced_columns(512, HALF)).astype(int)] > 0
    ends = np.where(
        wall.any(axis=0), [wall.argmax(axis=0), 512 - wall[::-1].argmax(axis=0)], np.nan
    )

    return bscan, *(ends * STUDY.rows / 512 - 0.5)


def at_every_column(rows: np.ndarray) -> np.ndarray:
    """Rows of the reduced frame as rows of the frame, (column,)."""
    return np.interp(np.arange(512), reduced_columns(512, HALF), (rows + 0.5) * 4 - 0.5)


def test_the_boundary_is_the_mean_of_its_rows_and_the_uncertainty_their_spread():
    outer = np.linspace(20.3, 40.7, HALF)
    inner = np.linspace(60.2, 70.9, HALF)
    seen = fixed_finder(outer, inner, sd=1.5).find(FRAME)
    assert seen.outer_row == pytest.approx((outer + 0.5) * 4 - 0.5, abs=0.4)
    assert seen.inner_row == pytest.approx((inner + 0.5) * 4 - 0.5, abs=0.4)
    assert seen.outer_sd == pytest.approx(4 * 1.5, rel=0.05)
    assert seen.column == pytest.approx(reduced_columns(512, HALF))
    assert seen.there.all()


def test_two_places_that_are_both_likely_make_it_unsure_and_the_path_stays_on_one():
    """In five columns the other place is a little likelier."""
    outer = np.full(HALF, 30.0)
    share = np.full(HALF, 0.9)
    share[40:45] = 0.45
    rows = share * distributions(outer) + (1 - share) * distributions(outer + 40)
    session = FixedSession(np.stack([rows, distributions(outer + 60)]), np.ones(HALF))
    seen = FixedFinder(session, STUDY, "drawn").find(FRAME)
    assert seen.outer_row == pytest.approx(4 * 30.5 - 0.5, abs=0.5)
    assert (seen.outer_sd[40:45] > 4 * 18).all()
    assert seen.outer_sd[50] < seen.outer_sd[42]


def test_the_thickness_does_not_jump_where_another_place_is_a_little_likelier() -> None:
    """Over 20 columns; the upper boundary may be as steep as it likes."""
    outer = 20.0 + 30.0 * np.abs(np.linspace(-1.0, 1.0, HALF)) ** 0.5
    share = np.full(HALF, 0.9)
    share[30:50] = 0.45
    inner = share * distributions(outer + 15) + (1 - share) * distributions(outer + 55)
    seen = FixedFinder(
        FixedSession(np.stack([distributions(outer), inner]), np.ones(HALF)),
        STUDY,
        "drawn",
    ).find(FRAME)
    assert seen.inner_row - seen.outer_row == pytest.approx(60.0, abs=4.0)
    assert (seen.inner_sd[30:50] > 4 * 15).all()


def test_a_column_without_wall_or_with_its_inner_boundary_above_shows_none_and_a_wall_at_an_edge_continues():
    outer = np.where(np.arange(HALF) < 30, np.nan, 30.0)
    seen = fixed_finder(outer, outer + 20).find(FRAME)
    assert np.array_equal(seen.there, np.arange(HALF) >= 30)
    assert seen.outer_row[30:] == pytest.approx(4 * 30.5 - 0.5, abs=0.2)
    assert (
        not fixed_finder(np.full(HALF, 50.0), np.full(HALF, 40.0))
        .find(FRAME)
        .there.any()
    )
    seen = fixed_finder(
        np.full(HALF, 0.0), np.full(HALF, STUDY.rows - 1.0), sd=0.3
    ).find(FRAME)
    assert (seen.outer_row < -0.5).all()
    assert (seen.inner_row > 511.0).all()


def test_a_network_with_other_outputs_or_answers_that_are_not_finite_is_refused():
    session = FixedSession(np.full((2, STUDY.rows, HALF), np.nan), np.ones(HALF))
    with pytest.raises(ModelError, match="drawn: inputs: found"):
        WallFinder(session, replace(STUDY, rows=64), "drawn")
    with pytest.raises(ModelError, match="numbers that are not finite"):
        FixedFinder(session, STUDY, "drawn").find(FRAME)


def refined(
    frame: np.ndarray, finder: WallFinder, scale: PixelScale = SCALE
) -> Segmentation:
    """The network's wall, moved to the edges of the frame."""
    part = lit_part(frame, scale)
    assert part is not None
    return refined_wall(part, finder.find(frame))


@pytest.mark.parametrize("dent_m", [0.0, 1.0e-3, 2.0e-3])
@pytest.mark.parametrize("thickness_m", [0.45e-3, 0.8e-3])
def test_the_refined_wall_is_as_good_as_the_other_way(
    thickness_m: float, dent_m: float
) -> None:
    bscan, *wall = seen_wall(thickness_m, dent_m, seed=3)
    finder = fixed_finder(*wall, sd=1.0)
    checked = refined(bscan.frame, finder)
    other = find_wall(bscan.frame, SCALE)
    assert checked.inner_found
    assert dice(checked.mask, bscan.truth_mask) > max(
        0.97, dice(other.mask, bscan.truth_mask) - 0.003
    )
    assert checked.thickness_m == pytest.approx(other.thickness_m, rel=0.06)


def test_a_needle_that_the_other_method_sees_is_kept_whichever_wall_is_shown() -> None:
    needle = SeenNeedle(
        angle_rad=0.4,
        tip_m=(0.0, 1e-3),
        tip=(256.0, 128.0),
        top=(280.0, -0.5),
        hidden=(250, 300),
    )
    bscan, outer, inner = seen_wall(seed=3)
    found = replace(find_wall(bscan.frame, SCALE), needle=needle)

    for shift in (0.0, 6.0):
        finder = fixed_finder(outer + shift, inner + shift)
        assert checked_by(finder, bscan.frame, SCALE, found, found).needle == needle


def test_the_networks_wall_is_moved_by_a_row_of_its_frame_at_most_and_a_farther_edge_is_another_things():
    """Its lower boundary is given 0.8 rows too high on the left, where the edge is; 3
    too low on the right: too far.

    Then its surface is given 3 rows too high: where `find_wall` sees the edge is not
    what it sees.
    """
    bscan, outer, inner = seen_wall(0.6e-3, 0.0, seed=3)
    left = np.arange(HALF) < HALF // 2
    checked = refined(
        bscan.frame,
        fixed_finder(outer, np.where(left, inner - 0.8, inner + 3.0), sd=1.0),
    )
    off = checked.inner_row - at_every_column(inner)
    assert np.nanmedian(np.abs(off[60:220])) < 2.0
    assert np.nanmedian(off[300:450]) == pytest.approx(12.0, abs=3.0)
    checked = find_wall(
        bscan.frame, SCALE, finder=fixed_finder(outer - 3.0, inner, sd=0.5)
    )
    assert np.nanmedian(
        (checked.outer_row - at_every_column(outer))[60:450]
    ) == pytest.approx(-12.0, abs=3.0)
    assert not checked.usable


def test_a_wall_beyond_the_frame_ends_1_mm_below_its_surface_and_one_that_leaves_it_keeps_its_thickness():
    bscan, outer, inner = seen_wall(0.6e-3, 0.0)
    below = np.full(HALF, STUDY.rows - 1.0)
    checked = refined(
        bscan.frame, fixed_finder(outer, np.where(np.isfinite(outer), below, np.nan))
    )
    assert not checked.inner_found
    assert np.isnan(checked.thickness_m)
    deep = checked.inner_row - checked.outer_row
    inside = checked.inner_row < 500
    assert deep[inside] == pytest.approx(
        1e-3 * SCALE.refractive_index / SCALE.depth_m, rel=1e-3
    )
    middle = np.abs(np.arange(HALF) - HALF / 2) < HALF / 4
    checked = refined(bscan.frame, fixed_finder(outer, np.where(middle, inner, below)))
    assert np.nanmedian(np.abs(checked.inner_row - at_every_column(inner))) < 3.0
    assert checked.thickness_m == pytest.approx(0.6e-3, rel=0.1)


def test_a_network_that_does_not_know_where_the_wall_ends_makes_the_frame_unusable_unless_the_other_does():
    bscan, outer, inner = seen_wall(0.6e-3, 0.0)

    def told(end: np.ndarray) -> Segmentation:
        rows = np.stack(
            [
                distributions(outer),
                distributions(end, sd=0.4 * np.nanmedian(inner - outer)),
            ]
        )
        finder = FixedFinder(
            FixedSession(rows, np.isfinite(outer).astype(float)), STUDY, "drawn"
        )

        return find_wall(bscan.frame, SCALE, finder=finder)

    assert told(inner + 5.0).reason.startswith(
        "the network does not know where the wall ends, in "
    )
    assert told(inner).usable


@pytest.mark.parametrize(
    ("shift", "what"),
    [
        ((20.0, 20.0), "its surface lies up to"),
        ((0.0, 14.0), "its inner boundary lies up to"),
    ],
)
def test_a_network_that_sees_another_wall_makes_the_frame_unusable(
    shift: tuple[float, float], what: str
) -> None:
    bscan, outer, inner = seen_wall()
    checked = find_wall(
        bscan.frame, SCALE, finder=fixed_finder(outer + shift[0], inner + shift[1])
    )
    assert not checked.usable
    assert checked.reason.startswith(f"two methods to find the wall differ: {what}")
    assert checked.methods.disagreement > 1.0
    alike = find_wall(bscan.frame, SCALE, finder=fixed_finder(outer, inner)).methods
    assert (
        replace(alike, first=without_wall(bscan.frame.shape, "")).disagreement
        == alike.disagreement
        < 0.1
    )


def test_an_unsure_network_does_not_contradict_and_one_that_sees_half_of_the_wall_or_none_does():
    bscan, outer, inner = seen_wall()
    assert find_wall(
        bscan.frame, SCALE, finder=fixed_finder(outer, inner + 6.0, sd=4.0)
    ).usable
    half = np.where(np.arange(HALF) < HALF // 2, np.nan, outer)
    checked = find_wall(bscan.frame, SCALE, finder=fixed_finder(half, inner))
    assert not checked.usable
    assert "one sees wall where the other does not" in checked.reason
    assert np.isnan(checked.outer_row[100])
    nowhere = np.full(HALF, np.nan)
    checked = find_wall(bscan.frame, SCALE, finder=fixed_finder(nowhere, nowhere))
    assert not checked.usable
    assert checked.reason == "the network sees no wall where the other method finds one"
    assert np.array_equal(
        checked.outer_row, find_wall(bscan.frame, SCALE).outer_row, equal_nan=True
    )


def test_an_empty_frame_stays_one_without_wall() -> None:
    wall = np.full(HALF, 20.0)
    for finder in (
        fixed_finder(wall, wall + 20),
        fixed_finder(wall + np.nan, wall + np.nan),
    ):
        checked = find_wall(FRAME, SCALE, finder=finder)
        assert not checked.usable
        assert checked.reason == "the frame is empty: all pixels are alike"
        assert not checked.mask.any()


def test_where_no_edge_is_near_the_networks_own_boundary_stays() -> None:
    """The wall's lower part is noise: the network says where its end is."""
    bscan, outer, inner = seen_wall(0.8e-3, 0.0)
    frame = bscan.frame.copy()
    below = np.arange(512)[:, None] > at_every_column(outer) + 0.3e-3 / SCALE.depth_m
    noise = np.random.default_rng(0).integers(0, 400, frame.shape, dtype=np.uint16)
    frame = np.where(below, noise, frame)
    checked = refined(frame, fixed_finder(outer, inner, sd=0.6))
    there = np.isfinite(checked.inner_row)
    assert np.nanmedian(np.abs(checked.inner_row - at_every_column(inner))[there]) < 6.0


@pytest.mark.parametrize("scale", [0.25, 4.0])
def test_a_wall_is_refined_whatever_scale_a_frame_is_said_to_have(scale: float) -> None:
    bscan, *wall = seen_wall(0.6e-3, 0.0)
    size = PixelScale(lateral_m=SCALE.lateral_m * scale, depth_m=SCALE.depth_m * scale)
    checked = refined(bscan.frame, fixed_finder(*wall, sd=1.0), size)
    assert dice(checked.mask, bscan.truth_mask) > 0.95
    assert checked.thickness_m == pytest.approx(0.6e-3 * scale, rel=0.1)


def test_a_reduced_frame_has_its_noise_at_zero_and_its_tissue_at_one() -> None:
    small = reduced_frame(seen_wall()[0].frame, 128, 176)
    assert small.shape == (128, 176)
    assert abs(np.median(small)) < 0.2
    assert 0.9 < np.quantile(small, 0.99) < 1.1
    assert not reduced_frame(FRAME, 128, 176).any()
    assert not reduced_frame(FRAME + 7, 128, 176).any()


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
) -> None:
    outer = np.full(HALF, 40.0)
    inner = np.full(HALF, 60.0)
    other = np.where(np.arange(HALF) < columns, outer + moved, np.nan)
    finder = LookedAt(fixed_finder(outer, inner), fixed_finder(other, other + 20.0))
    seen = finder.find(FRAME)
    top, bottom = finder.rows[1]
    assert 4 * 40 - 0.3 * 80 < top < 4 * 40 < 4 * 61 < bottom < 4 * 61 + 0.3 * 80
    assert seen.outer_row == pytest.approx(4 * (40.5 + moved * believed) - 0.5, abs=0.5)


def test_a_wall_that_fills_the_frame_or_none_is_looked_at_once_and_one_at_the_edge_of_a_second_look_is_there():
    for outer in (np.full(HALF, 5.0), np.full(HALF, np.nan)):
        finder = LookedAt(
            fixed_finder(outer, outer + 115.0), fixed_finder(outer, outer + 20.0)
        )
        finder.find(FRAME)
        assert finder.rows == [(0, 512)]

    session = FixedSession(
        np.stack([distributions(np.full(HALF, row), 0.3) for row in (0.0, 40.0)]),
        np.ones(HALF),
    )
    seen = WallFinder(session, STUDY, "drawn")._look(FRAME, 128, 384)
    assert seen.outer_row == pytest.approx(128.5, abs=0.5)
    # what a single answer sees elsewhere is left out of the wall
    spike = np.where(np.arange(HALF) == 40, 52.0, 40.0)
    assert fixed_finder(spike, spike + 20.0).find(FRAME).outer_row == pytest.approx(
        4 * 40.5 - 0.5, abs=0.5
    )


def test_an_unsure_network_that_takes_the_choroid_for_wall_leaves_its_end_to_the_other_way():
    """The light falls more where the choroid ends."""
    column = np.arange(512)
    top = 100.0 + 4e-4 * (column - 256) ** 2
    row = column[:, None]
    level = np.select(
        [row < top, row < top + 80, row < top + 104], [600.0, 2600.0, 1800.0], 600.0
    )
    frame = np.clip(np.random.default_rng(2).normal(level, 200.0), 0, 4095).astype(
        np.uint16
    )
    outer = (np.interp(reduced_columns(512, HALF), column, top) + 0.5) / 4 - 0.5
    checked = find_wall(frame, SCALE, finder=fixed_finder(outer, outer + 26.0, sd=2.0))
    assert checked.usable, checked.reason
    assert np.nanmedian(np.abs(checked.inner_row - top - 79.5)) < 2.0


def test_an_inner_boundary_moves_to_the_edge_near_it_and_stays_where_none_is() -> None:
    rng = np.random.default_rng(3)
    # too fast for the wide means of the first search
    edge = 300.0 + 8.0 * np.sin(np.linspace(0.0, 12.0, 512))
    level = np.where(np.arange(512)[:, None] < edge, 300.0, 60.0)
    frame = np.rint(level * rng.exponential(1.0, level.shape)).astype(np.uint16)
    found = sharpened_boundary(
        frame, np.where(np.arange(512) < 30, np.nan, 300.0), SCALE
    )
    assert np.isnan(found[:30]).all()
    assert np.abs(found - edge)[40:].mean() < 2.0  # 5 before
    even = rng.exponential(300.0, level.shape).astype(np.uint16)
    assert (
        np.abs(sharpened_boundary(even, np.full(512, 300.0), SCALE) - 300.0).mean()
        < 3.0
    )


@pytest.mark.parametrize("grey", [400, 4095])
def test_the_margins_of_a_page_are_black_to_the_search_and_saturate_nothing(
    grey: int,
) -> None:
    bscan = seen_wall()[0]
    page = np.full((592, 572), grey, dtype=np.uint16)
    page[30:542, 20:532] = bscan.frame
    wall = find_wall(page, SCALE)
    alone = find_wall(bscan.frame, SCALE)
    assert wall.usable
    assert np.isnan(wall.outer_row[:20]).all()
    assert np.nanmean(np.abs(wall.outer_row[20:532] - 30 - alone.outer_row)) < 1.0
    assert without_page(bscan.frame) is bscan.frame


def mean_by_sampling(
    frame: np.ndarray, scale: PixelScale, window: FrameWindow, row: int, column: int
) -> float:
    """Return the mean count of a cell over a fine grid of points in it; points beside
    the frame do not count.
    """
    depth = (row + (np.arange(200) + 0.5) / 200) * window.row_m
    lateral = (
        column - window.columns / 2 + (np.arange(200) + 0.5) / 200
    ) * window.column_m
    rows = np.floor(depth / scale.depth_m).astype(int)
    columns = np.floor(lateral / scale.lateral_m + frame.shape[1] / 2).astype(int)
    rows = rows[(rows >= 0) & (rows < len(frame))]
    columns = columns[(columns >= 0) & (columns < frame.shape[1])]

    return (
        float(frame[np.ix_(rows, columns)].mean())
        if len(rows) and len(columns)
        else 0.0
    )


def test_cells_are_means_over_their_part_of_the_frame() -> None:
    frame = np.random.default_rng(1).integers(0, 4096, (31, 45)).astype(np.uint16)
    scale = PixelScale(lateral_m=37e-6, depth_m=9e-6)
    window = FrameWindow(rows=8, columns=20, row_m=41e-6, column_m=1e-4)
    found = window.means(frame, scale)
    assert found.shape == (8, 20)

    for row, column in ((0, 10), (3, 4), (5, 13), (6, 2), (7, 10), (2, 0)):
        assert found[row, column] == pytest.approx(
            mean_by_sampling(frame, scale, window, row, column), rel=0.02
        )

    assert not found[7].any()  # below the frame
    assert not found[:, 0].any()  # beside it
