"""The force under each frame as the filter needs it: the label, freed of what is left of the sensor's zero.

E follows from F / E, so a zero that is off by 0.5 mN is an error of E by some percent. The label's tare rests on the
few seconds before the first contact and does not follow the sensor's drift. But the needle lets go between two pushes;
the rests there show the zero again and again, and a line through them corrects offset and drift.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.folder import Recording
from scleraforce.recording.labels import Trial, contact_force

Array = NDArray[np.float64]

PUSH_N = 4e-3  # a rest counts between two frames of at least this force: the needle must have let go visibly
QUIET_S = 1.0  # of a rest, for its search
SMOOTH_S = 0.4  # over which its ends are sought
EDGE_N = 2e-3  # above its quietest second a rest is over
EDGE_S = 0.3  # left out at its ends: low-pass and mean let the push leak in
FARTHEST_ZERO_N = 2e-3  # a "rest" beyond is none: the needle stayed on
REST_SD_N = 0.3e-3  # of a rest's mean: 4 mN of noise over 1 s at 200 Hz
LABEL_SD_N = 0.2e-3  # of a label's mean over 2 s, the same noise
# Before any rest is seen: offset of the tare (the same noise over 2 s) and drift, covariance (2, 2) in N and N/s.
ZERO_PRIOR = np.diag([0.25e-3**2, (0.2e-3 / 60) ** 2])


@dataclass(frozen=True)
class FrameForces:
    """Forces (frame,) in N, times since the log's beginning (frame,), and the zero that was taken off.

    `zero` (2,): offset in N and drift in N/s; `zero_covariance` (2, 2) of what is left of them in all forces alike.
    """

    force_n: Array
    since_start_s: Array
    zero: Array
    zero_covariance: Array


def frame_forces(recording: Recording, trials: tuple[Trial, ...]) -> FrameForces:
    """Return the forces of labelled trials, freed of offset and drift; NaN where there is no label."""
    force_n = np.array([np.nan if trial.measured_force_n is None else trial.measured_force_n for trial in trials])
    time_s = np.array([trial.time_s for trial in trials])
    if recording.forces is None or recording.info.force is None:
        return FrameForces(force_n, np.zeros_like(time_s), np.zeros(2), ZERO_PRIOR)
    log_s = recording.forces.time_s
    since_s = time_s - log_s[0]
    zeros = rest_zeros(contact_force(recording.forces, recording.info.force), log_s, time_s, force_n)
    zero, covariance = zero_line(*zeros)
    return FrameForces(force_n - zero[0] - zero[1] * since_s, since_s, zero, covariance)


def rest_zeros(contact_n: Array, log_s: Array, frames_s: Array, frames_n: Array) -> tuple[Array, Array]:
    """Return time since the log's beginning and mean force of every rest between two pushes, each (rest,).

    Args:
        contact_n: contact force at each sample, tared at the beginning.
        log_s: times of the samples.
        frames_s: times of the frames, increasing.
        frames_n: labels of the frames.
    """
    rate_hz = 1.0 / float(np.median(np.diff(log_s)))
    ends = np.searchsorted(log_s, frames_s)
    found = [
        _rest(contact_n[start:end], rate_hz, start)
        for (start, end), (before_n, after_n) in zip(pairwise(ends), pairwise(frames_n), strict=True)
        if min(before_n, after_n) > PUSH_N
    ]
    rests = [rest for rest in found if rest is not None and abs(rest[1]) < FARTHEST_ZERO_N]
    middle = np.array([rest[0] for rest in rests], dtype=np.intp)
    return log_s[middle] - log_s[0], np.array([rest[1] for rest in rests])


def zero_line(time_s: Array, zero_n: Array) -> tuple[Array, Array]:
    """Return offset and drift (2,) with their covariance (2, 2): a line through rests, with the tare as prior.

    The rests' own scatter counts where it is larger than expected.
    """
    design = np.stack([np.ones_like(time_s), time_s], axis=1)
    prior = np.linalg.inv(ZERO_PRIOR)
    sd = REST_SD_N
    for _ in range(2):
        covariance: Array = np.asarray(np.linalg.inv(prior + design.T @ design / sd**2), dtype=np.float64)
        line = covariance @ (design.T @ zero_n) / sd**2
        rest = zero_n - design @ line
        sd = max(REST_SD_N, float(np.sqrt(rest @ rest / max(len(rest) - 2, 1))))
    return line, covariance


def _rest(contact_n: Array, rate_hz: float, start: int) -> tuple[int, float] | None:
    """Return the middle sample of the rest between two frames, and its mean; None where there is hardly any."""
    quiet, smooth = (_running_mean(contact_n, round(span * rate_hz)) for span in (QUIET_S, SMOOTH_S))
    if len(quiet) < 2:
        return None
    middle = int(quiet.argmin()) + round(QUIET_S * rate_hz) // 2
    over = np.flatnonzero(smooth > quiet.min() + EDGE_N) + round(SMOOTH_S * rate_hz) // 2
    begin = int(over[over < middle].max(initial=-1)) + 1 + round(EDGE_S * rate_hz)
    end = int(over[over > middle].min(initial=len(contact_n))) - round(EDGE_S * rate_hz)
    if end - begin < round(QUIET_S * rate_hz) // 2:
        return None
    return start + (begin + end) // 2, float(contact_n[begin:end].mean())


def _running_mean(values: Array, length: int) -> Array:
    """Return the means of all stretches of a length, (samples - length + 1,); empty where there are too few samples."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    mean: Array = (total[length:] - total[:-length]) / length
    return mean
