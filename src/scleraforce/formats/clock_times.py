"""Dates and times of day as programs print them: year first, as in Europe or America, with AM and PM, or with names."""

import re
from collections.abc import Sequence
from datetime import date

import numpy as np
from numpy.typing import NDArray

ISO, DAY_FIRST, MONTH_FIRST, NAMED, CLOCK = "iso", "dmy", "mdy", "date", "clock"
CLOCKS = (ISO, DAY_FIRST, MONTH_FIRST, NAMED, CLOCK)
DAY_S = 86_400
EPOCH_DAY = date(1970, 1, 1).toordinal()
MONTHS = {
    name: month
    for month, names in enumerate(
        ("jan", "feb fév fev", "mar mär mrz", "apr avr", "may mai", "jun juin", "jul juil", "aug aoû aou", "sep",
         "oct okt", "nov", "dec dez déc"), start=1,
    )
    for name in names.split()
}  # fmt: skip
TIME = (
    r"(?P<hour>\d{1,2}):(?P<minute>\d\d)(:(?P<second>\d\d)([.,:](?P<fraction>\d+))?)?"
    r"\s*(?P<half>[AaPp]\.?[Mm]\.?)?\s*(?P<zone>Z|UTC|[+-]\d\d:?\d\d)?"
)
NUMBERS = r"(?P<first>\d{1,4})(?P<mark>[-/.])(?P<middle>\d{1,2})(?P=mark)(?P<last>\d{1,4})"
WORDS = (
    r"((?P<name>[^\W\d_]{3,9})\.?\s+(?P<day>\d{1,2})|(?P<day_before>\d{1,2})\.?[\s-]+(?P<name_after>[^\W\d_]{3,9})\.?)"
    r"[,\s-]+(?P<year>\d{4})"
)
MOMENT = re.compile(rf"\s*(({NUMBERS}|{WORDS})[,\s]*T?\s*)?{TIME}\s*")


def clock_of(text: str) -> str | None:
    """Return how a date or time is written, None where it is neither; "" where day and month may change places.

    >>> clock_of("2026-11-26 10:15"), clock_of("11/26/2026 10:15:30 PM"), clock_of("26.11.2026 10:15:30,25")
    ('iso', 'mdy', 'dmy')
    >>> clock_of("Nov 26, 2026, 3:04:00 PM"), clock_of("10:15:30.250"), clock_of("5/6/2026 10:15"), clock_of("1.5")
    ('date', 'clock', '', None)
    """
    found = MOMENT.fullmatch(text)
    if found is None:
        return None
    if found["name"] or found["name_after"]:
        return NAMED
    if not found["first"]:
        return CLOCK
    if len(found["first"]) == 4:
        return ISO
    if found["mark"] == "." or int(found["first"]) > 12:
        return DAY_FIRST
    return MONTH_FIRST if int(found["middle"]) > 12 else ""


def seconds_of(texts: Sequence[str], clock: str) -> NDArray[np.float64] | int:
    """Return dates and times in s since 1970, or times of day in s since the first midnight; without a zone in UTC.

    Args:
        texts: of one column.
        clock: how they are written, one of `CLOCKS`.

    Returns:
        The times (text,), or the place of the first text that is not written so.
    """
    days: dict[str, int] = {}
    time_s = np.empty(len(texts))
    for nth, text in enumerate(texts):
        found = MOMENT.fullmatch(text)
        if found is None:
            return nth
        try:
            written = text[: found.start("hour")]
            if written not in days:
                days[written] = _day(found, clock)
            time_s[nth] = days[written] * DAY_S + _of_day(found)
        except (ValueError, KeyError):
            return nth
    if clock == CLOCK:  # past midnight, the day begins anew
        time_s += DAY_S * np.concatenate([[0], np.cumsum(np.diff(time_s) < -DAY_S / 2)])
    return time_s


def _day(found: re.Match[str], clock: str) -> int:
    """Return the day since 1970.

    Raises:
        ValueError: there is no such day, or the date is written in another way.
        KeyError: there is no such month.
    """
    name = found["name"] or found["name_after"]
    if (clock == CLOCK) != (not name and not found["first"]) or (clock == NAMED) != bool(name):
        raise ValueError
    if clock == CLOCK:
        return 0
    if name:
        year, month, day = int(found["year"]), _month(name), int(found["day"] or found["day_before"])
    else:
        parts = [int(found[part]) for part in ("first", "middle", "last")]
        if (clock == ISO) != (len(found["first"]) == 4):
            raise ValueError
        year, month, day = (
            parts[place] for place in {ISO: (0, 1, 2), DAY_FIRST: (2, 1, 0), MONTH_FIRST: (2, 0, 1)}[clock]
        )
    return date(year + 2000 if year < 100 else year, month, day).toordinal() - EPOCH_DAY


def _month(name: str) -> int:
    short = name.lower()
    return next((MONTHS[short[:length]] for length in (4, 3) if short[:length] in MONTHS), 0)


def _of_day(found: re.Match[str]) -> float:
    hour, half = int(found["hour"]), found["half"]
    if half:
        if not 1 <= hour <= 12:
            raise ValueError
        hour = hour % 12 + (12 if half[0] in "pP" else 0)
    fraction = float(f"0.{found['fraction'] or 0}")
    if hour > 23 or int(found["minute"]) > 59:
        raise ValueError
    return hour * 3600 + int(found["minute"]) * 60 + int(found["second"] or 0) + fraction - _zone_s(found["zone"])


def _zone_s(zone: str | None) -> float:
    if zone is None or zone in ("Z", "UTC"):
        return 0.0
    sign = -1.0 if zone[0] == "-" else 1.0
    return sign * (int(zone[1:3]) * 3600 + int(zone[-2:]) * 60)
