"""Samples for the reader, drawn from the response library: any number, each of an eye of its own (NumPy only)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.learning.reader.boundary_errors import disturb
from scleraforce.library import Library
from scleraforce.library.slices import Framing, fill_boundaries, wall_boundaries
from scleraforce.reader.given import Told, given_inputs, told_modulus
from scleraforce.study import Range, ReaderStudy, Sampled, SliceStudy

__all__ = ["Eyes", "ReaderSamples", "draw_eyes", "draw_samples"]

Floats = NDArray[np.float64]

BARELY_INSIDE = 1.0 - 1e-9
ROUNDS = 40
CALIBRATED_SD = 0.06  # relative: a modulus that is told as surer than this was calibrated on the eye itself
TRUNCATED_SD = 2.5  # a told modulus is never farther off than this


@dataclass(frozen=True)
class Eyes:
    """Eyes under a needle, the B-scan's tilt and the section's rotation, and what is told of them; (sample,), SI."""

    told: Told
    modulus_pa: Floats
    iop_pa: Floats
    thickness_m: Floats
    gap_m: Floats
    size: Floats
    tilt_rad: Floats
    rotation_rad: Floats
    force_n: Floats


@dataclass(frozen=True)
class ReaderSamples:
    """What the reader learns from.

    `slices` uint8 (sample, row, column), 0 or 255; `given` float32 (sample, len(GIVEN)); `force_n` (sample,);
    `modulus_pa`: that the network is told (sample,); `lateral_m`: of the needle axis from the slice's middle (sample,).
    """

    slices: NDArray[np.uint8]
    given: NDArray[np.float32]
    force_n: Floats
    modulus_pa: Floats
    lateral_m: Floats

    def __len__(self) -> int:
        return len(self.force_n)


def draw_samples(
    library: Library, reader: ReaderStudy, slice_study: SliceStudy, count: int, rng: np.random.Generator
) -> ReaderSamples:
    """Draw samples: eyes, forces, framings, and boundary errors like those of the segmentation.

    Args:
        library: of responses; `within` the slices' reach is enough, and quicker.
        reader: the ranges.
        slice_study: size of the slices.
        count: of samples.
        rng: source of all randomness.

    Raises:
        InputError: the library does not hold such eyes.
    """
    eyes = draw_eyes(library, reader, count, rng)
    framing = Framing(
        reader.lateral_m.sample(rng, count), reader.surface_depth_m.sample(rng, count), eyes.size, eyes.rotation_rad
    )
    ratio = eyes.force_n / (eyes.modulus_pa * eyes.size**2)
    walls = library.curves(eyes.thickness_m / eyes.size, eyes.iop_pa / eyes.modulus_pa, ratio)
    true = wall_boundaries(walls.curves_sbnc, eyes.gap_m / eyes.size, eyes.tilt_rad, framing, slice_study)
    seen = disturb(true.depth_sbc, slice_study, rng, scale=reader.boundary_errors)
    slices = fill_boundaries(seen, slice_study)
    told_pa, _ = told_modulus(eyes.told, reader)
    return ReaderSamples(slices, given_inputs(eyes.told, reader), eyes.force_n, told_pa, framing.lateral_m)


def draw_eyes(library: Library, reader: ReaderStudy, count: int, rng: np.random.Generator) -> Eyes:
    """Draw eyes that the library holds, with forces up to the largest that it holds for each.

    Raises:
        InputError: the library holds hardly any such eye.
    """
    told_pa, told_sd, modulus_pa = _moduli(reader, count, rng)
    iop_pa, thickness_m, size = (np.empty(count) for _ in range(3))
    plain = rng.random(count) < reader.plain_share
    missing = np.arange(count)
    for _ in range(ROUNDS):  # a corner of the ranges may lie outside the library: draw these again
        iop_pa[missing] = _log_even(reader.iop_pa, len(missing), rng)
        thickness_m[missing] = reader.thickness_m.sample(rng, len(missing))
        size[missing] = np.where(plain[missing], 1.0, reader.size.sample(rng, len(missing)))
        inside = library.covers(
            thickness_m[missing] / size[missing], iop_pa[missing] / modulus_pa[missing], np.zeros(len(missing))
        )
        missing = missing[~inside]
        if not len(missing):
            break
    else:
        raise InputError("the library holds hardly any eye of [reader]; make one that covers its ranges")
    gap_m = reader.gap_m.sample(rng, count)
    largest_n = library.largest_force_ratio(thickness_m / size, iop_pa / modulus_pa) * modulus_pa * size**2
    told_iop_pa = _told(iop_pa, reader.iop_noise_fraction, reader.iop_missing_fraction, rng)
    told_thickness_m = _told(thickness_m, reader.thickness_noise_fraction, reader.thickness_missing_fraction, rng)
    told_gap_m = _told(gap_m, reader.gap_noise_fraction, reader.gap_missing_fraction, rng)
    calibrated = told_sd < CALIBRATED_SD
    told_pa *= np.where(calibrated, _calibration_factor(told_thickness_m / thickness_m, told_iop_pa / iop_pa), 1.0)
    told = Told(told_pa, told_sd, told_iop_pa, told_thickness_m, told_gap_m)
    tilt_rad, rotation_rad = (
        np.where(plain, 0.0, angle.sample(rng, count)) for angle in (reader.tilt_rad, reader.rotation_rad)
    )
    force_n = _forces(reader, largest_n, rng)
    return Eyes(told, modulus_pa, iop_pa, thickness_m, gap_m, size, tilt_rad, rotation_rad, force_n)


def _moduli(reader: ReaderStudy, count: int, rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    """Return moduli that are told, their relative standard deviations (NaN: missing), and the eyes' own (sample,).

    The eye's own is drawn from what is told, so that it means what it says; where nothing is, evenly from the range.
    """
    middle_pa = reader.youngs_modulus_pa.sample(rng, count)
    sd = _log_even(reader.modulus_sd_fraction, count, rng)
    error = np.clip(rng.standard_normal(count), -TRUNCATED_SD, TRUNCATED_SD)
    missing = rng.random(count) < reader.modulus_missing_fraction
    own_pa = np.where(missing, middle_pa, middle_pa * (1.0 + sd * error))
    return np.where(missing, np.nan, middle_pa), np.where(missing, np.nan, sd), own_pa


def _calibration_factor(thickness_factor: Floats, iop_factor: Floats) -> Floats:
    """Return by how much a calibrated modulus is off where it was fitted with thickness and IOP that are off.

    It is fitted to dents and forces, and at a given dent F goes as E t^2 IOP^(1/3) (docs/reader.md): so the product
    stays. A factor is NaN where nothing was told.
    """
    t, p = (np.nan_to_num(factor, nan=1.0) for factor in (thickness_factor, iop_factor))
    return 1.0 / (t**2 * np.cbrt(p))


def _forces(reader: ReaderStudy, largest_n: Floats, rng: np.random.Generator) -> Floats:
    """Return forces (sample,), even up to the largest that the library holds, a share of them small."""
    small = rng.random(len(largest_n)) < reader.small_force_share
    top_n = np.minimum(np.where(small, reader.small_force_n, reader.max_force_n), largest_n * BARELY_INSIDE)
    forces: Floats = top_n * rng.random(len(largest_n))
    return forces


def _told(values: Floats, noise: float, missing: float, rng: np.random.Generator) -> Floats:
    """Return values as they are told: off by relative noise, NaN where they are missing."""
    told = values * (1.0 + noise * rng.standard_normal(len(values)))
    return np.where(rng.random(len(values)) < missing, np.nan, told)


def _log_even(values: Sampled, count: int, rng: np.random.Generator) -> Floats:
    """Draw from a range with its logarithm evenly spread, or from a choice."""
    if not isinstance(values, Range):
        return values.sample(rng, count)
    low, high = np.log(values.bounds)
    drawn: Floats = np.exp(rng.uniform(low, high, count))
    return drawn
