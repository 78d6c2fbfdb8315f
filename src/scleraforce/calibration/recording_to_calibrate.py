"""What a calibration takes from a recording beside its frames: what is stated of the
eye, and remarks on its frames and forces.
"""

from collections.abc import Sequence

import numpy as np

from scleraforce.base.errors import CalibrationError
from scleraforce.base.units import from_si
from scleraforce.calibration.calibration import (
    EyeCalibration,
    FrameRecord,
    UsedRecording,
)
from scleraforce.calibration.seen_frames import EyeFrames
from scleraforce.recordings.force_errors import FrameForces
from scleraforce.recordings.forces_under_frames import label_remarks
from scleraforce.recordings.recording_folder import Recording, tables_digest
from scleraforce.records.eye import Eye
from scleraforce.records.globe import UNKNOWN
from scleraforce.records.needle import Needle
from scleraforce.records.remark import Remark
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup, completed_by_study
from scleraforce.records.study import Study

# forces above this multiple of the highest calibrated force are far from it
FAR_ABOVE = 1.5


def setup_to_calibrate(recording: Recording, study: Study) -> Setup:
    """Return what a calibration takes from a recording's statements, completed by the
    study's values; raises `CalibrationError`.

    The modulus is sought. The size of the needle is no input.
    """
    info = recording.info
    if info.eye.thickness_m is None:
        raise CalibrationError(
            f"{recording.path / 'recording.toml'}: eye.thickness_m: missing; a"
            " calibration needs the wall's thickness"
        )

    completed = completed_by_study(info.setup, study)
    # of several planes, each moment has its own
    gap_m = 0.0 if info.scan.planes else completed.needle.gap_m
    return Setup(
        eye=Eye(
            iop_pa=completed.eye.iop_pa,
            iop_sd_pa=info.eye.iop_sd_pa,
            iop_assumed=True if info.eye.iop_pa is None else None,
            thickness_m=completed.eye.thickness_m,
            thickness_sd_m=info.eye.thickness_sd_m,
            radius_m=info.eye.radius_m,
            radius_sd_m=info.eye.radius_sd_m,
            globe=completed.eye.globe or UNKNOWN,
        ),
        needle=Needle(gap_m=gap_m, polar_rad=completed.needle.polar_rad),
        scan=Scan(
            direction_rad=completed.scan.direction_rad, tilt_rad=completed.scan.tilt_rad
        ),
    )


def calibration_remarks(
    recording: Recording,
    frames: EyeFrames,
    records: Sequence[FrameRecord],
    others: Sequence[Remark] = (),
) -> tuple[Remark, ...]:
    """Return remarks on the frames and forces of a recording that was calibrated on,
    after others.
    """
    trials, *_ = frames.labelled()
    missed_n = [record.force_n for record in records if record.skipped is not None]
    used_n = [record.force_n for record in records if record.skipped is None]
    return (
        *others,
        *label_remarks(recording, trials),
        *recording.walls.remarks,
        *frames.log_remarks,
        *reach_remarks(used_n, missed_n),
    )


def reach_remarks(
    used_n: Sequence[float], missed_n: Sequence[float]
) -> tuple[Remark, ...]:
    """Return a remark if forces, N, were missed far above all that were calibrated
    on.

    A wall that leaves the picture, down a dent or up under a rising pressure, cannot be
    calibrated on, and shallow dents hardly tell modulus and rigidity of a sealed eye
    apart.

    >>> reach_remarks([0.011, 0.02], [0.028])
    ()
    """
    highest_n = max(used_n, default=0.0)
    missed_n = [force_n for force_n in missed_n if np.isfinite(force_n)]
    if not missed_n or max(missed_n) <= FAR_ABOVE * highest_n:
        return ()

    words = (
        f"no frame above {from_si(highest_n, 'mn'):.0f} mN could be calibrated on,"
        f" of forces up to {from_si(max(missed_n), 'mn'):.0f} mN; what is read"
        " above rests on the library's walls alone"
    )
    return (Remark("forces-not-reached", words),)


def nothing_taken(
    recording: Recording,
    frames: EyeFrames,
    records: Sequence[FrameRecord],
    study: Study,
) -> CalibrationError:
    """Return the error of a recording that has no frame to calibrate on."""
    trials, *_ = frames.labelled()
    reason = next((record.skipped for record in records), "excluded")
    least_mn = from_si(study.calibration.min_force_n, "mn")
    remarks = calibration_remarks(recording, frames, records)
    return CalibrationError(
        f"{recording.path}: none of its {len(trials)} frames can be calibrated on"
        f" ({reason}); it takes frames with a wall in view and more than"
        f" {least_mn:g} mN" + "".join(f"; {remark}" for remark in remarks)
    )


def used_recordings(
    recording: Recording,
    forces: FrameForces,
    earlier: EyeCalibration | None,
    remarks: tuple[Remark, ...],
) -> tuple[UsedRecording, ...]:
    """Return the recordings that an eye rests on, this one among them."""
    path = str(recording.path)
    sha256 = tables_digest(recording)
    zero_n, drift = forces.zero.tolist()
    used = UsedRecording(
        path=path, sha256=sha256, zero_n=zero_n, drift_n_per_s=drift, remarks=remarks
    )

    return (used,) if earlier is None else (*earlier.recordings, used)


def check_same_lean(recording: Recording, earlier: EyeCalibration) -> None:
    """Raise a `CalibrationError` if some recordings of an eye state the needle's lean
    and some do not.
    """
    if (earlier.lean_rad is None) != (recording.info.needle.lean_rad is None):
        raise CalibrationError(
            f"{recording.path / 'recording.toml'}: needle.lean_rad: some recordings of"
            f" {earlier.id} state it and some do not; state it in all of them, or in"
            " none"
        )
