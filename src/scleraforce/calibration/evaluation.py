"""An evaluation: a model's answers beside the measured forces, and the metrics (paper
sec. 3.4, Table 3, Fig. 10).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import nan
from os import PathLike
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from scleraforce.base.arrays import Integers
from scleraforce.base.errors import RecordingError
from scleraforce.base.notebook_cards import data_frame, flat, html_card, tidy
from scleraforce.base.plain_json import finite_json
from scleraforce.base.units import from_si
from scleraforce.calibration import answer_metrics
from scleraforce.reading.answer import Answer
from scleraforce.reading.eye_reader import (
    EyeReader,
    Memory,
    MomentFrame,
    OpenedMoment,
    other_eye,
)
from scleraforce.reading.interval_widths import IntervalScore, score_reading
from scleraforce.reading.reading_models import Reader
from scleraforce.reading.recorded_wall import recorded_wall
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
)
from scleraforce.records.frame import frame_digest
from scleraforce.records.remark import Remark, numbered, sentences
from scleraforce.records.setup import Setup
from scleraforce.wall.wall_in_metres import dent_measures, surface_places

Progress = Callable[[int], object] | None  # called with 1 after each frame


@dataclass(frozen=True, kw_only=True)
class FrameAnswer:
    """One frame: the measured force, and the answer of the model.

    `recording` is the path as given, `file` the frame's name. Without a force log there
    is no `measured_force_n` and no `target`; `measured_force_sd_n` is the standard
    deviation of its error (`recordings.force_errors`). `true_force_n`, of a virtual
    eye's `truth.json`, is for comparison only. `excluded` says why a
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
                keys
                | self.to_dict()
                | {
                    "warnings": "; ".join(self.answer.warnings),
                    "remarks": "; ".join(one.code for one in self.answer.remarks),
                }
            )
        )

        return row | {
            "scored": self.scored,
            "covered": self.label.covered if self.label else None,
        }

    def to_dict(self) -> dict[str, Any]:
        """Return the frame's keys in the JSON of `evaluate`."""
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
        answers = session.answers(progress)
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

    for read in session.read(progress):
        measured_n = read.trial.measured_force_n
        answer = read.answer
        if (
            read.entry.file in repeats
            or measured_n is None
            or read.trial.excluded is not None
            or read.calibrates
        ):
            continue

        for method, reading in answer.readings if answer.usable else ():
            fit = answer.fit if method == "fit" else None
            eye = recording.info.eye_name
            yield score_reading(method, reading, session.setup, eye, measured_n, fit)


