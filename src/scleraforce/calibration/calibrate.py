"""Young's modulus of each eye from its recordings, and of the population (paper sec.
3.2, Table 2).

The frames of an eye pass the filter one by one, and are then read again
(`stiffness_from_forces`), with the walls of one tissue at a time;
`stiffness_from_forces.search_stiffening` looks for the tissue that explains them best.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import CalibrationError
from scleraforce.base.normal_distribution import NINETY_PERCENT
from scleraforce.base.units import from_si
from scleraforce.calibration.calibration import (
    Calibration,
    EyeCalibration,
    FrameRecord,
    UsedRecording,
    rigidity_words,
)
from scleraforce.calibration.filter import eye_filter
from scleraforce.calibration.filter.eye_parameters import (
    polar_spread_rad,
    stated_globe,
)
from scleraforce.calibration.filter.library_sections import LibrarySections, library_eye
from scleraforce.calibration.filter.section_registration import first_belief
from scleraforce.calibration.holds_of_a_log import STEP_S
from scleraforce.calibration.seen_frames import (
    CalibrationSettings,
    EyeFrames,
    SeenFrame,
    count_nothing,
    frame_order,
)
from scleraforce.calibration.stiffness_from_forces import (
    TissueTrial,
    most_trials,
    own_modulus_and_globe,
    reread_eye,
    search_stiffening,
)
from scleraforce.calibration.who_yields import decided_relaxation
from scleraforce.library import Library
from scleraforce.library.sealed_eye import iop_ratio_under_force
from scleraforce.recordings.force_errors import FrameForces
from scleraforce.recordings.forces_under_frames import label_remarks, log_doubts
from scleraforce.recordings.recording_folder import Recording, tables_digest
from scleraforce.records.eye import Eye, open_doubts
from scleraforce.records.fields import declared
from scleraforce.records.globe import OPEN, SEALED, UNKNOWN
from scleraforce.records.needle import Needle, one_lean
from scleraforce.records.remark import Remark
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup, completed_by_study
from scleraforce.records.study import Study
from scleraforce.records.tissue_relaxation import Relaxation
from scleraforce.wall.wall_network import WallFinder

# standard deviations that a rigidity lies above 0 of a globe that cannot be open
SURE_SEALED = 3.0
STIFFENING = "stiffening"  # the parameter that no filter has: it is searched for
# frames of the search; if more are wanted, they are calibrated on once it is found
SOUGHT_ON = 6
# forces above this multiple of the highest calibrated force are far from it
FAR_ABOVE = 1.5
LEAKS = Remark(
    "leak-not-followed",
    "eye.leak_time_s: E and k are of the globe without its leak, which `read` and"
    " `monitor` do not follow",
    ("leak_time_s",),
)
LEAK_ROUNDS = 3  # of a calibration with the resting pressures that its E and k give


@dataclass
class _StepCount:
    """Counts down the steps of an eye's calibration and reports them."""

    left: int
    progress: Callable[[int], object]

    def __call__(self, steps: int) -> None:
        self.left -= steps
        self.progress(steps)


def calibrate_recordings(
    recordings: Sequence[Recording],
    study: Study,
    study_sha256: str,
    library: Library | None,
    parameters: tuple[str, ...] | None = None,
    frames: int | None = None,
    progress: Callable[[int], object] | None = None,
    finder: WallFinder | None = None,
) -> Calibration:
    """Calibrate every eye on its recordings; recordings of one eye add up. It raises
    `CalibrationError`.

    Without a library, mechanics is linear, as in the paper. The uncertain `parameters`
    are, of `e`, `stiffening`, `iop`, `thickness` and `gap`, by default e, and with a
    library the stiffening, which is found on the first recording of an eye; otherwise
    the stiffening is the study's. `frames` of each recording are taken that bear enough
    force, deep dents among them (None: all). `progress` is called with 1 after each
    frame, in each of `calibration_passes`. The `finder` checks the walls: a frame in
    which it sees another one is not used.
    """
    if parameters is None:
        parameters = ("e",) if library is None else ("e", STIFFENING)

    if library is None and STIFFENING in parameters:
        raise CalibrationError(
            "parameters: linear mechanics knows no tissue that stiffens; leave out"
            " stiffening"
        )

    of_filter = tuple(name for name in parameters if name != STIFFENING)
    passes = calibration_passes(library, parameters)
    settings = CalibrationSettings(
        study, library, of_filter, STIFFENING in parameters, frames, finder
    )
    eyes = dict[str, EyeCalibration]()

    for recording in recordings:
        eye_id = recording.info.eye_name
        count = _StepCount(passes * len(recording.frames), progress or count_nothing)
        eyes[eye_id] = _of_eye(
            recording, replace(settings, count=count), eyes.get(eye_id)
        )
        count(count.left)

    mechanics = "linear" if library is None else "finite-strain"
    return Calibration(eyes, study_sha256, study.classes.bounds_n, mechanics)


