"""Young's modulus of each eye from its recordings, and of the population (paper sec. 3.2, Table 2)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from scleraforce.calibration.assimilation import EyeFilter, EyeState, FrameStep, Skipped, moments
from scleraforce.calibration.eye_model import EyeConstants
from scleraforce.calibration.forces import FrameForces, frame_forces
from scleraforce.calibration.parameters import spread
from scleraforce.calibration.registration import first_belief
from scleraforce.calibration.session import EyeSession, begin, step
from scleraforce.errors import CalibrationError
from scleraforce.library import Library
from scleraforce.recording.agreement import log_doubts
from scleraforce.recording.files import Recording, frame_digest, tables_digest
from scleraforce.recording.labels import label_frames
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.observations import Boundaries
from scleraforce.segmentation.observed import dent, segmented_boundaries
from scleraforce.segmentation.wall import find_wall
from scleraforce.study import Study

__all__ = ["Calibration", "EyeCalibration", "FrameRecord", "UsedRecording", "calibrate_recordings", "eye_constants"]

Array = NDArray[np.float64]

SAME_MODULUS = 0.01  # relative; what else is stated of the eye moves the mean of a lognormal by less


@dataclass(frozen=True, kw_only=True)
class FrameRecord:
    """What became of a frame: estimate of E after it, or the reason why it was not used.

    `sha256` is the frame's content (`recording.files.frame_digest`), by which it is known again under any name.
    `force_n` is what the filter took, the label freed of offset and drift. `own_modulus_pa`: what the frame alone says.
    """

    recording: str
    file: str
    sha256: str
    force_n: float
    mean_pa: float
    sd_pa: float
    own_modulus_pa: float | None = None
    points: int = 0
    gated: tuple[int, ...] = ()
    nis: float = 0.0
    inflation: float = 1.0
    status: str = "ok"
    skipped: str | None = None


@dataclass(frozen=True, kw_only=True)
class UsedRecording:
    """A recording that was calibrated on: path as given, SHA-256 of its tables, zero of its force taken off.

    `doubts` are sentences on a log that does not go with the frames (`recording.agreement`).
    """

    path: str
    sha256: str
    zero_n: float
    drift_n_per_s: float
    doubts: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class EyeCalibration:
    """One eye: what is known after its frames.

    `names` of the uncertain parameters, `means` and `sds` of them in SI; `stated_thickness_m`: the recording's. `steps`
    are kept for figures, and are empty for what was read from a file.
    """

    id: str
    names: tuple[str, ...]
    means: tuple[float, ...]
    sds: tuple[float, ...]
    stated_thickness_m: float
    state: EyeState = field(repr=False)
    recordings: tuple[UsedRecording, ...] = field(repr=False)
    frames: tuple[FrameRecord, ...] = field(repr=False)
    steps: tuple[FrameStep, ...] = field(default=(), repr=False)
    filter: EyeFilter | None = field(default=None, repr=False)

    @property
    def used(self) -> tuple[FrameRecord, ...]:
        """The frames that the estimate rests on."""
        return tuple(frame for frame in self.frames if frame.skipped is None)

    @property
    def mean_pa(self) -> float:
        """Posterior mean of Young's modulus."""
        return self.means[self.names.index("youngs_modulus_pa")]

    @property
    def sd_pa(self) -> float:
        """Posterior standard deviation of Young's modulus."""
        return self.sds[self.names.index("youngs_modulus_pa")]

    @property
    def thickness_m(self) -> float:
        """The wall's thickness: estimated where it was uncertain, or else as it was stated."""
        return dict(zip(self.names, self.means, strict=True)).get("thickness_m", self.stated_thickness_m)

    def by_class(self, bounds_n: tuple[float, ...]) -> tuple[float | None, ...]:
        """Return the median of what the frames of each force class say of E on their own, in Pa; None where none does.

        All the same for a wall that bends as the model says; falling with the force for one that bends more.
        """
        classes: list[list[float]] = [[] for _ in range(len(bounds_n) + 1)]
        for frame in self.used:
            if frame.own_modulus_pa is not None:
                classes[int(np.searchsorted(bounds_n, frame.force_n))].append(frame.own_modulus_pa)
        return tuple(float(np.median(values)) if values else None for values in classes)

    @property
    def status(self) -> str:
        """'ok', or the last sentence of a filter that diverged."""
        return next((frame.status for frame in reversed(self.used) if frame.status != "ok"), "ok")


