"""An eye with walls of one tissue: its frames through the filter, one by one, and then read again."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scleraforce.calibration.assimilation import (
    PARAMETERS,
    RIGIDITY,
    EyeFilter,
    EyeSession,
    FrameStep,
    Skipped,
    begin,
    known_after,
    known_globe_after,
    moments,
    step,
)
from scleraforce.calibration.eye_model import EyeConstants
from scleraforce.calibration.forces import FrameForces, frame_forces
from scleraforce.calibration.known_forces import settled
from scleraforce.calibration.registration import first_belief
from scleraforce.calibration.result import EyeCalibration, FrameRecord, UsedRecording
from scleraforce.calibration.stiffening import TissueTrial
from scleraforce.errors import CalibrationError
from scleraforce.known import OPEN, UNKNOWN, Known, open_doubts, told_globe
from scleraforce.library import Library
from scleraforce.recording.folder import Recording, frame_digest, tables_digest
from scleraforce.recording.labels import label_frames, label_notes, log_doubts
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.observations import Boundaries, dent, segmented_boundaries
from scleraforce.segmentation.wall import find_wall
from scleraforce.segmentation.wall_finder import WallFinder
from scleraforce.study import Study
from scleraforce.units import from_si


@dataclass
class StepCount:
    """How many steps of an eye's calibration are still to come, and who is told of each."""

    left: int
    progress: Callable[[int], object] | None

    def __call__(self, steps: int) -> None:
        """Report steps."""
        self.left -= steps
        if self.progress is not None:
            self.progress(steps)

    def finish(self) -> None:
        """Report what was not needed."""
        self(self.left)


class SeenFrame(NamedTuple):
    """By what a frame is known again, and the wall's boundaries in it, or why they are of no use."""

    sha256: str
    wall: Boundaries | Skipped


@dataclass(frozen=True, eq=False)
class FrameWalls:
    """The frames of a recording, each read once; `used` are the digests of those that an earlier calibration used."""

    recording: Recording
    finder: WallFinder | None
    used: frozenset[str]
    _seen: dict[int, SeenFrame | None] = field(default_factory=dict)

    def look(self, index: int) -> SeenFrame | None:
        """Return what is seen in a frame; None if it was used before."""
        if index not in self._seen:
            self._seen[index] = self._look(self.recording.frame(self.recording.frames[index]))
        return self._seen[index]

    def _look(self, pixels: Pixels) -> SeenFrame | None:
        sha256, info = frame_digest(pixels), self.recording.info
        if sha256 in self.used:
            return None
        scale = PixelScale.of(info.oct)
        found = find_wall(pixels, scale, info.eye.thickness_m, self.finder)
        wall = segmented_boundaries(found, scale) if found.usable else Skipped(f"not usable: {found.reason}")
        return SeenFrame(sha256, wall)


Array = NDArray[np.float64]

FAR_ABOVE = 1.5  # of the highest force that is calibrated on: a force above is far from it


def frame_order(
    force_n: Array, included: Sequence[bool], min_force_n: float, frames: int | None, rising: bool
) -> list[int]:
    """Return the frames in the order in which they are looked at.

    All in theirs; or, where only some are wanted, the first few that say where the eye lies, then those of the highest
    force and of even shares of it, which tell modulus and rigidity apart, in rising order, then whatever else there is
    for those that cannot be used. Shallow dents hardly show the rigidity: they give the modulus, and from there the way
    to both is short. A deep one alone leaves a bent valley of both.

    Args:
        force_n: of each frame, N; not looked at where a frame is not included.
        included: whether a frame may be used.
        min_force_n: up to here a frame only says where the eye lies.
        frames: how many are wanted; None: all.
        rising: whether all are taken in rising order as well.
    """
    if frames is None and not rising:
        return list(range(len(included)))
    light = [index for index, inside in enumerate(included) if inside and force_n[index] <= min_force_n]
    left = [index for index, inside in enumerate(included) if inside and force_n[index] > min_force_n]
    left.sort(key=lambda index: -force_n[index])
    if frames is None:
        return [*light, *reversed(left), *(index for index, inside in enumerate(included) if not inside)]
    chosen, highest_n = list[int](), force_n[left[0]] if left else 0.0
    for share in np.arange(frames, 0, -1) / frames:
        if left:
            nearest = min(left, key=lambda index: abs(force_n[index] - share * highest_n))
            left.remove(nearest)
            chosen.append(nearest)
    return [*light[:frames], *reversed(chosen), *left]


