"""E of an eye from pictures alone: its posterior, frame by frame, and the calibration
of recordings without forces.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import exp, sqrt

import numpy as np

from scleraforce.base.errors import CalibrationError
from scleraforce.base.units import from_si
from scleraforce.calibration.calibration import (
    Calibration,
    EyeCalibration,
    FrameRecord,
    UsedRecording,
)
from scleraforce.calibration.filter.eye_filter import PARAMETERS, SkippedFrame
from scleraforce.calibration.seen_frames import (
    NO_WALL,
    CalibrationSettings,
    EyeFrames,
    frame_order,
)
from scleraforce.calibration.start_of_an_eye import first_fit
from scleraforce.fit import unknowns
from scleraforce.fit.frames_of_an_eye import EyeToFit, JointFit, ShownFrame, fit_shape
from scleraforce.fit.prior_of_an_eye import KNOWN_SD
from scleraforce.library import Library
from scleraforce.recordings.force_errors import LABEL_SD_N
from scleraforce.recordings.recording_folder import Recording, tables_digest
from scleraforce.records.eye import Modulus
from scleraforce.records.globe import UNKNOWN
from scleraforce.records.needle import one_lean
from scleraforce.records.remark import Remark
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study

MOST_FRAMES = 24  # of a posterior; frames of like dents say the same
# relative, of E in the fits of single frames that the joint fit begins with
START_SD = 0.05
TELLS_LITTLE = 0.8  # of the prior's standard deviation


@dataclass(frozen=True, eq=False, kw_only=True)
class EyePosterior:
    """The modulus of an eye by its frames, without forces, and a prior; `with_frames`
    returns a narrower one.

    `setup`: the setup with the prior of its modulus, `library`: that of its tissue.
    `frames` are the ones that count, at most `MOST_FRAMES`, whose dents are the most
    different; `fit` is theirs, None before the first. `iop_sd`: standard deviation of
    the logarithm of the known IOP.
    """

    setup: Setup
    study: Study
    library: Library
    frames: tuple[ShownFrame, ...] = ()
    fit: JointFit | None = None
    iop_sd: float = KNOWN_SD[unknowns.IOP]

    @property
    def modulus(self) -> Modulus:
        """The modulus; its source is "shape" from the first frame on."""
        assert self.setup.eye.modulus is not None
        if self.fit is None:
            return self.setup.eye.modulus

        mean, sd = self.fit.log_modulus
        mean_pa = exp(mean + 0.5 * sd**2)
        return Modulus(
            mean_pa=mean_pa, sd_pa=mean_pa * sqrt(np.expm1(sd**2)), source="shape"
        )

    @property
    def thickness_m(self) -> float | None:
        """The wall's thickness, m, with which the modulus reads forces."""
        return (
            self.setup.eye.thickness_m
            if self.fit is None
            else self.fit.moments(unknowns.THICKNESS)[0]
        )

    @property
    def known_eye(self) -> Setup:
        """The setup with this modulus and thickness, as a reader takes it, beside
        the eye before.
        """
        if self.fit is None:
            return self.setup

        return replace(
            self.setup,
            eye=replace(
                self.setup.eye,
                modulus=self.modulus,
                thickness_m=self.thickness_m,
                unlearned=self.setup.eye.before_learning,
            ),
        )

    def calibration(
        self,
        eye: str,
        recordings: Sequence[UsedRecording],
        frames: Sequence[FrameRecord],
    ) -> EyeCalibration:
        """Return the posterior, of one frame at least, as the calibration of an eye
        without known forces.
        """
        assert self.fit is not None
        modulus = self.modulus
        thickness_m, thickness_sd_m = self.fit.moments(unknowns.THICKNESS)
        return EyeCalibration(
            id=eye,
            names=(PARAMETERS["e"], PARAMETERS["thickness"]),
            means=(modulus.mean_pa, thickness_m),
            sds=(modulus.sd_pa, thickness_sd_m),
            bounds_n=self.study.classes.bounds_n,
            stated_thickness_m=thickness_m,
            globe=self.setup.eye.globe or UNKNOWN,
            without_force=True,
            recordings=tuple(recordings),
            frames=tuple(frames),
            stiffening=self.library.stiffening,
            relaxation=self.setup.eye.relaxation,
        )

    @property
    def _with_iop_sd(self) -> Setup:
        """The setup with the uncertainty of its pressure, if that is not stated."""
        eye = self.setup.eye
        if eye.iop_pa is None or eye.iop_sd_pa is not None:
            return self.setup
        return replace(self.setup, eye=replace(eye, iop_sd_pa=self.iop_sd * eye.iop_pa))

    def with_frames(self, frames: Sequence[ShownFrame]) -> "EyePosterior":
        """Return the posterior after more frames; a frame that no wall of the library
        lies on is left out.
        """
        library = self.library.nearest_contact(self.setup.needle.polar_rad)
        modulus = replace(
            self.modulus, sd_pa=START_SD * self.modulus.mean_pa, source="population"
        )
        begun = replace(self.setup, eye=replace(self.setup.eye, modulus=modulus))
        shown = list(self.frames)
        found = [] if self.fit is None else list(self.fit.unknown_fn)

        for frame in frames:
            fit = first_fit(frame, begun, library, self.study)
            if fit is not None:
                shown.append(frame)
                found.append(fit.unknown)

        if len(shown) == len(self.frames):
            return self

        kept = _spread(
            [unknown[unknowns.TIP] for unknown in found],
            [frame.force_n is not None for frame in shown],
        )
        shown = [shown[place] for place in kept]
        eye = EyeToFit(
            library=library,
            frames=shown,
            setup=self._with_iop_sd,
            trained=self.study.reader,
            smoothing_m=self.study.calibration.surface_smoothing_m,
            begun_fn=np.array([found[place] for place in kept]),
        )
        joint = fit_shape(eye, None if self.fit is None else self.fit.shared)

        return replace(self, frames=tuple(shown), fit=joint)


