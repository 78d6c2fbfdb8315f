"""Who yields in the holds of an eye's log, the tissue or the needle, by frames at
different times of one hold, else by those of different pushes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.calibration.calibration import EyeCalibration
from scleraforce.calibration.filter.eye_filter import SkippedFrame
from scleraforce.calibration.holds_of_a_log import (
    MOST_FRAMES,
    doubted_by_dents,
    held_frames,
    log_is_sure,
    who_yields,
)
from scleraforce.calibration.relaxation_from_holds import hold_log
from scleraforce.calibration.seen_frames import EyeFrames
from scleraforce.calibration.start_of_an_eye import ForceFrame
from scleraforce.calibration.stiffness_from_forces import KnownForce, read_again
from scleraforce.library import Library
from scleraforce.records.eye import Modulus
from scleraforce.records.study import Study
from scleraforce.records.tissue_relaxation import Relaxation


def decided_relaxation(
    eye: EyeCalibration, frames: EyeFrames, library: Library, study: Study
) -> Relaxation | None:
    """Return what an eye's frames say of its undecided relaxation; None if nothing.

    Two frames of one hold decide: how their dents change, not the forces of these.
    Without such frames those of different pushes may contradict a log that seems sure.
    The frames need not be the ones that the eye was calibrated on.
    """
    relaxation = eye.relaxation
    finding = None if relaxation is None else relaxation.finding
    if relaxation is None or finding is None or finding.cause != "undecided":
        return None

    _, forces, _, _ = frames.labelled()
    log = hold_log(frames.without_gaps, forces)
    held = held_frames(log, relaxation, forces.since_start_s)
    read = _read(eye, frames, [frame.index for frame in held.frames], library, study)
    pairs = tuple(frame for frame in held.frames if frame.index in read)
    indices = [frame.index for frame in pairs]
    after = who_yields(relaxation, replace(held, frames=pairs), *_logs(read, indices))
    if after.finding is not None and after.finding.cause != "undecided":
        return after

    touching = np.flatnonzero(log.contact[log.frames(forces.since_start_s)])
    if log_is_sure(finding) and len(touching):
        chosen = np.linspace(0, len(touching) - 1, MOST_FRAMES).round().astype(int)
        read = _read(eye, frames, touching[np.unique(chosen)].tolist(), library, study)
        indices = list(read)
        since_s = forces.since_start_s[indices]
        after = doubted_by_dents(after, log, since_s, *_logs(read, indices))

    return None if after is relaxation else after


def _logs(
    read: Mapping[int, KnownForce], indices: Sequence[int]
) -> tuple[Floats, Floats]:
    """Return ln of the forces that were read, (frame,), and their standard
    deviations.
    """
    each = [read[index] for index in indices]
    return (
        np.log([one.library_n for one in each]),
        np.array([one.sd_n / one.library_n for one in each]),
    )


def _read(
    eye: EyeCalibration,
    frames: EyeFrames,
    indices: Sequence[int],
    library: Library,
    study: Study,
) -> dict[int, KnownForce]:
    """Return readings of an eye's frames without their forces, by index; those that
    cannot be read are missing.
    """
    trials, forces, _, _ = frames.labelled()
    asked = list[int]()
    held = list[ForceFrame]()

    for index in indices:
        force_n = float(forces.force_n[index])
        seen = (
            frames.seen(index)
            if trials[index].excluded is None and np.isfinite(force_n)
            else None
        )
        if seen is not None and not isinstance(seen.wall, SkippedFrame):
            asked.append(index)
            held.append(seen.with_force(force_n, None))

    known = replace(
        frames.recording.info.setup,
        eye=replace(
            frames.recording.info.setup.eye,
            modulus=Modulus(
                mean_pa=eye.mean_pa, sd_pa=eye.effective_sd_pa, source="own"
            ),
            globe=eye.globe,
            thickness_m=eye.thickness_m,
        ),
    )
    of_tissue = library.for_stiffening(eye.stiffening)
    again = read_again(held, known, of_tissue, study)
    return {
        index: one for index, one in zip(asked, again, strict=True) if one is not None
    }
