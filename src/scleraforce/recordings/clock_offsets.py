"""The offset between the clock of a force log and that of the frames, from the dents
that the frames show.

A dent grows with the force. At the right offset the dents of all frames are a rising
function of the forces in the log; at others they are not. `estimate_clocks` tries every
offset under which enough frames lie on the log. Its measure is q, the share of the
dents' variance that no rising function of the force explains (isotonic regression,
Barlow et al. 1972). That needs no law of the dents, and stays the same while a needle
rests. Dents are smooth functions of the force, too: what no rising parabola explains is
added, as far as it is more than tissue that stiffens leaves. A frame counts little
where the force changes fast: within a ramp of the log some instant has any force.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import log

import numpy as np

from scleraforce.base.arrays import Flags, Floats, Places

LEAST_FRAMES = 6
STEP_S = 0.05  # between offsets that are tried
MOST_OFFSETS = 20_000
MOST_FRAMES = 48  # that are compared: neighbours in a film show the same
MEAN_S = 0.3  # over which the log is averaged: the filter of labels has 5 Hz
LONGEST_GAP_S = 0.5  # of the log; across a longer one nothing is interpolated
LEAST_SPAN = 1e-9  # of dents over their size: rounding is no difference
RAMP_S = 0.3  # over which a change of the force is taken
# q of frames at their own forces: 0.001 at most in virtual eyes of all figures' groups,
# 0.004 while the needle rests, where noise of the log exchanges forces that are alike
LEAST_REST = 5e-3
# Orders of the dents at random, which show how often chance gives a small q
SHUFFLES = 1000
SEED = 0
SHUFFLED = 0.01  # quantile of q among them, from which smaller ones are extrapolated
# The likelihood of an offset is the mean over so much about it: where frames lie on
# fast ramps of a log, some offset fits any dents for an instant
WITHIN_S = 0.5
# A fit is sure if another offset is as likely once in a thousand times (e^-7), and
# chance gives it, in all tries together, less than once in a hundred times (e^-5)
SURE = 7.0
BETTER = 10.0  # than the stated times, by which an offset must fit to contradict them
CHANCED = 5.0
LIKELY = 2.0  # 95 % of a normal error: chi square of one unknown over two
NEAR_S = 1.0  # offsets so near to the best ones are not another answer
# Clocks that drift: the change of the offset between first and last frame, its
# largest, and the least that matters (a tenth of a label's window)
DRIFTS_S = 6.0
DRIFT_STEP_S = 0.1
LEAST_DRIFT_S = 0.2
DRIFTS = 5.0  # gain of likelihood that shows a drift
PARTS = (2, 3, 4)  # in which frames are split to look for pauses of a clock


@dataclass(frozen=True, kw_only=True)
class ClockEstimate:
    """The log's clock minus the frames' clock, s, and how sure it is.

    All offsets from `low_s` to `high_s` fit as well (95 %). `related`: chance does not
    explain the fit. `sure`: no other offset fits nearly as well, either. `rest`: the
    share of the dents' variance that stays unexplained; `likelihood`: its logarithm as
    one. `drift_s`: how far the offset grows from the first to the last frame; 0 if it
    stays. `middle_s`, `span_s`: middle and length of the frames' times, on their own
    clock; the offset is that at the middle. `rivals_s`: other offsets that fit nearly
    as well. `parts`: if stretches of frames have offsets of their own, first and last
    frame of each, and its offset.
    """

    offset_s: float
    low_s: float
    high_s: float
    sure: bool
    related: bool
    rest: float
    likelihood: float
    drift_s: float = 0.0
    middle_s: float = 0.0
    span_s: float = 0.0
    rivals_s: tuple[float, ...] = ()
    parts: tuple[tuple[int, int, float], ...] = ()
    stated: float = -np.inf  # log likelihood of the stated times, as of one clock

    def contradicts(self) -> bool:
        """Return whether the dents show that both clocks differ."""
        far = self.likelihood - self.stated > BETTER
        return self.sure and not self.holds(0.0) and (far or self.drift_s != 0.0)

    def holds(self, offset_s: float, margin_s: float = 0.0) -> bool:
        """Return whether an offset fits as well as the best one, and others about it
        within a margin, too.
        """
        low_s = self.low_s + margin_s
        return not self.drift_s and low_s <= offset_s <= self.high_s - margin_s

    def moved(self, time_s: Floats) -> Floats:
        """Return times of frames on the log's clock, (frame,)."""
        rate = self.drift_s / self.span_s if self.span_s else 0.0
        return time_s + self.offset_s + rate * (time_s - self.middle_s)

    @property
    def words(self) -> str:
        """The estimate in words."""
        drift = (
            f"; it grows by {self.drift_s:.2g} s from the first frame to the last"
            if self.drift_s
            else ""
        )
        return (
            f"{self.offset_s:.2f} s (any of {self.low_s:.2f} to {self.high_s:.2f} s"
            f" fits the dents{drift})"
        )


