"""Frames of the analytic library's walls, for tests of the fit: where they are looked at, and errors of boundaries."""

import numpy as np
from analytic_library import analytic_library

from scleraforce.fitting.placement import Placed, Places
from scleraforce.study import Range, ReaderStudy

__all__ = ["BOTH", "LATERAL_M", "LIBRARY", "RANGES", "noisy_boundaries"]

COLUMNS = 256
LIBRARY = analytic_library()
RANGES = ReaderStudy(
    youngs_modulus_pa=Range(min=0.15e6, max=0.6e6),
    iop_pa=Range(min=100.0, max=600.0),
    thickness_m=Range(min=0.4e-3, max=0.9e-3),
    gap_m=Range(min=0.3e-3, max=1.0e-3),
)
LATERAL_M = (np.arange(COLUMNS) + 0.5 - COLUMNS / 2) * 15e-3 / COLUMNS
BOTH = Places(np.concatenate([LATERAL_M, LATERAL_M]), np.repeat([0, 1], COLUMNS))


def noisy_boundaries(predicted: Placed, noise_m: float, rng: np.random.Generator | None) -> np.ndarray:
    """Boundaries at BOTH (2, column); where rng is given, with errors along the normal, correlated over 0.35 mm."""
    depth = predicted.depth_m.reshape(2, -1)
    if rng is None:
        return depth
    kernel = np.exp(-(np.linspace(-3, 3, 19) ** 2) / 2)
    kernel /= np.sqrt((kernel**2).sum())
    rough = [np.convolve(rng.standard_normal(COLUMNS + len(kernel) - 1), kernel, "valid") for _ in "oi"]
    return depth + noise_m * np.array(rough) * np.sqrt(1 + predicted.slope.reshape(2, -1) ** 2)
