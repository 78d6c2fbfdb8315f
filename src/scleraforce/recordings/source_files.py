"""The files of sources: those in folders, and what is left out of them."""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from scleraforce.base.errors import InputError
from scleraforce.recordings.formats.log_text import clock_of
from scleraforce.recordings.frame_and_force_tables import is_number
from scleraforce.recordings.frame_names import SUFFIX, natural_order

TEXT_NAMES = (".csv", ".txt", ".tsv", ".log", ".dat", ".lvm")
# Files that programs leave beside frames, and notes about these.
OTHER_NAMES = ("thumbs.db", "ehthumbs.db", "desktop.ini", "icon\r")
OTHER_ENDINGS = (
    *(".ini", ".db", ".lnk", ".url", ".bak", ".tmp", ".part", ".roi"),
    *(".md", ".rst", ".rtf", ".html", ".htm", ".pdf", ".odt"),
    *(".doc", ".docx", ".ppt", ".pptx"),
    *(".yaml", ".yml", ".json", ".xml", ".toml"),
    *(".py", ".pyc", ".m", ".ipynb", ".ijm", ".sh", ".bat"),
)
FOREIGN_TEXTS = (b"PK", b"\xd0\xcf\x11\xe0")  # spreadsheets with other names
NEITHER = "files that are neither frames nor forces"
OF_FRAMES = "files that name frames, such as a table for `times`"
TABLE_BYTES = 64 * 2**10  # of a text, in which a table begins
TABLE_LINES = 3  # of numbers, that make a table
MOST_NAMED = 5  # files in one note
# of files of pixels
HEADERS = {
    ".img": (".hdr",),
    ".raw": (".mhd", ".nhdr"),
    ".zraw": (".mhd",),
    ".gz": (".nhdr",),
}
BAG_MARK = "metadata.yaml"
ZARR_MARKS = ("zarr.json", ".zattrs", ".zgroup", ".zarray")


@dataclass(frozen=True)
class SourceListing:
    """Files of sources, those of them that a folder gave, and a sentence on files of
    each folder that are not read.
    """

    files: tuple[Path, ...]
    of_folders: frozenset[Path]
    notes: tuple[str, ...]


def is_whole(path: Path) -> bool:
    """Return whether a folder is one source: a ROS bag, or a Zarr store."""
    return any((path / name).exists() for name in (BAG_MARK, *ZARR_MARKS))


def listed_files(given: Sequence[Path], table: Path | None = None) -> SourceListing:
    """Return the files of sources without a table of times; of folders in the order of
    the numbers in their names.

    Raises:
        InputError: a folder without files.
    """
    found: list[Path] = []
    inside: list[Path] = []
    notes: list[str] = []
    tables = {table.resolve()} if table is not None else set[Path]()

    for path in given:
        if not path.is_dir() or is_whole(path):
            found.append(path)
            continue

        shown, left_out = _of_folder(path, tables)
        words = _words(left_out)
        if not shown:
            more = f"; it has {words}" if words else ""
            raise InputError(f"{path}: no files in this folder{more}")

        found += shown
        inside += shown
        notes += [f"{path}: left out: {words}"] if words else []

    files = [
        path
        for path in found
        if not (tables and path.resolve() in tables)
        and not any(header in found for header in _headers_of(path))
    ]
    return SourceListing(tuple(files), frozenset(inside), tuple(notes))


def files_of(given: Sequence[Path]) -> list[Path]:
    """Return the files of sources, as `listed_files` does."""
    return [*listed_files(given).files]


def _headers_of(path: Path) -> list[Path]:
    base = path.with_suffix("") if path.suffixes[-2:] == [".raw", ".gz"] else path
    return [base.with_suffix(ending) for ending in HEADERS.get(path.suffix.lower(), ())]


LeftOut = dict[str, list[str]]  # names by why


def _of_folder(folder: Path, tables: Collection[Path]) -> tuple[list[Path], LeftOut]:
    shown: list[Path] = []
    left_out: LeftOut = {}

    for path in sorted(folder.iterdir(), key=lambda path: natural_order(path.name)):
        if path.name.startswith(".") or path.name == "__MACOSX":
            continue
        if tables and path.resolve() in tables:
            continue

        if path.is_symlink() and not path.exists():
            reason = "links that lead nowhere"
        elif path.is_dir():
            count = sum(bool(SUFFIX.search(each.name)) for each in path.rglob("*"))
            reason = "folders"
            left_out.setdefault(reason, []).append(f"{path.name}: {count} frames")
            continue
        elif not path.is_file():
            shown.append(path)  # a pipe, which reading refuses
            continue
        elif why := _why_left_out(path):
            reason = why
        else:
            shown.append(path)
            continue

        left_out.setdefault(reason, []).append(path.name)

    if not shown:  # a text alone is read, and its fault named
        texts = [
            name
            for name in left_out.get(NEITHER, ())
            if name.lower().endswith(TEXT_NAMES)
        ]
        return [folder / name for name in texts], left_out

    return shown, left_out


def _why_left_out(path: Path) -> str | None:
    """Return why a file in a folder is not a source; None if it is one."""
    name = path.name.lower()
    if name in OTHER_NAMES or name.endswith(OTHER_ENDINGS):
        return NEITHER
    if not name.endswith(TEXT_NAMES):
        return None

    with path.open("rb") as file:
        head = file.read(TABLE_BYTES)
    if head.startswith(FOREIGN_TEXTS) or not head:
        return None  # reading refuses it

    lines = head.replace(b"\0", b"").decode("latin-1").splitlines()
    rows = [re.split(r"[;\t,]", line) for line in lines]
    if sum(any(SUFFIX.search(each.strip(' "')) for each in row) for row in rows) > 1:
        return OF_FRAMES
    return None if sum(map(_is_row, lines)) >= TABLE_LINES else NEITHER


def _is_row(line: str) -> bool:
    """Return whether a line has two numbers, or one beside a date or time of day."""
    numbers = sum(map(is_number, line.translate(BLANKS).split()))
    dated = any(clock_of(field) is not None for field in re.split(r"[;\t,]", line))
    return numbers > 1 or (numbers == 1 and dated)


BLANKS = str.maketrans(";\t,", "   ")


def _words(left_out: LeftOut) -> str:
    return ", ".join(
        f"{len(names)} {reason if len(names) > 1 else _one(reason)} ({_some(names)})"
        for reason, names in left_out.items()
    )


def _some(names: Sequence[str]) -> str:
    more = ", ..." if len(names) > MOST_NAMED else ""
    return f"{', '.join(names[:MOST_NAMED])}{more}"


def _one(reason: str) -> str:
    """Return a reason of several files as that of one."""
    one = {"links": "link", "lead": "leads", "folders": "folder", "files": "file"}
    one |= {"are": "is", "name": "names"}
    return " ".join(one.get(word, word) for word in reason.split())