def calibration_passes(
    library: Library | None, parameters: tuple[str, ...] | None
) -> int:
    """Return the largest number of passes over the frames of a recording."""
    sought = parameters is None or STIFFENING in parameters
    return most_trials(library) + 1 if sought and library is not None else 1


def _of_eye(
    recording: Recording, settings: CalibrationSettings, before: EyeCalibration | None
) -> EyeCalibration:
    """Calibrate an eye; if its filter diverges, add a doubt on its stated globe."""
    globe = recording.info.eye.globe
    stated = None if globe is None else globe.kind
    used = (
        frozenset()
        if before is None
        else frozenset(sha256 for record in before.frames for _, sha256 in record.seen)
    )
    check_planes_can_calibrate(recording, settings)
    frames = EyeFrames(recording, settings, used, _known_relaxation(recording, before))
    recording = frames.recording

    if (
        before is not None
        and stated == before.globe.kind == "open"
        and before.globe.can_be_sealed
    ):
        return _as_open(_of_tissue(_without_globe(recording), settings, frames, before))

    found = _of_tissue(recording, settings, frames, before)
    if before is None and found.status == "ok":
        found = _of_yielding(recording, settings, frames, found)
    if (
        found.status == "ok"
        or before is not None
        or settings.library is None
        or stated is None
    ):
        return found

    other = _of_tissue(
        _without_globe(recording), replace(settings, count=count_nothing), frames, None
    )
    if other.status != "ok":
        return found
    if stated == "open" and other.globe.mean < max(
        SEALED.lowest, SURE_SEALED * other.globe.sd
    ):
        return _doubted(
            _as_open(other),
            "eye.globe is stated as open, and the model does not know its walls: they"
            f" are read as with {rigidity_words(other)}, less than that of closed eyes;"
            " is its limbus in view, or its wall uneven?",
        )

    doubt = (
        f"eye.globe is stated as {stated}, and the frames contradict that; for a globe"
        f" that may be open or sealed they show {rigidity_words(other)} and do not:"
        " state what it is, or leave eye.globe out"
    )
    return _doubted(replace(found, globe=UNKNOWN), doubt)


def _of_yielding(
    recording: Recording,
    settings: CalibrationSettings,
    frames: EyeFrames,
    found: EyeCalibration,
) -> EyeCalibration:
    """Calibrate an eye anew if frames of one hold decide who yields in the holds."""
    library = settings.library
    if library is None:
        return found

    relaxation = decided_relaxation(found, frames, library, settings.study)
    if relaxation is None:
        return found

    frames.decide(relaxation)
    frames.poses.clear()
    of_tissue = library.for_stiffening(found.stiffening)
    return calibrate_eye(
        recording,
        replace(settings, library=of_tissue, count=count_nothing),
        frames,
        None,
    ).found


def _known_relaxation(
    recording: Recording, before: EyeCalibration | None
) -> Relaxation | None:
    """Return how an eye relaxes as declared or found before; None: it is to be found.
    Early files have elastic eyes.
    """
    if before is not None:
        return before.relaxation or Relaxation.declared(())
    return recording.info.eye.relaxation


def _without_globe(recording: Recording) -> Recording:
    eye = replace(recording.info.eye, globe=None)
    return replace(recording, info=replace(recording.info, eye=eye))


def _as_open(eye: EyeCalibration) -> EyeCalibration:
    """Return an eye that was declared open and found with a small rigidity, which
    stands for other causes in its walls.

    It is as unsure as the declaration: the band that holds it with 90 % reaches down to
    0.
    """
    sd = max(eye.globe.sd, eye.globe.mean / NINETY_PERCENT)
    return replace(eye, globe=replace(eye.globe, kind=OPEN.kind, sd=sd))


