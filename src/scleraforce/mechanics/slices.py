"""The binary slice: a section of the wall, drawn into the window that the network sees (paper sec. 2.3).

A pixel is wall exactly where its centre lies in the wall. OpenCV's `fillPoly` also paints every pixel that the outline
touches, which fattens a 0.5 mm wall by about one pixel on each side (a disc of 20 pixels radius gains 6 % of its area),
and supersampling only shrinks that error while it multiplies the time. So the winding number of the contour is counted
at the pixel centres, column by column, and OpenCV's `threshold` makes the picture of it.
"""

import cv2
import numpy as np

from scleraforce.arrays import Bytes, Floats, Places
from scleraforce.mechanics.contact import Section, SliceWindow
from scleraforce.study import SliceStudy

WALL = 255  # the value of a pixel of the wall; 0 elsewhere
SNAP = 2.0**20  # parts of a pixel: an edge meant to run through pixel centres is not moved off them by the last bit


def slice_window(
    study: SliceStudy, top_m: float, framing_lateral_m: float = 0.0, framing_depth_m: float = 0.0
) -> SliceWindow:
    """Place the window of a slice in the plane's frame: laterally centred, row 0 `margin_m` above the unloaded wall.

    `top_m` is the smallest depth of the unloaded wall's section (with IOP and gravity, without the needle). The framing
    moves the wall right and down in the slice.

    >>> slice_window(SliceStudy(), top_m=0.0).left_m
    -0.007
    """
    left_m, top_m = -0.5 * study.columns * study.pixel_m - framing_lateral_m, top_m - study.margin_m - framing_depth_m
    return SliceWindow(left_m=left_m, top_m=top_m, columns=study.columns, rows=study.rows, pixel_m=study.pixel_m)


def fill_section(section: Section, window: SliceWindow) -> Bytes:
    """Draw a section, (rows, columns): `WALL` (255) in each pixel whose centre lies in the wall, else 0.

    Where a section overlaps itself it is still wall (winding number not 0); parts of it that leave the window are cut
    off. A centre on the contour belongs to the side to its right, or below it, so that walls that touch neither overlap
    nor leave a seam.

    >>> square = np.array([[0.0, 0.0], [3.0, 0.0]])
    >>> window = SliceWindow(left_m=-1.0, top_m=0.0, columns=5, rows=3, pixel_m=1.0)
    >>> fill_section(Section(square, square + [0.0, 2.0]), window)
    array([[  0, 255, 255, 255,   0],
           [  0, 255, 255, 255,   0],
           [  0,   0,   0,   0,   0]], dtype=uint8)
    """
    # In pixels: the centre of column c, row r is at (c, r).
    contour = np.concatenate([section.outer, section.inner[::-1], section.outer[:1]]).T
    origin = np.array([[window.left_m], [window.top_m]])
    across, down = np.rint((contour - origin) * (SNAP / window.pixel_m)) / SNAP - 0.5
    # The winding number of a centre: the signed edges that the ray from there upwards meets.
    edge, column, sense = columns_crossed(across, window.columns)
    row = down[edge] + (column - across[edge]) * (np.diff(down)[edge] / np.diff(across)[edge])
    first_below = np.clip(np.ceil(row - 0.5 / SNAP), 0, window.rows).astype(np.intp)
    entered = np.bincount(first_below * window.columns + column, sense, (window.rows + 1) * window.columns)
    winding = np.cumsum(entered.reshape(-1, window.columns)[:-1], axis=0, dtype=np.int8)
    return np.asarray(cv2.threshold(winding.view(np.uint8), 0, WALL, cv2.THRESH_BINARY)[1], dtype=np.uint8)


def columns_crossed(place: Floats, columns: int) -> tuple[Places, Places, Places]:
    """Return edge, column, and sense (1: to growing columns, else -1) of a line's crossings with columns 0, 1, 2 ...

    `place`, in columns: of the line's points. An edge crosses from ceil(start) to ceil(end) - 1, or the other way.
    """
    ends = np.clip(np.ceil(place), 0, columns).astype(np.intp)
    steps = np.diff(ends)
    crossed = np.abs(steps)
    edge = np.repeat(np.arange(len(steps)), crossed)
    nth = np.arange(len(edge)) - (np.cumsum(crossed) - crossed)[edge]
    return edge, np.minimum(ends[:-1], ends[1:])[edge] + nth, np.sign(steps)[edge]
