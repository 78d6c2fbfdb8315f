"""How wide a reader's intervals have to be: scores of readings of known forces, and their quantiles by group.

The score of a reading is how far the force is from the median, over how far the interval's end on that side is. The
factor of a group (`interval_factors`) is the score that 90 % of its readings stay below, every eye weighing the same:
the eyes are exchangeable, the frames of one are not. With n eyes the share is 0.9 (n + 1)/n, as for a new eye.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scleraforce.known.calibration_file import CalibrationSummary
from scleraforce.known.eye import known_of_eye, known_of_recording
from scleraforce.reader.force_reader import ForceReader
from scleraforce.reader.interval_factors import IntervalFactors
from scleraforce.reader.interval_groups import group_of
from scleraforce.reader.readings import METHODS, Reading
from scleraforce.recording.files import Recording, frame_digest
from scleraforce.recording.labels import label_frames
from scleraforce.recording.pixels import PixelScale

__all__ = [
    "LEVEL",
    "GroupChange",
    "Score",
    "group_changes",
    "interval_factors",
    "intervals_record",
    "recording_scores",
    "score",
    "stretched",
]

LEVEL = 0.9
LEAST_N = 1e-6  # of a half interval
SMALLEST, LARGEST = 0.3, 20.0  # factors: a group of few eyes must not promise more, nor say nothing


@dataclass(frozen=True)
class Score:
    """One reading's score: by which method, of which group and which eye."""

    method: str
    group: str
    eye: str
    score: float


@dataclass(frozen=True, kw_only=True)
class GroupChange:
    """How a group's readings did, and what becomes of the factor of its intervals.

    `held`: the share of the readings whose interval held the force, with the factor before.
    """

    method: str
    group: str
    eyes: int
    readings: int
    held: float
    factor_before: float
    factor: float


def score(reading: Reading, force_n: float) -> float:
    """Return how far a force is from a reading's median, over how far the interval's end on that side is.

    >>> round(score(Reading(probabilities=(1.0,), force_n=1e-3, interval_n=(0.0, 3e-3), contact_m=0.0), 4e-3), 9)
    1.5
    """
    low_n, high_n = reading.interval_n
    end_n = high_n if force_n > reading.force_n else low_n
    return abs(force_n - reading.force_n) / max(abs(end_n - reading.force_n), LEAST_N)


def interval_factors(scores: Iterable[Score]) -> dict[str, dict[str, float]]:
    """Return the factor of every group of every method that has scores."""
    grouped: dict[str, dict[str, list[Score]]] = {}
    for entry in scores:
        grouped.setdefault(entry.method, {}).setdefault(entry.group, []).append(entry)
    return {
        method: {group: round(_factor(found), 4) for group, found in sorted(groups.items())}
        for method, groups in sorted(grouped.items())
    }


def _factor(scores: list[Score]) -> float:
    """Return the score below which 90 % of the readings of a group lie, every eye weighing the same."""
    names, eye, count = np.unique([entry.eye for entry in scores], return_inverse=True, return_counts=True)
    values = np.array([entry.score for entry in scores])
    order = np.argsort(values)
    share = np.cumsum((1.0 / (count * len(names)))[eye][order])
    wanted = min(1.0, LEVEL * (len(names) + 1) / len(names))
    place = min(int(np.searchsorted(share, wanted * (1.0 - 1e-12))), len(values) - 1)
    return float(np.clip(values[order][place], SMALLEST, LARGEST))


def intervals_record(scores: list[Score], source: str) -> dict[str, Any]:
    """Return `intervals` of `model.json` from scores, and where these come from."""
    return {
        "level": LEVEL,
        "source": source,
        "eyes": len({entry.eye for entry in scores}),
        "readings": len(scores),
        **interval_factors(scores),
    }


def recording_scores(
    reader: ForceReader,
    recording: Recording,
    summary: CalibrationSummary,
    progress: Callable[[int], object] | None = None,
) -> Iterator[Score]:
    """Score both methods' readings of the frames of a recording that its eye was not calibrated on.

    Args:
        reader: the model; scores count from its intervals as they are.
        recording: with a force log.
        summary: of the eyes' calibration.
        progress: called with 1 after each frame.

    Raises:
        FrameError: a frame cannot be read.
    """
    study, eye = reader.study, recording.info.eye.id
    known = known_of_eye(known_of_recording(recording.info), summary, eye)
    scale = PixelScale.of(recording.info.oct)
    trials = label_frames(recording, study.classes, study.needle.max_force_n)
    for entry, trial in zip(recording.frames, trials, strict=True):
        pixels = recording.frame(entry)
        force_n = trial.measured_force_n if trial.excluded is None else None
        if force_n is not None and frame_digest(pixels) not in summary.digests:
            answer = reader.read(pixels, scale, known)
            for method, reading in answer.readings if answer.usable else ():
                group = group_of(known, reading.force_n, answer.fit if method == "fit" else None)
                yield Score(method, group, eye, score(reading, force_n))
        if progress:
            progress(1)


def group_changes(scores: Sequence[Score], before: IntervalFactors, after: IntervalFactors) -> tuple[GroupChange, ...]:
    """Return what scores say of each group that they are of, with its factors before and after."""
    found: dict[tuple[str, str], list[Score]] = {}
    for entry in scores:
        found.setdefault((entry.method, entry.group), []).append(entry)
    return tuple(
        GroupChange(
            method=method,
            group=group,
            eyes=len({entry.eye for entry in entries}),
            readings=len(entries),
            held=sum(entry.score <= 1.0 for entry in entries) / len(entries),
            factor_before=getattr(before, method).get(group, 1.0),
            factor=getattr(after, method).get(group, 1.0),
        )
        for (method, group), entries in sorted(found.items())
    )


def stretched(before: IntervalFactors, scores: Sequence[Score], source: str) -> dict[str, Any]:
    """Return `intervals` of `model.json` after scores that count from what was there; other groups stay as they are."""
    record = intervals_record(list(scores), source)
    for method in METHODS:
        was = getattr(before, method)
        found = {group: round(was.get(group, 1.0) * factor, 4) for group, factor in record.get(method, {}).items()}
        record[method] = {**was, **found}
    return record
