"""Names of frames: the numbers and times that they state, and whether they count on."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import PurePath

import numpy as np

from scleraforce.base.arrays import Floats, Integers
from scleraforce.recordings.formats.picture_streams import SECONDS

SUFFIX = re.compile(
    r"(\.ome)?\.(png|jpe?g|jp2|tiff?|bmp|gif|dcm|dicom|ima|npy|npz|nii(\.gz)?|nrrd|mha"
    r"|mhd|avi|mp4|mov|mkv|oct)$",
    re.IGNORECASE,
)
PAGE = re.compile(r"(.*)\[(\d+)\]")
WHOLE = re.compile(r"\d+", re.ASCII)
DECIMAL = re.compile(r"\d+(?:[.,]\d+)?", re.ASCII)
# Units of a count since 1970, by its digits; all begin in 2001.
SINCE_1970_S = {10: 1.0, 13: 1e-3, 16: 1e-6, 19: 1e-9}
EPOCH = re.compile(
    r"(?<!\d)(?P<whole>[1-9](?:\d{18}|\d{15}|\d{12}|\d{9}))"
    r"(?:\.(?P<fraction>\d+)|[_-](?P<nanoseconds>\d{9}))?(?!\d)",
    re.ASCII,
)
DATED = re.compile(
    r"(?<!\d)(?P<day>(?:19|20)\d\d(?P<mark>[-_.]?)\d\d(?P=mark)\d\d)(?:T| at |[ _.-])?"
    r"(?P<time>\d\d[-_.:h]?\d\d[-_.:m]?\d\d)(?:[.,]?(?P<fraction>\d{1,9}))?(?!\d)",
    re.ASCII | re.IGNORECASE,
)
WITH_UNIT = re.compile(
    r"(?P<whole>\d+)(?:[.,](?P<fraction>\d+))? ?"
    r"(?P<unit>seconds?|m?sec|ms|[uµ]s|ns|s)(?![^\W_])",
    re.ASCII,
)
# A number that was measured, and does not count frames.
QUANTITY = re.compile(
    r"\d[ _]?(mN|[uµμ]N|N|gf?|mg|[uµμ]m|mm|nm|k?Pa|mmHg|mbar|deg|mV|V|%)(?![A-Za-z])"
)
EVEN_SHARE = 0.25  # of the median step, by which even steps of time may differ


@dataclass(frozen=True, eq=False)
class NameTimes:
    """Times that names state, s, and the smallest step that they can state."""

    time_s: Floats
    resolution_s: float

    @property
    def even(self) -> bool:
        """Whether each time follows the one before after the same step."""
        steps_s = np.diff(self.time_s)
        middle_s = float(np.median(steps_s))
        most_s = self.resolution_s + EVEN_SHARE * abs(middle_s)
        return bool((np.abs(steps_s - middle_s) <= most_s).all() and middle_s >= 0.0)

    @property
    def counts(self) -> bool:
        """Whether each step is the smallest one, as of a counter."""
        return bool(np.isclose(np.diff(self.time_s), self.resolution_s).all())

    @property
    def fine(self) -> bool:
        """Whether even times show that no frame is missing."""
        step_s = float(np.median(np.diff(self.time_s)))
        return self.resolution_s <= EVEN_SHARE * step_s


def file_of(name: str) -> str:
    """Return the file of a page, like a.tif of a.tif[3]."""
    found = PAGE.fullmatch(name)
    return found[1] if found else name


def page_of(name: str) -> int:
    """Return the place of a page in its file, like 3 of a.tif[3]."""
    found = PAGE.fullmatch(name)
    return int(found[2]) if found else 0


def stem(name: str) -> str:
    """Return a file's name without its folder and the ending of its format.

    >>> stem("scans/10.1.png"), stem("scans/10.1"), stem("a/b.ome.tif")
    ('10.1', '10.1', 'b')
    """
    return SUFFIX.sub("", PurePath(name).name)


def times_in(names: Sequence[str], unit: str | None = None) -> NameTimes | None:
    """Return the times that all names state, or None.

    A name states a date and time (UTC), a count of s, ms, µs or ns since 1970, or a
    number beside its unit. With a `unit`, the number that changes is a time in it.

    >>> times_in(["a_20260503_142201.5", "a_20260503_142203.0"]).time_s % 60
    array([1.5, 3. ])
    >>> times_in(["10.png", "10.1.png", "10.25.png"], "s").time_s
    array([10.  , 10.1 , 10.25])
    """
    stems = [stem(name) for name in names]
    if unit is not None:
        return _in_unit(stems, SECONDS[unit])

    patterns = ((DATED, _of_date), (EPOCH, _of_epoch), (WITH_UNIT, _of_unit))
    stated = (_stated(stems, pattern, read) for pattern, read in patterns)
    return next((times for times in stated if times is not None), None)


TimeInName = tuple[float, float]  # a time and its resolution, s


def _stated(
    stems: Sequence[str],
    pattern: re.Pattern[str],
    read: Callable[[re.Match[str]], TimeInName | None],
) -> NameTimes | None:
    """Return the times of the one pattern that differs from name to name."""
    found = [[read(match) for match in pattern.finditer(text)] for text in stems]
    if len({len(moments) for moments in found}) != 1:
        return None

    columns = [each for each in zip(*found, strict=True) if len(set(each)) > 1]
    if len(columns) != 1 or None in columns[0]:
        return None

    time_s, resolution_s = np.array(columns[0], dtype=np.float64).T
    return NameTimes(time_s, float(resolution_s.max()))


def _fraction(digits: str | None) -> TimeInName:
    return (float(f"0.{digits}"), 10.0 ** -len(digits)) if digits else (0.0, 1.0)


def _of_date(found: re.Match[str]) -> TimeInName | None:
    digits = re.sub(r"\D", "", found["day"] + found["time"])
    try:
        moment = datetime.strptime(digits, "%Y%m%d%H%M%S").replace(tzinfo=UTC)
    except ValueError:
        return None

    part_s, resolution_s = _fraction(found["fraction"])
    return moment.timestamp() + part_s, resolution_s


def _of_epoch(found: re.Match[str]) -> TimeInName:
    unit_s = SINCE_1970_S[len(found["whole"])]
    part, resolution = _fraction(found["fraction"] or found["nanoseconds"])
    return (int(found["whole"]) + part) * unit_s, resolution * unit_s


def _of_unit(found: re.Match[str]) -> TimeInName:
    unit_s = SECONDS[found["unit"]]
    part, resolution = _fraction(found["fraction"])
    return (int(found["whole"]) + part) * unit_s, resolution * unit_s


def _in_unit(stems: Sequence[str], unit_s: float) -> NameTimes | None:
    for pattern in (DECIMAL, WHOLE):
        columns = _columns(stems, pattern)
        if columns is not None and len(columns) == 1:
            moments = [text.replace(",", ".").partition(".") for text in columns[0]]
            digits = max(len(part) for _, _, part in moments)
            time_s = np.array([float(f"{a}.{b}") for a, _, b in moments]) * unit_s
            return NameTimes(time_s, 10.0**-digits * unit_s)

    return None


def _columns(
    texts: Sequence[str], pattern: re.Pattern[str]
) -> list[tuple[str, ...]] | None:
    """Return the numbers that differ, each as a column; None: letters differ."""
    if len({pattern.sub("\0", text) for text in texts}) > 1:
        return None

    columns = zip(*(pattern.findall(text) for text in texts), strict=True)
    return [column for column in columns if len(set(map(float_of, column))) > 1]


def float_of(text: str) -> float:
    """Return a number with a point or a comma."""
    return float(text.replace(",", "."))


def numbers_in(names: Sequence[str]) -> Integers | None:
    """Return the number that differs from name to name, or None.

    Of several such numbers it is the one that counts by 1, else the only one that never
    repeats.

    >>> numbers_in(["eye2_0025.png", "eye2_0029.png"]), numbers_in(["a.png", "b.png"])
    (array([25, 29]), None)
    >>> numbers_in(["1_12mN.png", "2_36mN.png", "3_8mN.png"])
    array([1, 2, 3])
    """
    stems = [stem(name) for name in names]
    if len(set(stems)) < len(stems):  # files of several folders
        stems = [SUFFIX.sub("", name) for name in names]

    columns = _columns(stems, WHOLE)
    if columns is None:
        return _counted_at_an_end(stems)

    values = [np.array(list(map(int, each)), dtype=object) for each in columns]
    values = [each for each in values if max(each) < 2**63]
    counted = [each for each in values if (np.diff(each) == 1).all()]
    distinct = [each for each in values if len(set(each)) == len(each)]
    best = counted[:1] or (values if len(values) == 1 else distinct)
    return best[0].astype(np.int64) if len(best) == 1 else None


def _counted_at_an_end(stems: Sequence[str]) -> Integers | None:
    """Return the first or the last number of stems that differ elsewhere, if it counts
    by 1.
    """
    for pattern in (
        re.compile(r"^\D*(\d+)", re.ASCII),
        re.compile(r"(\d+)\D*$", re.ASCII),
    ):
        found = [pattern.search(text) for text in stems]
        numbers = [int(each[1]) for each in found if each is not None]
        if len(numbers) == len(stems) and (np.diff(numbers) == 1).all():
            return np.array(numbers, dtype=np.int64)

    return None


def are_measured(names: Sequence[str]) -> bool:
    """Return whether the number that differs in names is a force, length or the like.

    >>> are_measured(["12mN.png", "3mN.png"]), are_measured(["1_12mN.png", "2_3mN.png"])
    (True, False)
    """
    numbers = numbers_in(names)
    counted = numbers is not None and bool((np.diff(numbers) == 1).all())
    return not counted and all(QUANTITY.search(stem(name)) for name in names)


def order_fault(names: Sequence[str], rate_hz: float | None) -> str | None:
    """Return why names deny that frames follow each other in even steps, or None.

    Names without numbers say nothing about it.
    """
    if len(names) < 2 or not any(WHOLE.search(stem(name)) for name in names):
        return None

    numbers = numbers_in(names)
    counts = numbers is not None and bool((np.diff(numbers) == 1).all())
    times = times_in(names)
    if counts and times is not None and times.counts:
        return None  # "20260503_000001" may be a day and a number
    if times is not None and not times.even:
        at = _odd_step(times.time_s)
        return f"{names[at + 1]}: names state times in uneven steps; {_step(names, at)}"
    if times is not None and rate_hz is not None:
        span_s = float(times.time_s[-1] - times.time_s[0])
        expected_s = (len(names) - 1) / rate_hz
        if abs(span_s - expected_s) > times.resolution_s + 0.5 / rate_hz:
            return (
                f"{names[-1]}: names state times over {span_s:.6g} s, where"
                f" {len(names)} frames at {rate_hz:g} Hz take {expected_s:.6g} s"
            )
    if times is not None and times.fine:
        return None

    if counts:
        return None
    if numbers is None:
        return _no_number(names)

    at = int(np.argmax(np.diff(numbers) != 1))
    return f"{names[at + 1]}: does not count on: {_step(names, at)}"


def _odd_step(time_s: Floats) -> int:
    steps_s = np.diff(time_s)
    return int(np.argmax(np.abs(steps_s - np.median(steps_s))))


def _step(names: Sequence[str], at: int) -> str:
    before, after = (PurePath(name).name for name in names[at : at + 2])
    return f"{after} follows {before}"


def _no_number(names: Sequence[str]) -> str | None:
    stems = [stem(name) for name in names]
    if _columns(stems, WHOLE) is not None:
        at = len(names) - 1
        return f"{names[at]}: several numbers change in names; {_step(names, at - 1)}"

    form = WHOLE.sub("\0", stems[0])
    at = next(n for n, text in enumerate(stems) if WHOLE.sub("\0", text) != form)
    first, other = (PurePath(names[n]).name for n in (0, at))
    return f"{names[at]}: {other} and {first} are named in two ways"


def natural_order(name: str) -> list[tuple[int, str]]:
    """Return a key that sorts frame2 before frame10, and 10.png before 10.1.png."""
    parts = re.split(r"(\d+)", stem(name))
    found = [(int(part), "") if part.isdecimal() else (0, part) for part in parts]
    return [*found, (0, PurePath(name).name)]
