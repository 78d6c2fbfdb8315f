"""What a reader's network is told beside the slice, as numbers of order one (NumPy only)."""

from dataclasses import dataclass
from math import radians, sqrt

import numpy as np
from numpy.typing import NDArray

from scleraforce.known.globe import UNKNOWN
from scleraforce.library.base_bulge import pole_directions
from scleraforce.library.plan import LARGEST_POLAR_DEG
from scleraforce.study import ReaderStudy

Floats = NDArray[np.float64]

# One column of the network's input for each.
GIVEN = (
    "modulus known", "modulus", "log modulus sd", "iop known", "log iop", "log iop ratio",
    "thickness known", "thickness", "gap known", "gap", "rigidity low", "rigidity high",
    "polar angle known", "polar angle", "direction known", "pole along", "pole across", "stiffening",
)  # fmt: skip


STIFF = np.log1p(30.0)  # of tissue that stiffens by so much the input is 1


@dataclass(frozen=True)
class Told:
    """What is known of some eyes, each (sample,); NaN: unknown.

    `modulus_pa` and `modulus_sd_fraction` (relative) describe a normal distribution; both or none of them are known.
    The globe's rigidity lies with 90 % between `rigidity_low` and `rigidity_high`, Pa^(1/3)/m^3, of the cube-root law:
    both 0 in an open globe; that is never unknown, only wide. `polar_rad` is the contact's polar angle, `direction_rad`
    that of the section from the meridian. `stiffening` is b of the tissue, never unknown.
    """

    modulus_pa: Floats
    modulus_sd_fraction: Floats
    iop_pa: Floats
    thickness_m: Floats
    gap_m: Floats
    rigidity_low: Floats
    rigidity_high: Floats
    polar_rad: Floats
    direction_rad: Floats
    stiffening: Floats


def unknown_modulus(study: ReaderStudy) -> tuple[float, float]:
    """Return mean and relative standard deviation that stand for a modulus of which nothing is known.

    They are those of the training's range, evenly spread.

    >>> mean_pa, sd = unknown_modulus(ReaderStudy())
    >>> round(mean_pa), round(sd, 3)
    (400000, 0.361)
    """
    low, high = study.youngs_modulus_pa.bounds
    mean = 0.5 * (low + high)
    return mean, (high - low) / sqrt(12.0) / mean


def told_modulus(told: Told, study: ReaderStudy) -> tuple[Floats, Floats]:
    """Return mean, Pa, and relative standard deviation of the modulus (sample,), also where it is unknown."""
    mean, sd = unknown_modulus(study)
    unknown = np.isnan(told.modulus_pa)
    return np.where(unknown, mean, told.modulus_pa), np.where(unknown, sd, told.modulus_sd_fraction)


def given_inputs(told: Told, study: ReaderStudy) -> NDArray[np.float32]:
    """Return the network's second input, shape (sample, len(GIVEN)): flags (1: known) and values, 0 where unknown.

    A value at the ends of its training range is -1 or 1. The IOP stands there twice: also over the modulus, which is
    what the mechanics knows. Where the pole lies, along the section and across it, stands there over the farthest; of
    an unknown polar angle it is that of the range's middle.
    """
    modulus, sd = told_modulus(told, study)
    e, p, s = study.youngs_modulus_pa.bounds, study.iop_pa.bounds, study.modulus_sd_fraction.bounds
    iop_ratio = (np.log(p[0] / e[1]), np.log(p[1] / e[0]))
    a = study.polar_angle_rad.bounds
    polar = np.minimum(told.polar_rad, radians(LARGEST_POLAR_DEG))
    pole = pole_directions(np.where(np.isnan(polar), 0.5 * (a[0] + a[1]), polar), told.direction_rad)
    pole /= max(np.sin(a[1]), 1e-12)
    columns = (
        ~np.isnan(told.modulus_pa),
        _scaled(modulus, *e),
        _scaled(np.log(sd), np.log(s[0]), np.log(s[1])),
        ~np.isnan(told.iop_pa),
        _scaled(np.log(told.iop_pa), np.log(p[0]), np.log(p[1])),
        _scaled(np.log(told.iop_pa / modulus), *iop_ratio),
        ~np.isnan(told.thickness_m),
        _scaled(told.thickness_m, *study.thickness_m.bounds),
        ~np.isnan(told.gap_m),
        _scaled(told.gap_m, *study.gap_m.bounds),
        _scaled(told.rigidity_low, UNKNOWN.lowest, UNKNOWN.highest),
        _scaled(told.rigidity_high, UNKNOWN.lowest, UNKNOWN.highest),
        ~np.isnan(polar),
        _scaled(polar, *a),
        ~np.isnan(told.direction_rad),
        *pole.T,
        np.log1p(told.stiffening) / STIFF,
    )
    inputs: NDArray[np.float32] = np.nan_to_num(np.stack(columns, axis=1)).astype(np.float32)
    return inputs


def _scaled(values: Floats, low: float, high: float) -> Floats:
    return (values - 0.5 * (low + high)) / max(0.5 * (high - low), 1e-12)