def _doubted(eye: EyeCalibration, words: str) -> EyeCalibration:
    """Return an eye whose last recording contradicts the stated globe."""
    *others, last = eye.recordings
    doubt = Remark("globe-contradicted", words, ("globe",))
    last = replace(last, remarks=(*last.remarks, doubt))
    return replace(eye, recordings=(*others, last))


def _of_tissue(
    recording: Recording,
    settings: CalibrationSettings,
    frames: EyeFrames,
    earlier: EyeCalibration | None,
) -> EyeCalibration:
    """Calibrate an eye with the walls of the tissue that explains its frames best, or
    of the known one.
    """
    library = settings.library
    frames.poses.clear()
    if library is not None and earlier is None and settings.stiffening_sought:
        return _of_sought_tissue(recording, settings, library, frames)

    if library is not None:
        stiffening = (
            settings.study.tissue.stiffening if earlier is None else earlier.stiffening
        )
        library = library.for_stiffening(stiffening)

    return calibrate_eye(
        recording, replace(settings, library=library), frames, earlier
    ).found


def _of_sought_tissue(
    recording: Recording,
    settings: CalibrationSettings,
    library: Library,
    frames: EyeFrames,
) -> EyeCalibration:
    faults = list[CalibrationError]()
    more = len(recording.frames) > SOUGHT_ON and (
        settings.frames is None or settings.frames > SOUGHT_ON
    )

    def calibrate(
        of_tissue: Library, wanted: int | None
    ) -> TissueTrial[EyeCalibration]:
        with np.errstate(all="ignore"):
            # with walls that are far from the eye's a filter may end anywhere
            return calibrate_eye(
                recording,
                replace(settings, library=of_tissue, frames=wanted),
                frames,
                None,
            )

    def attempt(of_tissue: Library) -> TissueTrial[EyeCalibration] | None:
        try:
            return calibrate(of_tissue, SOUGHT_ON if more else settings.frames)
        except CalibrationError as fault:
            faults.append(fault)
            return None

    found = search_stiffening(library, attempt)
    if found is None:
        raise faults[0]

    stiffening, eye = found
    return (
        calibrate(library.for_stiffening(stiffening), settings.frames).found
        if more
        else eye
    )


def calibrate_eye(
    recording: Recording,
    settings: CalibrationSettings,
    frames: EyeFrames,
    earlier: EyeCalibration | None,
) -> TissueTrial[EyeCalibration]:
    """Calibrate an eye with the walls of one tissue; of one that leaks, anew with the
    pressures that this gives.
    """
    found = _calibrate_eye(recording, settings, frames, earlier, None)
    library = settings.library

    for _ in range(LEAK_ROUNDS if recording.info.eye.leak_time_s else 0):
        if library is None or found.found.status != "ok":
            break

        rests_pa = _rests_pa(recording, settings.study, library, frames, found.found)
        found = _calibrate_eye(
            recording, replace(settings, count=count_nothing), frames, earlier, rests_pa
        )

    return found


def _rests_pa(
    recording: Recording,
    study: Study,
    library: Library,
    frames: EyeFrames,
    eye: EyeCalibration,
) -> Floats:
    """Return the pressure at rest of a leaking eye at each frame (frame,), by its log,
    E and k.
    """
    _, forces, _, elastic_n = frames.labelled()
    stated_eye = setup_to_calibrate(recording, study).eye
    iop_pa = declared(stated_eye.iop_pa, "eye: iop_pa")
    modulus_pa = dict(zip(eye.names, eye.means, strict=True))[
        eye_filter.PARAMETERS["e"]
    ]
    law = eye.globe.pressure_law(eye.globe.mean)

    leak_time_s = recording.info.eye.leak_time_s
    if not law.is_sealed or leak_time_s is None:
        return np.full(len(forces.force_n), iop_pa)

    thickness = np.array([eye.stated_thickness_m])
    ends = library.iop_ratio_ends(thickness)

    def pressed(force_n: float, leaked_m3: float) -> float:
        rest = np.clip(law.pressure(iop_pa, -leaked_m3) / modulus_pa, *ends)
        force = np.array([force_n / modulus_pa])
        return modulus_pa * float(
            iop_ratio_under_force(
                library, thickness, rest, force, law.over(modulus_pa)
            )[0]
        )

    leaked_m3 = law.leaked_m3(iop_pa, leak_time_s / STEP_S, elastic_n, pressed)
    at_m3 = np.interp(
        forces.since_start_s, STEP_S * np.arange(len(leaked_m3)), leaked_m3
    )

    return law.pressure(iop_pa, -at_m3)