def estimate_clocks(
    frame_s: Floats, dents: Floats, log_s: Floats, force_n: Floats
) -> ClockEstimate | None:
    """Estimate the clock offset at which the dents follow the forces best.

    Args:
        frame_s: times of the frames on their own clock, rising, (frame,).
        dents: measures that grow with the dent of a frame, each in a unit of its own,
            (measure, frame); NaN: not seen. The one that fits best counts.
        log_s: times of the log, rising, (sample,).
        force_n: contact force, N, positive in contact, (sample,); NaN in gaps.

    Returns:
        The estimate, or None if fewer than six frames show a dent, or all show the
        same.
    """
    found = [
        estimate
        for dent in dents
        if (estimate := _estimate(frame_s, dent, log_s, force_n)) is not None
    ]
    return max(found, key=lambda each: (each.sure, each.likelihood), default=None)


def relation(
    frame_s: Floats, dents: Floats, log_s: Floats, force_n: Floats
) -> float | None:
    """Return minus the logarithm of the probability that dents fit the log at their
    stated times by chance; None if too few can be compared.

    Arguments are those of `estimate_clocks`, times are on one clock.
    """
    found = []
    for dent in dents:
        frames = _frames(frame_s, dent, log_s, force_n)
        if frames is not None:
            likelihood = float(frames.likelihoods(frames.frame_s[None])[0][0])
            if np.isfinite(likelihood):
                found.append(frames.sureness(likelihood))

    return max(found, default=None)


def _frames(
    frame_s: Floats, dent: Floats, log_s: Floats, force_n: Floats
) -> "_Frames | None":
    seen = np.isfinite(dent)
    known = np.isfinite(force_n)
    few = seen.sum() < LEAST_FRAMES or known.sum() < 2
    if few or np.ptp(dent[seen]) <= LEAST_SPAN * np.abs(dent[seen]).max():
        return None
    return _Frames(frame_s[seen], dent[seen], _Log.of(log_s[known], force_n[known]))


def _estimate(
    frame_s: Floats, dent: Floats, log_s: Floats, force_n: Floats
) -> ClockEstimate | None:
    frames = _frames(frame_s, dent, log_s, force_n)
    if frames is None:
        return None
    found = frames.estimate()
    if found is None:
        return None

    if found.sure:
        found = frames.drifting(found)
    parts = () if found.drift_s else frames.parts()
    seen = np.flatnonzero(np.isfinite(dent))
    numbered = tuple(
        (int(seen[start]), int(seen[stop - 1]), offset_s)
        for start, stop, offset_s in parts
    )
    return replace(found, parts=numbered, sure=found.sure and not parts)


@dataclass(frozen=True, eq=False)
class _Log:
    """A smoothed log: the force and its change in `RAMP_S`, N, at each sample.

    `gap`: the log has a gap before a sample. `correlated_s`: how long the force is
    alike.
    """

    log_s: Floats
    smooth_n: Floats
    change_n: Floats
    gap: Flags
    noise_n2: float
    correlated_s: float

    @classmethod
    def of(cls, log_s: Floats, force_n: Floats) -> "_Log":
        smooth_n, noise_n2 = _smoothed(log_s, force_n)
        gap = np.append(True, np.diff(log_s) > LONGEST_GAP_S)
        correlated_s = _correlation_time_s(log_s, smooth_n)
        before_n, after_n = (
            np.interp(log_s + side * RAMP_S / 2, log_s, smooth_n) for side in (-1, 1)
        )
        change_n = np.abs(after_n - before_n)
        return cls(log_s, smooth_n, change_n, gap, noise_n2, correlated_s)

    def forces(self, at_s: Floats) -> tuple[Floats, Floats]:
        """Return forces and their change at times, N, of their shape; NaN off the log
        and in its gaps.
        """
        after = np.searchsorted(self.log_s, at_s).clip(0, len(self.log_s) - 1)
        off = (at_s < self.log_s[0]) | (at_s > self.log_s[-1])
        off |= self.gap[after] & (self.log_s[after] > at_s)
        force_n = np.interp(at_s, self.log_s, self.smooth_n)
        change_n = np.interp(at_s, self.log_s, self.change_n)
        return np.where(off, np.nan, force_n), change_n


