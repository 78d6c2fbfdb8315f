"""Eyes to calibrate on, and what is stated of them."""

import numpy as np

from scleraforce.calibration.filter.eye_parameters import EyeConstants
from scleraforce.lab.virtual_eye import PhantomEye
from scleraforce.records.study import Study


def drawn_eye(
    number: int,
    rng: np.random.Generator,
    polar_rad: tuple[float, float] = (0.436, 0.785),
) -> PhantomEye:
    """Return one of many eyes: three thicknesses in turn, all else drawn; `polar_rad`:
    between which angles.
    """
    return PhantomEye(
        id=f"eye-{number}",
        thickness_m=(0.5e-3, 0.65e-3, 0.8e-3)[number % 3],
        youngs_modulus_pa=float(rng.uniform(0.2e6, 0.35e6)),
        iop_pa=float(rng.uniform(150.0, 400.0)),
        gap_m=float(rng.uniform(0.4e-3, 0.8e-3)),
        polar_rad=float(rng.uniform(*polar_rad)),
        azimuth_rad=float(rng.uniform(0.0, 6.28)),
    )


def stated(study: Study, eye: PhantomEye) -> EyeConstants:
    """Return what a recording would state; the contact's angle is not known."""
    low, high = study.needle.polar_angle_rad.bounds
    return EyeConstants(
        iop_pa=eye.iop_pa,
        thickness_m=eye.thickness_m,
        gap_m=eye.gap_m,
        polar_rad=(low + high) / 2,
        polar_sd_rad=(high - low) / 12**0.5,
        direction_rad=eye.direction_rad,
    )
