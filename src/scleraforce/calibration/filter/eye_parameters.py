"""The eye of a recording as the filter sees it, and its uncertain parameters.

The filter works on coordinates that are Gaussian. A positive parameter is lognormal:
its coordinate is ln(value / unit), with the moments of the prior. Otherwise (the
paper's choice) the coordinate is value / unit; the unit, the prior's mean, only keeps
the coordinates of order one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log, prod, sqrt

import numpy as np

from scleraforce.base.arrays import Flags, Floats
from scleraforce.records.fields import declared
from scleraforce.records.globe import UNKNOWN, Globe
from scleraforce.records.needle import Needle
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study

SAMPLE_STEP_M = 0.1e-3  # between the samples of a section


@dataclass(frozen=True, eq=False)
class ParameterSpace:
    """The uncertain parameters of a filter: their names, means and standard deviations
    of their priors (p,), SI.

    Some are `lognormal` (p,); of the others, too, only positive values exist.

    >>> mean, sd = np.array([0.49e6]), np.array([0.34e6])
    >>> space = ParameterSpace(("youngs_modulus_pa",), mean, sd, np.array([True]))
    >>> [round(float(v[0])) for v in space.moments(*space.prior())]
    [490000, 340000]
    """

    names: tuple[str, ...]
    means: Floats
    sds: Floats
    lognormal: Flags

    def __post_init__(self) -> None:
        if not ((self.sds > 0) & (self.means > 0)).all():
            raise ValueError(
                f"{', '.join(self.names)}: priors need positive means and standard"
                f" deviations, not {self.means} and {self.sds}"
            )

    def prior(self) -> tuple[Floats, Floats]:
        """Return mean (p,) and covariance (p, p) of the prior in the filter's
        coordinates.
        """
        ratios = [
            (sd / mean) ** 2
            for sd, mean in zip(self.sds.tolist(), self.means.tolist(), strict=True)
        ]
        logs = np.array([log(1 + ratio) for ratio in ratios])

        return np.where(self.lognormal, -logs / 2, 1.0), np.diag(
            np.where(self.lognormal, logs, ratios)
        )

    def values(self, coordinates: Floats) -> Floats:
        """Return the parameters (..., p) in SI for coordinates (..., p)."""
        scaled = np.where(
            self.lognormal,
            np.exp(np.where(self.lognormal, coordinates, 0.0)),
            coordinates,
        )
        return scaled * self.means

    def exist(self, values: Floats) -> Flags:
        """Return True for each row of values (..., p), SI, that an eye can have."""
        return np.asarray((np.isfinite(values) & (values > 0)).all(axis=-1))

    def moments(self, mean: Floats, covariance: Floats) -> tuple[Floats, Floats]:
        """Return means (p,) and standard deviations (p,) in SI of coordinates with the
        given Gaussian.
        """
        variance = np.diag(covariance)
        lognormal_mean = np.exp(np.where(self.lognormal, mean + variance / 2, 0.0))
        lognormal_sd = lognormal_mean * np.sqrt(
            np.expm1(np.where(self.lognormal, variance, 0.0))
        )
        means = np.where(self.lognormal, lognormal_mean, mean)
        sds = np.where(self.lognormal, lognormal_sd, np.sqrt(variance))

        return means * self.means, sds * self.means


@dataclass(frozen=True, kw_only=True)
class WallState:
    """The variables of a section, SI: modulus and force, and values of the eye that may
    be uncertain.
    """

    youngs_modulus_pa: float
    force_n: float
    iop_pa: float
    thickness_m: float
    gap_m: float
    polar_rad: float
    rigidity_pa13_per_m3: float = 0.0


def stated_wall(
    setup: Setup, youngs_modulus_pa: float, force_n: float, polar_rad: float
) -> WallState:
    """Return the state of the eye as stated; the rigidity is the mean of the known
    globe's. Raises `InputError` where IOP, thickness or gap is not declared.
    """
    return WallState(
        youngs_modulus_pa=youngs_modulus_pa,
        force_n=force_n,
        iop_pa=declared(setup.eye.iop_pa, "eye: iop_pa"),
        thickness_m=declared(setup.eye.thickness_m, "eye: thickness_m"),
        gap_m=declared(setup.needle.gap_m, "needle: gap_m"),
        polar_rad=polar_rad,
        rigidity_pa13_per_m3=stated_globe(setup).mean,
    )


def stated_globe(setup: Setup) -> Globe:
    """Return the globe as far as it is stated; one that is not may be sealed."""
    return setup.eye.globe or UNKNOWN


def stated_polar_rad(setup: Setup) -> float:
    """Return the contact's polar angle, stated or the middle of its range; raises
    `InputError` where there is none.
    """
    return declared(setup.needle.polar_rad, "needle: polar_rad")


def lagrange(nodes: Sequence[float], at: float) -> Floats:
    """Return the weights (node,) of Lagrange's polynomial through `nodes` at a place.

    >>> lagrange((0.0, 1.0, 2.0), 0.5).tolist()
    [0.375, 0.75, -0.125]
    """
    return np.array(
        [
            prod((at - other) / (node - other) for other in nodes if other != node)
            for node in nodes
        ]
    )


def polar_spread_rad(needle: Needle, study: Study) -> float:
    """Return the standard deviation of the contact's polar angle: 0 if it is stated,
    else that of a study's range, of which any angle is as likely.
    """
    low, high = study.needle.polar_angle_rad.bounds
    return (high - low) / 12**0.5 if needle.polar_rad is None else 0.0


def polar_nodes(polar_rad: float, polar_sd_rad: float) -> tuple[float, ...]:
    """Return the stated polar angle of the contact, or three over its range, the stated
    one in the middle.
    """
    spread = sqrt(3.0) * polar_sd_rad
    return tuple(
        polar_rad + k * spread for k in ((-1.0, 0.0, 1.0) if spread else (0.0,))
    )


def smoothed_curves(curves: Floats, sd_m: float) -> Floats:
    """Return curves (..., sample, 2), sampled every `SAMPLE_STEP_M`, smoothed by a
    Gaussian; the ends stay.
    """
    if sd_m == 0:
        return curves

    sd = sd_m / SAMPLE_STEP_M
    reach = round(4 * sd)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sd) ** 2)
    result = curves.copy()
    last = curves.shape[-2] - 2 * reach
    parts = (
        weight * curves[..., first : first + last, :]
        for first, weight in enumerate(weights / weights.sum())
    )
    result[..., reach:-reach, :] = sum(parts)

    return result
