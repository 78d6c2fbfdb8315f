"""The frames of a recording after the needle has gone through the wall: by its force log, its travel and readings."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scleraforce.arrays import Floats
from scleraforce.recording.folder import Recording
from scleraforce.recording.labels import contact_force, tare_samples
from scleraforce.recording.tables import ForceLog

BEFORE_S, BETWEEN_S = 0.08, 0.02  # of the levels on either side of a fall in a log; a fall is that sudden
FALL_SHARE, LEAST_FALL_N, DEVIATIONS = 0.4, 2e-3, 6.0  # of the level before; beyond the noise of a mean
LEVEL = 0.25  # of the fall: so much the levels themselves may change, or it is a slow retraction
STIFFNESS_N_M = 100.0  # of a steep wall: what the needle went back explains as much
LIFTED_N, LIFTED_S = 2e-3, 0.5  # without contact for so long, a push is over


def log_punctures(log: ForceLog, force_n: Floats, travel_m: Floats) -> list[float]:
    """Return the times of sudden falls to another level of contact, s.

    `force_n`: the contact force at each sample, tared and not filtered. `travel_m`: the needle's travel there, NaN
    where it is not known. A fall to no contact is taken for a needle that lets go.
    """
    count = max(round(BEFORE_S * log.sample_rate_hz), 2)
    gap = max(round(BETWEEN_S * log.sample_rate_hz), 1)
    noise_n = float(np.abs(np.diff(force_n)).mean()) * np.sqrt(np.pi / count) / 2.0  # of a level
    sums_n = np.concatenate([[0.0], np.cumsum(force_n)])
    means_n = (sums_n[count:] - sums_n[:-count]) / count  # of the samples from each on
    first = np.arange(count, len(force_n) - 3 * count - gap)  # of the level before
    earlier_n, before_n, after_n, later_n = (
        means_n[first + shift] for shift in (-count, 0, count + gap, 2 * count + gap)
    )
    fall_n = before_n - after_n
    half = count // 2
    back_m = np.nan_to_num(travel_m[first + half] - travel_m[first + count + gap + half])
    least_n = np.maximum(FALL_SHARE * before_n, LEAST_FALL_N) + STIFFNESS_N_M * np.maximum(back_m, 0.0)
    sudden = (fall_n >= np.maximum(least_n, DEVIATIONS * np.sqrt(2.0) * noise_n)) & (
        np.maximum(np.abs(earlier_n - before_n), np.abs(after_n - later_n)) <= LEVEL * fall_n + 2.0 * noise_n
    )
    touches = np.minimum(after_n, later_n) >= max(LIFTED_N, 3.0 * noise_n)
    found = np.flatnonzero(sudden & touches)
    runs = np.split(found, np.flatnonzero(np.diff(found) > 1) + 1) if len(found) else []
    steepest = [run[np.argmax(fall_n[run])] for run in runs]
    return [float(log.time_s[first[place] + count]) for place in steepest]


def pierced_by_log(recording: Recording) -> list[bool]:
    """Return of each frame whether the force log shows a puncture before it, in the same push."""
    times_s = np.array([frame.time_s for frame in recording.frames])
    if recording.forces is None or recording.info.force is None:
        return [False] * len(times_s)
    log, info = recording.forces.known(recording.info.force.axis), recording.info.force
    raw_n = info.contact_sign * log.force_n(info.axis)
    tared_n = raw_n - raw_n[: tare_samples(raw_n, log.sample_rate_hz)].mean()
    known = [(frame.time_s, frame.travel_m) for frame in recording.frames if frame.travel_m is not None]
    there_m = np.full(len(log.time_s), np.nan)
    if known:
        at_s, stated_m = np.array(known).T
        there_m = np.interp(log.time_s, at_s, stated_m, left=np.nan, right=np.nan)
    return after_punctures(times_s, log_punctures(log, tared_n, there_m), log.time_s, contact_force(log, info))


def after_punctures(times_s: Floats, punctures_s: Sequence[float], contact_s: Floats, contact_n: Floats) -> list[bool]:
    """Return of each frame whether a puncture lies before it, in the same push.

    `contact_n` (sample,): the contact force at `contact_s`, by which a push ends.
    """
    touching_s = contact_s[np.abs(contact_n) >= LIFTED_N]
    lifted = np.flatnonzero(np.diff(touching_s) > LIFTED_S)
    ends_s = np.append(touching_s[lifted], touching_s[-1:]) + LIFTED_S

    def within(pierced_s: float, at_s: float) -> bool:
        end_s = ends_s[ends_s > pierced_s]
        return pierced_s <= at_s and (not len(end_s) or at_s < end_s[0])

    return [any(within(pierced_s, at_s) for pierced_s in punctures_s) for at_s in times_s.tolist()]


def marked(recording: Recording, pierced: Sequence[bool]) -> Recording:
    """Return a recording with its pierced frames marked."""
    each = zip(recording.frames, pierced, strict=True)
    return replace(recording, frames=tuple(replace(entry, pierced=is_pierced) for entry, is_pierced in each))
