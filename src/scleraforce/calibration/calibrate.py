"""Young's modulus of each eye from its recordings, and of the population (paper sec. 3.2, Table 2)."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scleraforce.calibration.assimilation import (
    EyeFilter,
    EyeState,
    FrameInput,
    FrameStep,
    assimilate,
    eye_filter,
    first_state,
    moments,
)
from scleraforce.calibration.eye_model import EyeConstants, build_eye_model
from scleraforce.calibration.forces import FrameForces, frame_forces
from scleraforce.calibration.frames import segmented_boundaries
from scleraforce.calibration.observations import Boundaries
from scleraforce.calibration.parameters import spread
from scleraforce.calibration.registration import first_belief, frame_prior, register, updated_belief
from scleraforce.errors import CalibrationError
from scleraforce.imaging.segmentation import PixelScale, Segmenter
from scleraforce.recording.files import Recording
from scleraforce.recording.labels import Trial, label_frames
from scleraforce.study import Study

__all__ = ["Calibration", "EyeCalibration", "FrameRecord", "UsedRecording", "calibrate_recordings", "eye_constants"]


@dataclass(frozen=True)
class FrameRecord:
    """What became of a frame: estimate of E after it, or the reason why it was not used.

    `force_n` is what the filter took, the label freed of offset and drift. `own_modulus_pa`: what the frame alone says.
    """

    recording: str
    file: str
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


@dataclass(frozen=True)
class UsedRecording:
    """A recording that was calibrated on: path as given, SHA-256 of its tables, zero of its force taken off."""

    path: str
    sha256: str
    zero_n: float
    drift_n_per_s: float


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
    state: EyeState
    recordings: tuple[UsedRecording, ...]
    frames: tuple[FrameRecord, ...]
    steps: tuple[FrameStep, ...] = ()
    filter: EyeFilter | None = None

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
    """All eyes; the population is the mean of their means, its `sd` their spread (0 for one eye).

    `mechanics`: "linear" or "finite-strain", what the wall was taken to do.
    """

    eyes: Mapping[str, EyeCalibration]
    study_sha256: str
    bounds_n: tuple[float, ...]
    mechanics: str

    @property
    def population(self) -> tuple[float, float]:
        """Mean and spread of the eyes' mean moduli, in Pa."""
        return spread([eye.mean_pa for eye in self.eyes.values()])

    def left_out(self, eye_id: str) -> float:
        """Return the population's mean without one eye, in Pa (that eye's own where it is the only one)."""
        others = [eye.mean_pa for name, eye in self.eyes.items() if name != eye_id]
        return spread(others)[0] if others else self.population[0]


def calibrate_recordings(
    recordings: Sequence[Recording],
    study: Study,
    study_sha256: str,
    parameters: tuple[str, ...] = ("e",),
    frames: int | None = None,
    earlier: Mapping[str, EyeCalibration] | None = None,
    progress: Callable[[int], object] | None = None,
) -> Calibration:
    """Calibrate every eye on its recordings; recordings of one eye add up.

    Args:
        recordings: with force logs.
        study: prior, filter, mesh.
        study_sha256: hash of the study, kept as provenance.
        parameters: what is uncertain, of `e`, `iop`, `thickness`, `gap`; `e` among them.
        frames: take the first so many frames of each recording that bear enough force; None: all.
        earlier: eyes to go on from, by id; the frames that they have used are left out.
        progress: called with 1 after each frame.

    Raises:
        CalibrationError: a recording without force log or wall thickness, or no frame that can be used.
    """
    if "e" not in parameters:
        raise CalibrationError(f"parameters {','.join(parameters)}: e must be among them")
    eyes = dict(earlier or {})
    for recording in recordings:
        eye_id = recording.info.eye.id
        eyes[eye_id] = _calibrate(recording, study, parameters, frames, eyes.get(eye_id), progress)
    mine = {recording.info.eye.id: eyes[recording.info.eye.id] for recording in recordings}
    return Calibration(mine, study_sha256, study.classes.bounds_n, "linear")


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
        study.eye.iop_pa if info.eye.iop_pa is None else info.eye.iop_pa,
        info.eye.thickness_m,
        info.needle.slice_gap_m,
        (low + high) / 2 if stated is None else stated,
        (high - low) / 12**0.5 if stated is None else 0.0,
        info.oct.plane_direction_rad,
        info.oct.plane_tilt_rad,
    )