@dataclass(frozen=True, eq=False)
class _Frames:
    """Frames that show a dent, and the log they are compared with."""

    frame_s: Floats
    dent: Floats
    log: _Log

    def likelihoods(self, at_so: Floats) -> tuple[Floats, Floats]:
        """Return log likelihood and q of frames that were taken at times (offset,
        frame), NaN where too few are on the log.

        Frames count as independent if the force forgets its past between them.
        """
        # 200 ms: Numba, not for the labels of a recording
        from scleraforce.recordings.rising_fit import unexplained

        chosen = self._chosen
        force_on, change_on = self.log.forces(at_so[:, chosen])
        noise_n = self.log.noise_n2**0.5
        rest, count = unexplained(force_on, change_on, self.dent[chosen], noise_n)
        likelihood = -0.5 * count * self._weight * np.log(np.maximum(rest, LEAST_REST))
        return likelihood, rest

    @property
    def _chosen(self) -> Places:
        count = min(len(self.frame_s), MOST_FRAMES)
        return np.linspace(0, len(self.frame_s) - 1, count).round().astype(np.intp)

    @cached_property
    def independent(self) -> Places:
        """The frames that are farther apart than the force is alike, (place,)."""
        last_s = -np.inf
        places = []
        for place in self._chosen.tolist():
            if self.frame_s[place] - last_s >= self.log.correlated_s:
                places.append(place)
                last_s = self.frame_s[place]
        return np.array(places, dtype=np.intp)

    @property
    def _weight(self) -> float:
        return len(self.independent) / len(self._chosen)

    @cached_property
    def _by_chance(self) -> float:
        """Minus the logarithm of the probability that dents in any order have a q by
        chance, over log(1/q).

        Of 10^5 orders of 8 to 16 dents it is the same for all q from 0.03 to 0.3 within
        a tenth.
        """
        from scleraforce.recordings.rising_fit import rising_rests  # likewise

        dent = self.dent[self.independent]
        if len(dent) < LEAST_FRAMES or np.ptp(dent) == 0.0:
            return 0.0

        orders = np.tile(dent, (SHUFFLES, 1))
        shuffled = np.random.default_rng(SEED).permuted(orders, axis=1)
        left = np.quantile(rising_rests(shuffled), SHUFFLED)
        rest = left / ((dent - dent.mean()) ** 2).sum()
        return log(SHUFFLED) / log(min(max(float(rest), LEAST_REST), 0.99))

    def sureness(self, likelihood: float) -> float:
        """Return minus the logarithm of the probability of a likelihood by chance."""
        count = len(self.independent)
        return 2.0 * self._by_chance * likelihood / max(count, 1)

    def estimate(self) -> ClockEstimate | None:
        """Return the best offset and its rivals; None: no offset can be judged."""
        first_s = float(self.log.log_s[0] - self.frame_s[-1])
        last_s = float(self.log.log_s[-1] - self.frame_s[0])
        count = int(np.clip((last_s - first_s) / STEP_S, 2, MOST_OFFSETS))
        offsets_s = np.linspace(first_s, last_s, count)
        blocks = np.array_split(offsets_s, -(-count // 200))
        each = [self.likelihoods(self.frame_s + block[:, None]) for block in blocks]
        likelihood, rest = (np.concatenate(part) for part in zip(*each, strict=True))
        if not np.isfinite(likelihood).any():
            return None

        step_s = float(offsets_s[1] - offsets_s[0])
        likelihood = _within(likelihood, round(WITHIN_S / step_s))
        best = int(np.nanargmax(likelihood))
        low, high = _run(likelihood >= likelihood[best] - LIKELY, best)
        outer = _run(likelihood >= likelihood[best] - SURE, best)
        rivals = _rivals(offsets_s, likelihood, best, outer)
        tries = max((last_s - first_s) / WITHIN_S, 1.0)
        low_s = float(offsets_s[low])
        high_s = float(offsets_s[high])
        related = self.sureness(float(likelihood[best])) >= log(tries) + CHANCED

        return ClockEstimate(
            offset_s=(low_s + high_s) / 2,
            low_s=low_s - step_s / 2,
            high_s=high_s + step_s / 2,
            sure=related and not rivals,
            related=related,
            likelihood=float(likelihood[best]),
            stated=float(
                np.nan_to_num(self.likelihoods(self.frame_s[None])[0][0], nan=-np.inf)
            ),
            rest=float(np.nanmin(rest[low : high + 1])),
            middle_s=float(self.frame_s[0] + self.frame_s[-1]) / 2,
            span_s=float(np.ptp(self.frame_s)),
            rivals_s=rivals,
        )

    def drifting(self, found: ClockEstimate) -> ClockEstimate:
        """Return an estimate with its drift, if the frames show one."""
        drifts_s = np.arange(-DRIFTS_S, DRIFTS_S + DRIFT_STEP_S / 2, DRIFT_STEP_S)
        reach_s = np.arange(-DRIFTS_S / 2, DRIFTS_S / 2 + STEP_S, STEP_S)
        offsets_s = found.offset_s + reach_s
        along = (self.frame_s - found.middle_s) / max(found.span_s, STEP_S)
        table = np.stack(
            [
                self.likelihoods(self.frame_s + offsets_s[:, None] + drift_s * along)[0]
                for drift_s in drifts_s.tolist()
            ]
        )
        table = np.nan_to_num(table, nan=-np.inf)
        steady = table[np.abs(drifts_s) < LEAST_DRIFT_S].max()
        if table.max() < steady + DRIFTS:
            return found

        likely = table >= table.max() - LIKELY
        of_drift = drifts_s[likely.any(axis=1)]
        of_offset = offsets_s[likely.any(axis=0)]
        return replace(
            found,
            offset_s=float(of_offset[0] + of_offset[-1]) / 2,
            low_s=float(of_offset[0]) - STEP_S / 2,
            high_s=float(of_offset[-1]) + STEP_S / 2,
            drift_s=float(of_drift[0] + of_drift[-1]) / 2,
        )

    def parts(self) -> tuple[tuple[int, int, float], ...]:
        """Return stretches of frames that are sure of offsets of their own, () if one
        offset serves all.
        """
        for count in PARTS:
            ends = np.linspace(0, len(self.frame_s), count + 1).round().astype(int)
            found = list[tuple[int, int, ClockEstimate]]()
            for start, stop in pairwise(ends.tolist()):
                dent = self.dent[start:stop]
                if stop - start < LEAST_FRAMES or np.ptp(dent) == 0.0:
                    continue
                part = replace(self, frame_s=self.frame_s[start:stop], dent=dent)
                estimate = part.estimate()
                if estimate is not None and estimate.sure:
                    found.append((start, stop, estimate))

            apart = any(
                first.high_s + NEAR_S < second.low_s
                or second.high_s + NEAR_S < first.low_s
                for (*_, first), (*_, second) in pairwise(found)
            )
            if apart:
                return tuple(
                    (start, stop, each.offset_s) for start, stop, each in found
                )

        return ()


def _within(likelihood: Floats, count: int) -> Floats:
    """Return the logarithm of the mean likelihood of `count` neighbours, NaN as 0."""
    size = max(count, 1)
    top = float(np.nanmax(likelihood))
    each = np.nan_to_num(np.exp(likelihood - top), nan=0.0)
    mean = np.convolve(each, np.full(size, 1.0 / size), "same")
    return np.log(np.maximum(mean, 1e-300)) + top


def _rivals(
    offsets_s: Floats, likelihood: Floats, best: int, outer: tuple[int, int]
) -> tuple[float, ...]:
    """Return up to three offsets beyond the run `outer` that are nearly as likely."""
    low_s = offsets_s[outer[0]] - NEAR_S
    high_s = offsets_s[outer[1]] + NEAR_S
    far = (offsets_s < low_s) | (offsets_s > high_s)
    left = np.where(far & np.isfinite(likelihood), likelihood, -np.inf)
    rivals = list[float]()

    while len(rivals) < 3 and left.max() >= likelihood[best] - SURE:
        top = int(left.argmax())
        rivals.append(float(offsets_s[top]))
        left[np.abs(offsets_s - offsets_s[top]) < NEAR_S] = -np.inf

    return tuple(rivals)


def _smoothed(log_s: Floats, force_n: Floats) -> tuple[Floats, float]:
    """Return means of `MEAN_S` about each sample, N, and the variance of their
    noise, N².
    """
    total = np.append(0.0, np.cumsum(force_n))
    start = np.searchsorted(log_s, log_s - MEAN_S / 2)
    stop = np.searchsorted(log_s, log_s + MEAN_S / 2, "right")
    mean_n = (total[stop] - total[start]) / (stop - start)
    variance_n2 = float(np.abs(np.diff(force_n)).mean()) ** 2 * np.pi / 4.0
    return mean_n, variance_n2 / float(np.median(stop - start))


def _correlation_time_s(log_s: Floats, smooth_n: Floats) -> float:
    """Return the lag at which a log is less alike itself than by a half, s."""
    count = min(len(log_s), 2**14)
    even_s = np.linspace(log_s[0], log_s[-1], count)
    values = np.interp(even_s, log_s, smooth_n)
    values = values - values.mean()
    power = np.abs(np.fft.rfft(values, 2 * count)) ** 2
    alike = np.fft.irfft(power)[:count]
    below = np.flatnonzero(alike < 0.5 * alike[0])
    lag = int(below[0]) if len(below) else count - 1
    return lag * float(even_s[1] - even_s[0])


def _run(flags: Flags, index: int) -> tuple[int, int]:
    """Return first and last index of the run of true flags about one."""
    off = np.flatnonzero(~flags)
    place = int(np.searchsorted(off, index))
    first = int(off[place - 1]) + 1 if place else 0
    last = int(off[place]) - 1 if place < len(off) else len(flags) - 1
    return first, last
