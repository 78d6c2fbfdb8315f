"""An evaluation: a model's answers beside the measured forces, and the metrics (paper
sec. 3.4, Table 3, Fig. 10).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import nan
from os import PathLike
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from scleraforce.base.arrays import Integers
from scleraforce.base.errors import CalibrationError, RecordingError
from scleraforce.base.notebook_cards import data_frame, flat, html_card, tidy
from scleraforce.base.plain_json import finite_json
from scleraforce.base.units import from_si
from scleraforce.calibration import answer_metrics
from scleraforce.fit.unknowns import SIZE
from scleraforce.reading.answer import Answer
from scleraforce.reading.force_trend import (
    DENTS,
    NOISE_WINDOWS,
    OUTSIDE,
    DentForce,
    TimeToBound,
    TrendLimits,
    rise_of,
    time_to_bound,
    unexplained_fall,
)
from scleraforce.reading.interval_widths import IntervalScore, score_reading
from scleraforce.reading.load_model import suited_reader
from scleraforce.reading.reading_models import Reader
from scleraforce.reading.recorded_wall import recorded_wall
from scleraforce.reading.tissue_memory import Leak, TissueMemory
from scleraforce.reading.trained_ranges import CLASSIFIER
from scleraforce.recordings import forces_under_frames
from scleraforce.recordings.force_errors import label_sds
from scleraforce.recordings.forces_under_frames import Trial, label_frames
from scleraforce.recordings.frame_and_force_tables import FrameEntry
from scleraforce.recordings.recording_folder import (
    Recording,
    read_recording,
    true_forces,
)
from scleraforce.records.calibration_file import (
    CalibrationSummary,
    appearance_doubt,
    appearance_of,
    foreign_modulus,
    known_of_eye,
)
from scleraforce.records.frame import frame_digest
from scleraforce.records.missing_inputs import missing_inputs
from scleraforce.records.remark import Remark, numbered, sentences
from scleraforce.records.setup import Setup
from scleraforce.records.verdict import upper_end
from scleraforce.wall.wall_in_metres import dent_measures, surface_places

Progress = Callable[[int], object] | None  # called with 1 after each frame


@dataclass(frozen=True, kw_only=True)
class FrameAnswer:
    """One frame: the measured force, and the answer of the model.

    `recording` is the path as given, `file` the frame's name. Without a force log there
    is no `measured_force_n` and no `target`; `measured_force_sd_n` is the standard
    deviation of its error (`recordings.force_errors`). `true_force_n`, of a virtual
    eye's `truth.json`, is for comparison only. `to_bound`: when the force reaches the
    highest class, by the frames before (`reading.force_trend`). `excluded` says why a
    trial is left out of the metrics although it has a label (pierced, or above the
    study's largest force); `pierced`: the needle had gone through the wall, by
    frames.csv, or else by the readings or the force log; `calibration` marks a frame
    that Young's modulus was fitted on, which is left out as well. The frame was read
    with `youngs_modulus_pa`, from `modulus_source`. Frames of several planes have one
    answer, which counts once: all frames of a moment but the first are `repeats`.
    """

    recording: str
    eye: str
    file: str
    answer: Answer
    measured_force_n: float | None = None
    target: int | None = None
    calibration: bool = False
    excluded: str | None = None
    pierced: bool = False
    youngs_modulus_pa: float | None = None
    modulus_source: str | None = None
    measured_force_sd_n: float | None = None
    true_force_n: float | None = None
    to_bound: TimeToBound | None = None
    plane: str | None = None
    time_s: float | None = None
    repeats: bool = False

    @property
    def scored(self) -> bool:
        """True if the frame counts in the metrics."""
        return (
            self.target is not None
            and self.excluded is None
            and not self.calibration
            and not self.repeats
        )

    @property
    def misread(self) -> bool:
        """True if the frame has a label and the answer is another class."""
        return self.target is not None and self.answer.predicted != self.target

    def trial(
        self, force_n: float | None, sd_n: float | None = None
    ) -> answer_metrics.ForceTrial | None:
        """Return the read force beside a known one, N, with the SD of its error, N;
        None if either is missing.
        """
        read_n = self.answer.force_n
        interval_n = self.answer.interval_n
        if force_n is None or read_n is None or interval_n is None:
            return None

        return answer_metrics.ForceTrial(
            eye=self.eye,
            measured_n=force_n,
            read_n=read_n,
            interval_n=interval_n,
            measured_sd_n=sd_n or 0.0,
        )

    @property
    def label(self) -> answer_metrics.ForceTrial | None:
        """The read force beside the measured one; None if the frame does not count."""
        return (
            self.trial(self.measured_force_n, self.measured_force_sd_n)
            if self.scored
            else None
        )

    def as_row(self) -> dict[str, Any]:
        """Return the keys of `to_dict` without lists in lists, and `time_s`, `scored`
        and `covered`.
        """
        keys = {
            "recording": self.recording,
            "eye": self.eye,
            "file": self.file,
            "time_s": self.time_s,
        }
        row = flat(
            finite_json(
                keys | self.to_dict() | {"warnings": "; ".join(self.answer.warnings)}
            )
        )

        return row | {
            "scored": self.scored,
            "covered": self.label.covered if self.label else None,
        }

    def to_dict(self) -> dict[str, Any]:
        """Return the frame's keys in the JSON of `evaluate`."""
        median_ms, interval_ms = (
            self.to_bound.as_ms() if self.to_bound else (None, None)
        )
        return {
            "recording": self.recording,
            "eye": self.eye,
            "file": self.file,
            **(
                {"plane": self.plane, "time_s": self.time_s}
                if self.plane is not None
                else {}
            ),
            "measured_force_mn": from_si(self.measured_force_n, "mn"),
            "measured_force_sd_mn": from_si(self.measured_force_sd_n, "mn"),
            "true_force_mn": from_si(self.true_force_n, "mn"),
            "target": self.target,
            **self.answer.to_dict(),
            "time_to_bound_ms": median_ms,
            "time_to_bound_ms_interval": interval_ms,
            "calibration": self.calibration,
            "excluded": self.excluded,
            "pierced": self.pierced,
            "youngs_modulus_mpa": from_si(self.youngs_modulus_pa, "mpa"),
            "modulus_source": self.modulus_source,
        }


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """The answers of a model to the frames of one or more recordings, and the metrics
    over the frames that count.

    `bounds_n` are the class bounds of the model's study, `max_force_n` its largest
    force; `remarks` limit the result (a gap outside the training, inputs that are not
    known, frames without labels). `kind` is the model's.
    """

    model: str
    bounds_n: tuple[float, ...]
    max_force_n: float
    youngs_modulus_pa: float
    frames: tuple[FrameAnswer, ...]
    remarks: tuple[Remark, ...] = ()
    kind: str = "classifier"

    @property
    def notes(self) -> tuple[str, ...]:
        """The sentences of the remarks."""
        return sentences(self.remarks)

    def __repr__(self) -> str:
        error = (
            f", mean error {from_si(self.mae_n, 'mn'):.2f} mN" if self.forces else ""
        )
        right = f"{self.accuracy.hits} of {self.accuracy.total} classes right"

        return (
            f"<Evaluation of {self.model}: {len(self.frames)} frames, {right}{error}>"
        )

    def _repr_html_(self) -> str:
        """The metrics, for Jupyter."""
        facts = {
            "frames": str(len(self.frames)),
            "classes right": f"{self.accuracy.hits} of {self.accuracy.total}",
        }
        if self.forces:
            facts["force error"] = f"{from_si(self.mae_n, 'mn'):.2f} mN in the mean"
            facts["90 % interval and label agree"] = self.coverage.words()

        return html_card(
            f"Evaluation of {self.model}",
            facts | numbered(self.remarks),
        )

    def to_dataframe(self) -> Any:
        """Return a table of pandas with a row for each frame, units in the names;
        raises `InputError` without it.
        """
        return data_frame(self.rows())

    @property
    def reads_force(self) -> bool:
        """True if the model reads forces, not classes alone."""
        return self.kind != "classifier"

    @cached_property
    def scored(self) -> tuple[FrameAnswer, ...]:
        """The frames that count."""
        return tuple(frame for frame in self.frames if frame.scored)

    @cached_property
    def usable(self) -> "Evaluation":
        """The same evaluation, of the usable frames alone."""
        return replace(
            self, frames=tuple(frame for frame in self.frames if frame.answer.usable)
        )

    @cached_property
    def confusion(self) -> Integers:
        """Trials by target (row) and predicted (column) class, shape (classes,
        classes).
        """
        targets = [frame.target for frame in self.scored if frame.target is not None]
        predicted = [frame.answer.predicted for frame in self.scored]
        return answer_metrics.confusion_matrix(
            targets, predicted, len(self.bounds_n) + 1
        )

    @cached_property
    def forces(self) -> tuple[answer_metrics.ForceTrial, ...]:
        """Measured and read force of each usable frame that counts; empty with a
        classifier.
        """
        return tuple(trial for frame in self.scored if (trial := frame.label))

    @cached_property
    def true_forces(self) -> tuple[answer_metrics.ForceTrial, ...]:
        """True and read force of each usable frame that counts and whose true force is
        known.
        """
        return tuple(
            trial for frame in self.scored if (trial := frame.trial(frame.true_force_n))
        )

    @property
    def mae_n(self) -> float:
        """Mean absolute error of the force over `forces`, N; NaN if there are none."""
        return answer_metrics.mean_absolute_error(self.forces)

    @property
    def coverage(self) -> answer_metrics.Proportion:
        """Share of `forces` whose 90 % interval and label agree, the label's own error
        included.
        """
        return answer_metrics.coverage(self.forces)

    @property
    def true_coverage(self) -> answer_metrics.Proportion:
        """Share of `true_forces` in their 90 % intervals."""
        return answer_metrics.coverage(self.true_forces)

    @property
    def label_sd_n(self) -> float:
        """Median standard deviation of the labels of `forces`, N; NaN if there are
        none.
        """
        return (
            median([trial.measured_sd_n for trial in self.forces])
            if self.forces
            else nan
        )

    @property
    def accuracy(self) -> answer_metrics.Proportion:
        """Share of right answers."""
        return answer_metrics.accuracy(self.confusion)

    @property
    def recall(self) -> tuple[answer_metrics.Proportion, ...]:
        """Share of each target class that was recognised (rows; the paper's Table 3
        calls it precision).
        """
        return answer_metrics.recall(self.confusion)

    @property
    def precision(self) -> tuple[answer_metrics.Proportion, ...]:
        """Share of each predicted class that was right (columns; the paper's Table 3
        calls it recall).
        """
        return answer_metrics.precision(self.confusion)

    def to_dict(self) -> dict[str, Any]:
        """Return the result of `evaluate` as plain types, None for a figure that
        is not defined.
        """
        found: dict[str, Any] = finite_json(
            {
                "model": self.model,
                "kind": self.kind,
                "class_bounds_mn": [
                    from_si(bound_n, "mn") for bound_n in self.bounds_n
                ],
                **self._metrics(),
                "mae_mn": from_si(self.mae_n, "mn"),
                "coverage": self.coverage.value,
                "coverage_interval": self.coverage.interval,
                "coverage_by_eye": {
                    eye: one.value
                    for eye, one in answer_metrics.coverage_by_eye(self.forces).items()
                },
                "label_sd_mn": from_si(self.label_sd_n, "mn"),
                "truth": "truth.json" if self.true_forces else None,
                "true_mae_mn": from_si(
                    answer_metrics.mean_absolute_error(self.true_forces), "mn"
                ),
                "true_coverage": self.true_coverage.value,
                "true_coverage_interval": self.true_coverage.interval,
                "true_coverage_by_eye": {
                    eye: one.value
                    for eye, one in answer_metrics.coverage_by_eye(
                        self.true_forces
                    ).items()
                },
                "usable": self.usable._metrics(),
                "notes": self.notes,
                "remarks": [remark.to_dict() for remark in self.remarks],
                "frames": [frame.to_dict() for frame in self.frames],
            }
        )
        return found

    def rows(self) -> list[dict[str, Any]]:
        """Return a tidy table: a flat row for each frame, all with the same columns,
        their units in the names.

        Columns are the keys of the JSON of `evaluate` (docs/formats.md), `time_s`,
        `scored` (the frame counts in the metrics) and `covered` (interval and label
        agree).
        """
        return tidy(frame.as_row() for frame in self.frames)

    def _metrics(self) -> dict[str, Any]:
        shares = {"recall": self.recall, "precision": self.precision}
        values = {
            name: [share.value for share in of_classes]
            for name, of_classes in shares.items()
        }
        ends = {
            name: [share.interval for share in of_classes]
            for name, of_classes in shares.items()
        }

        return {
            "scored": len(self.scored),
            "accuracy": self.accuracy.value,
            "confusion": self.confusion.tolist(),
            **values,
            "intervals": {"accuracy": self.accuracy.interval, **ends},
        }


def check_once(paths: Sequence[Path]) -> None:
    """Raise a `RecordingError` if a recording is given twice."""
    for number, path in enumerate(paths):
        if path.resolve() in {before.resolve() for before in paths[:number]}:
            raise RecordingError(f"{path}: given twice; give each recording once")


FOREIGN = ("the modulus is the population's, not this eye's own",)


def evaluate_recordings(
    reader: Reader,
    recordings: Sequence[Recording | str | PathLike[str]],
    calibration: CalibrationSummary | None = None,
    progress: Progress = None,
) -> Evaluation:
    """Read every frame of recordings and compare with their force logs, and a virtual
    eye's with its `truth.json`.

    Recordings, or their folders, are given once each. Frames of the `calibration` are
    marked and not scored; a reader reads an eye of it with its own modulus, others with
    the population's. A recording or a frame that cannot be used raises `RecordingError`
    or `FrameError`, a calibration that does not suit the model `CalibrationError`.
    """
    check_once(
        [
            entry.path if isinstance(entry, Recording) else Path(entry)
            for entry in recordings
        ]
    )

    if (
        calibration is not None
        and reader.fixed_modulus_pa is None
        and calibration.mechanics == "linear"
    ):
        raise CalibrationError(
            f"{calibration.path}: mechanics: linear; {reader.path} reads with finite"
            " strain: calibrate with `mechanics=finite-strain`"
        )

    opened = [
        entry if isinstance(entry, Recording) else read_recording(entry)
        for entry in recordings
    ]
    frames = list[FrameAnswer]()
    remarks = list[Remark]()
    later = list[Remark]()
    study = reader.study

    if calibration is not None and reader.fixed_modulus_pa is not None:
        words = (
            "a classifier reads every eye with the modulus it was"
            f" trained for, {from_si(reader.fixed_modulus_pa, 'mpa'):.3g} MPa;"
            f" {calibration.path} only marks frames"
        )
        remarks.append(
            Remark("inputs-ignored", words, ("modulus",), about=str(reader.path))
        )

    for recording in opened:
        session = _EvaluatedRecording.of(reader, recording, calibration)
        answers = session.without_pierced(tuple(session.answers(progress)))
        remarks += (remark.on(recording.path) for remark in session.remarks())

        if not session.stated and (count := sum(frame.pierced for frame in answers)):
            first = next(frame.file for frame in answers if frame.pierced)
            words = f"{count} frames after a puncture are left out, from {first} on"
            after = Remark("frames-after-puncture", words)
            remarks.append(after.on(recording.path))

        later += (doubt.on(recording.path) for doubt in session.doubts(answers))
        frames += answers

    return Evaluation(
        model=reader.name,
        bounds_n=study.classes.bounds_n,
        max_force_n=study.needle.max_force_n,
        youngs_modulus_pa=study.eye.youngs_modulus_pa,
        frames=tuple(frames),
        remarks=(*remarks, *later),
        kind=reader.kind,
    )


def recording_scores(
    reader: Reader,
    recording: Recording,
    summary: CalibrationSummary,
    progress: Progress = None,
) -> Iterator[IntervalScore]:
    """Score both methods' readings of a recording's frames that did not calibrate, by
    the reader's intervals.
    """
    session = _EvaluatedRecording.of(reader, recording, summary)
    repeats = session.repeats

    for entry, trial, answer, calibrates in session.read(progress):
        if (
            entry.file in repeats
            or trial.measured_force_n is None
            or trial.excluded is not None
            or calibrates
        ):
            continue

        for method, reading in answer.readings if answer.usable else ():
            fit = answer.fit if method == "fit" else None
            eye = recording.info.eye_name
            yield score_reading(
                method, reading, session.setup, eye, trial.measured_force_n, fit
            )


@dataclass(frozen=True, eq=False)
class _EvaluatedRecording:
    """A recording, its reader in place of the one that was `asked` for, and the
    calibration of the eyes, if any.

    `stated`: frames.csv says which frames are pierced.
    """

    reader: Reader
    recording: Recording
    summary: CalibrationSummary | None
    setup: Setup
    asked: Path
    stated: bool

    @classmethod
    def of(
        cls, reader: Reader, recording: Recording, summary: CalibrationSummary | None
    ) -> "_EvaluatedRecording":
        """Return a session with the known values of the eye, and with the bundled
        reader that was trained for it.
        """
        known = recording.info.setup
        if summary is not None:
            known = known_of_eye(known, summary, recording.info.eye_name)

        stated = any(entry.pierced is not None for entry in recording.frames)
        recording = (
            recording if stated else forces_under_frames.with_punctures(recording)
        )
        return cls(
            suited_reader(reader, known), recording, summary, known, reader.path, stated
        )

    @cached_property
    def trials(self) -> tuple[Trial, ...]:
        """Labels of the frames."""
        study = self.reader.study
        return label_frames(self.recording, study.classes, study.needle.max_force_n)

    @property
    def foreign(self) -> str | None:
        """A sentence if the eye is read with the modulus of others although a
        calibration is given.
        """
        if self.summary is None or self.reader.fixed_modulus_pa is not None:
            return None
        return foreign_modulus(self.summary, self.recording.info.eye_name)

    @property
    def repeats(self) -> set[str]:
        """Files of the frames whose moment another frame stands for, as of several
        planes.
        """
        return {entry.file for moment in self.recording.moments for entry in moment[1:]}

    def remarks(self) -> Iterator[Remark]:
        """Yield remarks on the eye, its B-scans and its needle."""
        info = self.recording.info
        if self.reader.path != self.asked:
            words = (
                f"read with the bundled reader {self.reader.name}, which"
                " was trained for such eyes"
            )
            yield Remark("other-reader", words)

        yield from self.reader.limits(self.setup, info.scan, info.needle.gauge)
        if self.recording.forces is None:
            words = "no forces.csv: its frames are read, but not scored"
            yield Remark("no-forces", words)
        if self.foreign:
            yield Remark("population-modulus", self.foreign, ("modulus",))

        yield from self.recording.walls.remarks
        yield from missing_inputs(
            self.setup,
            forces=self.recording.forces is not None,
            classifier=self.reader.kind == CLASSIFIER,
        )

    def doubts(self, answers: Sequence[FrameAnswer]) -> tuple[Remark, ...]:
        """Return remarks on labels that are missing, and on a force log that
        contradicts the answers.
        """
        classes = self.reader.study.classes
        scale = self.recording.info.scan.scale
        dents = np.full((2, len(answers)), np.nan)
        for index, frame in enumerate(answers):
            wall = frame.answer.segmentation
            if wall is not None and wall.usable and not frame.repeats:
                dents[:, index] = dent_measures(*surface_places(wall, scale))

        read_n = [frame.answer.force_n for frame in answers]
        log = forces_under_frames.log_doubts(
            self.recording, classes, dents, read_n if self.reader.reads_force else ()
        )
        sds_n = [frame.measured_force_sd_n for frame in answers if frame.scored]
        unsure = forces_under_frames.unsure_remark(
            [sd_n for sd_n in sds_n if sd_n is not None], classes
        )
        other = self._other_eye(answers)
        labels = forces_under_frames.label_remarks(self.recording, self.trials)
        return (*labels, *unsure, *log, *other)

    def _other_eye(self, answers: Sequence[FrameAnswer]) -> tuple[Remark, ...]:
        """Return a remark if the frames show another eye than the calibration's."""
        if self.summary is None:
            return ()

        each = [frame.answer for frame in answers if frame.answer.usable]
        walls = [answer.segmentation for answer in each if answer.segmentation]
        fits = [answer.fit for answer in each if answer.fit is not None]
        shown = appearance_of(
            [wall.thickness_m for wall in walls if wall.inner_found],
            [float(np.exp(fit.unknown[SIZE])) for fit in fits],
        )
        doubt = appearance_doubt(self.summary, self.recording.info.eye_name, shown)
        return (Remark("other-eye", doubt, ("name",)),) if doubt else ()

    def read(
        self, progress: Progress
    ) -> Iterator[tuple[FrameEntry, Trial, Answer, bool]]:
        """Yield each frame with its label, its answer, and whether Young's modulus was
        fitted on it.
        """
        scale = self.recording.info.scan.scale
        study = self.reader.study
        history = TissueMemory.unknown(self.setup, study.needle.max_force_n)
        leak = Leak(self.setup)
        trials = iter(self.trials)
        digests = self.summary.digests if self.summary else frozenset()

        for moment in self.recording.moments:
            frames = [self.recording.frame(entry) for entry in moment]
            first = moment[0]
            planes = [
                plane
                for entry in moment
                if (plane := self.recording.info.scan.named(entry.plane))
            ]
            given = [
                recorded_wall(self.recording.walls, one.file, frames[0].shape, scale)
                for one in moment
            ]
            read = partial(
                self.reader.read_together, frames, scale, planes=planes, walls=given
            )
            elastic, leak = leak.read(read, first.time_s, first.held_s)
            calibrates = (
                any(frame_digest(pixels) in digests for pixels in frames)
                if digests
                else False
            )
            felt = [
                history.read(one, study.classes.bounds_n, first.time_s, first.held_s)
                for one in elastic
            ]
            history = felt[0][1]

            for entry, (answer, _) in zip(moment, felt, strict=True):
                yield entry, next(trials), answer, calibrates
                if progress:
                    progress(1)

    def answers(self, progress: Progress) -> Iterator[FrameAnswer]:
        """Answer each frame, in the recording's order."""
        recording = self.recording
        fixed_pa = self.reader.fixed_modulus_pa
        modulus = self.setup.eye.modulus
        used = (modulus.mean_pa, modulus.source) if modulus else (None, None)
        modulus_pa, source = used if fixed_pa is None else (fixed_pa, "trained")
        doubts = FOREIGN if self.foreign else ()
        true_n = true_forces(recording.path)
        sds_n = label_sds(recording, self.trials)
        seen = list[tuple[float, float]]()
        repeats = self.repeats

        for sd_n, (entry, trial, answer, calibrates) in zip(
            sds_n, self.read(progress), strict=True
        ):
            yield FrameAnswer(
                recording=str(recording.path),
                eye=recording.info.eye_name,
                file=entry.file,
                measured_force_n=trial.measured_force_n,
                measured_force_sd_n=sd_n,
                true_force_n=true_n.get(entry.file),
                target=trial.target,
                calibration=calibrates,
                excluded=trial.excluded,
                pierced=bool(entry.pierced),
                youngs_modulus_pa=modulus_pa,
                modulus_source=source,
                to_bound=self._to_bound(answer, entry.time_s, seen),
                plane=entry.plane,
                time_s=entry.time_s,
                repeats=entry.file in repeats,
                answer=replace(answer, warnings=(*answer.warnings, *doubts)),
            )

    def without_pierced(
        self, answers: tuple[FrameAnswer, ...]
    ) -> tuple[FrameAnswer, ...]:
        """Leave out the frames after a puncture that the readings show, as the monitor
        does; frames.csv overrules.
        """
        if self.stated:
            return answers

        dents = list[DentForce]()
        punctures_s = list[float]()
        limits = TrendLimits()

        for entry, frame in zip(self.recording.frames, answers, strict=True):
            force_n = (
                frame.answer.force_n
                if frame.answer.elastic_force_n is None
                else frame.answer.elastic_force_n
            )
            if force_n is not None and not frame.repeats:
                dents.append(DentForce(entry.time_s, force_n, entry.travel_m))
            # a fall between held pushes, which nobody saw, is no puncture
            fall = unexplained_fall(tuple(dents[-DENTS:]), limits)
            if fall is not None and fall.pierced:
                punctures_s.append(dents[-OUTSIDE].at_s)

        times_s = np.array([entry.time_s for entry in self.recording.frames])
        contact = (
            np.array([(dent.at_s, dent.force_n) for dent in dents]).reshape(-1, 2).T
        )
        log = self.recording.forces

        info = self.recording.info.force
        if log is not None and info is not None:
            contact = np.array(
                [log.time_s, forces_under_frames.contact_force(log, info)]
            )

        found = forces_under_frames.after_punctures(
            times_s, punctures_s, contact[0], contact[1]
        )
        return tuple(
            (
                replace(frame, pierced=True, excluded=frame.excluded or "pierced")
                if pierced
                else frame
            )
            for frame, pierced in zip(answers, found, strict=True)
        )

    def _to_bound(
        self, answer: Answer, at_s: float, seen: list[tuple[float, float]]
    ) -> TimeToBound | None:
        """Return when the force will reach the highest class, as the monitor does; add
        a usable frame to those seen.
        """
        upper_n = upper_end(answer.verdict)
        if not answer.usable or answer.force_n is None or upper_n is None:
            return None
        if not seen or seen[-1][0] != at_s:  # planes of one moment are one reading
            seen.append((at_s, answer.force_n))

        limits = TrendLimits()
        bound_n = self.reader.study.classes.bounds_n[-1]
        rise = rise_of(seen[-NOISE_WINDOWS * limits.rate_frames :], limits.rate_frames)
        return time_to_bound(rise, answer.force_n, upper_n, bound_n)