def _calibrate(
    recording: Recording,
    study: Study,
    parameters: tuple[str, ...],
    frames: int | None,
    earlier: EyeCalibration | None,
    progress: Callable[[int], object] | None,
) -> EyeCalibration:
    if recording.forces is None:
        raise CalibrationError(f"{recording.path}: no forces.csv; a calibration needs frames of known force")
    model = build_eye_model(study, eye_constants(recording, study), "thickness" in parameters)
    eye = eye_filter(model, study.calibration, parameters)
    trials = label_frames(recording, study.classes, study.needle.max_force_n)
    forces = frame_forces(recording, trials)
    run = _begin(eye, recording, forces, earlier)
    seen = {frame.file for frame in run.frames if frame.recording == str(recording.path)}
    segmenter = Segmenter(recording.info.oct.refractive_index)
    scale = PixelScale(
        recording.info.oct.width_m / recording.info.oct.columns, recording.info.oct.depth_m / recording.info.oct.rows
    )
    left = len(trials) if frames is None else frames
    for index, (entry, trial) in enumerate(zip(recording.frames, trials, strict=True)):
        if left > 0 and trial.file not in seen and trial.excluded is None:
            segmentation = segmenter.segment(recording.frame(entry), scale)
            reason = "" if segmentation.usable else f"not usable: {segmentation.reason}"
            boundaries = segmented_boundaries(segmentation, scale, recording.info.oct.refractive_index)
            run = _step(eye, run, str(recording.path), trial, forces, index, boundaries, reason)
            left -= int(run.frames[-1].skipped is None)
        if progress is not None:
            progress(1)
    if not run.used:
        raise CalibrationError(
            f"{recording.path}: none of its {len(trials)} frames can be calibrated on; frames with a wall in view and "
            f"more than {study.calibration.min_force_n * 1e3:g} mN would do"
        )
    return run


def _begin(eye: EyeFilter, recording: Recording, forces: FrameForces, earlier: EyeCalibration | None) -> EyeCalibration:
    """Return the eye before this recording's frames; what a recording's frames share is new with each recording."""
    used = UsedRecording(str(recording.path), recording_hash(recording), *forces.zero.tolist())
    recordings: tuple[UsedRecording, ...] = (used,)
    frames: tuple[FrameRecord, ...] = ()
    if earlier is None:
        state = first_state(eye)
    elif earlier.names != eye.space.names:
        raise CalibrationError(
            f"{earlier.id}: the earlier calibration has {', '.join(earlier.names)} for parameters, not "
            f"{', '.join(eye.space.names)}; begin anew or name the same"
        )
    elif used in earlier.recordings:
        state, recordings, frames = earlier.state, earlier.recordings, earlier.frames
    else:
        state = replace(earlier.state, belief=first_belief(eye.model))
        recordings, frames = (*earlier.recordings, used), earlier.frames
    means, sds = moments(eye, state)
    steps = () if earlier is None else earlier.steps
    return EyeCalibration(
        recording.info.eye.id, eye.space.names, tuple(means.tolist()), tuple(sds.tolist()),
        eye.model.constants.thickness_m, state, recordings, frames, steps, eye,
    )  # fmt: skip


def _step(
    eye: EyeFilter,
    run: EyeCalibration,
    path: str,
    trial: Trial,
    forces: FrameForces,
    index: int,
    boundaries: Boundaries,
    reason: str,
) -> EyeCalibration:
    """Return the eye after one more frame, used or not."""
    force_n = float(forces.force_n[index])
    record = FrameRecord(path, trial.file, force_n, run.mean_pa, run.sd_pa, skipped=reason or None)
    if reason:
        return replace(run, frames=(*run.frames, record))
    if (trial.measured_force_n or 0.0) <= eye.study.min_force_n:
        record = replace(record, skipped=f"at most {eye.study.min_force_n * 1e3:g} mN: used as a reference of the pose")
        state = _reference(eye, run, force_n, boundaries)
        return replace(run, state=state, frames=(*run.frames, record))
    frame = FrameInput(boundaries, force_n, float(forces.since_start_s[index]), forces.zero_covariance)
    step = assimilate(eye, run.state, frame)
    if step is None:
        return replace(run, frames=(*run.frames, replace(record, skipped="too little of the wall is in view")))
    means, sds = step.moments
    record = FrameRecord(
        path,
        trial.file,
        force_n,
        float(means[run.names.index("youngs_modulus_pa")]),
        float(sds[run.names.index("youngs_modulus_pa")]),
        step.registered.youngs_modulus_pa,
        step.result.observations,
        step.result.gated,
        step.result.nis,
        step.result.inflation,
        step.result.status,
    )
    return replace(
        run,
        means=tuple(means.tolist()),
        sds=tuple(sds.tolist()),
        state=step.state,
        frames=(*run.frames, record),
        steps=(*run.steps, step),
    )


def _reference(eye: EyeFilter, run: EyeCalibration, force_n: float, boundaries: Boundaries) -> EyeState:
    """Return the state after a frame that says where the eye lies, but nothing of its modulus."""
    if np.isfinite(boundaries.depth_m).sum() < 3:
        return run.state
    prior = frame_prior(run.state.belief, eye.study)
    fit = register(eye.model, boundaries, max(force_n, 0.0), run.mean_pa, prior)
    return replace(run.state, belief=updated_belief(run.state.belief, prior, fit))


def recording_hash(recording: Recording) -> str:
    """Return the SHA-256 of a recording's tables, in hexadecimal."""
    digest = hashlib.sha256()
    for name in ("recording.toml", "frames.csv", "forces.csv"):
        digest.update((recording.path / name).read_bytes())
    return digest.hexdigest()