def _calibrate_eye(
    recording: Recording,
    settings: CalibrationSettings,
    frames: EyeFrames,
    earlier: EyeCalibration | None,
    rests_pa: Floats | None,
) -> TissueTrial[EyeCalibration]:
    """Calibrate an eye, whose frames have resting pressures of their own if it
    leaks.
    """
    study = settings.study
    library = settings.library
    trials, forces, relaxation, _ = frames.labelled()
    session = _begin(recording, settings, frames, earlier)
    records, steps = (
        ([], []) if earlier is None else (list(earlier.frames), list(earlier.steps))
    )
    least_n = study.calibration.min_force_n
    left = len(trials) if settings.frames is None else settings.frames
    included = [trial.excluded is None for trial in trials]
    rising = stated_globe(session.filter.model.setup).can_be_sealed
    order = frame_order(forces.force_n, included, least_n, settings.frames, rising)
    taken = dict[int, tuple[SeenFrame, float | None]]()
    refused = 0
    path = str(recording.path)

    for index in order:
        seen = frames.seen(index) if left > 0 and included[index] else None
        if seen is not None:
            force_n = float(forces.force_n[index])
            if isinstance(seen.wall, eye_filter.SkippedFrame):
                found: eye_filter.FrameStep | eye_filter.SkippedFrame | None = seen.wall
            else:
                rest_pa = None if rests_pa is None else float(rests_pa[index])
                now = _at(session, seen, rest_pa, study)
                now = eye_filter.step(
                    now, seen.wall, force_n, float(forces.since_start_s[index])
                )
                session = replace(now, filter=session.filter)
                found = session.last
                refused += force_n > least_n and isinstance(
                    found, eye_filter.SkippedFrame
                )

                if isinstance(found, eye_filter.FrameStep):
                    taken[len(records)] = seen, rest_pa
                    steps.append(found)
                    left -= 1

            assert found is not None  # after a step
            mean_pa = session.modulus.mean_pa
            sd_pa = session.modulus.sd_pa
            of_frame = partial(
                FrameRecord,
                recording=path,
                file=seen.file,
                sha256=seen.sha256,
                planes=seen.files,
            )
            frame = of_frame(force_n=force_n, mean_pa=mean_pa, sd_pa=sd_pa)
            records.append(_recorded(frame, found))

        settings.count(1)

    settings.count(len(trials) - len(order))
    missed_n = [record.force_n for record in records if record.skipped is not None]
    used_n = [record.force_n for record in records if record.skipped is None]
    sealed = open_doubts(recording.info.eye.globe) if library is None else ()
    remarks = (
        *(Remark("inputs-ignored", words, ("globe",)) for words in sealed),
        *(() if rests_pa is None else (LEAKS,)),
        *label_remarks(recording, trials),
        *recording.walls.remarks,
        *log_doubts(recording, study.classes, frames.dents),
        *reach_remarks(used_n, missed_n),
    )

    if not used_n:
        reason = next((record.skipped for record in records), "excluded")
        raise CalibrationError(
            f"{path}: none of its {len(trials)} frames can be calibrated on ({reason});"
            " it takes frames with a wall in view and more than"
            f" {from_si(least_n, 'mn'):g} mN"
            + "".join(f"; {remark}" for remark in remarks)
        )

    means, sds = eye_filter.parameter_moments(session.filter, session.state)
    eye = EyeCalibration(
        id=recording.info.eye_name,
        names=session.filter.space.names,
        means=tuple(means.tolist()),
        sds=tuple(sds.tolist()),
        bounds_n=study.classes.bounds_n,
        stated_thickness_m=declared(
            session.filter.model.setup.eye.thickness_m, "eye: thickness_m"
        ),
        globe=eye_filter.known_globe_after(session.filter, session.state),
        state=session.state,
        recordings=_recordings(recording, forces, earlier, remarks),
        frames=tuple(records),
        steps=tuple(steps),
        filter=session.filter,
        stiffening=0.0 if library is None else library.stiffening,
        relaxation=relaxation,
        lean_rad=one_lean(recording.info.needle.lean_rad),
    )

    return _settled(eye, eye_filter.known_after(session), taken, refused, settings)


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


