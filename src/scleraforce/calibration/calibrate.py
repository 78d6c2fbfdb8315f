"""Young's modulus of each eye from its recordings, and of the population (paper sec.
3.2, Table 2).

The frames of an eye are fitted together (`start_of_an_eye`), and are then read again
(`stiffness_from_forces`), with the walls of one tissue at a time;
`stiffness_from_forces.search_stiffening` looks for the tissue that explains them best.
Linear mechanics is the paper's, and so is its filter (`filtered_eye`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import exp

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import CalibrationError
from scleraforce.base.normal_distribution import NINETY_PERCENT
from scleraforce.base.units import from_si
from scleraforce.calibration.calibration import (
    RIGIDITY,
    Calibration,
    EyeCalibration,
    FrameRecord,
    rigidity_words,
)
from scleraforce.calibration.filter.eye_filter import PARAMETERS, SkippedFrame
from scleraforce.calibration.filtered_eye import filter_eye
from scleraforce.calibration.found_walls import FoundWalls
from scleraforce.calibration.holds_of_a_log import STEP_S
from scleraforce.calibration.recording_to_calibrate import (
    calibration_remarks,
    check_same_lean,
    nothing_taken,
    setup_to_calibrate,
    used_recordings,
)
from scleraforce.calibration.seen_frames import (
    NO_WALL,
    CalibrationSettings,
    EyeFrames,
    count_nothing,
    frame_order,
)
from scleraforce.calibration.start_of_an_eye import (
    SOUGHT,
    ForceFrame,
    StartedEye,
    first_fit,
    of_other_eyes,
    start_eye,
    with_prior,
)
from scleraforce.calibration.stiffness_from_forces import (
    KnownForce,
    RereadEye,
    TissueTrial,
    modulus_after,
    most_trials,
    own_modulus_and_globe,
    reread_eye,
    search_stiffening,
)
from scleraforce.calibration.who_yields import decided_relaxation
from scleraforce.fit import unknowns
from scleraforce.fit.one_frame import BoundaryFit
from scleraforce.fit.prior_of_an_eye import prior_of
from scleraforce.library import Library
from scleraforce.library.sealed_eye import iop_ratio_under_force
from scleraforce.recordings.recording_folder import Recording
from scleraforce.records.fields import declared
from scleraforce.records.globe import OPEN, SEALED, UNKNOWN
from scleraforce.records.needle import one_lean
from scleraforce.records.remark import Remark
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study
from scleraforce.records.tissue_relaxation import Relaxation

# standard deviations that a rigidity lies above 0 of a globe that cannot be open
SURE_SEALED = 3.0
STIFFENING = "stiffening"  # a parameter that is searched for, by whole calibrations
# frames of the search; if more are wanted, they are calibrated on once it is found
SOUGHT_ON = 6
LEAKS = Remark(
    "leak-not-followed",
    "eye.leak_time_s: E and k are of the globe without its leak, which single frames"
    " and `monitor` do not follow",
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
    walls: FoundWalls | None = None,
) -> Calibration:
    """Calibrate every eye on its recordings; recordings of one eye add up. It raises
    `CalibrationError`.

    Without a library, mechanics is linear, as in the paper. The uncertain `parameters`
    are, of `e`, `stiffening`, `iop`, `thickness` and `gap`, by default e, and with a
    library the stiffening, which is found on the first recording of an eye; otherwise
    the stiffening is the study's. `frames` of each recording are taken that bear enough
    force, deep dents among them (None: all). `progress` is called with 1 after each
    frame, in each of `calibration_passes`. `walls` finds them: where a network checks
    it, a frame in which that sees another wall is not used.
    """
    if parameters is None:
        parameters = ("e",) if library is None else ("e", STIFFENING)

    if library is None and STIFFENING in parameters:
        raise CalibrationError(
            "parameters: linear mechanics knows no tissue that stiffens; leave out"
            " stiffening"
        )

    at_once = tuple(name for name in parameters if name != STIFFENING)
    passes = calibration_passes(library, parameters)
    settings = CalibrationSettings(
        study, library, at_once, STIFFENING in parameters, frames, walls or FoundWalls()
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
    """Calibrate an eye; if that diverges, add a doubt on its stated globe."""
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
    if library is None:
        return filter_eye(recording, settings, frames, earlier)
    if earlier is None and settings.stiffening_sought:
        return _of_sought_tissue(recording, settings, library, frames)

    stiffening = (
        settings.study.tissue.stiffening if earlier is None else earlier.stiffening
    )
    of_tissue = replace(settings, library=library.for_stiffening(stiffening))
    return calibrate_eye(recording, of_tissue, frames, earlier).found


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
        of_tissue: Library, wanted: int | None, before: StartedEye | None
    ) -> TissueTrial[EyeCalibration]:
        with np.errstate(all="ignore"):
            # with walls that are far from the eye's a fit may end anywhere
            return calibrate_eye(
                recording,
                replace(settings, library=of_tissue, frames=wanted),
                frames,
                None,
                before,
            )

    def attempt(
        of_tissue: Library, before: StartedEye | None
    ) -> TissueTrial[EyeCalibration] | None:
        try:
            return calibrate(of_tissue, SOUGHT_ON if more else settings.frames, before)
        except CalibrationError as fault:
            faults.append(fault)
            return None

    found = search_stiffening(library, attempt)
    if found is None:
        raise faults[0]

    stiffening, eye = found
    return (
        calibrate(library.for_stiffening(stiffening), settings.frames, None).found
        if more
        else eye
    )


def calibrate_eye(
    recording: Recording,
    settings: CalibrationSettings,
    frames: EyeFrames,
    earlier: EyeCalibration | None,
    before: StartedEye | None = None,
) -> TissueTrial[EyeCalibration]:
    """Calibrate an eye with the walls of one tissue; of one that leaks, anew with the
    pressures that this gives. `before`: the eye by the same frames and another tissue.
    """
    found = _calibrate_eye(recording, settings, frames, earlier, None, before)
    library = settings.library

    for _ in range(LEAK_ROUNDS if recording.info.eye.leak_time_s else 0):
        if library is None or found.found.status != "ok":
            break

        rests_pa = _rests_pa(recording, settings.study, library, frames, found.found)
        found = _calibrate_eye(
            recording,
            replace(settings, count=count_nothing),
            frames,
            earlier,
            rests_pa,
            found.started,
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
    modulus_pa = dict(zip(eye.names, eye.means, strict=True))[PARAMETERS["e"]]
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
    before: StartedEye | None,
) -> TissueTrial[EyeCalibration]:
    """Calibrate an eye with the walls of one tissue; its frames have resting pressures
    of their own if it leaks.
    """
    study = settings.study
    library = settings.library
    assert library is not None  # else `filtered_eye.filter_eye`
    _, forces, relaxation, _ = frames.labelled()
    if earlier is not None:
        check_same_lean(recording, earlier)
    setup = with_prior(setup_to_calibrate(recording, study), study)
    check_library(setup, study, library)
    taken = _taken_frames(recording, settings, frames, setup, rests_pa)
    if not taken.frames:
        if earlier is None:
            raise nothing_taken(recording, frames, taken.records, study)
        return _as_before(recording, frames, earlier, taken)

    started = start_eye(
        _beside_followed(setup, frames, taken.frames),
        taken.frames,
        taken.fits,
        library.nearest_contact(setup.needle.polar_rad),
        study,
        _sought_sds(setup, settings),
        before,
    )
    records = list(() if earlier is None else earlier.frames)
    read_before = [frame.again for frame in records if frame.again is not None]
    begun = replace(setup, eye=started.setup.eye)
    after = (
        reread_eye(begun, taken.frames, read_before, library, study)
        if started.status == "ok"
        else RereadEye(begun, (None,) * len(taken.frames), 0.0)
    )
    records += _reread_records(taken, after, setup, started.status)
    names, means, sds = _parameters(after.setup, started)
    leaks = () if rests_pa is None else (LEAKS,)
    remarks = calibration_remarks(recording, frames, records, leaks)
    eye = EyeCalibration(
        id=recording.info.eye_name,
        names=names,
        means=means,
        sds=sds,
        bounds_n=study.classes.bounds_n,
        stated_thickness_m=declared(after.setup.eye.thickness_m, "eye: thickness_m"),
        globe=declared(after.setup.eye.globe, "globe"),
        recordings=used_recordings(recording, forces, earlier, remarks),
        frames=tuple(records),
        discrepancy=after.setup.eye.discrepancy,
        stiffening=library.stiffening,
        relaxation=relaxation,
        lean_rad=one_lean(recording.info.needle.lean_rad),
        assumed_iop_pa=after.setup.eye.assumed_iop_pa,
        prior=declared(setup.eye.modulus, "modulus"),
        errors=started.fit.declared,
    ).with_appearance(None)

    if eye.status != "ok":
        return TissueTrial.diverged(eye, taken.refused, started)
    return after.trial(eye, taken.refused, started)


def check_library(setup: Setup, study: Study, library: Library) -> None:
    """Raise a `CalibrationError` if a library has no walls of an eye."""
    mine = (
        study.eye.radius_m,
        study.eye.poisson_ratio,
        study.needle.outer_diameter_m / 2,
    )
    theirs = library.radius_m, library.poisson_ratio, library.needle_radius_m
    if not np.allclose(mine, theirs, rtol=1e-6):
        raise CalibrationError(
            "library: made for another radius of the eye, Poisson's ratio or needle"
            " than the study's; make it anew"
        )

    thickness_m = declared(setup.eye.thickness_m, "eye: thickness_m")
    thinnest, thickest = (float(library.thickness_m[end]) for end in (0, -1))
    if not thinnest <= thickness_m <= thickest:
        raise CalibrationError(
            f"thickness: {from_si(thickness_m, 'um'):g} µm; the library has"
            f" walls of {from_si(thinnest, 'um'):.0f} to"
            f" {from_si(thickest, 'um'):.0f} µm"
        )


def _sought_sds(setup: Setup, settings: CalibrationSettings) -> dict[str, float]:
    """Return the standard deviations of what is uncertain beside E, by its name in
    `SOUGHT`; that of the IOP is of its logarithm. One that is not stated is sought.
    """
    study = settings.study.calibration
    eye = setup.eye
    iop_pa = max(declared(eye.iop_pa, "eye: iop_pa"), 1.0)
    sds = {
        "iop": (eye.iop_sd_pa or study.iop_sd_pa) / iop_pa,
        "thickness": eye.thickness_sd_m or study.thickness_sd_m,
        "gap": study.gap_sd_m,
    }
    found = {name: sds[name] for name in settings.parameters if name in sds}
    if eye.iop_assumed:
        unstated = prior_of(replace(setup, eye=eye.declared()), settings.study.reader)
        found["iop"] = float(unstated.sd[unknowns.IOP])
    return found


@dataclass(frozen=True, eq=False)
class _TakenFrames:
    """The frames of a recording that an eye is calibrated on.

    `records` of all frames that were looked at; `places` of the taken ones among them,
    with their `frames` and first `fits`. `refused`: the number of frames of known force
    that no wall of the library lies on.
    """

    records: tuple[FrameRecord, ...]
    places: tuple[int, ...]
    frames: tuple[ForceFrame, ...]
    fits: tuple[BoundaryFit, ...]
    refused: int


def _taken_frames(
    recording: Recording,
    settings: CalibrationSettings,
    frames: EyeFrames,
    setup: Setup,
    rests_pa: Floats | None,
) -> _TakenFrames:
    """Return the wanted number of frames of a recording, or all that can be used."""
    study = settings.study
    library = settings.library
    assert library is not None
    near = library.nearest_contact(setup.needle.polar_rad)
    others = of_other_eyes(setup)
    trials, forces, _, _ = frames.labelled()
    least_n = study.calibration.min_force_n
    left = len(trials) if settings.frames is None else settings.frames
    included = [trial.excluded is None for trial in trials]
    order = frame_order(forces.force_n, included, least_n, settings.frames)
    records = list[FrameRecord]()
    found = dict[int, tuple[ForceFrame, BoundaryFit]]()
    refused = 0

    for index in order:
        settings.count(1)
        force_n = float(forces.force_n[index])
        if left <= 0 or not included[index] or not force_n > least_n:
            continue

        seen = frames.seen(index)
        if seen is None:
            continue

        rest_pa = None if rests_pa is None else float(rests_pa[index])
        skipped = None

        if isinstance(seen.wall, SkippedFrame):
            skipped = seen.wall.reason
        else:
            frame = seen.with_force(force_n, rest_pa)
            fit = first_fit(frame.shown, seen.beside(others), near, study)
            if fit is None:
                skipped = NO_WALL
                refused += 1
            else:
                found[len(records)] = frame, fit
                left -= 1

        records.append(
            FrameRecord(
                recording=str(recording.path),
                file=seen.file,
                sha256=seen.sha256,
                planes=seen.files,
                force_n=force_n,
                mean_pa=0.0,
                sd_pa=0.0,
                skipped=skipped,
            )
        )

    settings.count(len(trials) - len(order))
    return _TakenFrames(
        records=tuple(records),
        places=tuple(found),
        frames=tuple(frame for frame, _ in found.values()),
        fits=tuple(fit for _, fit in found.values()),
        refused=refused,
    )


def _as_before(
    recording: Recording,
    frames: EyeFrames,
    earlier: EyeCalibration,
    taken: _TakenFrames,
) -> TissueTrial[EyeCalibration]:
    """Return an eye to which a further recording adds no frame."""
    _, forces, _, _ = frames.labelled()
    records = (*earlier.frames, *taken.records)
    remarks = calibration_remarks(recording, frames, records)
    eye = replace(
        earlier,
        recordings=used_recordings(recording, forces, earlier, remarks),
        frames=records,
    )
    return TissueTrial(
        found=eye, refused=taken.refused, frames=0, of_boundaries=0.0, of_forces=0.0
    )


def _beside_followed(
    setup: Setup, frames: EyeFrames, taken: Sequence[ForceFrame]
) -> Setup:
    """Return a setup beside the plane that is followed, at the frames' median gap; of a
    single plane the setup.
    """
    if frames.followed is None:
        return setup

    turned = setup.turned(frames.followed.direction_rad)
    gap_m = float(np.median([frame.gap_m or 0.0 for frame in taken]))
    return replace(turned, needle=replace(turned.needle, gap_m=gap_m))


def _reread_records(
    taken: _TakenFrames, after: RereadEye, setup: Setup, status: str
) -> list[FrameRecord]:
    """Return the records of a recording's frames with their readings, and E after
    each of them.
    """
    records = list(taken.records)
    read = list[KnownForce]()

    for place, again in zip(taken.places, after.again, strict=True):
        record = replace(records[place], again=again)
        if again is not None:
            read.append(again)
            record = replace(record, own_modulus_pa=again.own_modulus_pa)

        is_last = place == taken.places[-1]
        estimate = (
            own_modulus_and_globe(after.setup)[0]
            if is_last
            else modulus_after(read, after.setup, setup)
        )
        records[place] = replace(
            record, mean_pa=estimate.mean_pa, sd_pa=estimate.sd_pa, status=status
        )

    return records


def _parameters(
    setup: Setup, started: StartedEye
) -> tuple[tuple[str, ...], tuple[float, ...], tuple[float, ...]]:
    """Return names, means and standard deviations of what was found of an eye."""
    modulus, globe = own_modulus_and_globe(setup)
    found = {PARAMETERS["e"]: (modulus.mean_pa, modulus.sd_pa)}

    for name, place in SOUGHT.items():
        if place in started.fit.names:
            mean, sd = started.fit.moments(place)
            if place == unknowns.IOP:
                mean = exp(mean)
                sd = mean * sd
            found[PARAMETERS[name]] = mean, sd

    if globe.can_be_sealed:
        found[RIGIDITY] = globe.mean, globe.sd

    means, sds = zip(*found.values(), strict=True)
    return tuple(found), means, sds


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