@dataclass(frozen=True, eq=False)
class Calibration:
    """All eyes; the population is the mean of their means, its `sd` their spread (None for one eye).

    `mechanics`: "linear" or "finite-strain", what the wall was taken to do.
    """

    eyes: Mapping[str, EyeCalibration]
    study_sha256: str
    bounds_n: tuple[float, ...]
    mechanics: str

    @property
    def population(self) -> tuple[float, float | None]:
        """Mean and spread of the eyes' mean moduli, in Pa; one eye has no spread."""
        return spread([eye.mean_pa for eye in self.eyes.values()])

    def left_out(self, eye_id: str) -> float:
        """Return the population's mean without one eye, in Pa (that eye's own where it is the only one)."""
        others = [eye.mean_pa for name, eye in self.eyes.items() if name != eye_id]
        return spread(others)[0] if others else self.population[0]


def calibrate_recordings(
    recordings: Sequence[Recording],
    study: Study,
    study_sha256: str,
    library: Library | None,
    parameters: tuple[str, ...] = ("e",),
    frames: int | None = None,
    earlier: Calibration | None = None,
    progress: Callable[[int], object] | None = None,
) -> Calibration:
    """Calibrate every eye on its recordings; recordings of one eye add up.

    Args:
        recordings: with force logs.
        study: prior, filter, mesh.
        study_sha256: hash of the study, kept as provenance.
        library: responses of finite strain; None: linear mechanics, as in the paper.
        parameters: what is uncertain, of `e`, `iop`, `thickness`, `gap`; `e` among them.
        frames: take the first so many frames of each recording that bear enough force; None: all.
        earlier: to go on from; the frames that its eyes have used are left out.
        progress: called with 1 after each frame.

    Raises:
        CalibrationError: a recording without force log or wall thickness, or no frame that can be used; an earlier
            calibration with other mechanics or parameters.
    """
    if "e" not in parameters:
        raise CalibrationError(f"parameters {','.join(parameters)}: e must be among them")
    mechanics = "linear" if library is None else "finite-strain"
    if earlier is not None and earlier.mechanics != mechanics:
        raise CalibrationError(
            f"the earlier calibration has {earlier.mechanics} mechanics, not {mechanics}; name the same"
        )
    eyes = {} if earlier is None else dict(earlier.eyes)
    for recording in recordings:
        eye_id = recording.info.eye.id
        eyes[eye_id] = _calibrate(recording, study, library, parameters, frames, eyes.get(eye_id), progress)
    mine = {recording.info.eye.id: eyes[recording.info.eye.id] for recording in recordings}
    return Calibration(mine, study_sha256, study.classes.bounds_n, mechanics)


def eye_constants(recording: Recording, study: Study) -> EyeConstants:
    """Return what a recording states about its eye, and where it does not, the study.

    Raises:
        CalibrationError: the wall's thickness is not stated; nothing in a frame says as much about E.
    """
    info = recording.info
    if info.eye.thickness_m is None:
        raise CalibrationError(
            f"{recording.path / 'recording.toml'}: eye.thickness_m: missing; a calibration needs the wall's thickness"
        )
    low, high = study.needle.polar_angle_rad.bounds
    stated = info.needle.polar_angle_rad
    return EyeConstants(
        iop_pa=study.eye.iop_pa if info.eye.iop_pa is None else info.eye.iop_pa,
        thickness_m=info.eye.thickness_m,
        gap_m=info.needle.slice_gap_m,
        polar_rad=(low + high) / 2 if stated is None else stated,
        polar_sd_rad=(high - low) / 12**0.5 if stated is None else 0.0,
        direction_rad=info.oct.plane_direction_rad,
        tilt_rad=info.oct.plane_tilt_rad,
    )


def _calibrate(
    recording: Recording,
    study: Study,
    library: Library | None,
    parameters: tuple[str, ...],
    frames: int | None,
    earlier: EyeCalibration | None,
    progress: Callable[[int], object] | None,
) -> EyeCalibration:
    if recording.forces is None:
        raise CalibrationError(f"{recording.path}: no forces.csv; a calibration needs frames of known force")
    trials = label_frames(recording, study.classes, study.needle.max_force_n)
    forces = frame_forces(recording, trials)
    session = begin(study, eye_constants(recording, study), library, parameters, forces.zero_covariance)
    run = _begin(session.filter, session.state, recording, forces, earlier)
    session = replace(session, state=run.state)
    seen = {frame.sha256 for frame in run.frames}
    scale = PixelScale.of(recording.info.oct)
    left = len(trials) if frames is None else frames
    shown = [float("nan")] * len(trials)
    for index, (entry, trial) in enumerate(zip(recording.frames, trials, strict=True)):
        pixels = recording.frame(entry) if left > 0 and trial.excluded is None else None
        if pixels is not None and (sha256 := frame_digest(pixels)) not in seen:
            segmentation = find_wall(pixels, scale)
            reason = "" if segmentation.usable else f"not usable: {segmentation.reason}"
            boundaries = segmented_boundaries(segmentation, scale)
            shown[index] = dent(boundaries) if segmentation.usable else float("nan")
            record = FrameRecord(
                recording=str(recording.path),
                file=trial.file,
                sha256=sha256,
                force_n=float(forces.force_n[index]),
                mean_pa=run.mean_pa,
                sd_pa=run.sd_pa,
                skipped=reason or None,
            )
            since_s = float(forces.since_start_s[index])
            session, run = _step(session, run, record, since_s, boundaries)
            left -= int(run.frames[-1].skipped is None)
        if progress is not None:
            progress(1)
    doubts = log_doubts(recording, study.classes, shown)
    if not run.used:
        raise CalibrationError(
            f"{recording.path}: none of its {len(trials)} frames can be calibrated on ({_first_reason(run)}); it "
            f"takes frames with a wall in view and more than {study.calibration.min_force_n * 1e3:g} mN"
            + "".join(f"; {doubt}" for doubt in doubts)
        )
    *others, last = run.recordings
    return replace(run, recordings=(*others, replace(last, doubts=doubts or last.doubts)))