def reach_doubts(used_n: Sequence[float], missed_n: Sequence[float]) -> tuple[str, ...]:
    """Return a sentence on forces far above those that could be calibrated on; none where there are none.

    A wall that leaves the picture, down a dent or up under a rising pressure, cannot be calibrated on, and modulus and
    rigidity of a sealed eye can hardly be told apart in shallow dents.

    Args:
        used_n: forces of the frames that were calibrated on, N.
        missed_n: of those that were to be, and could not.

    >>> reach_doubts([0.011, 0.02], [0.028])
    ()
    """
    highest_n, missed_n = max(used_n, default=0.0), [force_n for force_n in missed_n if np.isfinite(force_n)]
    if not missed_n or max(missed_n) <= FAR_ABOVE * highest_n:
        return ()
    return (
        f"no frame above {from_si(highest_n, 'mn'):.0f} mN could be calibrated on, of forces up to "
        f"{from_si(max(missed_n), 'mn'):.0f} mN; what is read above rests on the library's walls alone",
    )


SAME_MODULUS = 0.01  # relative; what else is stated of the eye moves the mean of a lognormal by less


@dataclass(frozen=True)
class Way:
    """How eyes are calibrated; see `calibrate_recordings`. `parameters` are those of the filter."""

    study: Study
    library: Library | None
    parameters: tuple[str, ...]
    stiffening_sought: bool
    frames: int | None
    finder: WallFinder | None


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
        globe=told_globe(info.eye) or UNKNOWN,
    )


def calibrate_eye(
    recording: Recording,
    way: Way,
    frames: FrameWalls,
    earlier: EyeCalibration | None,
    count: StepCount,
) -> TissueTrial[EyeCalibration]:
    """Calibrate an eye with the walls of one tissue."""
    if recording.forces is None or recording.info.force is None:
        raise CalibrationError(f"{recording.path}: no forces.csv; a calibration needs frames of known force")
    trials = label_frames(recording, way.study.classes, way.study.needle.max_force_n)
    known = recording.forces.known(recording.info.force.axis)
    forces = frame_forces(replace(recording, forces=known), trials)
    session = _begin(recording, way.study, way.library, way.parameters, forces, earlier)
    records, steps = ([], []) if earlier is None else (list(earlier.frames), list(earlier.steps))
    left = len(trials) if way.frames is None else way.frames
    included = [trial.excluded is None for trial in trials]
    rising = session.filter.model.constants.globe.can_be_sealed
    order = frame_order(forces.force_n, included, way.study.calibration.min_force_n, way.frames, rising)
    shown = [float("nan")] * len(trials)
    taken: dict[int, Boundaries] = {}
    refused, least_n = 0, way.study.calibration.min_force_n
    for index in order:
        trial = trials[index]
        seen = frames.look(index) if left > 0 and trial.excluded is None else None
        if seen is not None:
            force_n, since_s = float(forces.force_n[index]), float(forces.since_start_s[index])
            session, found, boundaries = _take(session, seen.wall, force_n, since_s)
            refused += boundaries is not None and force_n > least_n and isinstance(found, Skipped)
            shown[index] = float("nan") if boundaries is None else dent(boundaries)
            record = FrameRecord(
                recording=str(recording.path),
                file=trial.file,
                sha256=seen.sha256,
                force_n=force_n,
                mean_pa=session.mean_pa,
                sd_pa=session.sd_pa,
            )
            records.append(_recorded(record, found))
            if isinstance(found, FrameStep):
                assert boundaries is not None  # of a frame without a wall there is no step
                taken[len(records) - 1] = boundaries
                steps.append(found)
                left -= 1
        count(1)
    count(len(trials) - len(order))
    missed_n = [record.force_n for record in records if record.skipped is not None]
    used_n = [record.force_n for record in records if record.skipped is None]
    doubts = (
        *label_notes(recording, trials),
        *log_doubts(recording, way.study.classes, shown),
        *reach_doubts(used_n, missed_n),
    )
    if way.library is None:
        doubts = (*open_doubts(recording.info.eye.globe), *doubts)
    if all(record.skipped is not None for record in records):
        reason = next((record.skipped for record in records), "excluded")
        raise CalibrationError(
            f"{recording.path}: none of its {len(trials)} frames can be calibrated on ({reason}); it "
            f"takes frames with a wall in view and more than {from_si(way.study.calibration.min_force_n, 'mn'):g} mN"
            + "".join(f"; {doubt}" for doubt in doubts)
        )
    means, sds = moments(session.filter, session.state)
    found_eye = EyeCalibration(
        id=recording.info.eye.id,
        names=session.filter.space.names,
        means=tuple(means.tolist()),
        sds=tuple(sds.tolist()),
        stated_thickness_m=session.filter.model.constants.thickness_m,
        globe=known_globe_after(session.filter, session.state),
        state=session.state,
        recordings=_recordings(recording, forces, earlier, doubts),
        frames=tuple(records),
        steps=tuple(steps),
        filter=session.filter,
        stiffening=0.0 if way.library is None else way.library.stiffening,
    )
    if way.library is None or found_eye.status != "ok":
        return TissueTrial.diverged(found_eye, refused)
    return _settled(found_eye, known_after(session), taken, refused, way)


