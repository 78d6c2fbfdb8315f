"""What a model says about recordings, beside what their force logs say."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from scleraforce.calibration.label_errors import label_sds
from scleraforce.errors import CalibrationError, RecordingError
from scleraforce.known.calibration_file import CalibrationSummary
from scleraforce.known.eye import Known, foreign_modulus, known_of_eye, known_of_recording
from scleraforce.models.shipped import model_name
from scleraforce.reader.answers import Answer
from scleraforce.reader.evaluation import Evaluation, FrameAnswer
from scleraforce.reader.reader import Reader
from scleraforce.recording.folder import Recording, RecordingInfo, frame_digest, read_recording, true_forces
from scleraforce.recording.labels import Trial, label_frames, label_notes, log_doubts
from scleraforce.recording.pixels import PixelScale
from scleraforce.units import from_si

FOREIGN = ("the modulus is the population's, not this eye's own",)


def evaluate_recordings(
    reader: Reader,
    paths: Sequence[str | PathLike[str]],
    calibration: CalibrationSummary | None = None,
    progress: Callable[[int], object] | None = None,
) -> Evaluation:
    """Read every frame of recordings and compare with their force logs, and a virtual eye's with its `truth.json`.

    Args:
        reader: the model.
        paths: recording folders; each once.
        calibration: of the eyes; the frames that it used are marked and not scored. A model of kind "reader" reads an
            eye that it knows with its own modulus, others with the population's.
        progress: called with 1 after each frame.

    Raises:
        RecordingError: a recording cannot be used, or is given twice.
        FrameError: a frame cannot be read.
        CalibrationError: the calibration cannot be used with this model.
    """
    folders = [Path(path) for path in paths]
    _refuse_twice(folders)
    if calibration is not None:
        _refuse_linear(reader, calibration)
    recordings = [read_recording(path) for path in folders]
    frames: list[FrameAnswer] = []
    notes = list(_notes(reader, folders, recordings, calibration))
    study = reader.study
    for path, recording in zip(folders, recordings, strict=True):
        trials = label_frames(recording, study.classes, study.needle.max_force_n)
        answers = tuple(_answers(reader, str(path), recording, trials, calibration, progress))
        doubts = (*label_notes(recording, trials), *_doubts(reader, recording, answers))
        notes += (f"{path}: {doubt}" for doubt in doubts)
        frames += answers
    return Evaluation(
        model=model_name(reader.path),
        bounds_n=study.classes.bounds_n,
        max_force_n=study.needle.max_force_n,
        youngs_modulus_pa=study.eye.youngs_modulus_pa,
        frames=tuple(frames),
        notes=tuple(notes),
        kind=reader.kind,
    )


def _doubts(reader: Reader, recording: Recording, answers: Sequence[FrameAnswer]) -> tuple[str, ...]:
    """Return sentences on a force log that does not go with what a model reads."""
    classes = reader.study.classes
    if reader.reads_force:
        return log_doubts(recording, classes, [frame.predicted_force_n for frame in answers], in_newtons=True)
    return log_doubts(recording, classes, [frame.predicted if frame.usable else None for frame in answers])


def _refuse_twice(paths: Sequence[Path]) -> None:
    """A recording that counted twice would narrow the intervals without cause."""
    seen: set[Path] = set()
    for path in paths:
        if path.resolve() in seen:
            raise RecordingError(f"{path}: given twice; give each recording once")
        seen.add(path.resolve())


def _refuse_linear(reader: Reader, calibration: CalibrationSummary) -> None:
    """Moduli of a linear wall are not those of one that bends as far as it does."""
    if reader.fixed_modulus_pa is None and calibration.mechanics == "linear":
        raise CalibrationError(
            f"{calibration.path}: mechanics: linear; {reader.path} reads with finite strain: calibrate with "
            "--mechanics finite-strain"
        )


def _notes(
    reader: Reader,
    paths: Sequence[Path],
    recordings: Sequence[Recording],
    summary: CalibrationSummary | None,
) -> Iterator[str]:
    if summary is not None and reader.fixed_modulus_pa is not None:
        yield (
            f"{reader.path}: a classifier reads every eye with the modulus it was trained for, "
            f"{from_si(reader.fixed_modulus_pa, 'mpa'):.3g} MPa; {summary.path} only marks frames"
        )
    for path, recording in zip(paths, recordings, strict=True):
        yield from _limits(reader, path, recording, summary)
        foreign = _foreign(reader, recording, summary)
        if foreign:
            yield f"{path}: {foreign}"


def _limits(reader: Reader, path: Path, recording: Recording, summary: CalibrationSummary | None) -> Iterator[str]:
    """Say what of a recording the model's training did not cover, and where its frames cannot be scored."""
    info = recording.info
    for sentence in reader.limits(_known(info, summary), info.oct, info.needle.gauge):
        yield f"{path}: {sentence}"
    if recording.forces is None:
        yield f"{path}: no forces.csv: its frames are read, but not scored"


