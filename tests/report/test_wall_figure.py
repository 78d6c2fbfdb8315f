"""Computed walls over a frame: they are laid where the surface is, and every frame shows both."""

import numpy as np
import pytest

from scleraforce.report.slice_figures import ComputedWall, FrameWithWalls, laid_on_surface, plot_walls
from scleraforce.section.plane import Section

WIDTH_M, COLUMNS = 15e-3, 512
LATERAL_M = (np.arange(COLUMNS) + 0.5) * WIDTH_M / COLUMNS


def dented(lateral_m: np.ndarray) -> np.ndarray:
    """Depth of an eye with a dent at 0, m."""
    return 12e-3 - np.sqrt((12e-3) ** 2 - lateral_m**2) + 1.5e-3 * np.exp(-((lateral_m / 1.5e-3) ** 2))


def wall() -> Section:
    lateral_m = np.linspace(-9e-3, 9e-3, 400)
    outer = np.stack([lateral_m, dented(lateral_m)], axis=1)
    return Section(outer, outer + np.array([0.0, 0.5e-3]))


@pytest.mark.parametrize(("shift_m", "down_m"), [(0.0, 0.4e-3), (0.25e-3, 0.9e-3), (-0.4e-3, 0.1e-3)])
def test_a_wall_is_laid_where_the_surface_is_though_a_third_of_it_is_unseen(shift_m: float, down_m: float) -> None:
    surface_m = dented(LATERAL_M - WIDTH_M / 2 - shift_m) + down_m
    surface_m[100:270] = np.nan
    surface_m[300:310] += 1e-3  # a wrong stretch
    laid = laid_on_surface(wall(), surface_m, WIDTH_M)
    moved = laid.outer[0] - wall().outer[0] - [WIDTH_M / 2, 0.0]
    assert moved == pytest.approx([shift_m, down_m], abs=13e-6)  # half a step of the shifts
    assert laid.inner - laid.outer == pytest.approx(wall().inner - wall().outer)


def test_where_no_surface_is_seen_the_wall_stays_in_the_middle() -> None:
    laid = laid_on_surface(wall(), np.full(COLUMNS, np.nan), WIDTH_M)
    assert laid.outer == pytest.approx(wall().outer + np.array([WIDTH_M / 2, 0.0]))


def test_each_frame_is_drawn_bare_and_with_all_its_walls() -> None:
    walls = tuple(ComputedWall(name, wall().shifted(WIDTH_M / 2, 0.3e-3)) for name in ("finite strain", "linear"))
    frame = np.zeros((64, 64), dtype=np.uint16)
    figure = plot_walls([FrameWithWalls(title, frame, (WIDTH_M, 4e-3), walls) for title in ("a", "b", "c")])
    assert len(figure.axes) == 6
    assert [len(axes.get_lines()) for axes in figure.axes] == [0, 0, 0, 4, 4, 4]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["finite strain", "linear"]
