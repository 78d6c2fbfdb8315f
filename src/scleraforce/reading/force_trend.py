"""The trend of the force over the last frames: its rise to the bound, and a fall that
means a pierced wall.

The slope is the median of all pairs' slopes (Theil 1950, Sen 1968), so a single outlier
does not turn it. Its standard deviation is that of a straight-line fit. Ten residuals
estimate the noise badly, now and then much too low by chance. So the noise is at least
that of the second differences, which are free of a steady rise, over all frames kept. A
fast fall that no withdrawal of the needle explains: the needle has gone through the
wall. Plain Python takes a tenth of the time of NumPy's calls for ten points, while the
robot waits.

A fall in a gap between frames is another matter: a puncture takes milliseconds, and
what was not seen cannot be told from it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from math import inf, pi, sqrt
from operator import itemgetter
from statistics import fmean, median
from typing import NamedTuple

from scleraforce.base.normal_distribution import NORMAL_MEDIAN
from scleraforce.base.units import from_si

OUTSIDE = 2  # readings on either side of a fall: a single wild one is not a fall
STEP_S = 0.008  # an interval at 100 frames a second, less its jitter
STEPS_BEFORE = 2
MISSING = 1.5  # usual intervals, between one that is there and one that is missing


@dataclass(frozen=True, kw_only=True)
class TrendLimits:
    """Limits of a trend, in SI: what counts as a rise, and what explains a fall.

    docs/monitor_decision.md explains each.
    """

    reaction_s: float = 0.05
    loss_in_row_s: float = 0.04
    rate_frames: int = 10
    rate_deviations: float = 3.0
    fall_share: float = 0.4
    fall_n: float = 2e-3
    fall_s: float = 0.03
    retraction_m_s: float = 5e-3
    stiffness_n_m: float = 100.0
    eye_m_s: float = 2e-3
    travel_lag_s: float = 0.05

    @property
    def short_gap_s(self) -> float:
        """Readings so close together leave no gap: `rate_frames` of them come within
        the reaction time, and within the longest stretch that may go unread at once.
        """
        return min(self.reaction_s, self.loss_in_row_s) / self.rate_frames


class DentForce(NamedTuple):
    """A frame's dent as its elastic force, and the needle's last stated travel, `age_s`
    before the frame, if any.
    """

    at_s: float
    force_n: float
    travel_m: float | None = None
    age_s: float = 0.0


FORCE_N = itemgetter(DentForce._fields.index("force_n"))


class ForceFall(NamedTuple):
    """A fall of the dent's force, from a level to another, within a time of which
    nothing was seen for `unseen_s`.

    `pierced`: no withdrawal can have made it; else it was not seen.
    """

    from_n: float
    to_n: float
    within_s: float
    unseen_s: float
    pierced: bool


def unexplained_fall(
    dents: tuple[DentForce, ...], limits: TrendLimits
) -> ForceFall | None:
    """Return a fall that ends with the last two dents, oldest first, and that nothing
    explains; else None.

    The level before is the lower of two neighbouring readings, the level after the
    higher of the last two, so neither a single reading nor a steady retraction passes
    for a fall. Between the inner two of these at most `fall_s` was seen, and any time
    was not: gaps. A needle that was seen all the time may have gone back at
    `retraction_m_s`, on a wall of `stiffness_n_m`. What it did in a gap is only what
    its stated travel says, or what the frames on either side show it doing.
    """
    if len(dents) < 2 * OUTSIDE:
        return None

    left_n = max(dent.force_n for dent in dents[-OUTSIDE:])
    if max(map(FORCE_N, dents)) - left_n < limits.fall_n:  # mostly; it is quick
        return None

    gap_s = _gap(dents, limits)
    unseen_s = 0.0
    looked = False  # for a step since the last gap

    for place in range(len(dents) - OUTSIDE - 1, OUTSIDE - 2, -1):
        interval_s = dents[place + 1].at_s - dents[place].at_s
        if interval_s > gap_s:
            looked |= dents[-1].at_s - dents[place + 1].at_s >= STEP_S
            unseen_s += interval_s

        within_s = dents[-OUTSIDE].at_s - dents[place].at_s
        if within_s - unseen_s > limits.fall_s:
            break

        level_n = min(dents[place - 1].force_n, dents[place].force_n)
        fall_n = level_n - left_n
        if fall_n < max(limits.fall_share * level_n, limits.fall_n):
            continue

        noise = limits.rate_deviations * noise_n(
            [dent.force_n for dent in dents[: place + 1]]
        )
        sure_n = fall_n - limits.fall_n - noise
        if sure_n >= _possible_n(dents, place, limits):
            return ForceFall(level_n, left_n, within_s, unseen_s, pierced=True)
        if looked and unseen_s and sure_n >= _shown_n(dents, place, gap_s, limits):
            return ForceFall(level_n, left_n, within_s, unseen_s, pierced=False)

    return None


def _gap(dents: tuple[DentForce, ...], limits: TrendLimits) -> float:
    """Return the time between two readings beyond which one is missing, s.

    It is one and a half times the usual one, between the time for which readings are as
    good as without a gap and the time that a fall may take.
    """
    recent = dents[-limits.rate_frames :]
    usual_s = median([later.at_s - dent.at_s for dent, later in pairwise(recent)])
    return min(max(MISSING * usual_s, limits.short_gap_s), limits.fall_s)


def _possible_n(dents: tuple[DentForce, ...], place: int, limits: TrendLimits) -> float:
    """Return how far the force can fall from the dent at a place to the last but one,
    N: by the needle's withdrawal and the eye's own motion.
    """
    high = dents[place]
    low = dents[-OUTSIDE]
    within_s = low.at_s - high.at_s
    back_m = limits.retraction_m_s * within_s

    stated_m = _stated_m(dents, place, limits)
    if stated_m is not None:
        unseen_m = limits.retraction_m_s * (high.age_s + low.age_s)
        back_m = min(back_m, stated_m + unseen_m)

    return limits.stiffness_n_m * (back_m + limits.eye_m_s * within_s)


def _stated_m(
    dents: tuple[DentForce, ...], place: int, limits: TrendLimits
) -> float | None:
    """Return how far the needle went back from the dent at a place on, by its stated
    travel; None if that is not stated.
    """
    high = dents[place]
    if high.travel_m is None or dents[-OUTSIDE].travel_m is None:
        return None

    earlier = [
        dent.travel_m
        for dent in dents[: place + 1]
        if high.at_s - dent.at_s <= limits.travel_lag_s
    ]
    before, after = (
        [there_m for there_m in places_m if there_m is not None]
        for places_m in (earlier, [dent.travel_m for dent in dents[place:]])
    )

    return max(max(before) - min(after), 0.0)


def _shown_n(
    dents: tuple[DentForce, ...], place: int, gap_s: float, limits: TrendLimits
) -> float:
    """Return how far the force fell from the dent at a place to the last but one, by
    what is stated or seen, N.

    Where frames follow each other, that is the fall that they show, as far as a
    withdrawal and the eye can make it. In a gap it is the fall that the frames on
    either side show to go on. The travel stated for the whole time, which may be a
    frame's interval old, explains as much as it says.
    """
    fastest_n_s = limits.stiffness_n_m * (limits.retraction_m_s + limits.eye_m_s)
    last = len(dents) - OUTSIDE
    shown_n = 0.0
    begun = dents[place]

    for before in range(place, last + 1):
        high = dents[before]
        took_s = dents[before + 1].at_s - high.at_s
        if before < last and took_s <= gap_s:
            continue

        seen_n = max(begun.force_n - high.force_n, 0.0)
        shown_n += min(seen_n, fastest_n_s * (high.at_s - begun.at_s))
        if before < last:
            shown_n += min(_falling_n_s(dents, before), fastest_n_s) * took_s
        begun = dents[before + 1]

    stated_m = _stated_m(dents, place, limits)
    if stated_m is None:
        return shown_n

    old_s = min(dents[place].age_s, gap_s) + min(dents[last].age_s, gap_s)
    stated_n = limits.stiffness_n_m * (stated_m + limits.retraction_m_s * old_s)
    return max(shown_n, stated_n)


def _falling_n_s(dents: tuple[DentForce, ...], before: int) -> float:
    """Return how fast the force is seen to fall on either side of the gap after the
    dent `before`, N/s: the faster of both.

    Two steps before the gap have to show it, and each step after it: a single one may
    be part of a puncture. A step takes `STEP_S` or an interval, so that noise looks
    like no withdrawal.
    """
    earlier = _steps(_apart(dents[before::-1]))[:STEPS_BEFORE]
    later = _steps(_apart(dents[before + 1 :]))
    both = len(earlier) == STEPS_BEFORE
    return max(min(earlier) if both else 0.0, min(later, default=0.0), 0.0)


def _apart(dents: Sequence[DentForce]) -> list[tuple[float, float]]:
    """Return mean times, s, and forces, N, of neighbouring dents, a step apart."""
    groups: list[list[DentForce]] = []
    for dent in dents:
        if groups and abs(dent.at_s - groups[-1][0].at_s) < STEP_S:
            groups[-1].append(dent)
        else:
            groups.append([dent])

    return [
        (fmean([one.at_s for one in group]), fmean([one.force_n for one in group]))
        for group in groups
    ]


def _steps(points: Sequence[tuple[float, float]]) -> list[float]:
    """Return how fast the force falls from each point to the next in time, N/s."""
    return [
        (force_n - next_n) / (next_s - at_s)
        for (at_s, force_n), (next_s, next_n) in pairwise(points)
    ]


def noise_n(forces_n: list[float]) -> float:
    """Return the standard deviation of readings, from their second differences, which
    are free of a steady change.

    Fewer than three show none.
    """
    bends_n = [
        abs(a - 2.0 * b + c)
        for a, b, c in zip(forces_n, forces_n[1:], forces_n[2:], strict=False)
    ]
    # a second difference has six variances
    return NORMAL_MEDIAN * median(bends_n or [0.0]) / sqrt(6.0)


LEAST_PAIRS = 4
HORIZON_S = 2.0  # of a time until the bound
ROUNDING = 1e-9
# Of the time until the bound (`python -m monitor bound`, seed 2): noise, since
# neighbouring readings err alike; relative, of the slope, since a reader's error
# changes with the dent; of the force over its upper end, at least.
ALIKE = 2.0
SLOPE_ERROR = 0.15
LEAST_SHARE = 0.5
Z90 = 1.645  # of the ends of a 90 % interval


class ForceRise(NamedTuple):
    """A straight line through the last frames, `points` (s from now, N): at `now_n`,
    rising by `slope`, N/s.

    `sd_n` is the noise of one frame; `middle_s` and `spread_s` are the mean of the
    points' times, and the square root of the sum of their squared distances from it.
    """

    points: list[tuple[float, float]]
    slope: float
    now_n: float
    sd_n: float
    middle_s: float
    spread_s: float

    @property
    def variances(self) -> tuple[float, float]:
        """Variances of the line's place in its middle, which is a median, N^2, and of
        its slope, (N/s)^2.
        """
        sd_n = ALIKE * self.sd_n
        return (
            0.5 * pi * sd_n**2 / len(self.points),
            (sd_n / self.spread_s) ** 2 + (SLOPE_ERROR * self.slope) ** 2,
        )


@dataclass(frozen=True)
class TimeToBound:
    """Time until the force reaches the bound, s, if it rises as in the last frames:
    median, ends of the 90 % interval.

    None: not within 2 s.
    """

    early_s: float
    median_s: float | None
    late_s: float | None

    def as_ms(self) -> tuple[float | None, tuple[float, float | None]]:
        """Return the median, and the interval, in ms."""
        return from_si(self.median_s, "ms"), (
            from_si(self.early_s, "ms"),
            from_si(self.late_s, "ms"),
        )


REACHED = TimeToBound(0.0, 0.0, 0.0)


def rise_of(history: Sequence[tuple[float, float]], frames: int) -> ForceRise | None:
    """Return the line through the last frames; None if fewer than `frames`, or too few
    differ in time.

    `history` has time (s) and force (N) of the last frames, oldest first.
    """
    if len(history) < frames:
        return None

    now_s = history[-1][0]
    points = [(at_s - now_s, force_n) for at_s, force_n in history[-frames:]]
    slope = _slope(points)
    if slope is None:
        return None

    offsets_n = [force_n - slope * at_s for at_s, force_n in points]
    now_n = median(offsets_n)
    off_n = median([abs(offset_n - now_n) for offset_n in offsets_n])
    sd_n = max(NORMAL_MEDIAN * off_n, noise_n([force_n for _, force_n in history]))
    middle_s = fmean([at_s for at_s, _ in points])
    spread_s = sqrt(sum((at_s - middle_s) ** 2 for at_s, _ in points))

    return ForceRise(points, slope, now_n, sd_n, middle_s, spread_s)


def risen_force(rise: ForceRise, ahead_s: float, deviations: float) -> float | None:
    """Return the force after `ahead_s` at the least slope that the frames allow; None
    if it does not rise.

    `deviations` standard deviations of the slope are subtracted from it. If the rise
    slows down, a line predicts too much; then the prediction of a parabola through the
    slopes of the two halves counts, if it is less.
    """
    least = rise.slope - deviations * rise.sd_n / rise.spread_s
    if least <= 0.0:
        return None
    slowing_n = _slowing_force(rise.points, ahead_s)
    return None if slowing_n is None else min(rise.now_n + least * ahead_s, slowing_n)


def time_to_bound(
    rise: ForceRise | None, force_n: float, upper_n: float, bound_n: float
) -> TimeToBound | None:
    """Return when the upper end of the interval reaches the bound, if it keeps its
    ratio to the rising force.

    None: not within 2 s, nor does the line say so, or the frames of the line are spread
    over more than that.
    """
    if upper_n >= bound_n:
        return REACHED
    if rise is None or -rise.points[0][0] > HORIZON_S:
        return None

    share = max(force_n / upper_n if upper_n > 0.0 else 0.0, LEAST_SHARE)
    missing_n = bound_n * share - rise.now_n - rise.slope * rise.middle_s
    early_s, median_s, late_s = (
        _reaches(rise, missing_n, deviations) for deviations in (-Z90, 0.0, Z90)
    )

    return None if early_s is None else TimeToBound(early_s, median_s, late_s)


def _reaches(rise: ForceRise, missing_n: float, deviations: float) -> float | None:
    """Return when the line less a number of its standard deviations has risen by
    `missing_n` since its middle, s.

    None: not within 2 s. With d the time from the middle of the frames, this is slope d
    - missing = z sqrt(a + b d^2), a and b the variances of the line's place and slope
    (Fieller 1954); the square of it has two roots.
    """
    a, b = rise.variances

    def beyond_n(at_s: float) -> float:
        return rise.slope * at_s - missing_n - deviations * sqrt(a + b * at_s**2)

    if beyond_n(-rise.middle_s) >= 0.0:
        return 0.0

    z = deviations**2
    slack_n = ROUNDING * abs(missing_n)
    square = rise.slope**2 - z * b
    half = rise.slope * missing_n

    under = z * (a * rise.slope**2 + b * missing_n**2 - z * a * b)
    if under < 0.0 or square == 0.0:
        return None

    roots_s = [(half + sign * sqrt(under)) / square for sign in (-1.0, 1.0)]
    ahead_s = [
        at_s + rise.middle_s
        for at_s in roots_s
        if deviations * (rise.slope * at_s - missing_n) >= -slack_n
    ]

    return min((at_s for at_s in ahead_s if 0.0 < at_s <= HORIZON_S), default=None)


def _slowing_force(points: list[tuple[float, float]], ahead_s: float) -> float | None:
    """Return the force that a slowing rise reaches within `ahead_s`, at most its top;
    infinity if it keeps its slope.

    None: it has passed its top. Times count from now, so the points have negative ones.
    """
    half = len(points) // 2 + 1
    early = _slope(points[:half])
    late = _slope(points[-half:])
    if early is None or late is None or late >= early:
        return inf

    early_s, late_s = (
        fmean([at_s for at_s, _ in part]) for part in (points[:half], points[-half:])
    )
    bend = (late - early) / (late_s - early_s)

    slope = late - bend * late_s
    if slope <= 0.0:
        return None

    now_n = median(
        [
            force_n - slope * at_s - 0.5 * bend * at_s**2
            for at_s, force_n in points[-half:]
        ]
    )
    rising_s = min(ahead_s, -slope / bend)

    return now_n + slope * rising_s + 0.5 * bend * rising_s**2


def _slope(points: list[tuple[float, float]]) -> float | None:
    """Return the median slope of all pairs; None if too few pairs differ in time."""
    slopes = [
        (later_n - earlier_n) / (later_s - earlier_s)
        for (earlier_s, earlier_n), (later_s, later_n) in combinations(points, 2)
        if later_s > earlier_s
    ]
    return median(slopes) if len(slopes) >= LEAST_PAIRS else None


DENTS = 64  # that are kept: 64 ms at 1000 a second

NOISE_WINDOWS = 5  # times the frames of the slope are kept, to estimate the noise
