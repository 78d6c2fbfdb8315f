"""Who yields in the holds of an eye's log, the tissue or the needle, by frames at
different times of one hold.
"""

from dataclasses import replace

import numpy as np

from scleraforce.calibration.assimilation import Skipped
from scleraforce.calibration.eye_frames import EyeFrames
from scleraforce.calibration.holds import HeldFrame, held_frames, who_yields
from scleraforce.calibration.known_forces import read_again
from scleraforce.calibration.relaxation import hold_log
from scleraforce.calibration.result import EyeCalibration
from scleraforce.known import Modulus, known_of_recording
from scleraforce.known.relaxation import KnownRelaxation
from scleraforce.library import Library
from scleraforce.study import Study


def decided(
    eye: EyeCalibration, frames: EyeFrames, library: Library, study: Study
) -> KnownRelaxation | None:
    """Return what the frames of an eye's holds say of its undecided relaxation; None
    without such frames.

    The frames need not be the ones that it was calibrated on: what counts is how their
    dents change within a hold, not the forces of these.
    """
    relaxation = eye.relaxation
    finding = None if relaxation is None else relaxation.finding
    if relaxation is None or finding is None or finding.cause != "undecided":
        return None

    trials, forces, _, _ = frames.labelled()
    log = hold_log(frames.without_gaps, forces)
    asked = list[HeldFrame]()
    walls = []

    held = held_frames(log, relaxation, forces.since_start_s)
    for frame in held.frames:
        force_n = float(forces.force_n[frame.index])
        seen = (
            frames.seen(frame.index)
            if trials[frame.index].excluded is None and np.isfinite(force_n)
            else None
        )
        if seen is not None and not isinstance(seen.wall, Skipped):
            asked.append(frame)
            walls.append((seen.planes or seen.wall, force_n))

    known = replace(
        known_of_recording(frames.recording.info),
        modulus=Modulus(mean_pa=eye.mean_pa, sd_pa=eye.sd_pa, source="own"),
        globe=eye.globe,
        thickness_m=eye.thickness_m,
    )
    of_tissue = library.for_stiffening(eye.stiffening)
    read = [
        (frame, again)
        for frame, again in zip(
            asked, read_again(walls, known, of_tissue, study), strict=True
        )
        if again is not None
    ]
    after = who_yields(
        relaxation,
        replace(held, frames=tuple(frame for frame, _ in read)),
        np.log([again.library_n for _, again in read]),
        np.array([again.sd_n / again.library_n for _, again in read]),
    )

    return None if after is relaxation else after
