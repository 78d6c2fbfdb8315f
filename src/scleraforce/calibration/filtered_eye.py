"""An eye's modulus by the paper's filter, with linear walls (paper sec. 3.2)."""

from dataclasses import replace

from scleraforce.calibration.calibration import EyeCalibration, FrameRecord
from scleraforce.calibration.filter import eye_filter
from scleraforce.calibration.filter.eye_parameters import polar_spread_rad
from scleraforce.calibration.filter.section_registration import first_belief
from scleraforce.calibration.recording_to_calibrate import (
    calibration_remarks,
    check_same_lean,
    nothing_taken,
    setup_to_calibrate,
    used_recordings,
)
from scleraforce.calibration.seen_frames import (
    CalibrationSettings,
    EyeFrames,
    frame_order,
)
from scleraforce.recordings.recording_folder import Recording
from scleraforce.records.eye import open_doubts
from scleraforce.records.fields import declared
from scleraforce.records.globe import OPEN
from scleraforce.records.needle import one_lean
from scleraforce.records.remark import Remark


def filter_eye(
    recording: Recording,
    settings: CalibrationSettings,
    frames: EyeFrames,
    earlier: EyeCalibration | None,
) -> EyeCalibration:
    """Return an eye after its frames have passed the filter one by one."""
    study = settings.study
    trials, forces, relaxation, _ = frames.labelled()
    session = _begin(recording, settings, frames, earlier)
    records = list(() if earlier is None else earlier.frames)
    steps = list(() if earlier is None else earlier.steps)
    left = len(trials) if settings.frames is None else settings.frames
    included = [trial.excluded is None for trial in trials]
    order = frame_order(
        forces.force_n,
        included,
        study.calibration.min_force_n,
        settings.frames,
    )

    for index in order:
        seen = frames.seen(index) if left > 0 and included[index] else None
        if seen is not None:
            force_n = float(forces.force_n[index])
            found: eye_filter.FrameStep | eye_filter.SkippedFrame | None
            if isinstance(seen.wall, eye_filter.SkippedFrame):
                found = seen.wall
            else:
                session = eye_filter.step(
                    session, seen.wall, force_n, float(forces.since_start_s[index])
                )
                found = session.last

            if isinstance(found, eye_filter.FrameStep):
                steps.append(found)
                left -= 1

            assert found is not None  # after a step
            record = FrameRecord(
                recording=str(recording.path),
                file=seen.file,
                sha256=seen.sha256,
                force_n=force_n,
                mean_pa=session.modulus.mean_pa,
                sd_pa=session.modulus.sd_pa,
            )
            records.append(_recorded(record, found))

        settings.count(1)

    settings.count(len(trials) - len(order))
    ignored = open_doubts(recording.info.eye.globe)
    remarks = calibration_remarks(
        recording,
        frames,
        records,
        [Remark("inputs-ignored", words, ("globe",)) for words in ignored],
    )
    if all(record.skipped is not None for record in records):
        raise nothing_taken(recording, frames, records, study)

    means, sds = eye_filter.parameter_moments(session.filter, session.state)
    return EyeCalibration(
        id=recording.info.eye_name,
        names=session.filter.space.names,
        means=tuple(means.tolist()),
        sds=tuple(sds.tolist()),
        bounds_n=study.classes.bounds_n,
        stated_thickness_m=declared(
            session.filter.model.setup.eye.thickness_m, "eye: thickness_m"
        ),
        globe=OPEN,
        state=session.state,
        recordings=used_recordings(recording, forces, earlier, remarks),
        frames=tuple(records),
        steps=tuple(steps),
        filter=session.filter,
        relaxation=relaxation,
        lean_rad=one_lean(recording.info.needle.lean_rad),
        assumed_iop_pa=session.filter.model.setup.eye.assumed_iop_pa,
        prior=study.calibration.prior(),
    )


def _begin(
    recording: Recording,
    settings: CalibrationSettings,
    frames: EyeFrames,
    earlier: EyeCalibration | None,
) -> eye_filter.EyeSession:
    """Return the eye before this recording's frames; the pose that frames share is new
    with each recording.
    """
    setup = setup_to_calibrate(recording, settings.study)
    # as in the paper: linear mechanics knows no other
    setup = replace(setup, eye=replace(setup.eye, globe=OPEN))
    _, forces, _, _ = frames.labelled()
    session = eye_filter.begin(
        settings.study,
        setup,
        settings.parameters,
        forces.zero_covariance,
        polar_sd_rad=polar_spread_rad(recording.info.needle, settings.study),
    )

    if earlier is None:
        return session

    check_same_lean(recording, earlier)
    assert earlier.state is not None  # of a filter
    return replace(
        session, state=replace(earlier.state, belief=first_belief(session.filter.model))
    )


def _recorded(
    record: FrameRecord, found: eye_filter.FrameStep | eye_filter.SkippedFrame
) -> FrameRecord:
    if isinstance(found, eye_filter.SkippedFrame):
        return replace(record, skipped=found.reason)

    result = found.result
    own_pa = found.registered.wall.youngs_modulus_pa
    return replace(
        record,
        own_modulus_pa=own_pa,
        points=result.observations,
        gated=result.gated,
        nis=result.nis,
        inflation=result.inflation,
        status=result.status,
    )
