"""The order and the times of frames: by a table, the names of files, or what these
state.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from scleraforce.base.errors import FrameError, InputError
from scleraforce.recordings.formats.picture_streams import (
    SECONDS,
    FrameTimes,
    PictureSource,
    UnansweredError,
    joined_files,
    rising,
)
from scleraforce.recordings.frame_names import (
    NameTimes,
    are_measured,
    file_of,
    natural_order,
    numbers_in,
    order_fault,
    times_in,
)
from scleraforce.recordings.frame_times import TimesTable, read_times

NUMBERS = "numbers"
TIMES = "times"
LISTED = "order"
NAMES_SOURCE = "the files' names"
WAYS = (
    f"are frames missing ({NUMBERS}), are names times ({TIMES}), or are all frames"
    f" there, evenly spaced as they are listed ({LISTED})? a table (`times`) settles"
    " it, too"
)


@dataclass(frozen=True)
class FramesBy:
    """What orders and times frames: `NUMBERS`, `TIMES` (with a unit) or `LISTED`."""

    way: str
    unit: str | None = None


def parse_frames_by(text: str | None) -> FramesBy | None:
    """Return what `frames_by` says; None without.

    >>> parse_frames_by("times:ms")
    FramesBy(way='times', unit='ms')
    """
    if text is None:
        return None

    way, colon, unit = (part.strip() for part in text.partition(":"))
    unit = unit.lower()
    known = way in (NUMBERS, TIMES, LISTED) and (
        not colon or (way == TIMES and unit in SECONDS)
    )
    if not known:
        raise InputError(
            f"`frames_by`: {text!r}; give {NUMBERS}, {LISTED}, {TIMES}, or {TIMES} with"
            f" a unit, like {TIMES}:ms"
        )

    return FramesBy(way, unit or None)


def ordered_files(
    scans: Sequence[PictureSource],
    by: FramesBy | None,
    table: Path | None,
    rate_hz: float | None,
) -> PictureSource:
    """Return files of frames as one scan, in the order and with the times of a table's
    names, else of the files' names if `by` says so, else of what they state.

    Raises:
        UnansweredError: nothing but the position of frames orders them, and their
            names or numbers deny it.
    """
    if table is not None and by is not None and by.way == TIMES:
        raise InputError(
            f"`frames_by`: {TIMES}, and `times` states when frames were taken; give one"
            " of them"
        )

    table_of = None if table is None else read_times(table)
    whole = _by_table(scans, table_of)
    if whole is not None:
        return whole

    _check_one_series(scans)
    if by is not None and by.way == TIMES:
        return _by_names(scans, by.unit, rate_hz)

    whole = joined_files(scans)
    if by is not None and by.way == NUMBERS:
        return _by_numbers(whole, scans)
    if by is None and table is None and len(whole.names) > 1:
        _check_position(whole, rate_hz)
    by_position = whole.times is None and not whole.numbers
    if by is None and table is not None and by_position:
        _check_rows(whole, table)

    return whole


def can_order(
    scans: Sequence[PictureSource],
    usual: FramesBy,
    table: Path | None,
    rate_hz: float | None,
) -> bool:
    """Return whether what orders the frames of a laboratory orders these files, and
    they do not state their times themselves.
    """
    try:
        if joined_files(scans).times is not None:
            return False
        ordered_files(scans, usual, table, rate_hz)
    except InputError:
        return False

    return True


def _by_table(
    scans: Sequence[PictureSource], table: TimesTable | None
) -> PictureSource | None:
    if table is None:
        return None

    names = tuple(name for scan in scans for name in scan.names)
    labels = scans[0].labels if len(scans) == 1 else None
    time_s = table.times_of(replace(scans[0], names=names, labels=labels))
    if time_s is None:
        return None

    ends = np.cumsum([len(scan.names) for scan in scans])
    parts = np.split(time_s, ends[:-1])
    timed = [
        replace(
            scan,
            times=FrameTimes(part, str(table.path)),
            other_times=(),
            numbers=(),
            times_fault=None,
        )
        for scan, part in zip(scans, parts, strict=True)
    ]

    whole = joined_files(timed)
    if whole.times is None and len(names) > 1:
        order = np.argsort(time_s, kind="stable")
        at = int(np.argmin(np.diff(time_s[order])))
        first, other = (names[nth] for nth in order[at : at + 2])
        raise InputError(
            f"{table.path}: {first} and {other} are both of"
            f" {time_s[order[at]]:g} s; give each frame a time of its own"
        )

    return whole


def _check_one_series(scans: Sequence[PictureSource]) -> None:
    first = next((scan for scan in scans if scan.series is not None), None)
    for scan in scans:
        if first is not None and scan.series not in (None, first.series):
            raise FrameError(
                f"{scan.names[0]}: SeriesInstanceUID is {scan.series}, where"
                f" {first.names[0]} has {first.series}: two recordings; import each"
                " alone, or name the frames of one in `times=TABLE`"
            )


def _names_of(whole: PictureSource) -> tuple[str, ...]:
    """Return the names that may order frames: of pages, or of files in their order."""
    if whole.labels is not None:
        return whole.labels
    return tuple(dict.fromkeys(map(file_of, whole.names)))


def _by_names(
    scans: Sequence[PictureSource], unit: str | None, rate_hz: float | None
) -> PictureSource:
    if rate_hz is not None:
        raise InputError(
            f"`rate_hz`: `frames_by={TIMES}` states when frames were taken; give one of"
            " them"
        )

    plain = [replace(scan, times=None, other_times=(), numbers=()) for scan in scans]
    whole = joined_files(plain)
    names = _names_of(whole)
    stated = times_in(names, unit) if len(names) == len(whole.names) else None
    if stated is None:
        way = f"give `frames_by={TIMES}:s` (or ms, us, ns)" if unit is None else _way()
        raise InputError(
            f"{whole.names[0]}: `frames_by`: no time in all names, with a date, since"
            f" 1970 or with a unit; {way}"
        )

    return _timed(whole, names, stated)


def _way() -> str:
    return "give `times=TABLE`"


def _timed(
    whole: PictureSource, names: Sequence[str], stated: NameTimes
) -> PictureSource:
    order = np.argsort(stated.time_s, kind="stable")
    time_s = stated.time_s[order]
    if not rising(time_s):
        at = int(np.argmin(np.diff(time_s)))
        first, other = (names[nth] for nth in order[at : at + 2])
        raise InputError(
            f"{first}: `frames_by`: its name states the time of {other}; remove one, or"
            " give `times=TABLE`"
        )

    moved = whole if (order == np.arange(len(order))).all() else whole.reordered(order)
    return replace(moved, times=FrameTimes(time_s, NAMES_SOURCE), times_fault=None)


def _by_numbers(whole: PictureSource, scans: Sequence[PictureSource]) -> PictureSource:
    """Return frames in the order of their numbers, as steps at a rate."""
    if whole.numbers:
        return replace(whole, times=None, steps=whole.numbers[0].values)

    names = _names_of(whole)
    pages = len(whole.names) // len(names)
    even = len(names) * pages == len(whole.names) and (
        whole.labels is not None or all(len(scan.names) == pages for scan in scans)
    )
    numbers = numbers_in(names)
    if numbers is None or not even:
        found = order_fault(names, None) or f"{names[0]}: files of unequal lengths"
        raise InputError(
            f"{found}; `frames_by={NUMBERS}` takes one number in each name"
        )

    order = np.argsort(numbers, kind="stable")
    if not (np.diff(numbers[order]) > 0).all():
        at = int(np.argmin(np.diff(numbers[order])))
        first, other = (names[nth] for nth in order[at : at + 2])
        raise InputError(f"{first}: `frames_by`: {other} has its number; remove one")

    within = np.arange(pages)
    steps = (numbers[order][:, np.newaxis] * pages + within).ravel()
    places = (order[:, np.newaxis] * pages + within).ravel()
    moved = whole if (np.diff(places) > 0).all() else whole.reordered(places)
    return replace(moved, times=None, steps=steps)


def _check_position(whole: PictureSource, rate_hz: float | None) -> None:
    """Ask about frames that only their position times, if something denies it."""
    if whole.one_moment is not None:
        raise UnansweredError(
            "frames_by",
            f"{file_of(whole.names[0])}: {whole.one_moment}: is each the next"
            f" moment ({LISTED})? Otherwise save the frames alone, as moments (t)",
        )
    if whole.times is not None:
        return

    fault = None
    if whole.numbers:
        numbers = whole.numbers[0]
        gaps = np.diff(numbers.values) != 1
        at = int(np.argmax(gaps)) + 1
        fault = (
            f"{whole.names[at]}: {numbers.source} is {numbers.values[at]} after"
            f" {numbers.values[at - 1]}"
            if gaps.any()
            else None
        )
    else:
        names = _names_of(whole)
        own_order = _listed_by_hand(names)
        fault = None if own_order else order_fault(names, rate_hz)

    if fault is not None:
        raise UnansweredError("frames_by", f"{fault}: {WAYS}")


def _check_rows(whole: PictureSource, table: Path) -> None:
    """Ask about rows without names for frames that are sorted by what was measured."""
    names = _names_of(whole)
    if (
        len(names) > 1
        and are_measured(names)
        and list(names) in (sorted(names), sorted(names, key=natural_order))
    ):
        raise UnansweredError(
            "frames_by",
            f"{table}: it has no column of files, and {names[0]} to {names[-1]} are in"
            f" the order of what was measured: are the rows, too ({LISTED})? Otherwise"
            " add a column of files",
        )


def _listed_by_hand(names: Sequence[str]) -> bool:
    """Return whether names without a number in common are in an order that no program
    sorts them in.
    """
    return numbers_in(names) is None and list(names) not in (
        sorted(names),
        sorted(names, key=natural_order),
    )
