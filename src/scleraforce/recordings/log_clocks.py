"""Clocks of force logs: counters that overflow, stamps that repeat or step back."""

from collections.abc import Callable, Iterator

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import RecordingError

# Bits of counters, and what they count in, s.
COUNTER_BITS = (8, 10, 12, 16, 24, 31, 32)
COUNTED_S = {1e-9: "ns", 1e-6: "us", 1e-3: "ms", 1.0: "s"}
# Clocks without hours, without the day, and with the hour twice when summer time ends.
HOUR_S = 3600.0
PERIODS_S = {1.0: "a second", 60.0: "a minute", HOUR_S: "an hour", 86_400.0: "a day"}
NEAR_STEPS = 3.0  # steps between an overflow and the samples beside it
# Stamps of one tick hold several samples: 15.6 ms of Windows, a second of spreadsheets.
LONGEST_TICK_S = 1.0
# Back by no more than this, a clock was set right, or two samples were exchanged.
LONGEST_BACK_S = 0.1
MOST_BACK = 0.01  # of the samples
EVEN_TICKS = 1.5  # within which an even clock must agree with all stamps
GAP_TICKS = 8.0  # between stamps: the log has a gap


def mended_times(
    time_s: Floats, place: Callable[[int], str], tick_s: float = 1.0
) -> tuple[Floats, tuple[str, ...]]:
    """Return times that rise, and sentences on what was mended.

    Args:
        time_s: times as logged, shape (samples,).
        place: the file and line of a sample, for messages.
        tick_s: the unit that the log counts in.

    Raises:
        RecordingError: the clock steps back for no known reason.
    """
    notes: list[str] = []
    if len(time_s) < 3 or not np.isfinite(time_s).all() or (np.diff(time_s) > 0).all():
        return time_s, ()

    time_s = _without_overflow(time_s, place, tick_s, notes)
    _check_back(time_s, place)
    time_s = _rising(time_s, place, notes)

    return time_s, tuple(notes)


def _without_overflow(
    time_s: Floats, place: Callable[[int], str], tick_s: float, notes: list[str]
) -> Floats:
    steps_s = np.diff(time_s)
    forward_s = steps_s[steps_s > 0.0]
    if not len(forward_s):
        return time_s

    usual_s = float(np.median(forward_s))
    added_s = np.zeros(len(time_s))
    turns = list[tuple[int, str]]()

    for before in np.flatnonzero(steps_s < -LONGEST_BACK_S / 2).tolist():
        for period_s, words in _periods(tick_s):
            step_s = steps_s[before] + period_s
            from_zero = -period_s / 2 <= time_s[before + 1] < NEAR_STEPS * usual_s
            rises = 0.0 < step_s <= NEAR_STEPS * usual_s
            if rises and (from_zero or period_s == HOUR_S):
                added_s[before + 1 :] += period_s
                turns.append((before + 1, words))
                break

    if turns:
        first, words = turns[0]
        times = "" if len(turns) == 1 else f" {len(turns)} times"
        notes.append(
            f"{place(first)}: the clock begins anew after {words}{times}, and is"
            " counted on"
        )

    return time_s + added_s


def _periods(tick_s: float) -> Iterator[tuple[float, str]]:
    """Yield periods of clocks that begin at their least value, s, each in words."""
    for unit_s in dict.fromkeys((tick_s, *COUNTED_S)):
        name = COUNTED_S.get(unit_s, f"steps of {unit_s:g} s")
        for bits in COUNTER_BITS:
            yield 2.0**bits * unit_s, f"2^{bits} {name}"

    yield from PERIODS_S.items()


def _check_back(time_s: Floats, place: Callable[[int], str]) -> None:
    back_s = np.maximum.accumulate(time_s) - time_s
    sample = int(np.argmax(back_s > LONGEST_BACK_S))
    if back_s[sample] > LONGEST_BACK_S:
        found = f"{time_s[sample]:.12g} does not come after {time_s[sample - 1]:.12g}"
        way = (
            "the clock begins anew: give each part as a file of its own, with its"
            " header"
        )
        raise RecordingError(f"{place(sample)}: time_s: {found}; {way}")

    backwards = int((np.diff(time_s) < 0.0).sum())
    if backwards > max(MOST_BACK * len(time_s), 1.0):
        sample = int(np.argmax(np.diff(time_s) < 0.0)) + 1
        raise RecordingError(
            f"{place(sample)}: time_s: the clock steps back {backwards} times in"
            f" {len(time_s)} samples; sort the log by its time"
        )


