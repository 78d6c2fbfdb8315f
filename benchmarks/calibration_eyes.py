"""Eyes to calibrate on, and what is stated of them."""

import numpy as np

from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import OPEN
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study


def drawn_eye(
    number: int,
    rng: np.random.Generator,
    polar_rad: tuple[float, float] = (0.436, 0.785),
) -> Setup:
    """Return one of many eyes: three thicknesses in turn, all else drawn; `polar_rad`:
    between which angles.
    """
    return Setup(
        eye=Eye(
            f"eye-{number}",
            thickness_m=(0.5e-3, 0.65e-3, 0.8e-3)[number % 3],
            modulus=Modulus.stated(float(rng.uniform(0.2e6, 0.35e6))),
            iop_pa=float(rng.uniform(150.0, 400.0)),
        ),
        needle=Needle(
            gap_m=float(rng.uniform(0.4e-3, 0.8e-3)),
            polar_rad=float(rng.uniform(*polar_rad)),
            azimuth_rad=float(rng.uniform(0.0, 6.28)),
        ),
    )


def stated(study: Study, setup: Setup) -> Setup:
    """Return what a recording would state; the contact's angle is not known."""
    low, high = study.needle.polar_angle_rad.bounds
    return Setup(
        eye=Eye(iop_pa=setup.eye.iop_pa, thickness_m=setup.eye.thickness_m, globe=OPEN),
        needle=Needle(gap_m=setup.needle.gap_m, polar_rad=(low + high) / 2),
        scan=Scan(direction_rad=setup.scan.direction_rad),
    )
