"""Logs that end badly, and characters of other programs: what is whole is read, and the
rest is counted.
"""

import codecs
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from scleraforce.base.whole_files import BYTE_ORDER_MARKS, KINDS, read_bytes
from scleraforce.recordings.frame_and_force_tables import TextTable, field_counts

NUL = "\0"
SAMPLED_BYTES = 4096
ONE_SIDED = 0.6  # of the bytes on even or on odd places: UTF-16 without a mark
LONGEST_LETTER = 4  # bytes of UTF-8
WINDOWS = "cp1252"
MINUS = re.compile(
    "[\N{MINUS SIGN}\N{EN DASH}\N{SMALL HYPHEN-MINUS}"
    "\N{FULLWIDTH HYPHEN-MINUS}](?=[\\d.,])"
)
THOUSANDS_MARKS = (
    "'\N{RIGHT SINGLE QUOTATION MARK}\N{NO-BREAK SPACE}\N{NARROW NO-BREAK SPACE}"
    "\N{THIN SPACE}\N{FIGURE SPACE}"
)
BETWEEN_THOUSANDS = r"(?<![\d.,])(\d{{1,3}})((?:[{marks}]\d{{3}})+)(?!\d)"
# A whole cell, beside separators that are no spaces: a date has spaces as well.
SPACED_CELL = re.compile(r"(?<![^;\t\n])( *[+-]?\d{1,3})((?: \d{3})+)(?=[.,;\t\n]|$)")
BEGINS_NUMBER = "+-.0123456789\"'"
# A line that is cut, in a log of many, may stand where a program was begun anew.
FEW_LINES = 3
MOST_LINES = 0.01
SHOWN = 40  # letters of a line in a note
# What a number may be cut to.
BEGUN_NUMBER = re.compile(r"[+-]?\d*[.,]?\d*([eE][+-]?)?|[nN][aA]?")


def decoded_log(path: Path) -> tuple[str, tuple[str, ...]]:
    """Return the text of a log and sentences on how it was read: UTF-8, UTF-16 with or
    without a byte order mark, or Windows' code page; numbers with plain minus signs and
    nothing between thousands.
    """
    data = read_bytes(path, KINDS["forces"])
    text, notes = _decoded(data)
    text = text.replace("\r\n", "\n")
    filled = len(text) - len(text.rstrip(NUL))
    if filled:
        text = text.rstrip(NUL)
        notes.append(f"{filled} NUL characters at the end of {path.name} are left out")

    if not text.isascii():
        text = MINUS.sub("-", text)

    text, count = _without_thousands(text)
    if count:
        notes.append(
            f"{count} numbers of {path.name} have apostrophes or spaces between"
            " thousands"
        )

    return text, tuple(notes)


def _without_thousands(text: str) -> tuple[str, int]:
    """Return a text whose lines of numbers have nothing between thousands, and the
    number of those that had; settings above them stay as they are.
    """
    marks = "".join(mark for mark in THOUSANDS_MARKS if mark in text)
    head = text[:SAMPLED_BYTES]
    patterns = [re.compile(BETWEEN_THOUSANDS.format(marks=marks))] if marks else []
    patterns += [SPACED_CELL] if ";" in head or "\t" in head else []
    if not any(pattern.search(text) for pattern in patterns):
        return text, 0

    total = 0
    lines = text.split("\n")
    for nth, line in enumerate(lines):
        if line.lstrip()[:1] in BEGINS_NUMBER:
            for pattern in patterns:
                lines[nth], count = pattern.subn(_without_marks, lines[nth])
                total += count

    return "\n".join(lines), total


def _without_marks(found: re.Match[str]) -> str:
    return found[1] + re.sub(r"\D", "", found[2])


