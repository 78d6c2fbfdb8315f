"""Read regular files whole, within the size of their kind (docs/files.md); write files
whole or not at all.
"""

import codecs
import hashlib
import os
import secrets
import shutil
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path

from scleraforce.base.errors import (
    CalibrationError,
    FrameError,
    InputError,
    ModelError,
    RecordingError,
    StudyError,
)

MIB = 2**20
# flags of Unix and of Windows
OPEN_FLAGS = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
# What editors on Windows write; UTF-32 is before UTF-16, whose mark is the beginning of
# its own.
BYTE_ORDER_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32-le",
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
    b"": "utf-8",
}
NOUNS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


@dataclass(frozen=True)
class FileKind:
    """One kind of file: its noun in messages, its largest size, a hint for a user
    without one, and the exception.
    """

    noun: str
    max_bytes: int
    hint: str
    error: type[InputError]


MODEL_HINT = (
    "a model folder has model.onnx, study.toml, card.md and model.json, and a reader's"
    " folder has library.npz as well"
)
KINDS = {
    "study": FileKind(
        "study file", MIB, "`scleraforce init DIR` writes a study file", StudyError
    ),
    "recording": FileKind(
        "recording.toml", MIB, "a recording folder has a recording.toml", RecordingError
    ),
    "frames": FileKind(
        "frames.csv", 64 * MIB, "a recording folder has a frames.csv", RecordingError
    ),
    "walls": FileKind("walls.csv", 64 * MIB, "", RecordingError),
    "forces": FileKind("forces.csv", 1024 * MIB, "", RecordingError),
    "frame": FileKind("frame", 256 * MIB, "", FrameError),
    "calibration": FileKind(
        "calibration file",
        64 * MIB,
        "`scleraforce calibrate` writes this file",
        CalibrationError,
    ),
    "model record": FileKind("model.json", MIB, MODEL_HINT, ModelError),
    "model file": FileKind("file of a model folder", 256 * MIB, MODEL_HINT, ModelError),
    "store metadata": FileKind(
        "zarr.json of a data set or library", 16 * MIB, "", InputError
    ),
    "store chunk": FileKind(
        "chunk of a data set or library", 1024 * MIB, "", InputError
    ),
    "truth": FileKind(
        "truth.json", 64 * MIB, "virtual acquisitions have it", RecordingError
    ),
    "result": FileKind("JSON result of an earlier run", 64 * MIB, "", InputError),
}


def read_bytes(path: Path, kind: FileKind) -> bytes:
    """Read a regular file."""
    hint = f"; {kind.hint}" if kind.hint else ""
    try:
        # A pipe that nobody writes to would hold up a plain open() for ever.
        descriptor = os.open(
            path, os.O_RDONLY | OPEN_FLAGS | getattr(os, "O_NONBLOCK", 0)
        )
        try:
            found = os.fstat(descriptor)
            check_regular(path, found, kind)

            with open(descriptor, "rb", closefd=False) as file:
                # one more byte tells of a file that grows meanwhile
                data = file.read(found.st_size + 1)
        finally:
            os.close(descriptor)
    except OSError as fault:
        raise kind.error(f"{path}: {fault.strerror}{hint}") from fault
    except ValueError as fault:  # a name with a null character
        raise kind.error(f"{str(path)!r}: {fault}") from fault

    if len(data) > found.st_size:
        raise kind.error(f"{path}: grows while it is read; give it when it is whole")

    return data


@contextmanager
def opened_regular(path: Path, error: type[InputError]) -> Iterator[BufferedReader]:
    """Open a regular file to read; nothing else is opened, nor waited for, whatever the
    path was a moment ago.
    """
    flags = os.O_RDONLY | OPEN_FLAGS | getattr(os, "O_NONBLOCK", 0)
    with open(path, "rb", opener=lambda name, _: os.open(name, flags)) as file:
        kind = stat.S_IFMT(os.fstat(file.fileno()).st_mode)
        if kind != stat.S_IFREG:
            raise error(
                f"{path}: {NOUNS.get(kind, 'no regular file')}; give a regular file"
            )

        yield file


def check_regular(path: Path, found: os.stat_result, kind: FileKind) -> None:
    """Check that a path is a regular file of an allowed size."""
    if not stat.S_ISREG(found.st_mode):
        raise kind.error(
            f"{path}: {NOUNS.get(stat.S_IFMT(found.st_mode), 'no regular file')}; give"
            " a regular file"
        )
    if found.st_size > kind.max_bytes:
        limit = (
            f"more than {kind.max_bytes // MIB} MiB, which is more than a {kind.noun}"
            " may have (docs/files.md)"
        )
        raise kind.error(f"{path}: {limit}")


def read_text(path: Path, kind: FileKind) -> str:
    """Read a regular file as text: UTF-8, or UTF-16 and UTF-32 with their byte order
    mark, which is left out.
    """
    data = read_bytes(path, kind)
    mark = next(filter(data.startswith, BYTE_ORDER_MARKS))
    data = data.removeprefix(mark)
    encoding = BYTE_ORDER_MARKS[mark]

    try:
        return data.decode(encoding).replace("\r\n", "\n")
    except UnicodeDecodeError as fault:
        line = data[: fault.start].count(b"\n") + 1
        byte = f"byte 0x{data[fault.start]:02x}"
        raise kind.error(
            f"{path}:{line}: not {encoding.upper()} text ({byte}); save the file as"
            " UTF-8"
        ) from fault


def hash_sources(*places: str) -> str:
    """Return the SHA-256, in hexadecimal, of source files of this package, or of all
    files below folders of it.
    """
    digest = hashlib.sha256()
    for place in (Path(__file__).parents[1] / place for place in places):
        for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            digest.update(file.read_bytes())
    return digest.hexdigest()


def write_whole(content: str | bytes, path: Path) -> None:
    """Write a file whole or not at all; one of that name is replaced."""
    with renamed_when_whole(path) as part:
        part.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def renamed_when_whole(path: Path) -> Iterator[Path]:
    """Give a temporary file beside `path`, which gets that name when it is finished,
    and is removed otherwise.

    The file is made exclusively, under an unpredictable name: a planted link is not
    followed.
    """
    part = path.with_name(f".scleraforce-{secrets.token_hex(8)}.part")
    try:
        os.close(
            os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | OPEN_FLAGS, 0o666)
        )
        yield part
        part.replace(path)
    except OSError as fault:
        raise InputError(f"{path}: {fault.strerror}") from fault
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def write_whole_folder(files: Mapping[str, bytes], folder: Path) -> None:
    """Write a folder of files, by their places in it, whole or not at all."""
    with folder_when_whole(folder) as part:
        for place, content in files.items():
            (part / place).parent.mkdir(parents=True, exist_ok=True)
            (part / place).write_bytes(content)


@contextmanager
def folder_when_whole(folder: Path) -> Iterator[Path]:
    """Give the name of a new folder beside `folder`, which gets that name when it is
    finished, else is removed.
    """
    part = folder.with_name(f".scleraforce-{secrets.token_hex(8)}.part")
    try:
        yield part
        part.rename(folder)
    except OSError as fault:
        if fault.filename is not None and not Path(fault.filename).is_relative_to(part):
            raise
        raise InputError(f"{folder}: {fault.strerror}") from fault
    finally:
        shutil.rmtree(part, ignore_errors=True)
