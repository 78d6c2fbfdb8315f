"""The force under each frame as the filter needs it: the label, freed of the sensor's drift.

E follows from F / E, so a zero that wanders by 1 mN in the minutes of a recording is an error of E by some percent. The
needle lets go between two frames; the quietest second there shows where zero has wandered to. Only the slope of those
zeros over time is used: the label's tare stays as it is.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.files import Recording
from scleraforce.recording.labels import Trial, contact_force

__all__ = ["FrameForces", "frame_forces", "zero_drift"]

Array = NDArray[np.float64]

QUIET_S = 1.0  # of a rest between two pushes
LEAST_RESTS = 5
LARGEST_SCATTER_N = 1e-3  # of the zeros about their line; more, and the needle did not let go between the frames
UNKNOWN_DRIFT_N_PER_S = 0.3e-3 / 60 / 3**0.5  # standard deviation where the log does not show it
ZERO_SD_N = 0.25e-3  # of the tare: 4 mN of noise over 2 s at 200 Hz
LABEL_SD_N = 0.2e-3  # of a label's mean over 2 s, the same noise


@dataclass(frozen=True)
class FrameForces:
    """Forces (frame,) in N; what is uncertain about all of them together: drift_sd times seconds since the tare."""

    force_n: Array
    since_tare_s: Array
    drift_n_per_s: float
    drift_sd_n_per_s: float


def frame_forces(recording: Recording, trials: tuple[Trial, ...]) -> FrameForces:
    """Return the forces of labelled trials, freed of drift where the log shows it.

    Trials without a label get NaN.
    """
    force_n = np.array([np.nan if trial.measured_force_n is None else trial.measured_force_n for trial in trials])
    time_s = np.array([trial.time_s for trial in trials])
    if recording.forces is None or recording.info.force is None:
        return FrameForces(force_n, np.zeros_like(time_s), 0.0, 0.0)
    log_s = recording.forces.time_s
    since_s = time_s - log_s[0]
    drift, sd = zero_drift(contact_force(recording.forces, recording.info.force), log_s, time_s)
    return FrameForces(force_n - drift * since_s, since_s, drift, sd)


def zero_drift(force_n: Array, log_s: Array, frames_s: Array) -> tuple[float, float]:
    """Return the drift of zero in N/s and its standard deviation.

    Args:
        force_n: contact force at each sample of the log, tared at its beginning.
        log_s: times of the samples.
        frames_s: times of the frames, increasing; between two of them the needle lets go.
    """
    rate_hz = 1.0 / float(np.median(np.diff(log_s)))
    length = round(QUIET_S * rate_hz)
    total = np.concatenate([[0.0], np.cumsum(force_n)])
    mean_n = (total[length:] - total[:-length]) / length
    ends = np.searchsorted(log_s, frames_s)
    rests = [_quietest(mean_n, start, end - length) for start, end in pairwise(ends)]
    where = np.array([rest for rest in rests if rest is not None], dtype=np.intp)
    if len(where) < LEAST_RESTS:
        return 0.0, UNKNOWN_DRIFT_N_PER_S
    return _line(log_s[where] + QUIET_S / 2 - log_s[0], mean_n[where])


def _quietest(mean_n: Array, start: int, end: int) -> int | None:
    return None if end <= start else start + int(mean_n[start:end].argmin())


def _line(time_s: Array, zero_n: Array) -> tuple[float, float]:
    """Return slope and its standard deviation of a line through zeros, some of which are none (Theil and Sen 1968)."""
    first, second = np.triu_indices(len(time_s), 1)
    slope = float(np.median((zero_n[second] - zero_n[first]) / (time_s[second] - time_s[first])))
    residual = zero_n - slope * time_s
    residual -= np.median(residual)
    scatter = 1.4826 * float(np.median(np.abs(residual)))
    if scatter > LARGEST_SCATTER_N:
        return 0.0, UNKNOWN_DRIFT_N_PER_S
    kept = np.abs(residual) < 3.5 * max(scatter, 0.1e-3)
    if kept.sum() < LEAST_RESTS:
        return 0.0, UNKNOWN_DRIFT_N_PER_S
    centred = time_s[kept] - time_s[kept].mean()
    slope = float(centred @ zero_n[kept] / (centred @ centred))
    rest = zero_n[kept] - zero_n[kept].mean() - slope * centred
    return slope, float(np.sqrt(rest @ rest / (kept.sum() - 2) / (centred @ centred)))