@dataclass(frozen=True, eq=False)
class _EvaluatedRecording:
    """A recording, the reader of its eye, and the calibration of the eyes, if any.

    `stated`: frames.csv says which frames are pierced.
    """

    eye_reader: EyeReader
    recording: Recording
    summary: CalibrationSummary | None
    stated: bool

    @classmethod
    def of(
        cls, model: Reader, recording: Recording, summary: CalibrationSummary | None
    ) -> "_EvaluatedRecording":
        """Return a recording with the reader of its eye."""
        stated = any(entry.pierced is not None for entry in recording.frames)
        if not stated:
            recording = forces_under_frames.with_punctures(recording)
        eye_reader = EyeReader.of(model, recording.info.setup, summary)
        return cls(eye_reader, recording, summary, stated)

    @property
    def reader(self) -> Reader:
        """The model that reads the eye."""
        return self.eye_reader.model

    @property
    def setup(self) -> Setup:
        """What is known of the eye, by its calibration, too."""
        return self.eye_reader.setup

    @cached_property
    def trials(self) -> tuple[Trial, ...]:
        """Labels of the frames."""
        study = self.reader.study
        return label_frames(self.recording, study.classes, study.needle.max_force_n)

    @property
    def repeats(self) -> set[str]:
        """Files of the frames whose moment another frame stands for, as of several
        planes.
        """
        return {entry.file for moment in self.recording.moments for entry in moment[1:]}

    def remarks(self) -> Iterator[Remark]:
        """Yield remarks on the eye, its B-scans and its needle."""
        pressures_pa = [entry.iop_pa for entry in self.recording.frames]
        stated_pa = sorted(iop_pa for iop_pa in pressures_pa if iop_pa is not None)
        found = list[Remark]()
        if None in pressures_pa:
            found += self.eye_reader.remarks
        for iop_pa in stated_pa[:1] + stated_pa[-1:]:  # all others are between
            found += self.eye_reader.at(iop_pa).remarks

        yield from dict.fromkeys(found)
        if self.recording.forces is None:
            words = "no forces.csv: its frames are read, but not scored"
            yield Remark("no-forces", words)
        yield from self.recording.walls.remarks

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

        each = [frame.answer for frame in answers]
        return other_eye(each, self.summary, self.recording.info.eye_name)

    def read(self, progress: Progress) -> Iterator["_ReadFrame"]:
        """Yield each frame with its label and its answer."""
        recording = self.recording
        memory = self.eye_reader.start()
        trials = iter(self.trials)
        digests = self.summary.digests if self.summary else frozenset()

        for entries in recording.moments:
            moment = recorded_moment(recording, entries)
            if not self.stated:  # but found in the log, which the readings do not know
                moment = replace(moment, pierced=None)
            answers, memory = self.eye_reader.read(moment, memory)
            calibrates = bool(digests) and any(
                frame_digest(frame.pixels) in digests for frame in moment.frames
            )
            for entry, answer in zip(entries, answers, strict=True):
                yield _ReadFrame(entry, next(trials), answer, calibrates, memory)
                if progress:
                    progress(1)

    def answers(self, progress: Progress) -> tuple[FrameAnswer, ...]:
        """Return the answer to each frame, in the recording's order."""
        recording = self.recording
        fixed_pa = self.reader.fixed_modulus_pa
        modulus = self.setup.eye.modulus
        used = (modulus.mean_pa, modulus.source) if modulus else (None, None)
        modulus_pa, source = used if fixed_pa is None else (fixed_pa, "trained")
        true_n = true_forces(recording.path)
        sds_n = label_sds(recording, self.trials)
        repeats = self.repeats
        answers = list[FrameAnswer]()
        punctures_s: tuple[float, ...] = ()

        for sd_n, read in zip(sds_n, self.read(progress), strict=True):
            entry = read.entry
            trial = read.trial
            punctures_s = read.memory.punctures_s
            answer = FrameAnswer(
                recording=str(recording.path),
                eye=recording.info.eye_name,
                file=entry.file,
                measured_force_n=trial.measured_force_n,
                measured_force_sd_n=sd_n,
                true_force_n=true_n.get(entry.file),
                target=trial.target,
                calibration=read.calibrates,
                excluded=trial.excluded,
                pierced=bool(entry.pierced),
                youngs_modulus_pa=modulus_pa,
                modulus_source=source,
                plane=entry.plane,
                time_s=entry.time_s,
                repeats=entry.file in repeats,
                answer=read.answer,
            )
            answers.append(answer)

        return self._without_pierced(tuple(answers), punctures_s)

    def _without_pierced(
        self, answers: tuple[FrameAnswer, ...], punctures_s: tuple[float, ...]
    ) -> tuple[FrameAnswer, ...]:
        """Leave out the frames after a puncture that the readings show, as the monitor
        does; frames.csv overrules.
        """
        if self.stated:
            return answers

        times_s = np.array([entry.time_s for entry in self.recording.frames])
        log = self.recording.forces
        info = self.recording.info.force
        if log is not None and info is not None:
            contact_s = log.time_s
            contact_n = forces_under_frames.contact_force(log, info)
        else:
            shown = [frame for frame in answers if not frame.repeats]
            dents = [
                (frame.time_s, dent_n)
                for frame in shown
                if (dent_n := frame.answer.dent_force_n) is not None
            ]
            contact_s, contact_n = np.array(dents, np.float64).reshape(-1, 2).T

        found = forces_under_frames.after_punctures(
            times_s, punctures_s, contact_s, contact_n
        )
        return tuple(
            (
                replace(frame, pierced=True, excluded=frame.excluded or "pierced")
                if pierced
                else frame
            )
            for frame, pierced in zip(answers, found, strict=True)
        )


@dataclass(frozen=True, eq=False)
class _ReadFrame:
    """A frame of a recording with its label and its answer.

    `calibrates`: Young's modulus was fitted on it. `memory`: after its moment.
    """

    entry: FrameEntry
    trial: Trial
    answer: Answer
    calibrates: bool
    memory: Memory


def recorded_moment(
    recording: Recording, entries: Sequence[FrameEntry]
) -> OpenedMoment:
    """Return the frames of a moment of a recording, with the walls that were drawn."""
    scan = recording.info.scan
    scale = scan.scale
    frames = []
    for entry in entries:
        pixels = recording.frame(entry)
        wall = recorded_wall(recording.walls, entry.file, pixels.shape, scale)
        frames.append(MomentFrame(pixels, scan.named(entry.plane), wall))

    first = entries[0]
    return OpenedMoment(
        tuple(frames),
        scale,
        first.time_s,
        first.held_s,
        first.iop_pa,
        first.travel_m,
        first.pierced,
    )
