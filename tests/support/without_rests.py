"""Labels of a force log whose zero no rest between two pushes tells of."""

import numpy as np

from scleraforce.calibration.forces import LABEL_SD_N, ZERO_PRIOR, FrameForces

__all__ = ["without_rests"]


def without_rests(forces_n: np.ndarray, rng: np.random.Generator, sd_n: float = LABEL_SD_N) -> FrameForces:
    """Return true forces with noise, in the place of `virtual_eyes.label_forces`."""
    noise_n = sd_n * rng.standard_normal(len(forces_n))
    return FrameForces(forces_n + noise_n, np.zeros(len(forces_n)), np.zeros(2), ZERO_PRIOR)