def _settled(
    eye: EyeCalibration, known: Known, taken: Mapping[int, Boundaries], refused: int, way: Way
) -> TissueTrial[EyeCalibration]:
    """Return a calibration with what its frames tell when they are read again.

    Args:
        eye: the calibration.
        known: of the eye after it.
        taken: boundaries of the frames that were used now, by their place among the eye's; others were read before.
        refused: how many frames the filter did not take.
        way: with the library, for any contact.
    """
    assert way.library is not None  # whose frames are read again
    frames = list(eye.frames)
    asked = [(boundaries, frames[place].force_n) for place, boundaries in taken.items()]
    earlier = [frame.again for place, frame in enumerate(frames) if frame.again is not None and place not in taken]
    after = settled(known, asked, earlier, way.library, way.study)
    found = after.known
    for place, read in zip(taken, after.again, strict=True):
        frames[place] = replace(frames[place], again=read)
    assert found.modulus is not None  # as before
    assert found.globe is not None
    now = {
        PARAMETERS["e"]: (found.modulus.mean_pa, found.modulus.sd_pa),
        RIGIDITY: (found.globe.mean, found.globe.sd),
    }
    estimates = zip(eye.names, eye.means, eye.sds, strict=True)
    means, sds = zip(*(now.get(name, (mean, sd)) for name, mean, sd in estimates), strict=True)
    settled_eye = replace(
        eye, means=means, sds=sds, globe=found.globe, discrepancy=found.discrepancy, frames=tuple(frames)
    )
    return after.trial(settled_eye, refused)


def _begin(
    recording: Recording,
    study: Study,
    library: Library | None,
    parameters: tuple[str, ...],
    forces: FrameForces,
    earlier: EyeCalibration | None,
) -> EyeSession:
    """Return the eye before this recording's frames; what a recording's frames share is new with each recording."""
    constants = eye_constants(recording, study)
    if library is None:
        constants = replace(constants, globe=OPEN)  # as in the paper: linear mechanics knows no other
    session = begin(study, constants, library, parameters, forces.zero_covariance)
    if earlier is None:
        return session
    if earlier.names != session.filter.space.names:
        raise CalibrationError(
            f"{earlier.id}: the earlier calibration has {', '.join(earlier.names)} for parameters, not "
            f"{', '.join(session.filter.space.names)}; begin anew or name the same"
        )
    _check_state(session.filter, earlier)
    if tables_digest(recording) in {entry.sha256 for entry in earlier.recordings}:
        return replace(session, state=earlier.state)
    return replace(session, state=replace(earlier.state, belief=first_belief(session.filter.model)))


def _check_state(eye: EyeFilter, earlier: EyeCalibration) -> None:
    """Check that the state of an earlier calibration gives its moduli again."""
    with np.errstate(over="ignore", invalid="ignore"):
        means, sds = moments(eye, earlier.state)
    modulus_pa = means[eye.space.names.index(PARAMETERS["e"])]
    same = abs(modulus_pa / earlier.used[-1].mean_pa - 1.0) < SAME_MODULUS
    if not (same and np.isfinite((means, sds)).all()):
        raise CalibrationError(
            f"{earlier.id}: the state of the earlier calibration is not that of its parameters under this study; begin "
            "anew, or give the study that it was made with"
        )


def _take(
    session: EyeSession, seen: Boundaries | Skipped, force_n: float, since_s: float
) -> tuple[EyeSession, FrameStep | Skipped, Boundaries | None]:
    """Return the eye after one more frame, what became of the frame, and the wall's boundaries in it."""
    if isinstance(seen, Skipped):
        return session, seen, None
    session = step(session, seen, force_n, since_s)
    assert session.last is not None  # what `step` has just done
    return session, session.last, seen


def _recorded(record: FrameRecord, found: FrameStep | Skipped) -> FrameRecord:
    """Return a frame's record with what became of the frame."""
    if isinstance(found, Skipped):
        return replace(record, skipped=found.reason)
    result = found.result
    return replace(
        record,
        own_modulus_pa=found.registered.youngs_modulus_pa,
        points=result.observations,
        gated=result.gated,
        nis=result.nis,
        inflation=result.inflation,
        status=result.status,
    )


def _recordings(
    recording: Recording, forces: FrameForces, earlier: EyeCalibration | None, doubts: tuple[str, ...]
) -> tuple[UsedRecording, ...]:
    """Return the recordings that an eye rests on, this one among them."""
    zero_n, drift_n_per_s = forces.zero.tolist()
    used = UsedRecording(
        path=str(recording.path),
        sha256=tables_digest(recording),
        zero_n=zero_n,
        drift_n_per_s=drift_n_per_s,
        doubts=doubts,
    )
    before = () if earlier is None else earlier.recordings
    if used.sha256 not in {entry.sha256 for entry in before}:
        return (*before, used)
    *others, last = before
    return (*others, replace(last, doubts=doubts or last.doubts))
