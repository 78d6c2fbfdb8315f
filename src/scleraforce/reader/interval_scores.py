"""How wide a reader's intervals have to be: scores of readings of known forces, and what they stretch intervals by.

The score of a reading is how far the force is from the median, over how far the interval's end on that side is. What
90 % of the readings stay below, every eye weighing the same, makes 90 % of the intervals hold: the eyes are
exchangeable, the frames of one are not. With n eyes the share is 0.9 (n + 1)/n, as for a new eye.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.known.calibration_file import CalibrationSummary
from scleraforce.known.eye import known_of_eye, known_of_recording
from scleraforce.reader.force_reader import ForceReader
from scleraforce.reader.interval_factors import Factors, IntervalFactors
from scleraforce.reader.interval_traits import GLOBE_TRAITS, traits_of
from scleraforce.reader.readings import METHODS, Reading
from scleraforce.recording.folder import Recording, frame_digest
from scleraforce.recording.labels import label_frames
from scleraforce.recording.pixels import PixelScale

Floats = NDArray[np.float64]

LEVEL = 0.9
LEAST_N = 1e-6  # of a half interval
SMALLEST, LARGEST = 0.3, 20.0  # factors: a few eyes must not promise more, nor say nothing
FEW_EYES = 9  # 90 % of a new eye's readings: with fewer eyes no quantile promises as much


@dataclass(frozen=True)
class Score:
    """One reading's score: by which method, of which traits (`interval_traits.traits_of`) and which eye."""

    method: str
    traits: tuple[str, ...]
    eye: str
    score: float


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """How a method's readings with one kind of modulus did, and by how much their intervals are stretched for it.

    `held`: the share of the readings whose interval held the force before. `globes`: which of `GLOBE_TRAITS`
    they have, whose factors grow by `factor`.
    """

    method: str
    modulus: str
    globes: tuple[str, ...]
    eyes: int
    readings: int
    held: float
    factor: float


def score(reading: Reading, force_n: float) -> float:
    """Return how far a force is from a reading's median, over how far the interval's end on that side is.

    >>> round(score(Reading(probabilities=(1.0,), force_n=1e-3, interval_n=(0.0, 3e-3), contact_m=0.0), 4e-3), 9)
    1.5
    """
    low_n, high_n = reading.interval_n
    end_n = high_n if force_n > reading.force_n else low_n
    return abs(force_n - reading.force_n) / max(abs(end_n - reading.force_n), LEAST_N)


def eye_count(scores: Iterable[Score]) -> int:
    """Return of how many eyes scores are."""
    return len({entry.eye for entry in scores})


def weights_of_eyes(scores: Sequence[Score]) -> Floats:
    """Return the weight of each score, of sum 1: every eye weighs the same."""
    names, eye, count = np.unique([entry.eye for entry in scores], return_inverse=True, return_counts=True)
    weights: Floats = (1.0 / (count * len(names)))[eye]
    return weights


def share_of_new_eye(eyes: int) -> float:
    """Return which share of the scores of some eyes has to be held for 90 % of a new eye's.

    >>> round(share_of_new_eye(90), 3), share_of_new_eye(8)
    (0.91, 1.0)
    """
    return min(1.0, LEVEL * (eyes + 1) / eyes)


def conformal_quantile(scores: Sequence[Score]) -> float:
    """Return the score below which 90 % of the readings of a new eye lie."""
    values = np.array([entry.score for entry in scores])
    order = np.argsort(values)
    held = np.cumsum(weights_of_eyes(scores)[order])
    wanted = share_of_new_eye(eye_count(scores))
    place = min(int(np.searchsorted(held, wanted * (1.0 - 1e-12))), len(values) - 1)
    return float(np.clip(values[order][place], SMALLEST, LARGEST))


def of_each_modulus(scores: Iterable[Score]) -> dict[tuple[str, str], list[Score]]:
    """Return the scores of each method and kind of modulus that has any."""
    found: dict[tuple[str, str], list[Score]] = {}
    for entry in scores:
        found.setdefault((entry.method, entry.traits[0]), []).append(entry)
    return dict(sorted(found.items()))


def intervals_record(scores: Sequence[Score], factors: Mapping[str, Factors], source: str) -> dict[str, Any]:
    """Return `intervals` of `model.json`: the factors of both methods, and on what they rest."""
    return {
        "level": LEVEL,
        "source": source,
        "eyes": eye_count(scores),
        "readings": len(scores),
        **factors,
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
                traits = traits_of(known, reading.force_n, answer.fit if method == "fit" else None)
                yield Score(method, traits, eye, score(reading, force_n))
        if progress:
            progress(1)


def stretches(scores: Iterable[Score]) -> tuple[Stretch, ...]:
    """Return by how much intervals have to be stretched to hold on the eyes that scores are of.

    All readings with one kind of modulus together: a user's eyes are too few to tell their traits apart. Fewer than
    `FEW_EYES` only widen: that these did well does not say that others will.
    """
    found = list[Stretch]()
    for (method, modulus), entries in of_each_modulus(scores).items():
        eyes, factor = eye_count(entries), conformal_quantile(entries)
        globes = tuple(globe for globe in GLOBE_TRAITS if any(globe in entry.traits for entry in entries))
        found.append(
            Stretch(
                method=method,
                modulus=modulus,
                globes=globes,
                eyes=eyes,
                readings=len(entries),
                held=sum(entry.score <= 1.0 for entry in entries) / len(entries),
                factor=max(factor, 1.0) if eyes < FEW_EYES else factor,
            )
        )
    return tuple(found)


def stretched(before: IntervalFactors, changes: Iterable[Stretch]) -> Mapping[str, Factors]:
    """Return the factors of both methods after stretches that count from what was there; those of other traits stay."""
    after = {method: {modulus: dict(given) for modulus, given in getattr(before, method).items()} for method in METHODS}
    for change in changes:
        given = after[change.method].setdefault(change.modulus, {})
        given |= {globe: round(given.get(globe, 1.0) * change.factor, 4) for globe in change.globes}
    return after