def _spread(tips_m: Sequence[float], needed: Sequence[bool]) -> list[int]:
    """Return the places of `MOST_FRAMES` dents that are the most different, and of the
    needed ones, in order.
    """
    kept = sorted(range(len(tips_m)), key=lambda place: tips_m[place])
    while len(kept) > MOST_FRAMES:
        around = [
            tips_m[after] - tips_m[before]
            for before, after in zip(kept, kept[2:], strict=False)
        ]
        free = [place for place in range(1, len(kept) - 1) if not needed[kept[place]]]
        if not free:
            break

        kept.pop(min(free, key=lambda place: around[place - 1]))

    return sorted(kept)


def calibrate_without_force(
    recordings: Sequence[Recording],
    settings: CalibrationSettings,
    study_sha256: str,
    population: Modulus | None = None,
    progress: Callable[[int], object] = lambda _: None,
) -> Calibration:
    """Calibrate every eye on the shape of its dents; `settings.frames` of each
    recording also by their forces.

    `population` is the prior of E, by default the study's. A later recording of an eye
    begins with the posterior of an earlier one. It raises `CalibrationError`: no
    pressure is stated, or no frame is usable.
    """
    eyes = dict[str, EyeCalibration]()
    prior = population or settings.study.calibration.prior()

    for recording in recordings:
        eye = recording.info.eye_name
        eyes[eye] = _of_eye(recording, settings, prior, eyes.get(eye), progress)

    return Calibration(
        eyes, study_sha256, settings.study.classes.bounds_n, "finite-strain"
    )


def _of_eye(
    recording: Recording,
    settings: CalibrationSettings,
    prior: Modulus,
    before: EyeCalibration | None,
    progress: Callable[[int], object],
) -> EyeCalibration:
    info = recording.info
    place = recording.path / "recording.toml"
    known = recording.info.setup
    library = settings.library
    assert library is not None  # at finite strain

    if info.eye.iop_pa is None:
        raise CalibrationError(
            f"{place}: eye.iop_pa: missing; without forces E is found beside the known"
            " pressure"
        )

    if before is not None:
        prior = Modulus(mean_pa=before.mean_pa, sd_pa=before.sd_pa, source="population")

    relaxation = info.eye.relaxation
    earlier = () if before is None else before.frames
    used = frozenset(sha256 for frame in earlier for _, sha256 in frame.seen)
    frames = EyeFrames(recording, settings, used, relaxation)
    shown, records = _shown(frames, _known_forces(frames, settings), progress)

    if frames.followed is not None:
        gaps_m = [frame.gap_m for frame in shown.values() if frame.gap_m is not None]
        known = replace(
            known.turned(frames.followed.direction_rad),
            needle=replace(
                known.turned(frames.followed.direction_rad).needle,
                gap_m=float(np.median(gaps_m or 0.0)),
            ),
        )

    begun = EyePosterior(
        setup=replace(known, eye=replace(known.eye, modulus=prior)),
        study=settings.study,
        library=library,
    )
    after = begun.with_frames(list(shown.values()))
    if not after.frames:
        reason = next((record.skipped for record in records if record.skipped), NO_WALL)
        raise CalibrationError(
            f"{recording.path}: none of its {len(records)} frames can be calibrated on"
            f" ({reason})"
        )

    counted = set(map(id, after.frames))
    modulus = after.modulus

    for number, frame in shown.items():
        skipped = (
            None
            if id(frame) in counted
            else f"{NO_WALL}, or other frames have the same dent"
        )
        records[number] = replace(
            records[number],
            skipped=skipped,
            mean_pa=modulus.mean_pa,
            sd_pa=modulus.sd_pa,
        )

    entry = UsedRecording(
        path=str(recording.path),
        sha256=tables_digest(recording),
        zero_n=0.0,
        drift_n_per_s=0.0,
        remarks=_remarks(after, prior),
    )
    recordings, earlier = (before.recordings, before.frames) if before else ((), ())
    found = after.calibration(info.eye_name, [*recordings, entry], [*earlier, *records])

    return replace(found, lean_rad=one_lean(info.needle.lean_rad))


