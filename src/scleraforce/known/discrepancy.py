"""How far an eye's forces lie off those of the library's walls, as frames of known force have told.

Tissue stiffens, walls are uneven and corneas have a stiffness of their own. Most of that a calibration's E absorbs;
what is left grows with the force, and frames of the same eye share it. So it is learned per eye, as the discrepancy of
a model (Kennedy and O'Hagan, J. R. Stat. Soc. B 63, 2001):

    ln(F / F_library) = level + growth (F_library / 60 mN - 1/2)
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

REFERENCE_N = 60e-3  # growth is that from no force to this one; beyond it the discrepancy stays as it is


@dataclass(frozen=True, kw_only=True)
class ForceDiscrepancy:
    """Means and standard deviations of level and growth, which are normal, and their correlation.

    All are given E and the globe's rigidity at their means; a standard deviation of either above it takes level and
    growth along by `level_by` and `growth_by` (by E, by the rigidity): an eye's frames tell all of these together.
    `scatter`: how far the forces of single frames lie off these, in standard deviations of what is expected.
    `largest_n`: the largest of these forces, N, beyond which the eye is extrapolated; `widest_gap`: the widest gap
    between two of them, or below the first, as a share of the largest. None where they are not known.
    """

    level: float
    growth: float
    level_sd: float
    growth_sd: float
    correlation: float
    level_by: tuple[float, float] = (0.0, 0.0)
    growth_by: tuple[float, float] = (0.0, 0.0)
    scatter: float = 1.0
    largest_n: float | None = None
    widest_gap: float | None = None

    def corrected_n(
        self,
        library_n: Floats,
        level_z: Floats | float = 0.0,
        growth_z: Floats | float = 0.0,
        eye_z: Floats | tuple[float, float] = (0.0, 0.0),
    ) -> Floats:
        """Return the forces of the eye where the library's are `library_n`, N.

        Args:
            library_n: forces of the library's wall, N.
            level_z: standard normal numbers, by which the level is drawn; 0: its mean.
            growth_z: likewise, of the growth.
            eye_z: by how many standard deviations E and rigidity are above their means (..., 2).

        >>> stiffer = ForceDiscrepancy(level=0.0, growth=0.2, level_sd=0.0, growth_sd=0.0, correlation=0.0)
        >>> (1e3 * stiffer.corrected_n(np.array([0.0, 30e-3, 60e-3]))).round(2).tolist()
        [0.0, 30.0, 66.31]
        """
        level = self.level + self.level_sd * level_z + np.asarray(eye_z) @ self.level_by
        across = self.correlation * level_z + sqrt(1.0 - self.correlation**2) * growth_z
        growth = self.growth + self.growth_sd * across + np.asarray(eye_z) @ self.growth_by
        forces: Floats = library_n * np.exp(level + growth * beside_middle(library_n))
        return forces

    def at_reference(self) -> tuple[float, float]:
        """Return mean and standard deviation of ln(F / F_library) at 60 mN.

        >>> stiffer = ForceDiscrepancy(level=0.02, growth=0.2, level_sd=0.03, growth_sd=0.08, correlation=0.0)
        >>> mean, sd = stiffer.at_reference()
        >>> round(mean, 3), round(sd, 3)
        (0.12, 0.05)
        """
        half = 0.5 * self.growth_sd
        variance = self.level_sd**2 + half**2 + 2.0 * self.correlation * self.level_sd * half
        return self.level + 0.5 * self.growth, sqrt(variance)


NO_DISCREPANCY = ForceDiscrepancy(level=0.0, growth=0.0, level_sd=0.0, growth_sd=0.0, correlation=0.0)


def beside_middle(library_n: Floats) -> Floats:
    """Return where forces lie beside the middle of the range, -1/2 to 1/2: what growth is multiplied by."""
    return np.clip(library_n / REFERENCE_N, 0.0, 1.0) - 0.5
