"""Readings of a force sensor that are not measurements: rows that recur, stretches
without noise, and the end of the sensor's range.

Every live sensor has noise. A column is tested only if its noise exceeds its own step,
so that a quiet or coarse sensor, which repeats its few values honestly, is not
suspected. Thresholds are in the log's own noise, steps and usual repeats.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from math import pi, sqrt

import numpy as np

from scleraforce.base.arrays import Flags, Floats

LEAST_SAMPLES = 200  # fewer samples show no noise
# A sensor repeats a value honestly for less than half a second, less than twenty times
# its mean repeats, and less than five times the longest below half a second. The
# chance of twenty times the mean is 1e-7 where the noise is a third of a step.
LEAST_STILL_S = 0.5
MEAN_REPEATS = 20
USUAL_REPEATS = 5
# A live column changes by more than a step and back in more than this share of its
# changes: 0 of a quiet sensor between two steps, 0.1 where the noise is half a step.
LIVE_SHARE = 0.05
LEAST_CHANGES = 100
LARGE_CHANGE = 1.5  # steps
ROUNDING = 1e-9  # of a column's span: a sixtieth of a step of 24 bits
# From so many steps of noise on, a straight line shows a gap that a program filled.
FINE_STEPS = 20.0
STRAIGHT_STEPS = 2.5  # a line's second difference, by rounding
# A row is no measurement if it stands apart from the samples before and after by so
# many standard deviations, so often, and if most samples that stand apart are this row.
APART = 4.0
# More often than noise gives it, three times and by seven standard deviations.
OFTEN = 3.0
SURE = 7.0
LEAST_APART = 8
LEAST_APART_SHARE = 5e-4
MOST_OF_APART = 0.7
CANDIDATES = 32  # the most frequent rows of a log
NEIGHBOURS = 5  # samples whose median is the level on one side
REACH_S = 0.25  # within which they lie, as does a run of the row
LEAST_REACH = 10  # samples
# The end of a range is reached so often, and more often than the value beside it: the
# tail of live noise falls.
LEAST_TOP = 20
RAIL_STEPS = 5.0
# Where a sensor is at its end for less than this share of half a second, the mean is
# off by less than 0.05 standard deviations of its noise.
SATURATED_SHARE = 0.1
AROUND_S = 0.5
STATED_RANGE = 0.999  # of a stated range
ROUNDS = 4  # one finding may uncover another


@dataclass(frozen=True, eq=False)
class NoValue:
    """Samples (sample,) that are no measurement, and what they show, in words."""

    samples: Flags
    words: str


def no_values(
    wrench_sc: Floats, columns: tuple[str, ...], time_s: Floats, range_n: float = np.inf
) -> list[NoValue]:
    """Return the readings of a log that are no measurements, each sample once.

    Args:
        wrench_sc: forces in N and torques in N m, shape (samples, columns), NaN where
            there is none.
        columns: their names, like fz_n.
        time_s: shape (samples,), increasing.
        range_n: the stated range of the sensor's forces, infinite without one.
    """
    known: Flags = np.asarray(np.isfinite(wrench_sc).all(axis=1))
    rate_hz = 1.0 / float(np.median(np.diff(time_s)))
    found: list[NoValue] = []

    def search(by: Callable[[_Readings], Iterator[tuple[Flags, str]]]) -> None:
        places = np.flatnonzero(known)
        values_sc = wrench_sc[places] + 0.0
        readings = _Readings(values_sc, columns, time_s[places], rate_hz)

        for flags, words in by(readings):
            samples: Flags = np.zeros(len(known), dtype=np.bool_)
            samples[places[flags]] = True
            samples = samples & known
            if samples.any():
                found.append(NoValue(samples, words))
                known[samples] = False

    search(lambda readings: _at_stated_range(readings, range_n))
    for _ in range(ROUNDS):
        before = len(found)
        for by in SEARCHES:
            if known.sum() >= LEAST_SAMPLES:
                search(by)
        if len(found) == before:
            break

    return found


@dataclass(frozen=True, eq=False)
class _Readings:
    """The samples of a log that have values."""

    values_sc: Floats  # -0 is 0
    columns: tuple[str, ...]
    time_s: Floats
    rate_hz: float

    @cached_property
    def rows(self) -> "np.typing.NDArray[np.uint64]":
        """A number for each row (sample,), the same for equal rows."""
        bits = np.ascontiguousarray(self.values_sc).view(np.uint64)
        mixed = np.zeros(len(bits), dtype=np.uint64)
        for column in bits.T:
            mixed = (mixed ^ column) * np.uint64(0x9E3779B97F4A7C15)
            mixed ^= mixed >> np.uint64(29)

        return mixed

    @cached_property
    def steps(self) -> Floats:
        """The usual difference between neighbouring values of each column; 0 of a
        constant one.

        It is the median of all differences, each with the number of samples beside it:
        a word of no value lies between the sensor's own values.
        """
        steps = []
        for values in self.values_sc.T:
            levels, counts = np.unique(values, return_counts=True)
            gaps = np.diff(levels)
            some = gaps > ROUNDING * np.ptp(levels)
            weights = np.minimum(counts[1:], counts[:-1])[some]
            order = np.argsort(gaps[some])
            total = np.cumsum(weights[order])
            half = np.searchsorted(total, total[-1:].sum() / 2)
            steps.append(float(gaps[some][order][half]) if len(total) else 0.0)

        return np.array(steps)

    @cached_property
    def live(self) -> Flags:
        """Whether each column has more noise than its step."""
        return np.array(
            [
                step > 0.0 and _is_live(values, step)
                for values, step in zip(self.values_sc.T, self.steps, strict=True)
            ]
        )

    def at(self, places: np.ndarray) -> "_Readings":
        """Return the samples at places."""
        rate_hz = self.rate_hz * len(places) / len(self.time_s)
        return _Readings(
            self.values_sc[places], self.columns, self.time_s[places], rate_hz
        )

    def of(self, column: int) -> "_Readings":
        """Return one column."""
        return _Readings(
            self.values_sc[:, [column]],
            (self.columns[column],),
            self.time_s,
            self.rate_hz,
        )

    @property
    def live_forces(self) -> list[int]:
        """The live columns of forces."""
        return [
            column
            for column, name in enumerate(self.columns)
            if name.endswith("_n") and self.live[column]
        ]


def _is_live(values: Floats, step: float) -> bool:
    changes = np.diff(values)
    changes = changes[np.abs(changes) > step / 2]
    if len(changes) < LEAST_CHANGES:
        return False

    back = changes[1:] * changes[:-1] < 0.0
    large = np.abs(changes[:-1]) > LARGE_CHANGE * step

    return bool((back & large).mean() > LIVE_SHARE)


def _noise(values_sc: Floats) -> Floats:
    """Return the standard deviation of each column's noise, from second differences,
    on which even motion and a few knocks have no effect.
    """
    sizes = np.abs(np.diff(values_sc, 2, axis=0))
    usual = np.minimum(sizes, 2.0 * np.quantile(sizes, 0.9, axis=0))
    return np.asarray(usual.mean(axis=0) * sqrt(pi / 2.0) / sqrt(6.0))


def _runs(flags: Flags) -> tuple[np.ndarray, np.ndarray]:
    """Return the first places of runs of set flags, and the places after them."""
    edges = np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


def _at_stated_range(
    readings: _Readings, range_n: float
) -> Iterator[tuple[Flags, str]]:
    for column, name in enumerate(readings.columns):
        at_end = np.abs(readings.values_sc[:, column]) >= STATED_RANGE * range_n
        if name.endswith("_n") and at_end.any():
            words = f"{name} is at the end of the stated range, {range_n:g} N"
            yield at_end | _often(readings, at_end), words


def _recurring_rows(readings: _Readings) -> Iterator[tuple[Flags, str]]:
    flags, row = _recurring(readings)
    if flags.any():
        listed = ", ".join(f"{value:g}" for value in row)
        yield flags, f"the row {listed} recurs among others"


def _recurring_forces(readings: _Readings) -> Iterator[tuple[Flags, str]]:
    for column, name in enumerate(readings.columns):
        if name.endswith("_n") and len(readings.columns) > 1:
            flags, row = _recurring(readings.of(column))
            if flags.any():
                yield flags, f"{name} is {row[0]:g} again and again, among others"


def _recurring(readings: _Readings) -> tuple[Flags, Floats]:
    """Return where one row is no measurement, nowhere if all are honest, and the
    row.
    """
    run = np.cumsum(np.diff(readings.rows, prepend=readings.rows[:1]) != 0)
    if np.median(np.bincount(run)) > 1:  # a slow sensor, logged faster
        once = readings.at(np.flatnonzero(np.diff(run, prepend=-1)))
    else:
        once = readings
        run = np.arange(len(run))

    rows, first, count = np.unique(once.rows, return_index=True, return_counts=True)
    frequent = np.argsort(-count, kind="stable")[:CANDIDATES]

    for place in frequent[count[frequent] >= LEAST_APART]:
        row = once.values_sc[first[place]]
        flags = _no_measurement(once, once.rows == rows[place], row)
        if flags is not None:
            return flags[run], row  # the next round finds the next row

    return np.zeros(len(run), dtype=np.bool_), readings.values_sc[0]


def _no_measurement(readings: _Readings, is_row: Flags, row: Floats) -> Flags | None:
    """Return the places where a row is no measurement, None if it is honest.

    It is none if noise does not make it so often, or if it stands apart from its
    neighbours more often than all other samples together. It is taken for a measurement
    still where the noise around it reaches it more often than the failure does.
    """
    others_sc = readings.values_sc[~is_row]
    if len(others_sc) < LEAST_SAMPLES:
        return None

    noise = np.maximum(_noise(others_sc), readings.steps / 2)
    used = noise > 0.0
    others = others_sc[:, used] / noise[used]
    value = row[used] / noise[used]
    apart_by = APART + readings.steps[used] / noise[used]  # both are rounded

    start, stop = _runs(is_row)
    reach_s = max(REACH_S, LEAST_REACH / readings.rate_hz)
    brief = int((stop - start < reach_s * readings.rate_hz).sum())
    density = np.minimum(readings.steps[used] / noise[used] / sqrt(2.0 * pi), 1.0)
    by_chance = len(is_row) * float(np.prod(density[readings.live[used]]))
    count = int(is_row.sum())
    scatter = sqrt(by_chance * count / len(start))  # of runs, not of samples
    most = max(OFTEN * by_chance, by_chance + SURE * scatter)
    if readings.live.any() and brief >= LEAST_APART and count > most:
        return is_row

    # of a run, the number of other samples before it
    after = start - np.concatenate([[0], np.cumsum(stop - start)[:-1]])
    inner = (after >= NEIGHBOURS) & (after <= len(others) - NEIGHBOURS)
    start, stop, after = start[inner], stop[inner], after[inner]
    if not len(start):
        return None

    before, behind = _levels(others, after)
    time_s = readings.time_s[~is_row]
    near = (time_s[after + NEIGHBOURS - 1] - time_s[after - NEIGHBOURS]) < 2 * reach_s
    apart = near & _stand_apart(value[None], before, behind, apart_by)
    count = int((stop - start)[apart].sum())
    if apart.sum() < max(LEAST_APART, LEAST_APART_SHARE * len(is_row)):
        return None

    places = np.arange(NEIGHBOURS, len(others) - NEIGHBOURS)
    left, right = _levels(others, places, skipped=1)
    else_apart = int(_stand_apart(others[places], left, right, apart_by).sum())
    if apart.sum() < MOST_OF_APART * (apart.sum() + else_apart):
        return None

    far = int((np.abs(others - value) > apart_by).any(axis=1).sum())
    failing = count / max(count + far, 1)
    middle = (before + behind) / 2
    honest = np.prod(density * np.exp(-0.5 * (value - middle) ** 2), axis=1)
    every = np.prod(density) < failing  # the noise never makes this row as often
    flags = is_row.copy() if every else np.zeros_like(is_row)
    for first, last in zip(
        start[honest < failing], stop[honest < failing], strict=True
    ):
        flags[first:last] = True

    return flags


def _levels(
    values: Floats, places: np.ndarray, skipped: int = 0
) -> tuple[Floats, Floats]:
    """Return the medians of the values before places, and from them on or after."""
    reach = np.arange(NEIGHBOURS)
    before = np.median(values[places[:, None] - 1 - reach], axis=1)
    behind = np.median(
        values[np.minimum(places[:, None] + skipped + reach, len(values) - 1)], axis=1
    )
    return before, behind


def _stand_apart(
    value: Floats, before: Floats, behind: Floats, apart_by: Floats
) -> Flags:
    """Return whether values lie outside both levels, on one side, in any column."""
    below = np.minimum(before, behind) - value > apart_by
    above = value - np.maximum(before, behind) > apart_by
    return np.asarray((below | above).any(axis=1))


def _still_rows(readings: _Readings) -> Iterator[tuple[Flags, str]]:
    if readings.live.any():
        held = readings.rows[1:] == readings.rows[:-1]
        yield from _stretches(readings, held, 1, "all columns hold a value")


def _still_forces(readings: _Readings) -> Iterator[tuple[Flags, str]]:
    for column in readings.live_forces:
        values = readings.values_sc[:, column]
        step = readings.steps[column]
        name = readings.columns[column]
        held = np.abs(np.diff(values)) <= ROUNDING * np.ptp(values)
        yield from _stretches(readings, held, 1, f"{name} holds a value")

        if float(_noise(values)) > FINE_STEPS * step:
            straight = np.abs(np.diff(values, 2)) < STRAIGHT_STEPS * step
            yield from _stretches(readings, straight, 2, f"{name} is a straight line")


def _stretches(
    readings: _Readings, quiet: Flags, order: int, words: str
) -> Iterator[tuple[Flags, str]]:
    """Yield the stretches whose differences of an order are quiet for longer than
    usual.
    """
    start, stop = _runs(quiet)
    length = stop - start + order
    half_second = LEAST_STILL_S * readings.rate_hz
    short = length[length < half_second]
    left = len(readings.time_s) - int(length[length >= half_second].sum())
    repeats = left / max(left - int((short - order).sum()), 1)
    usual = int(short.max(initial=1))
    least = max(half_second, MEAN_REPEATS * repeats, USUAL_REPEATS * usual)
    long = length >= least
    if not long.any():
        return

    flags = np.zeros(len(readings.time_s), dtype=np.bool_)
    for first, last in zip(start[long], stop[long], strict=True):
        flags[first : last + order] = True

    longest_s = float(length.max()) / readings.rate_hz
    yield flags, f"{words} for up to {longest_s:.3g} s, and has noise elsewhere"


def _at_range(readings: _Readings) -> Iterator[tuple[Flags, str]]:
    for column in readings.live_forces:
        values = readings.values_sc[:, column]
        step = readings.steps[column]
        start, stop = _runs(np.abs(np.diff(values)) < step / 2)
        repeats = len(values) / max(len(values) - int((stop - start).sum()), 1)
        # a rail of fine steps is noisy by a few
        fine = float(_noise(values)) > FINE_STEPS * step
        width = (RAIL_STEPS if fine else 1.0) * step
        for sign in (1.0, -1.0):
            end = float((sign * values).max())
            below = end - sign * values
            at_end = below < width - step / 2
            beside = below[~at_end].min(initial=np.inf) if not fine else width
            next_count = int((~at_end & (below < beside + width - step / 2)).sum())
            count = int(at_end.sum())
            if count >= LEAST_TOP * repeats and count > next_count:
                said = f"{readings.columns[column]} is never beyond {sign * end:.6g} N"
                words = f"{said} and there {count} times: the end of its range"
                yield _often(readings, at_end), words


def _often(readings: _Readings, flags: Flags) -> Flags:
    """Return the samples around which a tenth of half a second is flagged."""
    reach = max(round(AROUND_S * readings.rate_hz), 1)
    total = np.cumsum(np.concatenate([[0], flags]))
    places = np.arange(len(flags))
    start = np.maximum(places - reach // 2, 0)
    stop = np.minimum(start + reach, len(flags))

    return np.asarray((total[stop] - total[start]) >= SATURATED_SHARE * (stop - start))


SEARCHES = (
    _recurring_rows,
    _recurring_forces,
    _still_rows,
    _at_range,
    _still_forces,
)