def setup_to_calibrate(recording: Recording, study: Study) -> Setup:
    """Return what the filter takes from a recording's statements, completed by the
    study's values; raises `CalibrationError`.

    The modulus is sought. Uncertainties, and the recording's size of eye and needle,
    are no inputs of the filter.
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


def check_planes_can_calibrate(
    recording: Recording, settings: CalibrationSettings
) -> None:
    """Raise a `CalibrationError` if a recording of several planes meets linear
    mechanics or an uncertain gap.
    """
    place = f"{recording.path / 'recording.toml'}: oct.plane"
    if recording.info.scan.planes and settings.library is None:
        raise CalibrationError(
            f"{place}: linear mechanics takes a single plane; calibrate at finite"
            " strain"
        )
    if recording.info.scan.planes and "gap" in settings.parameters:
        raise CalibrationError(
            f"{place}: several planes show their gaps; leave gap out of the parameters"
        )


def _at(
    session: eye_filter.EyeSession,
    seen: SeenFrame,
    rest_pa: float | None,
    study: Study,
) -> eye_filter.EyeSession:
    """Return the eye at a frame's place, if it is one of several planes, and its own
    resting pressure, if it leaks.
    """
    model = session.filter.model
    if seen.planes is not None and isinstance(model, LibrarySections):
        model = library_eye(
            study, seen.beside(model.setup), model.library, model.polar_sd_rad
        )
    if rest_pa is not None:
        eye = replace(model.setup.eye, iop_pa=rest_pa)
        model = replace(model, setup=replace(model.setup, eye=eye))
    return replace(session, filter=replace(session.filter, model=model))


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
    if settings.library is None:
        # as in the paper: linear mechanics knows no other
        setup = replace(setup, eye=replace(setup.eye, globe=OPEN))

    _, forces, _, _ = frames.labelled()
    begun = (
        settings.study,
        setup,
        settings.library,
        settings.parameters,
        forces.zero_covariance,
    )
    session = eye_filter.begin(
        *begun,
        frames.poses if earlier is None else None,
        polar_sd_rad=polar_spread_rad(recording.info.needle, settings.study),
    )

    if earlier is None:
        return session
    if (earlier.lean_rad is None) != (recording.info.needle.lean_rad is None):
        raise CalibrationError(
            f"{recording.path / 'recording.toml'}: needle.lean_rad: some recordings of"
            f" {earlier.id} state it and some do not; state it in all of them, or in"
            " none"
        )

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
    record = replace(
        record, own_modulus_pa=own_pa, points=result.observations, gated=result.gated
    )

    return replace(
        record, nis=result.nis, inflation=result.inflation, status=result.status
    )


def _recordings(
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


def _settled(
    eye: EyeCalibration,
    setup: Setup,
    taken: Mapping[int, tuple[SeenFrame, float | None]],
    refused: int,
    settings: CalibrationSettings,
) -> TissueTrial[EyeCalibration]:
    """Return a calibration after its frames are read again, at their resting pressures,
    Pa, if it leaks.
    """
    if settings.library is None or eye.status != "ok":
        return TissueTrial.diverged(eye, refused)

    frames = list(eye.frames)
    asked = [
        (seen.planes or seen.wall, frames[place].force_n)
        for place, (seen, _) in taken.items()
        if not isinstance(seen.wall, eye_filter.SkippedFrame)
    ]
    rested = [rest_pa for _, rest_pa in taken.values() if rest_pa is not None]
    earlier = [
        frame.again
        for place, frame in enumerate(frames)
        if frame.again is not None and place not in taken
    ]
    after = reread_eye(
        setup, asked, earlier, settings.library, settings.study, rested or None
    )

    for place, read in zip(taken, after.again, strict=True):
        frames[place] = replace(frames[place], again=read)

    modulus, globe = own_modulus_and_globe(after.setup)
    now = {
        eye_filter.PARAMETERS["e"]: (modulus.mean_pa, modulus.sd_pa),
        eye_filter.RIGIDITY: (globe.mean, globe.sd),
    }
    estimates = zip(eye.names, eye.means, eye.sds, strict=True)
    means, sds = zip(
        *(now.get(name, (mean, sd)) for name, mean, sd in estimates), strict=True
    )
    discrepancy = after.setup.eye.discrepancy
    settled_eye = replace(
        eye,
        means=means,
        sds=sds,
        globe=globe,
        discrepancy=discrepancy,
        frames=tuple(frames),
    )

    return after.trial(settled_eye, refused)