def _known_forces(frames: EyeFrames, settings: CalibrationSettings) -> dict[int, float]:
    """Return the forces, N, that are to be known, by the numbers of their frames."""
    if settings.frames is None:
        return {}

    trials, forces, _, _ = frames.labelled()
    least_n = settings.study.calibration.min_force_n
    included = [trial.excluded is None for trial in trials]
    found = dict[int, float]()

    for place in frame_order(forces.force_n, included, least_n, settings.frames):
        seen = frames.seen(place)
        force_n = float(forces.force_n[place])
        if (
            len(found) < settings.frames
            and force_n > least_n
            and seen
            and not isinstance(seen.wall, SkippedFrame)
        ):
            found[place] = force_n

    return found


def _shown(
    frames: EyeFrames, forces_n: dict[int, float], progress: Callable[[int], object]
) -> tuple[dict[int, ShownFrame], list[FrameRecord]]:
    """Return what usable frames show, by the numbers of their records, and a record of
    each new frame.
    """
    shown = dict[int, ShownFrame]()
    records = list[FrameRecord]()

    for number, entry in enumerate(frames.recording.frames):
        seen = None if entry.pierced else frames.seen(number)
        progress(1)
        if seen is None:
            continue

        wall = seen.wall
        path = str(frames.recording.path)
        force_n = forces_n.get(number, 0.0)
        of_frame = partial(
            FrameRecord,
            recording=path,
            file=seen.file,
            sha256=seen.sha256,
            planes=seen.files,
        )
        record = of_frame(force_n=force_n, mean_pa=0.0, sd_pa=0.0)

        if isinstance(wall, SkippedFrame):
            record = replace(record, skipped=wall.reason)
        else:
            shown[len(records)] = ShownFrame(
                lateral_m=wall.lateral_m,
                depth_bc=wall.depth_m,
                iop_pa=entry.iop_pa,
                travel_m=entry.travel_m,
                force_n=forces_n.get(number),
                force_sd_n=LABEL_SD_N,
                gap_m=seen.place[0] if seen.planes else None,
            )

        records.append(record)

    return shown, records


def _remarks(after: EyePosterior, prior: Modulus) -> tuple[Remark, ...]:
    """Return remarks that say what E rests on."""
    known = sum(frame.force_n is not None for frame in after.frames)
    forces = "no force was measured" if not known else f"{known} forces are known"
    percent = from_si(after.modulus.relative_sd, "percent")
    words = (
        f"{forces}: E is from the shape of {len(after.frames)} dents beside the IOP,"
        f" and sure to {percent:.0f} %"
    )

    of_shape = Remark("modulus-from-shape", words, ("modulus",))
    if after.modulus.relative_sd < TELLS_LITTLE * prior.relative_sd:
        return (of_shape,)

    tips_m = after.fit.unknown_fn[:, unknowns.TIP] if after.fit else np.zeros(1)
    deepest_mm = from_si(float(tips_m.max()), "mm")
    words = (
        f"dents of up to {deepest_mm:.1f} mm tell little: E is mostly its prior;"
        " push deeper, or measure a force"
    )
    return of_shape, Remark("modulus-from-prior", words, ("modulus",))