def _first_reason(run: EyeCalibration) -> str:
    """Return why the first frame was not used."""
    return next((frame.skipped for frame in run.frames if frame.skipped), "excluded")


def _begin(
    eye: EyeFilter, state: EyeState, recording: Recording, forces: FrameForces, earlier: EyeCalibration | None
) -> EyeCalibration:
    """Return the eye before this recording's frames; what a recording's frames share is new with each recording."""
    zero_n, drift_n_per_s = forces.zero.tolist()
    used = UsedRecording(
        path=str(recording.path), sha256=tables_digest(recording), zero_n=zero_n, drift_n_per_s=drift_n_per_s
    )
    recordings: tuple[UsedRecording, ...] = (used,)
    frames: tuple[FrameRecord, ...] = ()
    if earlier is not None and earlier.names != eye.space.names:
        raise CalibrationError(
            f"{earlier.id}: the earlier calibration has {', '.join(earlier.names)} for parameters, not "
            f"{', '.join(eye.space.names)}; begin anew or name the same"
        )
    if earlier is not None:
        again = used.sha256 in {entry.sha256 for entry in earlier.recordings}
        state = earlier.state if again else replace(earlier.state, belief=first_belief(eye.model))
        recordings = earlier.recordings if again else (*earlier.recordings, used)
        frames = earlier.frames
    means, sds = _moments(eye, state, earlier)
    steps = () if earlier is None else earlier.steps
    return EyeCalibration(
        recording.info.eye.id, eye.space.names, tuple(means.tolist()), tuple(sds.tolist()),
        eye.model.constants.thickness_m, state, recordings, frames, steps, eye,
    )  # fmt: skip


def _moments(eye: EyeFilter, state: EyeState, earlier: EyeCalibration | None) -> tuple[Array, Array]:
    """Return means and standard deviations of the parameters; an earlier calibration's E must come out again."""
    with np.errstate(over="ignore", invalid="ignore"):
        means, sds = moments(eye, state)
    modulus_pa = means[eye.space.names.index("youngs_modulus_pa")]
    same = earlier is None or abs(modulus_pa / earlier.mean_pa - 1.0) < SAME_MODULUS
    if earlier is not None and not (same and np.isfinite((means, sds)).all()):
        raise CalibrationError(
            f"{earlier.id}: the state of the earlier calibration is not that of its parameters under this study; begin "
            "anew, or give the study that it was made with"
        )
    return means, sds


def _step(
    session: EyeSession,
    run: EyeCalibration,
    record: FrameRecord,
    since_s: float,
    boundaries: Boundaries,
) -> tuple[EyeSession, EyeCalibration]:
    """Return the eye after one more frame, used or not; its record is as it stands before."""
    if record.skipped:
        return session, replace(run, frames=(*run.frames, record))
    session = step(session, boundaries, record.force_n, since_s)
    if isinstance(session.last, FrameStep):
        return session, _used(run, record, session.last)
    skipped = session.last.reason if isinstance(session.last, Skipped) else None
    record = replace(record, skipped=skipped)
    return session, replace(run, state=session.state, frames=(*run.frames, record))


def _used(run: EyeCalibration, record: FrameRecord, found: FrameStep) -> EyeCalibration:
    """Return the eye after a frame that its estimate rests on."""
    means, sds = found.moments
    place = run.names.index("youngs_modulus_pa")
    result = found.result
    record = replace(
        record,
        mean_pa=float(means[place]),
        sd_pa=float(sds[place]),
        own_modulus_pa=found.registered.youngs_modulus_pa,
        points=result.observations,
        gated=result.gated,
        nis=result.nis,
        inflation=result.inflation,
        status=result.status,
    )
    return replace(
        run,
        means=tuple(means.tolist()),
        sds=tuple(sds.tolist()),
        state=found.state,
        frames=(*run.frames, record),
        steps=(*run.steps, found),
    )
