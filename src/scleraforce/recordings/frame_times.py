"""Tables of the times of frames, by the names of files or in the frames' order."""

import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np

from scleraforce.base.arrays import Floats, Integers
from scleraforce.base.errors import InputError
from scleraforce.recordings.formats import log_text
from scleraforce.recordings.formats.foreign_force_logs import (
    CLOCK_NAMES,
    LogColumn,
    columns_by_header,
)
from scleraforce.recordings.formats.picture_streams import PictureSource
from scleraforce.recordings.frame_and_force_tables import (
    TextTable,
    is_number,
    numbers_of,
)
from scleraforce.recordings.frame_names import SUFFIX, file_of, numbers_in, page_of

# Headers of a column with names of files, or numbers in them.
FILE_COLUMNS = re.compile(
    r"((image|frame|file|picture|b_?scan|scan|png|tiff?|dicom|bild|datei)_)*"
    r"(file_?names?|file_?path|files?|images?|img|frames?|pictures?|names?|path"
    r"|frame_?(number|no|nr|index)|image_?(number|no|nr|index)|bild|bilddatei|datei"
    r"|dateiname|fichier|nom)"
)


class _Name(NamedTuple):
    """A file's name in a table or on disk, its folders before it."""

    given: str
    parts: tuple[str, ...]
    stem: str

    @classmethod
    def of(cls, text: str) -> "_Name":
        plain = unicodedata.normalize("NFC", text.strip().strip("\"'"))
        parts = tuple(part for part in re.split(r"[\\/]+", plain.casefold()) if part)
        base = parts[-1] if parts else ""
        return cls(plain, parts, SUFFIX.sub("", base))

    def likeness(self, other: "_Name") -> tuple[int, ...]:
        """Return a key that is larger for names that have more in common."""
        shared = 0
        for mine, theirs in zip(self.parts[-2::-1], other.parts[-2::-1], strict=False):
            if mine != theirs:
                break
            shared += 1

        mine, theirs = (
            PurePosixPath(each.given.replace("\\", "/")).name for each in (self, other)
        )
        return (self.parts[-1:] == other.parts[-1:], shared, mine == theirs)


@dataclass(frozen=True, eq=False)
class TimesTable:
    """Times of frames, s, and their files' names; None: in the order of the frames."""

    path: Path
    time_s: Floats
    column: str | None
    names: tuple[str, ...] | None
    lines: tuple[int, ...]

    def times_of(self, scan: PictureSource) -> Floats | None:
        """Return the time of each frame; None if the table does not name the files.

        Raises:
            InputError: the first frame that the table does not name, or names twice.
        """
        if self.names is None:
            return None

        files = [file_of(name) for name in scan.names]
        paged = len(set(files)) < len(files)
        if paged and scan.labels is not None and self._names_some(scan.labels):
            return self._matched(scan.labels)
        if paged:
            return self._of_pages(scan.names)
        if (numbers := _whole_numbers(self.names)) is not None:
            return self._of_numbers(scan, numbers)

        return self._matched(scan.names)

    def names_some(self, scan: PictureSource) -> bool:
        """Return whether the table names one of the frames."""
        return self._names_some([*scan.names, *(scan.labels or ())])

    def _names_some(self, names: Sequence[str]) -> bool:
        listed = {_Name.of(name).stem for name in self.names or ()}
        return any(_Name.of(name).stem in listed for name in names)

    def _matched(self, names: Sequence[str]) -> Floats:
        rows_of = dict[str, list[tuple[_Name, int]]]()
        for row, name in enumerate(self.names or ()):
            entry = _Name.of(name)
            rows_of.setdefault(entry.stem, []).append((entry, row))

        return np.array([self._time_of(name, rows_of) for name in names])

    def _time_of(
        self, name: str, rows_of: Mapping[str, Sequence[tuple[_Name, int]]]
    ) -> float:
        file = _Name.of(name)
        listed = [
            (file.likeness(entry), row) for entry, row in rows_of.get(file.stem, ())
        ]
        if not listed:
            some = ", ".join((self.names or ())[:3])
            raise InputError(
                f"{self.path}: {self.column}: no row for {name}; there are {some}, ..."
            )

        most = max(likeness for likeness, _ in listed)
        rows = [row for likeness, row in listed if likeness == most]
        times_s = {float(self.time_s[row]) for row in rows}
        if len(times_s) > 1:
            lines = " and ".join(str(self.lines[row]) for row in rows[:2])
            raise InputError(
                f"{self.path}: {self.column}: {name} is in lines {lines}, with two"
                " times"
            )

        return times_s.pop()

    def _of_numbers(self, scan: PictureSource, numbers: Integers) -> Floats | None:
        """Return times by the numbers in files' names, in a column of numbers."""
        own = numbers_in(scan.names)
        if own is None:
            return None

        place = {int(number): row for row, number in enumerate(numbers)}
        missing = [nth for nth, number in enumerate(own) if int(number) not in place]
        if not missing and len(place) == len(numbers):
            return self.time_s[[place[int(number)] for number in own]]

        counts_on = all((np.diff(each) == 1).all() for each in (own, numbers))
        if counts_on and len(own) == len(numbers):
            return None  # one counts from 0, the other from 1

        name = scan.names[missing[0]] if missing else scan.names[0]
        raise InputError(
            f"{self.path}: {self.column}: no row for {name}; there are numbers"
            f" {numbers.min()} to {numbers.max()}"
        )

    def _of_pages(self, names: Sequence[str]) -> Floats | None:
        """Return times of pages: of each file's rows, or by the numbers of pages."""
        files = [file_of(name) for name in names]
        pages = [page_of(name) for name in names]
        rows_of = dict[str, list[int]]()
        for row, name in enumerate(self.names or ()):
            rows_of.setdefault(_Name.of(name).stem, []).append(row)

        rows = {file: rows_of.get(_Name.of(file).stem, []) for file in files}
        if any(rows.values()):
            for file, of_file in rows.items():
                if len(of_file) <= max(pages) and len(rows) > 1:
                    raise InputError(
                        f"{self.path}: {self.column}: {len(of_file)} rows for {file},"
                        f" which has {files.count(file)} frames"
                    )
                if len(of_file) <= max(pages):
                    return None  # of the frames that are imported

            return self.time_s[
                [rows[file][page] for file, page in zip(files, pages, strict=True)]
            ]

        numbers = _whole_numbers(self.names or ())
        if numbers is None or len(rows) > 1 or numbers.min() not in (0, 1):
            return None

        place = {int(number): row for row, number in enumerate(numbers - numbers.min())}
        if len(place) < len(numbers) or not all(page in place for page in pages):
            return None

        return self.time_s[[place[page] for page in pages]]


