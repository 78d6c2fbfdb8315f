"""The wall finder's network: encoder and decoder with shortcuts (Ronneberger et al. 2015, U-Net), at half resolution.

A reduced frame goes in. For every second column come out two distributions over the rows, of the wall's upper and
lower boundary, and how sure it is that there is wall. Rows come back to full resolution in the last step, as two
channels that are interleaved: most of the work is done on a quarter of the pixels.
"""

from collections.abc import Iterator

from scleraforce.learning.framework import torch
from scleraforce.study import WallFinderStudy

INPUTS_OF_PIXEL = 3  # level, its root, and the row
BOUNDARIES = 2  # upper and lower


class WallFinderNetwork(torch.nn.Module):
    """Logits of the boundaries' rows (n, 2, rows, columns / 2), and of a column's having wall (n, columns / 2).

    Its input is a batch of reduced frames, float (n, rows, columns).
    """

    def __init__(self, study: WallFinderStudy) -> None:
        """Build the network with random weights (from PyTorch's generator)."""
        super().__init__()
        self.rows, self.columns = study.rows, study.columns
        sizes = study.channels
        self.down = torch.nn.ModuleList()
        self.level = torch.nn.ModuleList()
        for before, size in zip((INPUTS_OF_PIXEL, *sizes), sizes, strict=False):
            self.down.append(_convolution(before, size, stride=2))
            self.level.append(_convolution(size, size))
        self.deepest = torch.nn.ModuleList(_convolution(sizes[-1], sizes[-1]) for _ in range(2))
        self.up = torch.nn.ModuleList()
        for below, size in reversed(list(zip(sizes[1:], sizes, strict=False))):
            self.up.append(_convolution(below + size, size))
        self.boundaries = torch.nn.Conv2d(sizes[0], 2 * BOUNDARIES, 1)
        self.wall = torch.nn.Conv1d(2 * sizes[0], 1, 1)

    def forward(self, frames: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return both logits."""
        signal, shortcuts = self.inputs(frames), []
        for down, level in zip(self.down, self.level, strict=True):
            signal = level(down(signal))
            shortcuts.append(signal)
        for block in self.deepest:
            signal = signal + block(signal)
        for block, shortcut in zip(self.up, reversed(shortcuts[:-1]), strict=True):
            signal = torch.nn.functional.interpolate(signal, scale_factor=2, mode="nearest")
            signal = block(torch.cat([signal, shortcut], dim=1))
        pooled = torch.cat([signal.amax(dim=2), signal.mean(dim=2)], dim=1)
        return self._interleaved(self.boundaries(signal)), self.wall(pooled)[:, 0]

    def inputs(self, frames: torch.Tensor) -> torch.Tensor:
        """Return what the first convolution sees, (n, INPUTS_OF_PIXEL, rows, columns)."""
        row = torch.linspace(-1.0, 1.0, self.rows)[:, None].expand_as(frames)
        stacked = torch.stack([frames, frames.clamp(min=0.0).sqrt(), row], dim=1)
        return stacked.contiguous(memory_format=torch.channels_last)  # quicker on a CPU

    def convolutions(self) -> Iterator[tuple[str, torch.nn.Sequential]]:
        """Yield every 3 x 3 convolution with the name of its place."""
        for kind in ("down", "level", "deepest", "up"):
            for number, block in enumerate(getattr(self, kind)):
                yield f"{kind}{number}", block

    def _interleaved(self, channels: torch.Tensor) -> torch.Tensor:
        """Return (n, boundary, row, column) of (n, boundary * 2, row / 2, column)."""
        count, _, rows, columns = channels.shape
        parts = channels.reshape(count, BOUNDARIES, 2, rows, columns).transpose(2, 3)
        return parts.reshape(count, BOUNDARIES, 2 * rows, columns)


def _convolution(before: int, size: int, stride: int = 1) -> torch.nn.Sequential:
    """Return a 3 x 3 convolution, normalised over the batch, with a ramp behind it."""
    return torch.nn.Sequential(
        torch.nn.Conv2d(before, size, 3, stride, 1, bias=False), torch.nn.BatchNorm2d(size), torch.nn.ReLU()
    )
