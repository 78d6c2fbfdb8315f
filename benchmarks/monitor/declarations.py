"""Known inputs of a monitor for one eye: with and without the globe, with and without
frames of known force.

Thickness, pressure and gap have the errors of calipers and gauges, the same in every
declaration.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from monitor.eyes import SessionEye, largest_force_n
from monitor.pictures import Frame, PooledGenerator, still_frame
from scleraforce.calibration.start_of_an_eye import ForceFrame
from scleraforce.calibration.stiffness_from_forces import (
    eye_of_forces,
    search_stiffening,
)
from scleraforce.reading.reading_models import ForceReader
from scleraforce.recordings.force_errors import LABEL_SD_N, ZERO_PRIOR
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import OPEN, SEALED, UNKNOWN
from scleraforce.records.needle import Needle
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall_in_metres import segmented_boundaries
from virtual_eyes import changed, wall_of

DECLARATIONS: Mapping[str, str] = {
    "declared": "declared; E and k from three frames",
    "found": "not declared; E and k from three frames",
    "unknown": "not declared; E alone, calibrated",
    "option": "not declared; E alone, as an option",
}
CALIBRATION_N = (10e-3, 20e-3, 28e-3)
# IOP and E: relative
THICKNESS_SD_M = 10e-6
GAP_SD_M = 20e-6
IOP_SD = 0.03
MODULUS_SD = 0.015


def declarations(
    drawn: SessionEye, reader: ForceReader, seed: int, rng: np.random.Generator
) -> dict[str, Setup]:
    """Return the known inputs of each declaration; after a calibration that diverges, E
    and k are unknown.
    """
    stated, modulus = stated_eye(drawn, rng)
    noise = PooledGenerator((seed, int(rng.integers(2**31))))
    forces_n = [min(force_n, largest_force_n(drawn)) for force_n in CALIBRATION_N]
    frames = [still_frame(drawn, force_n, rng, noise) for force_n in forces_n]
    zero_n = rng.normal(0.0, np.sqrt(ZERO_PRIOR[0, 0]))
    labelled = [
        (frame, force_n + zero_n + rng.normal(0.0, LABEL_SD_N))
        for frame, force_n in zip(frames, forces_n, strict=True)
    ]
    globe = SEALED if drawn.study.globe.kind == "sealed" else OPEN

    return {
        "declared": calibrated(changed(stated, globe=globe), labelled, reader),
        "found": calibrated(stated, labelled, reader),
        "unknown": changed(stated, modulus=modulus),
        "option": changed(stated, modulus=Modulus.stated(modulus.mean_pa)),
    }


def stated_eye(drawn: SessionEye, rng: np.random.Generator) -> tuple[Setup, Modulus]:
    """Return what is stated of an eye but its globe; and an E that makes up for that,
    as a calibration's does.
    """
    wall = wall_of(drawn.setup)
    thickness_m = wall.thickness_m + rng.normal(0.0, THICKNESS_SD_M)
    iop_pa = wall.iop_pa * (1.0 + rng.normal(0.0, IOP_SD))
    thinner = wall.thickness_m / thickness_m
    same_force = thinner**2 * (wall.iop_pa / iop_pa) ** (1.0 / 3.0)
    modulus_pa = wall.youngs_modulus_pa * same_force
    modulus_pa *= 1.0 + rng.normal(0.0, MODULUS_SD)
    stated = Setup(
        eye=Eye(iop_pa=iop_pa, thickness_m=thickness_m, globe=UNKNOWN),
        needle=Needle(
            gap_m=wall.gap_m + rng.normal(0.0, GAP_SD_M), polar_rad=wall.polar_rad
        ),
    )

    return stated, Modulus(
        mean_pa=modulus_pa, sd_pa=MODULUS_SD * modulus_pa, source="own"
    )


def calibrated(
    stated: Setup, labelled: Sequence[tuple[Frame, float]], reader: ForceReader
) -> Setup:
    """Return what is known of an eye after frames of known force."""
    scale = PixelScale.of(reader.study.oct)
    walls = [(find_wall(frame, scale), force_n) for frame, force_n in labelled]
    frames = [
        ForceFrame(wall=segmented_boundaries(wall, scale), force_n=force_n)
        for wall, force_n in walls
        if wall.usable
    ]
    found = search_stiffening(
        reader.library,
        lambda of_tissue, before: eye_of_forces(
            stated, frames, of_tissue, reader.study, before
        ),
    )
    assert found is not None  # the library has these eyes
    stiffening, (known, _) = found
    return replace(known, eye=replace(known.eye, stiffening=stiffening))
