"""The reader's network: from a slice and what is known of the eye to a histogram of F/E and the contact's place.

A column of a slice is wall from one depth to another, so three numbers say all of it: whether there is wall, how much,
and its mean depth. The depth enters as the distance from the undeformed circle of the eye, so that what varies is the
dent and the framing. Convolutions along the columns follow, then layers that also see what is known of the eye.
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.learning.framework import torch
from scleraforce.reader.networks import GIVEN
from scleraforce.study import ReaderStudy, SliceStudy

FEATURES = 3  # of a column: wall at all, amount of wall, mean depth below the circle
KERNEL, STRIDE = 5, 2
GIVEN_UNITS = 32
COMPONENTS = 3  # of the mixture that the force is told by
SHARPNESS = (-6.0, 1.0)  # least and largest logarithm of a component's scale, over the range of the histogram
FAR = 1e4  # stands for the ends of the line, over the range of the histogram
TYPICAL_WALL = 0.6e-3  # m: amounts and depths enter in such units, so that they are of order one


class ReaderNetwork(torch.nn.Module):
    """A mixture of logistic distributions of the force's place, and the contact's place in mm (sample,).

    The force's place is sqrt(x / max x), x = F/E: from 0 to 1 along the histogram. A few numbers say where the force is
    and how sure that is; a network that has to say as much by the height of 128 bins learns slowly to be sure.

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
        self.force = torch.nn.Linear(widths[-1], 3 * COMPONENTS)
        with torch.no_grad():
            middles = torch.linspace(0.3, 0.9, COMPONENTS)
            self.force.bias[:] = torch.cat([torch.zeros(COMPONENTS), middles, torch.full((COMPONENTS,), -2.0)])
        self.bins = reader.bins
        self.place = torch.nn.Linear(widths[-1], 1)

    def forward(self, slices: torch.Tensor, given: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return mixtures (sample, 3 COMPONENTS): logits of weights, middles, log scales; and the contact's places."""
        signal = self.features(slices)
        for convolution in self.convolutions:
            signal = torch.relu(convolution(signal))
        known = torch.relu(self.given_layer(given))
        signal = signal.flatten(1)
        for layer in self.hidden:
            signal = torch.relu(layer(torch.cat([signal, known], dim=1)))
        return self.force(signal), self.place(signal)[:, 0]

    def features(self, slices: torch.Tensor) -> torch.Tensor:
        """Return the numbers that say what a column shows (sample, FEATURES, column)."""
        amount, moment = torch.nn.functional.conv1d(slices, self.projection).unbind(1)
        there = amount.clamp(max=1.0)
        below_circle = moment / amount.clamp(min=1.0) - self.circle * there
        return torch.stack([there, amount * self.wall_unit - there, below_circle], dim=1)


def log_density(mixture: torch.Tensor, place: torch.Tensor) -> torch.Tensor:
    """Return the logarithm of a mixture's density at places (sample,)."""
    weight, middle, log_scale = _parts(mixture)
    z = (place[:, None] - middle) * torch.exp(-log_scale)
    each = torch.nn.functional.logsigmoid(z) + torch.nn.functional.logsigmoid(-z) - log_scale
    return torch.logsumexp(torch.log_softmax(weight, dim=1) + each, dim=1)


def histogram(mixture: torch.Tensor, bins: int) -> torch.Tensor:
    """Return the mixture's share in each bin (sample, bin); the end bins have all that lies beyond."""
    weight, middle, log_scale = _parts(mixture)
    ends = torch.from_numpy(bin_ends(bins))
    below = torch.sigmoid((ends - middle[:, :, None]) * torch.exp(-log_scale)[:, :, None])
    shares = (torch.softmax(weight, dim=1)[:, :, None] * below).sum(dim=1)
    return shares[:, 1:] - shares[:, :-1]


def _parts(mixture: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return logits of the weights, middles and log scales, each (sample, COMPONENTS)."""
    weight, middle, log_scale = torch.split(mixture, COMPONENTS, dim=1)
    return weight, middle, log_scale.clamp(*SHARPNESS)


def bin_ends(bins: int) -> NDArray[np.float32]:
    """Return the places of the bins' ends (bins + 1,); the first and the last are far away."""
    ends = np.linspace(0.0, 1.0, bins + 1, dtype=np.float32)
    ends[[0, -1]] = -FAR, FAR
    return ends


def circle_depth(slice_study: SliceStudy, radius_m: float) -> NDArray[np.float64]:
    """Return the depth of a circle of the eye's radius below its top, at the slice's columns (column,), m."""
    lateral = (np.arange(slice_study.columns) + 0.5 - slice_study.columns / 2) * slice_study.pixel_m
    depth: NDArray[np.float64] = radius_m - np.sqrt(np.maximum(radius_m**2 - lateral**2, 0.0))
    return depth