def _decoded(data: bytes) -> tuple[str, list[str]]:
    mark = next(filter(data.startswith, BYTE_ORDER_MARKS))
    encoding = BYTE_ORDER_MARKS[mark]
    data = data.removeprefix(mark)
    if encoding != "utf-8":
        return data.decode(encoding, errors="replace"), []

    if not mark and (wide := _without_mark(data)) is not None:
        said = f"read as {wide.upper()} without a byte order mark"
        return data[: len(data) // 2 * 2].decode(wide, errors="replace"), [said]

    bare = data.rstrip(b"\0")
    try:
        return data.decode(), []
    except UnicodeDecodeError as fault:
        if fault.start > len(bare) - LONGEST_LETTER and fault.end == len(bare):
            return data[: fault.start].decode(), []  # a letter that is cut

    return data.decode(WINDOWS, errors="replace"), [f"not UTF-8: read as {WINDOWS}"]


def _without_mark(data: bytes) -> str | None:
    sample = data[:SAMPLED_BYTES]
    half = max(len(sample) // 2, 1)
    even = sample[::2].count(0) / half
    odd = sample[1::2].count(0) / half
    if odd > ONE_SIDED and even < 1.0 - ONE_SIDED:
        return codecs.lookup("utf-16-le").name
    if even > ONE_SIDED and odd < 1.0 - ONE_SIDED:
        return codecs.lookup("utf-16-be").name

    return None


def without_broken_lines(
    table: TextTable, is_header: Callable[[str], bool], ends: bool
) -> TextTable:
    """Return a log without the lines that are no samples, and sentences on them:
    further headers, remarks, lines with NUL characters, and lines that are cut.

    `ends`: the last line ends with a line break. Lines of other counts of fields stay,
    unless they are few.
    """
    table = _without_open_quotes(table)
    counts = field_counts(table)
    some = Counter(
        count
        for count, line in zip(counts, table.lines, strict=True)
        if any(map(str.isdigit, line))
    )
    if not some:
        return table

    usual = some.most_common(1)[0][0]
    headers: list[int] = []
    remarks: list[int] = []
    short: list[int] = []

    for nth, (count, line) in enumerate(zip(counts, table.lines, strict=True)):
        if NUL in line:
            short.append(nth)
        elif is_header(line):
            headers.append(nth)
        elif _is_remark(line, count, usual, table):
            remarks.append(nth)
        elif count < usual:
            short.append(nth)

    last = len(table.lines) - 1
    if not ends and counts[last] == usual and _is_cut(table):
        short.append(last)
    if len(short) > max(FEW_LINES, MOST_LINES * len(table.lines)):
        short = []

    return _left_out(
        table,
        (headers, "a further header", "further headers"),
        (remarks, "no sample", "no samples"),
        (short, "cut", "cut"),
    )


def _without_open_quotes(table: TextTable) -> TextTable:
    opened = [nth for nth, line in enumerate(table.lines) if line.count('"') % 2]
    few = len(opened) <= max(FEW_LINES, MOST_LINES * len(table.lines))
    return _left_out(table, (opened, "cut", "cut")) if few else table


def _is_remark(line: str, count: int, usual: int, table: TextTable) -> bool:
    bare = line.strip().lstrip('"')
    if bare.startswith(("#", "%", "//")) or not any(map(str.isdigit, bare)):
        return True

    # "Samples: 200", below lines that begin with numbers
    first = table.lines[0].strip().lstrip('"')
    return count < usual and bare[:1].isalpha() and not first[:1].isalpha()


def _is_cut(table: TextTable) -> bool:
    """Return whether the last number of the last line has fewer decimals than all
    others of its column.
    """
    ends = [line.rstrip().rpartition(".")[2] for line in table.lines[-21:]]
    *before, last = [len(end) if end.isdigit() else 0 for end in ends]
    return len(set(before)) == 1 and last < before[0]


def _left_out(table: TextTable, *parts: tuple[Sequence[int], str, str]) -> TextTable:
    """Return a table without lines, and with notes on each part of them: places, and
    what one of them and several are.
    """
    left_out = {nth for lines, *_ in parts for nth in lines}
    notes = [_said(table, *part) for part in parts]
    kept = [nth for nth in range(len(table.lines)) if nth not in left_out]

    return replace(
        table,
        lines=tuple(table.lines[nth] for nth in kept),
        numbers=tuple(table.numbers[nth] for nth in kept),
        notes=(*table.notes, *filter(None, notes)),
    )


def _said(table: TextTable, lines: Sequence[int], one: str, many: str) -> str:
    if not lines:
        return ""

    text = table.lines[lines[0]].strip().replace(NUL, "")
    shown = f"{text[:SHOWN]}..." if len(text) > SHOWN else text
    place = f"{table.place(lines[0])}: {shown!r}"
    if len(lines) == 1:
        return f"1 line is {one} and is left out: {place}"
    return f"{len(lines)} lines are {many} and are left out; the first is {place}"


def without_broken_rows(
    table: TextTable,
    time: int,
    forces: Sequence[int],
    is_time: Callable[[str], bool],
    is_force: Callable[[str], bool],
) -> TextTable:
    """Return a log without the rows at its end that have no time, without those that
    have neither a time nor a force, and without a last row that is cut.

    Other faults stay, to be named.
    """
    rows = [table.fields(line) for line in range(len(table.lines))]
    cells = [
        (
            row[time] if time < len(row) else "",
            [row[at] if at < len(row) else "" for at in forces],
        )
        for row in rows
    ]
    timed = [is_time(moment) or moment.lower() == "nan" for moment, _ in cells]
    if not any(timed):
        return table

    end = len(timed) - timed[::-1].index(True)
    empty = [
        nth
        for nth, (moment, values) in enumerate(cells)
        if nth >= end or not (timed[nth] or any(map(is_force, values)))
    ]
    last = end - 1
    faults = [value for value in cells[last][1] if not is_force(value)]
    cut = [last] if any(map(BEGUN_NUMBER.fullmatch, filter(None, faults))) else []
    untimed = [
        nth
        for nth, (moment, _) in enumerate(cells[:end])
        if not moment and nth not in empty
    ]
    if len(untimed) > max(FEW_LINES, MOST_LINES * len(cells)):
        untimed = []

    return _left_out(
        table,
        (empty, "no sample", "no samples"),
        (untimed, "without a time", "without a time"),
        (cut, "cut", "cut"),
    )
