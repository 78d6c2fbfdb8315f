"""A calibrated sealed eye as the filter leaves it, made by hand."""

import numpy as np

from scleraforce.calibration.assimilation import PARAMETERS, RIGIDITY, SHARED, EyeState
from scleraforce.calibration.known_forces import KnownForce
from scleraforce.calibration.registration import NUISANCES, PoseBelief
from scleraforce.calibration.result import Calibration, EyeCalibration, FrameRecord, UsedRecording
from scleraforce.calibration.roukf import Posterior
from scleraforce.known.eye import REFERENCE_RIGIDITY, SEALED, ForceDiscrepancy

__all__ = ["calibration_of_a_sealed_eye"]


def calibration_of_a_sealed_eye() -> Calibration:
    """E 0.3 ± 0.01 MPa, thickness 651 ± 12 µm and k 0.0312 ± 0.0012 mmHg^(1/3)/µl; forces 13 % high."""
    names, pose = (PARAMETERS["e"], PARAMETERS["thickness"], RIGIDITY), len(NUISANCES)
    count = len(names)
    posterior = Posterior(np.zeros(count), np.eye(count), np.eye(count), 3, ())
    state = EyeState(posterior, PoseBelief(np.zeros(pose), np.eye(pose)), np.zeros((count, len(SHARED))), np.eye(2))
    frames = tuple(
        FrameRecord(
            recording="mine",
            file=f"{number}.png",
            sha256=str(number),
            force_n=0.015 * number,
            mean_pa=0.3e6,
            sd_pa=1e4,
            own_modulus_pa=(0.2 + 0.05 * number) * 1e6,
            again=KnownForce(
                force_n=0.015 * number,
                library_n=0.014 * number,
                sd_n=2e-4,
                modulus_pa=0.3e6,
                rigidity=REFERENCE_RIGIDITY,
            ),
        )
        for number in (1, 2, 3)
    )
    eye = EyeCalibration(
        id="mine",
        names=names,
        means=(0.3e6, 651e-6, 1.04 * REFERENCE_RIGIDITY),
        sds=(1e4, 12e-6, 0.04 * REFERENCE_RIGIDITY),
        stated_thickness_m=650e-6,
        globe=SEALED,
        state=state,
        recordings=(UsedRecording(path="mine", sha256="0" * 64, zero_n=0.0, drift_n_per_s=0.0),),
        frames=frames,
        discrepancy=ForceDiscrepancy(level=0.02, growth=0.2, level_sd=0.02, growth_sd=0.04, correlation=0.0),
    )
    return Calibration({"mine": eye}, "0" * 64, (0.005, 0.03), "finite-strain")
