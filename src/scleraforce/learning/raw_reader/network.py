"""The raw reader's network: from a reduced raw frame and what is known of the eye to the force and the contact's place.

A network like the wall finder's says for every second column where both boundaries may lie. What it says becomes a
slice that is not binary: the share of each pixel that is wall, in the mean over all places that the boundaries may
have. The layers of the slice network read that. So no boundary is decided on the way, and all learns from the force.
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.learning.framework import torch
from scleraforce.learning.reader.network import ReaderNetwork
from scleraforce.learning.wall_finder.network import WallFinderNetwork
from scleraforce.segmentation.frame_window import FrameWindow
from scleraforce.study import SliceStudy, Study


class RawReaderNetwork(torch.nn.Module):
    """Mixtures of the force's place and places of the contact, as of `ReaderNetwork`; and the logits of the wall.

    `frames`: reduced, float (n, row, column); `given` (n, len(GIVEN)).
    """

    def __init__(self, study: Study, reads_slices: ReaderNetwork) -> None:
        """Build the network with random weights (from PyTorch's generator), before one that reads slices."""
        super().__init__()
        self.sees_wall = WallFinderNetwork(study.raw_reader.wall)
        self.reads_slices = reads_slices
        window = FrameWindow.of(study.raw_reader)
        self.down: torch.Tensor
        self.along: torch.Tensor
        self.register_buffer("down", torch.from_numpy(slice_rows(window, study.slice)))
        self.register_buffer("along", torch.from_numpy(slice_weights(window, study.slice)))

    def forward(
        self, frames: torch.Tensor, given: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return mixtures, the contact's places in mm, and logits of the boundaries' rows and of there being wall."""
        row_logits, wall_logits = self.sees_wall(frames)
        mixtures, places = self.reads_slices(self.slices(row_logits, wall_logits), given)
        return mixtures, places, row_logits, wall_logits

    def slices(self, row_logits: torch.Tensor, wall_logits: torch.Tensor) -> torch.Tensor:
        """Return the share of each pixel of the slices that is wall (n, row, column)."""
        of_row = row_logits.softmax(dim=2)
        outer, inner = (of_row.cumsum(dim=2) - 0.5 * of_row).unbind(1)
        wall = (outer - inner).clamp(min=0.0) * wall_logits.sigmoid()[:, None]
        return self.down @ wall @ self.along


def slice_rows(window: FrameWindow, study: SliceStudy) -> NDArray[np.float32]:
    """Return the weights (row of the slice, row of the window) of the means over a slice's rows.

    >>> slice_rows(FrameWindow(rows=4, columns=2, row_m=5e-5, column_m=1e-4), SliceStudy(rows=8))[:3]
    array([[0.5, 0.5, 0. , 0. ],
           [0. , 0. , 0.5, 0.5],
           [0. , 0. , 0. , 0. ]], dtype=float32)
    """
    edges = np.arange(window.rows + 1) * window.row_m
    pixels = np.arange(study.rows + 1)[:, None] * study.pixel_m
    covered: NDArray[np.float64] = np.diff(np.clip(edges, pixels[:-1], pixels[1:]), axis=1) / study.pixel_m
    return covered.round(6).astype(np.float32)


def slice_weights(window: FrameWindow, study: SliceStudy) -> NDArray[np.float32]:
    """Return the weights (pair of the window's columns, column of the slice) of what lies between two pairs."""
    pairs_m = window.laterals_m.reshape(-1, 2).mean(axis=1)
    columns_m = (np.arange(study.columns) + 0.5 - 0.5 * study.columns) * study.pixel_m
    unit = np.eye(len(pairs_m))
    weights: NDArray[np.float64] = np.stack([np.interp(columns_m, pairs_m, each) for each in unit])
    return weights.astype(np.float32)