def _whole_numbers(texts: Sequence[str]) -> Integers | None:
    if not all(re.fullmatch(r"\s*\d{1,18}\s*", text, re.ASCII) for text in texts):
        return None
    return np.array([int(text) for text in texts], dtype=np.int64)


def read_times(path: Path) -> TimesTable:
    """Read a table of frames' times: a column of times with their unit or of dates, and
    if there is one a column of names.
    """
    text = log_text.read_log_text(path, least=1)
    time = _time_column(text)
    moments = text.column(time.name)

    if time.unit in log_text.CLOCKS:
        time_s = log_text.seconds_of(moments, time.unit)
        if isinstance(time_s, int):
            raise InputError(
                f"{text.place(time_s)}: {time.name}: {moments[time_s]!r} is not a time"
                f" ({time.unit})"
            )
    else:
        time_s = numbers_of(text, [text.names.index(time.name)])[:, 0] * time.factor

    column = _name_column(text, time.name)
    names = None if column is None else tuple(text.column(column))
    return TimesTable(path, np.asarray(time_s), column, names, text.numbers)


def _time_column(text: TextTable) -> LogColumn:
    by_header = [
        column
        for column in columns_by_header(text.names, {}, text.units)
        if column.ours == "time_s"
    ]
    named = [name for name in text.names if _plain(name) in CLOCK_NAMES]

    for name in dict.fromkeys([*(column.name for column in by_header), *named]):
        clocks = set(map(log_text.clock_of, text.column(name)))
        if None in clocks:
            continue
        if known := sorted(clock for clock in clocks if clock):
            return LogColumn("time_s", name, known[0])
        raise InputError(
            f"{text.place(0)}: {name}: {text.column(name)[0]!r}: is the day or the"
            " month first? Write dates like 2026-05-31"
        )

    if not by_header:
        listed = ", ".join(map(repr, text.names))
        raise InputError(
            f"{text.path}: no column of times with its unit, like time_s or Time (ms);"
            f" there are {listed}"
        )

    return by_header[0]


def _plain(name: str) -> str:
    bare = re.sub(r"[\[({<].*?[\])}>]", "", name)
    return re.sub(r"[\W_]+", "_", bare).strip("_").lower()


def _name_column(text: TextTable, time: str) -> str | None:
    """Return the column with names of files: most of its cells end in a format, or its
    header says so.
    """
    others = [
        name for name in text.names if name != time and text.names.count(name) == 1
    ]
    headed = [name for name in others if FILE_COLUMNS.fullmatch(_plain(name))]

    for name in (*headed, *others):
        cells = text.column(name)
        if (
            sum(bool(SUFFIX.search(cell.strip().strip("\"'"))) for cell in cells)
            > len(cells) / 2
        ):
            return name

    worded = [
        name
        for name in headed
        if not all(is_number(cell) for cell in text.column(name))
    ]
    counted = [name for name in headed if _whole_numbers(text.column(name)) is not None]
    return next(iter([*worded, *counted]), None)
