"""The force under each frame as the filter needs it, and how far the label of a frame
may lie off it.

E follows from F / E, so a zero that is off by 0.5 mN is an error of E by some percent.
The needle lets go between two pushes; a line through these rests corrects the sensor's
offset and drift. The error of a label is the sum of the independent parts of
docs/calibration.md, "Error of a label".
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import pi, sqrt

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.recordings.forces_under_frames import (
    Trial,
    contact_force,
    low_pass,
    tare_samples,
)
from scleraforce.recordings.recording_folder import Recording

# a rest counts between two frames of at least this force: the needle must have let go
# visibly
PUSH_N = 4e-3
QUIET_S = 1.0  # of a rest, for its search
SMOOTH_S = 0.4  # over which its ends are sought
EDGE_N = 2e-3  # above its quietest second a rest is over
EDGE_S = 0.3  # left out at its ends: low-pass and mean let the push leak in
FARTHEST_ZERO_N = 2e-3  # of a rest: beyond it the needle stayed on
REST_SD_N = 0.3e-3  # of a rest's mean: 4 mN of noise over 1 s at 200 Hz
LABEL_SD_N = 0.2e-3  # of a label's mean over 2 s, the same noise
# Before any rest is seen: offset of the tare (the same noise over 2 s) and drift,
# covariance (2, 2) in N and N/s.
ZERO_PRIOR = np.diag([0.25e-3**2, (0.2e-3 / 60) ** 2])


@dataclass(frozen=True)
class FrameForces:
    """Forces (frame,) in N, times since the log's beginning (frame,), and the zero that
    was subtracted.

    `zero` (2,): offset in N and drift in N/s; `zero_covariance` (2, 2) of their errors,
    which all forces share.
    """

    force_n: Floats
    since_start_s: Floats
    zero: Floats
    zero_covariance: Floats


def frame_forces(recording: Recording, trials: tuple[Trial, ...]) -> FrameForces:
    """Return the forces of labelled trials, without offset and drift; NaN without a
    label.
    """
    force_n = np.array(
        [
            np.nan if trial.measured_force_n is None else trial.measured_force_n
            for trial in trials
        ]
    )
    time_s = np.array([trial.time_s for trial in trials])

    if recording.forces is None or recording.info.force is None:
        return FrameForces(force_n, np.zeros_like(time_s), np.zeros(2), ZERO_PRIOR)

    log_s = recording.forces.time_s
    since_s = time_s - log_s[0]
    zeros = rest_zeros(
        contact_force(recording.forces, recording.info.force), log_s, time_s, force_n
    )
    zero, covariance = zero_line(*zeros)

    return FrameForces(force_n - zero[0] - zero[1] * since_s, since_s, zero, covariance)


def rest_zeros(
    contact_n: Floats, log_s: Floats, frames_s: Floats, frames_n: Floats
) -> tuple[Floats, Floats]:
    """Return time since the log's beginning and mean force of every rest between two
    pushes, each (rest,).

    Of the log: contact force, tared at the beginning, and times; of the frames: times,
    increasing, and labels.
    """
    rate_hz = 1.0 / float(np.median(np.diff(log_s)))
    ends = np.searchsorted(log_s, frames_s)
    found = [
        _rest(contact_n[start:end], rate_hz, start)
        for (start, end), (before_n, after_n) in zip(
            pairwise(ends), pairwise(frames_n), strict=True
        )
        if min(before_n, after_n) > PUSH_N
    ]
    rests = [
        rest for rest in found if rest is not None and abs(rest[1]) < FARTHEST_ZERO_N
    ]
    middle = np.array([rest[0] for rest in rests], dtype=np.intp)

    return log_s[middle] - log_s[0], np.array([rest[1] for rest in rests])


def zero_line(time_s: Floats, zero_n: Floats) -> tuple[Floats, Floats]:
    """Return offset and drift (2,) with their covariance (2, 2): a line through rests,
    with the tare as prior.

    The rests' own scatter counts if it is larger than expected.
    """
    design = np.stack([np.ones_like(time_s), time_s], axis=1)
    prior = np.linalg.inv(ZERO_PRIOR)
    sd = REST_SD_N

    for _ in range(2):
        covariance: Floats = np.asarray(
            np.linalg.inv(prior + design.T @ design / sd**2), dtype=np.float64
        )
        line = covariance @ (design.T @ zero_n) / sd**2
        rest = zero_n - design @ line
        sd = max(REST_SD_N, float(np.sqrt(rest @ rest / max(len(rest) - 2, 1))))

    return line, covariance


def _rest(contact_n: Floats, rate_hz: float, start: int) -> tuple[int, float] | None:
    """Return the middle sample of the rest between two frames, and its mean; None
    without a rest.
    """
    total = np.concatenate([[0.0], np.cumsum(contact_n)])
    lengths = (round(QUIET_S * rate_hz), round(SMOOTH_S * rate_hz))

    # means of all windows
    quiet, smooth = ((total[length:] - total[:-length]) / length for length in lengths)
    if len(quiet) < 2:
        return None

    middle = int(quiet.argmin()) + round(QUIET_S * rate_hz) // 2
    over = (
        np.flatnonzero(smooth > quiet.min() + EDGE_N) + round(SMOOTH_S * rate_hz) // 2
    )
    begin = int(over[over < middle].max(initial=-1)) + 1 + round(EDGE_S * rate_hz)

    end = int(over[over > middle].min(initial=len(contact_n))) - round(EDGE_S * rate_hz)
    if end - begin < round(QUIET_S * rate_hz) // 2:
        return None

    return start + (begin + end) // 2, float(contact_n[begin:end].mean())


REST_S = 1.0  # that `REST_SD_N` is of
MEAN_S = 0.1  # of the means that the noise is taken from
LEAST_SPAN_S = 1.0  # about a frame, that a parabola is laid through
TERMS = 3  # of the parabola
MOST_FRAMES = 200  # of which the noise is taken
HARMONICS = 20  # of the quantisation
SURE = 2.0  # standard errors, beyond which motion counts
LEAST_SCALE = 1e-3  # of the noise over that of the zero's line: every sensor has noise


def label_sds(
    recording: Recording, trials: Sequence[Trial]
) -> tuple[float | None, ...]:
    """Return the standard deviation of the error of each frame's label, N; None without
    a label.
    """
    log = recording.forces
    info = recording.info.force
    labelled = [trial for trial in trials if trial.measured_force_n is not None]
    if log is None or info is None or not labelled:
        return tuple(None for _ in trials)

    every_n = info.contact_sign * log.force_n(info.axis)
    there = np.isfinite(every_n)
    log_s = log.time_s[there]
    raw_n = every_n[there]
    contact_n = contact_force(log, info)[there]
    frames_s = np.array([trial.time_s for trial in labelled])
    frames_n = np.array([trial.measured_force_n for trial in labelled])
    around = [_around(log_s, raw_n, time_s, info.average_s) for time_s in frames_s]
    densities = [
        density
        for density, *_ in around[:: max(len(around) // MOST_FRAMES, 1)]
        if np.isfinite(density)
    ]
    density = (
        float(np.median(densities))
        if densities
        else _sample_variance(raw_n) / log.sample_rate_hz
    )
    scale = max(sqrt(density / REST_S) / REST_SD_N, LEAST_SCALE)
    rests_s, rests_n = rest_zeros(contact_n, log_s, frames_s, frames_n)
    # times, too: the prior of the drift stays
    line, covariance = zero_line(rests_s / scale, rests_n / scale)
    at_frame = np.stack([np.ones_like(frames_s), (frames_s - log_s[0]) / scale], axis=1)
    zero = scale**2 * (
        (at_frame @ line) ** 2
        + np.einsum("fi,ij,fj->f", at_frame, covariance, at_frame)
    )
    tare_s = tare_samples(raw_n, log.sample_rate_hz) / log.sample_rate_hz
    tare = max(density / tare_s - scale**2 * float(ZERO_PRIOR[0, 0]), 0.0)
    noise = density * _energy(info.average_s, log.sample_rate_hz)
    shared = noise + tare + 2.0 * _quantisation(raw_n)
    motion = [
        max(motion_n**2 - (SURE * gain) ** 2 * density, 0.0)
        for _, motion_n, gain in around
    ]
    found = iter(np.sqrt(shared + zero + motion).tolist())

    return tuple(
        None if trial.measured_force_n is None else next(found) for trial in trials
    )


def _around(
    log_s: Floats, raw_n: Floats, time_s: float, average_s: float
) -> tuple[float, float, float]:
    """Fit a parabola to means of 0.1 s about a frame; return the noise's density, N^2
    s, the motion, N, and its gain.

    The density is NaN with too few samples. The motion is the difference of the mean
    over the window from the force at the frame; its standard error is the gain,
    1/sqrt(s), times the square root of the density.
    """
    half_s = max(average_s, LEAST_SPAN_S) / 2
    start, stop = np.searchsorted(log_s, [time_s - half_s, time_s + half_s])
    since_s = log_s[start:stop] - time_s
    force_n = raw_n[start:stop]
    block = np.floor((since_s + half_s) / MEAN_S).astype(np.intp)
    count = np.bincount(block)

    full = (
        count > 0.5 * np.median(count[count > 0])
        if len(count)
        else np.zeros(0, dtype=np.bool_)
    )
    if full.sum() <= TERMS:
        return np.nan, 0.0, 0.0

    mean_s, mean_n = (
        np.bincount(block, weights=values)[full] / count[full]
        for values in (since_s, force_n)
    )
    design = np.stack([np.ones_like(mean_s), mean_s, mean_s**2], axis=1)
    inverse = np.linalg.inv(design.T @ design)
    parabola = inverse @ design.T @ mean_n
    rest = mean_n - design @ parabola
    freedom = len(mean_n) - TERMS
    median = (
        1.0 - 2.0 / (9.0 * freedom)
    ) ** 3  # of a chi square over its degrees of freedom (Wilson and Hilferty)
    window_s = since_s[np.abs(since_s) <= average_s / 2]
    off = (
        np.array([0.0, window_s.mean(), (window_s**2).mean()])
        if len(window_s)
        else np.zeros(TERMS)
    )
    density = MEAN_S * float(rest @ rest) / freedom / median

    return density, float(off @ parabola), sqrt(float(off @ inverse @ off) / MEAN_S)


def _energy(average_s: float, rate_hz: float) -> float:
    """Return the energy of a label's weights, 1/s: low-pass, and mean over the
    window.
    """
    time_s = (
        np.arange(
            -round((average_s / 2 + 1.0) * rate_hz),
            round((average_s / 2 + 1.0) * rate_hz) + 1,
        )
        / rate_hz
    )
    window = np.where(np.abs(time_s) <= average_s / 2, 1.0, 0.0)
    weights = low_pass(window / window.sum(), time_s)

    return float(weights @ weights) * rate_hz


def _sample_variance(raw_n: Floats) -> float:
    """Return the variance of a sample's noise, N^2, from the differences of
    neighbours.
    """
    steps_n = np.abs(np.diff(raw_n))
    return float(steps_n.mean() ** 2 * pi / 4.0)


def _quantisation(raw_n: Floats) -> float:
    """Return the variance of the bias that the log's steps leave, N^2 (see above)."""
    levels_n = np.unique(raw_n)
    if len(levels_n) < 2:
        return 0.0

    step_n = float(np.diff(levels_n).min())
    noise = max(_sample_variance(raw_n) - step_n**2 / 12.0, 0.0)
    k = np.arange(1, HARMONICS + 1)
    return float(
        (
            (step_n / (pi * k)) ** 2
            / 2.0
            * np.exp(-((2.0 * pi * k / step_n) ** 2) * noise)
        ).sum()
    )
