"""Fields of light: speckle, thin bright curves, shadows; what all drawn B-scans are made of."""

from collections.abc import Sequence
from math import ceil, log, sqrt

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.optics import Shadow
from scleraforce.segmentation.grid import Float

Complex = NDArray[np.complex64]


def transmission(shadows: Sequence[Shadow], columns_m: NDArray[np.float64]) -> Float:
    """Return the share of the light that shadows leave in each column, shape (columns,)."""
    left = np.ones(len(columns_m))
    for shadow in shadows:
        across = (columns_m - shadow.centre_m) / (shadow.width_m / 2)
        left *= 1.0 - shadow.loss_fraction * np.exp(-log(2.0) * across**4)  # flat bottom, soft edges
    return left.astype(np.float32)


def add_ridge(
    field: Complex,
    depth_rows: NDArray[np.floating],
    amplitude: NDArray[np.floating],
    sigma_rows: float,
    rng: np.random.Generator,
) -> None:
    """Add a thin bright curve with a random phase in each column to the field; NaN depths are left out."""
    sigma = max(sigma_rows, 0.4)  # not narrower than a pixel shows
    column = np.flatnonzero(np.isfinite(depth_rows) & np.isfinite(amplitude) & (np.abs(depth_rows) < 2 * len(field)))
    depth, strength = depth_rows[column], amplitude[column] * np.exp(2j * np.pi * rng.random(len(column)))
    reach = ceil(4 * sigma)
    row = np.floor(depth).astype(int) + np.arange(-reach, reach + 1)[:, None]
    profile = np.exp(-(((row + 0.5 - depth) / sigma) ** 2) / 2)
    seen = (row >= 0) & (row < len(field))
    field[row[seen], np.broadcast_to(column, row.shape)[seen]] += (profile * strength)[seen].astype(np.complex64)


def circular_gaussian(shape: tuple[int, ...], rng: np.random.Generator) -> Complex:
    """Return independent complex circular Gaussian values of mean intensity 1."""
    pairs = rng.standard_normal((*shape, 2), dtype=np.float32) * np.float32(sqrt(0.5))
    values: Complex = pairs.view(np.complex64)[..., 0]
    return values


def seen_through(field: Complex, sigma_rows: float, sigma_columns: float) -> Complex:
    """See a field of independent scatterers through a Gaussian point spread function that keeps the mean intensity."""
    parts = np.ascontiguousarray(field).view(np.float32).reshape(*field.shape, 2)
    seen = cv2.sepFilter2D(parts, -1, _kernel(sigma_columns), _kernel(sigma_rows), borderType=cv2.BORDER_REFLECT_101)
    values: Complex = np.ascontiguousarray(seen, dtype=np.float32).view(np.complex64)[..., 0]
    return values


def _kernel(sigma: float) -> NDArray[np.float64]:
    """Return a sampled Gaussian of unit energy, shape (2 reach + 1,)."""
    reach = ceil(3.5 * sigma)
    values = np.exp(-((np.arange(-reach, reach + 1) / max(sigma, 1e-6)) ** 2) / 2)
    unit: NDArray[np.float64] = values / np.sqrt((values**2).sum())
    return unit


def amplitude_sigma(intensity_width_m: float) -> float:
    """Return the standard deviation of a Gaussian amplitude from the full width at half maximum of its intensity."""
    return intensity_width_m / (2.0 * sqrt(log(2.0)))


def decibel(level_db: float) -> float:
    """Return a ratio of intensities from dB."""
    return float(10.0 ** (level_db / 10.0))
