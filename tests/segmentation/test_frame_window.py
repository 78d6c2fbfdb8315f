"""The window of a raw frame: means of counts over cells of a fixed size, whatever the frame's pixels are."""

import numpy as np
import pytest

from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.wall_finder import FrameWindow

WINDOW = FrameWindow(rows=80, columns=144, row_m=50e-6, column_m=100e-6)


def mean_by_sampling(frame: np.ndarray, scale: PixelScale, window: FrameWindow, row: int, column: int) -> float:
    """Return the mean count of a cell over a fine grid of points in it; points beside the frame do not count."""
    depth = (row + (np.arange(200) + 0.5) / 200) * window.row_m
    lateral = (column - window.columns / 2 + (np.arange(200) + 0.5) / 200) * window.column_m
    rows = np.floor(depth / scale.depth_m).astype(int)
    columns = np.floor(lateral / scale.lateral_m + frame.shape[1] / 2).astype(int)
    rows, columns = rows[(rows >= 0) & (rows < len(frame))], columns[(columns >= 0) & (columns < frame.shape[1])]
    return float(frame[np.ix_(rows, columns)].mean()) if len(rows) and len(columns) else 0.0


def test_cells_are_means_over_their_part_of_the_frame() -> None:
    frame = np.random.default_rng(1).integers(0, 4096, (31, 45)).astype(np.uint16)
    scale = PixelScale(lateral_m=37e-6, depth_m=9e-6)
    window = FrameWindow(rows=8, columns=20, row_m=41e-6, column_m=1e-4)
    found = window.means(frame, scale)
    assert found.shape == (8, 20)
    for row, column in ((0, 10), (3, 4), (5, 13), (6, 2), (7, 10), (2, 0)):
        assert found[row, column] == pytest.approx(mean_by_sampling(frame, scale, window, row, column), rel=0.02)
    assert not found[7].any()  # below the frame
    assert not found[:, 0].any()  # beside it


def test_a_wall_lies_in_the_same_cells_in_frames_of_any_size() -> None:
    places = []
    for rows, columns, width_m, depth_m in ((512, 512, 15e-3, 4e-3), (640, 800, 16e-3, 5.2e-3)):
        scale = PixelScale(lateral_m=width_m / columns, depth_m=depth_m / rows)
        depth_of_row = (np.arange(rows) + 0.5) * scale.depth_m
        lit = (depth_of_row > 1e-3) & (depth_of_row < 1.6e-3)
        frame = np.repeat(np.where(lit, 2000, 300)[:, None], columns, axis=1).astype(np.uint16)
        reduced = WINDOW.reduced(frame, scale)
        places.append(np.flatnonzero(reduced[:, 72] > 0.5))
    np.testing.assert_array_equal(*places)
    assert (places[0][0], places[0][-1]) == (20, 31)  # 50 µm each