def _foreign(reader: Reader, recording: Recording, summary: CalibrationSummary | None) -> str | None:
    """Return a sentence where a recording's eye is read with the modulus of others, although a calibration is given."""
    if summary is None or reader.fixed_modulus_pa is not None:
        return None
    return foreign_modulus(summary, recording.info.eye.id)


def _answers(
    reader: Reader,
    given: str,
    recording: Recording,
    trials: Sequence[Trial],
    summary: CalibrationSummary | None,
    progress: Callable[[int], object] | None,
) -> Iterator[FrameAnswer]:
    """Answer each frame of a recording, in its order."""
    eye = recording.info.eye.id
    scale = PixelScale.of(recording.info.oct)
    known = _known(recording.info, summary)
    modulus_pa, source = _modulus(reader, known)
    digests = frozenset[str]() if summary is None else summary.digests
    doubts = FOREIGN if _foreign(reader, recording, summary) else ()
    sds_n = label_sds(recording, trials)
    true_n = true_forces(recording.path) if (recording.path / "truth.json").exists() else {}
    for entry, trial, sd_n in zip(recording.frames, trials, sds_n, strict=True):
        pixels = recording.frame(entry)
        answer = reader.read(pixels, scale, known)
        yield FrameAnswer(
            recording=given,
            eye=eye,
            file=entry.file,
            measured_force_n=trial.measured_force_n,
            measured_force_sd_n=sd_n,
            true_force_n=true_n.get(entry.file),
            target=trial.target,
            calibration=frame_digest(pixels) in digests,
            excluded=trial.excluded,
            youngs_modulus_pa=modulus_pa,
            modulus_source=source,
            **_read(replace(answer, warnings=(*answer.warnings, *doubts))),
        )
        if progress:
            progress(1)


def _known(info: RecordingInfo, summary: CalibrationSummary | None) -> Known:
    """Return what a recording and a calibration say of its eye."""
    known = known_of_recording(info)
    return known if summary is None else known_of_eye(known, summary, info.eye.id)


def _modulus(reader: Reader, known: Known) -> tuple[float | None, str | None]:
    """Return the modulus that an eye is read with, and where it is from."""
    if reader.fixed_modulus_pa is not None:
        return reader.fixed_modulus_pa, "trained"
    return (known.modulus.mean_pa, known.modulus.source) if known.modulus else (None, None)


def _read(answer: Answer) -> dict[str, Any]:
    """Return what an answer says, under the names of `FrameAnswer`."""
    return {
        "predicted": answer.predicted,
        "probabilities": answer.probabilities,
        "usable": answer.usable,
        "reason": answer.reason,
        "predicted_force_n": answer.force_n,
        "interval_n": answer.interval_n,
        "contact_m": answer.contact_m,
        "iop_at_dent_pa": answer.iop_at_dent_pa,
        "needle": answer.needle,
        "conjunctiva_m": answer.conjunctiva_m,
        "warnings": answer.warnings,
        "can_calibrate": answer.can_calibrate,
        "segmentation": answer.segmentation,
    }
