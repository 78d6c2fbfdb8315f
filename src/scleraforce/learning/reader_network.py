"""The reader's network: from a slice and what is known of the eye to a histogram of F/E and the contact's place.

A column of a slice is wall from one depth to another, so three numbers say all of it: whether there is wall, how much,
and its mean depth. The depth enters as the distance from the undeformed circle of the eye, so that what varies is the
dent and the framing. Convolutions along the columns follow, then layers that also see what is known of the eye.
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.learning.framework import torch
from scleraforce.reader.given import GIVEN
from scleraforce.study import ReaderStudy, SliceStudy

__all__ = ["FEATURES", "KERNEL", "STRIDE", "ReaderNetwork", "circle_depth"]

FEATURES = 3  # of a column: wall at all, amount of wall, mean depth below the circle
KERNEL, STRIDE = 5, 2
GIVEN_UNITS = 32
TYPICAL_WALL = 0.6e-3  # m: amounts and depths enter in such units, so that they are of order one


class ReaderNetwork(torch.nn.Module):
    """Histogram logits (sample, bin) and lateral place in mm (sample,) from slices and given values.

    `slices`: float, 0 or 1, shape (sample, row, column); `given`: shape (sample, len(GIVEN)).
    """

    def __init__(self, reader: ReaderStudy, slice_study: SliceStudy, radius_m: float) -> None:
        """Build the network with random weights (from PyTorch's generator)."""
        super().__init__()
        depth = (np.arange(slice_study.rows) + 0.5 - slice_study.rows / 2) * slice_study.pixel_m / TYPICAL_WALL
        projection = np.stack([np.ones(slice_study.rows), depth])[:, :, None]
        circle = circle_depth(slice_study, radius_m) / TYPICAL_WALL
        self.wall_unit = slice_study.pixel_m / TYPICAL_WALL
        self.projection: torch.Tensor
        self.circle: torch.Tensor
        self.register_buffer("projection", torch.from_numpy(projection.astype(np.float32)))
        self.register_buffer("circle", torch.from_numpy(circle.astype(np.float32)))
        sizes = (FEATURES, *reader.channels)
        self.convolutions = torch.nn.ModuleList(
            torch.nn.Conv1d(sizes[n], sizes[n + 1], KERNEL, STRIDE, KERNEL // 2) for n in range(len(reader.channels))
        )
        columns = slice_study.columns
        for _ in reader.channels:
            columns = (columns - 1) // STRIDE + 1
        self.given_layer = torch.nn.Linear(len(GIVEN), GIVEN_UNITS)
        widths = (sizes[-1] * columns, *reader.hidden)
        self.hidden = torch.nn.ModuleList(
            torch.nn.Linear(widths[n] + GIVEN_UNITS, widths[n + 1]) for n in range(len(reader.hidden))
        )
        self.histogram = torch.nn.Linear(widths[-1], reader.bins)
        self.place = torch.nn.Linear(widths[-1], 1)

    def forward(self, slices: torch.Tensor, given: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return logits and lateral place."""
        signal = self.features(slices)
        for convolution in self.convolutions:
            signal = torch.relu(convolution(signal))
        known = torch.relu(self.given_layer(given))
        signal = signal.flatten(1)
        for layer in self.hidden:
            signal = torch.relu(layer(torch.cat([signal, known], dim=1)))
        return self.histogram(signal), self.place(signal)[:, 0]

    def features(self, slices: torch.Tensor) -> torch.Tensor:
        """Return the numbers that say what a column shows (sample, FEATURES, column)."""
        amount, moment = torch.nn.functional.conv1d(slices, self.projection).unbind(1)
        there = amount.clamp(max=1.0)
        below_circle = moment / amount.clamp(min=1.0) - self.circle * there
        return torch.stack([there, amount * self.wall_unit - there, below_circle], dim=1)


def circle_depth(slice_study: SliceStudy, radius_m: float) -> NDArray[np.float64]:
    """Return the depth of a circle of the eye's radius below its top, at the slice's columns (column,), m."""
    lateral = (np.arange(slice_study.columns) + 0.5 - slice_study.columns / 2) * slice_study.pixel_m
    depth: NDArray[np.float64] = radius_m - np.sqrt(np.maximum(radius_m**2 - lateral**2, 0.0))
    return depth
