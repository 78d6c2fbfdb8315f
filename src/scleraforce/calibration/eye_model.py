"""The eye that a recording shows, as the filter sees it: one interface for linear and finite-strain mechanics."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, prod, sqrt
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from scleraforce.known.eye import Known, Modulus
from scleraforce.known.globe import OPEN, KnownGlobe

Array = NDArray[np.float64]

SAMPLE_STEP_M = 0.1e-3  # between the samples of a section


@dataclass(frozen=True, kw_only=True)
class EyeConstants:
    """What is stated about an eye and its plane, SI; `polar_sd_rad` is 0 where the recording states the angle.

    `direction_rad` is None where it is not stated. `globe` is what is known of it.
    """

    iop_pa: float
    thickness_m: float
    gap_m: float
    polar_rad: float
    polar_sd_rad: float
    direction_rad: float | None = None
    tilt_rad: float = 0.0
    globe: KnownGlobe = OPEN

    @property
    def section_direction_rad(self) -> float:
        """Direction of the plane for linear mechanics: one that is not stated counts as that of the meridian."""
        return 0.0 if self.direction_rad is None else self.direction_rad


@dataclass(frozen=True, kw_only=True)
class WallState:
    """What the section depends on, SI: the modulus and the force, and what may be uncertain of the eye beside them."""

    youngs_modulus_pa: float
    force_n: float
    iop_pa: float
    thickness_m: float
    gap_m: float
    polar_rad: float
    rigidity_pa13_per_m3: float = 0.0


class EyeModel(Protocol):
    """The sections of one eye."""

    @property
    def constants(self) -> EyeConstants:
        """What is stated about the eye."""
        ...

    @property
    def polar_ends_rad(self) -> tuple[float, float]:
        """Polar angles between which the section's turning with the angle is taken; equal where it does not turn."""
        ...

    def curves(self, states: Sequence[WallState]) -> Array:
        """Return the sections as a segmentation sees them, (state, boundary, sample, 2) in m: lateral and depth."""
        ...

    def outside(self, state: WallState) -> str | None:
        """Return why the model's mechanics does not hold at a state, None where it does.

        `curves` goes on smoothly beyond, so that a search finds its way back; an estimate must not rest on that.
        """
        ...


def stated_wall(
    constants: EyeConstants,
    youngs_modulus_pa: float,
    force_n: float,
    polar_rad: float,
    rigidity_pa13_per_m3: float | None = None,
) -> WallState:
    """Return the state of the eye as stated, at a modulus, a force, the contact's polar angle and a rigidity.

    The rigidity is that in the middle of what is known of the globe where it is None.
    """
    return WallState(
        youngs_modulus_pa=youngs_modulus_pa,
        force_n=force_n,
        iop_pa=constants.iop_pa,
        thickness_m=constants.thickness_m,
        gap_m=constants.gap_m,
        polar_rad=polar_rad,
        rigidity_pa13_per_m3=constants.globe.mean if rigidity_pa13_per_m3 is None else rigidity_pa13_per_m3,
    )


def known_of_constants(constants: EyeConstants, modulus: Modulus | None = None) -> Known:
    """Return what a reader is told of an eye of which this is stated, and its modulus."""
    return Known(
        modulus=modulus,
        iop_pa=constants.iop_pa,
        thickness_m=constants.thickness_m,
        gap_m=constants.gap_m,
        polar_rad=constants.polar_rad,
        direction_rad=constants.direction_rad,
        globe=constants.globe,
    )


def parameter_sections(
    model: EyeModel, names: Sequence[str], values_rp: Array, force_n: float, polar_rad: float
) -> Array:
    """Return the sections for rows of uncertain parameters, shape (row, boundary, sample, 2).

    Args:
        model: the eye.
        names: of the fields of `WallState`, in the order of the columns.
        values_rp: their values, SI.
        force_n: force of the needle.
        polar_rad: polar angle of the contact.
    """
    stated = stated_wall(model.constants, 1.0, force_n, polar_rad)
    return model.curves([replace(stated, **dict(zip(names, row, strict=True))) for row in values_rp.tolist()])


def lagrange(nodes: Sequence[float], at: float) -> Array:
    """Return the weights (node,) of Lagrange's polynomial through `nodes` at a place.

    >>> lagrange((0.0, 1.0, 2.0), 0.5).tolist()
    [0.375, 0.75, -0.125]
    """
    return np.array([prod((at - other) / (node - other) for other in nodes if other != node) for node in nodes])


def polar_nodes(constants: EyeConstants) -> tuple[float, ...]:
    """Return the contact's polar angle, or three over its range where it is not stated; the middle one is stated."""
    spread = sqrt(3.0) * constants.polar_sd_rad
    return tuple(constants.polar_rad + k * spread for k in ((-1.0, 0.0, 1.0) if spread else (0.0,)))


def smoothed(curves: Array, sd_m: float) -> Array:
    """Return curves (..., sample, 2), sampled every `SAMPLE_STEP_M`, smoothed by a Gaussian; the ends stay."""
    if sd_m == 0:
        return curves
    sd = sd_m / SAMPLE_STEP_M
    inside = slice(ceil(4 * sd), -ceil(4 * sd))
    result = curves.copy()
    result[..., inside, :] = gaussian_filter1d(curves, sd, axis=-2)[..., inside, :]
    return result