def _rising(time_s: Floats, place: Callable[[int], str], notes: list[str]) -> Floats:
    """Return times with the samples of equal stamps spaced evenly from each stamp to
    the next.
    """
    steps_s = np.diff(time_s)
    if (steps_s > 0.0).all():
        return time_s

    highest_s = np.maximum.accumulate(time_s)
    starts = np.flatnonzero(np.diff(highest_s, prepend=-np.inf) > 0.0)
    if len(starts) < 3:
        raise RecordingError(
            f"{place(len(time_s) - 1)}: time_s: {len(starts)} different times for"
            f" {len(time_s)} samples; give a column of finer times (`columns`), or a"
            " counter of samples with its rate, like time=NAME:200Hz"
        )

    stamps_s = time_s[starts]
    counts = np.diff(np.append(starts, len(time_s)))
    tick_s = float(np.median(np.diff(stamps_s)))
    first = int(np.argmax(steps_s <= 0.0)) + 1
    several = counts > 1
    most_back_s = float(-steps_s.min())

    if np.median(counts) < 2.0:
        evened = int((counts - 1).sum())
        backwards = "" if most_back_s <= 0.0 else f" (by {1e3 * most_back_s:.3g} ms)"
        what = "repeats its stamp" if most_back_s <= 0.0 else "steps back"
        notes.append(
            f"{place(first)}: the clock {what}{backwards}: {evened} of {len(time_s)}"
            " stamps are spaced evenly between those beside them"
        )
    elif tick_s <= LONGEST_TICK_S:
        rate_hz = (len(time_s) - counts[-1]) / (stamps_s[-1] - stamps_s[0])
        notes.append(
            f"{place(first)}: {int(several.sum())} stamps are of several samples each,"
            f" {1e3 * tick_s:.4g} ms apart; the samples are spaced evenly, about"
            f" {rate_hz:.4g} a second, and may be off by {1e3 * tick_s:.4g} ms"
        )
        even_s = _even(len(time_s), starts, stamps_s, tick_s)
        if even_s is not None:
            return even_s
    else:
        raise RecordingError(
            f"{place(first)}: time_s: {counts[0]} samples have one time, and the next"
            f" comes {tick_s:g} s later; give a column of finer times (`columns`), or a"
            " counter of samples with its rate, like time=NAME:200Hz"
        )

    # from each stamp to the next, unless the log has a gap there
    usual_s = tick_s / float(np.median(counts))
    span_s = np.append(np.diff(stamps_s), usual_s * counts[-1])
    wide = span_s > np.maximum(2.0 * tick_s, 2.0 * usual_s * counts)
    span_s = np.where(wide, usual_s * counts, span_s)
    within = np.arange(len(time_s)) - np.repeat(starts, counts)

    return np.asarray(
        np.repeat(stamps_s, counts) + within * np.repeat(span_s / counts, counts)
    )


def _even(
    count: int, starts: np.ndarray, stamps_s: Floats, tick_s: float
) -> Floats | None:
    """Return an even clock that agrees with all stamps within a tick; None if there is
    none.
    """
    if len(starts) < 4 or np.diff(stamps_s).max() > GAP_TICKS * tick_s:
        return None

    # the first stamp may have lost samples, and the last may want some
    step_s, begin_s = np.polyfit(starts[1:-1], stamps_s[1:-1], 1)
    even_s = begin_s + step_s * np.arange(count)
    stamp_s = np.repeat(stamps_s, np.diff(np.append(starts, count)))
    ahead_s = even_s - stamp_s
    if np.ptp(ahead_s) > EVEN_TICKS * tick_s:
        return None

    return np.asarray(even_s - ahead_s[starts[1:-1]].min())
