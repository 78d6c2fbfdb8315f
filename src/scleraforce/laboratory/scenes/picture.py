"""What light meets in each pixel of a scene, filled layer by layer: backscatter and loss."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.scenes.window import Curve, Window
from scleraforce.segmentation.grid import Float


@dataclass(frozen=True)
class Ridge:
    """A thin bright curve: its row in the drawing (column,), NaN where it is not, intensity over the noise (column,).

    `sigma_rows` is its half width; one that is `shadowed` loses what the light has lost down to there.
    """

    row: Curve
    intensity: Curve
    sigma_rows: float
    shadowed: bool = True


@dataclass(frozen=True)
class Picture:
    """A drawing of (rows + above, columns) pixels.

    `scatter`: backscatter over the mean noise; `loss`: of the logarithm of the intensity in each pixel, both ways;
    `ridges` come on top.
    """

    window: Window
    scatter: Float
    loss: Float
    ridges: list[Ridge]

    @property
    def rows(self) -> Float:
        """The middles of the rows, shape (row, 1)."""
        rows: Float = np.arange(len(self.scatter), dtype=np.float32)[:, None] + np.float32(0.5)
        return rows

    def inside(self, top: Curve, bottom: Curve) -> NDArray[np.bool_]:
        """Return which pixels lie between two curves, given as rows (column,); none where one is NaN."""
        rows = self.rows
        within: NDArray[np.bool_] = (rows >= top.astype(np.float32)) & (rows < bottom.astype(np.float32))
        return within

    def fill(
        self, top: Curve, bottom: Curve, intensity: Curve | float, attenuation_per_m: float, stretch: float
    ) -> None:
        """Fill what lies between two curves (rows), in place of what was there.

        Args:
            top: upper edge, (column,).
            bottom: lower edge, (column,).
            intensity: backscatter over the mean noise, one or (column,).
            attenuation_per_m: of the light, one way.
            stretch: of optical over geometric depth.
        """
        within = self.inside(top, bottom)
        np.copyto(self.scatter, np.asarray(intensity, dtype=np.float32), where=within)
        loss = 2.0 * attenuation_per_m * self.window.pixel_m / stretch
        np.copyto(self.loss, np.float32(loss), where=within)

    def brighten(self, top: Curve, bottom: Curve, gain: Curve) -> None:
        """Multiply the backscatter between two curves (rows) by a gain, (column,) or (row, column)."""
        np.multiply(self.scatter, gain, out=self.scatter, where=self.inside(top, bottom), casting="same_kind")

    def shade(self, row: Curve, left: Curve) -> None:
        """Let only a share of the light (column,) pass beyond a row (column,)."""
        at = np.clip(np.nan_to_num(row, nan=0.0), 0, len(self.loss) - 1).astype(np.intp)
        self.loss[at, np.arange(self.loss.shape[1])] -= np.log(np.maximum(left, np.float32(1e-6)))


def empty_picture(window: Window) -> Picture:
    """Return a drawing with nothing in it."""
    shape = (window.rows + window.above, window.columns)
    return Picture(window, np.zeros(shape, dtype=np.float32), np.zeros(shape, dtype=np.float32), [])


def level(decibels: Curve | float) -> Curve:
    """Return ratios of intensities from dB."""
    ratio: Curve = np.power(10.0, np.asarray(decibels) / 10.0)
    return ratio
