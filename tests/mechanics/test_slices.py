import cv2
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from scleraforce.mechanics.contact import Section, SliceWindow
from scleraforce.mechanics.slices import WALL, fill_section, slice_window
from scleraforce.study import SliceStudy

PIXEL = 1e-4
WINDOW = SliceWindow(left_m=-7e-3, top_m=-3e-4, columns=140, rows=40, pixel_m=PIXEL)


def from_pixels(contour, window=WINDOW):
    """Section whose closed contour is given in pixels, (0, 0) being the window's upper left corner."""
    points = np.asarray(contour, dtype=np.float64) * window.pixel_m + (window.left_m, window.top_m)
    half = len(points) // 2
    return Section(points[:half], points[half:][::-1])


def naive_winding(contour, x, y):
    """Winding number by the definition: the sum of the angles under which the edges are seen."""
    seen = (contour[:, 0] - x) + 1j * (contour[:, 1] - y)
    return round(np.angle(np.roll(seen, -1) * seen.conj()).sum() / (2 * np.pi))


def naive_slice(section, window):
    """Second implementation: the definition at every pixel centre."""
    image = np.zeros((window.rows, window.columns), np.uint8)
    for row in range(window.rows):
        for column in range(window.columns):
            x = window.left_m + (column + 0.5) * window.pixel_m
            y = window.top_m + (row + 0.5) * window.pixel_m
            image[row, column] = WALL if naive_winding(section.contour, x, y) else 0
    return image


def test_a_rectangle_through_pixel_centres_holds_its_left_and_top_edge_only():
    image = fill_section(from_pixels([(10.5, 5.5), (20.5, 5.5), (20.5, 9.5), (10.5, 9.5)]), WINDOW)
    rows, columns = np.nonzero(image)
    assert (columns.min(), columns.max(), rows.min(), rows.max()) == (10, 19, 5, 8)
    assert np.count_nonzero(image) == 10 * 4


def test_walls_that_touch_neither_overlap_nor_leave_a_seam():
    rng = np.random.default_rng(3)
    seam = np.c_[np.linspace(-5, 145, 40), 20 + 6 * rng.standard_normal(40)]
    seam[::4] = np.floor(seam[::4]) + 0.5  # some corners on pixel centres
    seam[:, 0].sort()
    above = fill_section(from_pixels(np.r_[[(-5, -5), (145, -5)], seam[::-1]]), WINDOW)
    below = fill_section(from_pixels(np.r_[seam, [(145, 45), (-5, 45)]]), WINDOW)
    np.testing.assert_array_equal(above, 255 - below)


def wall(outer_pixels, thickness_pixels=6.0):
    """A wall of constant thickness under a curve, as a section."""
    step = np.gradient(outer_pixels, axis=0)
    normal = np.c_[-step[:, 1], step[:, 0]] / np.hypot(*step.T)[:, None]
    points = [
        p * PIXEL + (WINDOW.left_m, WINDOW.top_m) for p in (outer_pixels, outer_pixels + thickness_pixels * normal)
    ]
    return Section(*points)


X = np.linspace(-10, 150, 161)


def w_dent():
    return wall(np.c_[X, 4 + 14 * np.exp(-(((X - 60) / 7) ** 2)) + 11 * np.exp(-(((X - 85) / 6) ** 2))], 5.0)


def fold():
    u = np.linspace(-1, 1, 300)
    return wall(np.c_[70 + 80 * u - 45 * np.sin(np.pi * u), 17 + 14 * u], 4.0)


def dent_through_the_floor():
    return wall(np.c_[X, 3 + 60 * np.exp(-(((X - 70) / 20) ** 2))])


def dome_through_the_roof():
    return wall(np.c_[X, -8 + 0.01 * (X - 70) ** 2], 5.0)


@pytest.mark.parametrize("shape", [w_dent, fold, dent_through_the_floor, dome_through_the_roof])
def test_a_slice_agrees_with_the_winding_number_at_every_centre(shape):
    section = shape()
    np.testing.assert_array_equal(fill_section(section, WINDOW), naive_slice(section, WINDOW))


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.floats(-5, 17), st.floats(-5, 15)), min_size=3, max_size=9))
def test_any_polygon_agrees_with_opencv_away_from_its_edge(points):
    window = SliceWindow(left_m=0.0, top_m=0.0, columns=12, rows=10, pixel_m=PIXEL)
    contour = np.asarray(points, dtype=np.float32)
    image = fill_section(from_pixels(contour, window), window)
    for row in range(10):
        for column in range(12):
            centre = (column + 0.5, row + 0.5)
            if abs(cv2.pointPolygonTest(contour, centre, measureDist=True)) > 1e-3:
                assert bool(image[row, column]) == bool(naive_winding(np.float64(contour), *centre))


def test_the_window_puts_the_unloaded_top_below_the_margin_and_framing_moves_the_wall_right_and_down():
    study = SliceStudy()
    flat = Section(np.array([[-1e-3, 0.0], [1e-3, 0.0]]), np.array([[-1e-3, 5e-4], [1e-3, 5e-4]]))
    rows, columns = np.nonzero(fill_section(flat, slice_window(study, top_m=0.0)))
    assert (columns.min(), columns.max(), rows.min(), rows.max()) == (60, 79, 3, 7)
    window = slice_window(study, 0.0, framing_lateral_m=4e-4, framing_depth_m=2e-4)
    rows, columns = np.nonzero(fill_section(flat, window))
    assert (columns.min(), columns.max(), rows.min(), rows.max()) == (64, 83, 5, 9)
