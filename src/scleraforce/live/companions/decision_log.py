"""The log of decisions: JSON lines with a checksum each, so that a crash at any byte
costs one record at most.

A line is `{"kind": ..., ..., "crc32": "89abcdef"}`: the checksum (zlib.crc32) is that
of the bytes before `, "crc32"`.
"""

import errno
import fcntl
import json
import os
import re
import shutil
import threading
import time
import zlib
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from scleraforce.base.units import from_si
from scleraforce.live.companions.process_channel import Channel, ChannelClosedError
from scleraforce.live.companions.process_messages import (
    Alive,
    CompanionMessage,
    Decided,
    Note,
    SelfReport,
)

FILE_BYTES = 16 * 2**20
TOTAL_BYTES = 2**30
LEAST_FREE_BYTES = 10**9
CHECK_S = 1.0
CHECK = re.compile(rb', "crc32": "([0-9a-f]{8})"\}')


@dataclass(frozen=True)
class LogPart:
    """A part of a log: a whole record, or torn or damaged bytes.

    `offset` is the place of its first byte in the file, `data` its bytes, and `record`
    its contents without the checksum; None for torn or damaged bytes.
    """

    file: Path
    offset: int
    data: bytes
    record: dict[str, Any] | None


def format_line(record: Mapping[str, Any]) -> bytes:
    """Return a line of a log."""
    body = json.dumps(record).encode()[:-1]
    return b'%s, "crc32": "%08x"}\n' % (body, zlib.crc32(body))


def read_log(path: str | PathLike[str]) -> Iterator[LogPart]:
    """Yield the parts of a log in order: of one file, or of all files of a folder.

    A changed byte costs its own record and no other, even if it was the end of a line.
    """
    path = Path(path)
    for file in _files(path) if path.is_dir() else [path]:
        offset = 0
        with file.open("rb") as lines:
            for line in lines:
                yield from _parts(file, offset, line)
                offset += len(line)


class DecisionLog:
    """Appends records to the numbered files of a folder, for one process at a time.

    A file has at most `file_bytes`; beyond `total_bytes` the oldest files are removed,
    never the newest. It raises OSError if the folder cannot be used, or another process
    uses it; so do its methods.
    """

    def __init__(
        self, folder: Path, file_bytes: int = FILE_BYTES, total_bytes: int = TOTAL_BYTES
    ) -> None:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._separator = b""
        self._folder = folder
        self._file_bytes = file_bytes
        self._total_bytes = total_bytes
        self._lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        self._turn = threading.Lock()  # another thread may sync

        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as fault:
            os.close(self._lock)
            raise OSError(
                fault.errno, "in use by another monitor", str(folder)
            ) from fault

        files = _files(folder)
        self._open(files[-1] if files else _file(folder, 1))

    def append(self, record: Mapping[str, Any]) -> bytes:
        """Append a record with one write; return its line."""
        line = format_line(record)
        if self._size and self._size + len(line) > self._file_bytes:
            with self._turn:
                self._next_file()

        written = os.write(self._descriptor, self._separator + line)
        self._size += written
        complete = written == len(self._separator) + len(line)
        self._separator = b"" if complete else b"\n"

        if not complete:
            raise OSError(errno.ENOSPC, "a record was cut", str(self._path))

        return line

    def sync(self) -> None:
        """Wait until the disk has all records; raise OSError if it fails, or the file
        was removed or replaced.
        """
        with self._turn:
            os.fdatasync(self._descriptor)
            same = os.path.samestat(self._path.stat(), os.fstat(self._descriptor))

        if not same:
            raise FileNotFoundError(
                errno.ENOENT, "replaced by another file", str(self._path)
            )

    def close(self) -> None:
        """Sync and close."""
        os.fdatasync(self._descriptor)
        os.close(self._descriptor)
        os.close(self._lock)

    def _open(self, path: Path) -> None:
        self._path = path
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o600)
        os.fchmod(self._descriptor, 0o600)  # also of a file of an earlier version
        self._size = os.fstat(self._descriptor).st_size
        torn = self._size and os.pread(self._descriptor, 1, self._size - 1) != b"\n"
        # a torn record stays, on a line of its own
        self._separator = b"\n" if torn else b""
        os.fsync(self._lock)

    def _next_file(self) -> None:
        before = self._descriptor
        self._open(_file(self._folder, _number(self._path) + 1))
        os.fdatasync(before)
        os.close(before)
        files = _files(self._folder)
        total = sum(file.stat().st_size for file in files)

        for file in files:
            if total <= self._total_bytes:  # the newest one is still empty, so it stays
                break

            total -= file.stat().st_size
            file.unlink()


def _parts(file: Path, offset: int, line: bytes) -> Iterator[LogPart]:
    """Yield the parts of a line; there are several if the end of a line was changed."""
    at = 0
    for check in CHECK.finditer(line):
        begin = next(
            (
                b
                for b in (at, at + 1)
                if zlib.crc32(line[b : check.start()]) == int(check[1], 16)
            ),
            None,
        )
        if begin is None:
            yield LogPart(file, offset + at, line[at : check.end()], None)
        else:
            if begin > at:
                yield LogPart(file, offset + at, line[at:begin], None)
            record = json.loads(line[begin : check.start()] + b"}")
            yield LogPart(file, offset + begin, line[begin : check.end()], record)

        at = check.end()

    rest = line[at:].removesuffix(b"\n")
    if rest:
        yield LogPart(file, offset + at, rest, None)


def _file(folder: Path, number: int) -> Path:
    return folder / f"decisions-{number:06d}.jsonl"


def _number(path: Path) -> int:
    return int(path.stem.removeprefix("decisions-"))


def _files(folder: Path) -> list[Path]:
    return sorted(
        (
            p
            for p in folder.glob("decisions-*.jsonl")
            if re.fullmatch(r"decisions-\d+", p.stem)
        ),
        key=_number,
    )


class Journal:
    """The log, its syncs, and the faults reported to the monitor: each once, until it
    is mended.
    """

    def __init__(self, folder: Path, channel: Channel) -> None:
        self.sync_due_s = 0.0  # on the monotonic clock
        self._log = DecisionLog(folder / "log")
        self._channel = channel
        self._folder = folder
        self._faults: dict[str, str] = {}
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="log")
        self._syncing: Future[None] | None = None

    def record(self, message: Decided | Note) -> bytes:
        """Append a message to the log; return its line, also if it could not be
        written.
        """
        if isinstance(message, Decided):
            record: dict[str, Any] = {"kind": "entry", "entry": message.entry.as_json()}
        else:
            record = {"kind": "note", "time_s": message.time_s, "text": message.text}

        try:
            line = self._log.append(record)
        except OSError as fault:
            self.fault("log", fault)
            return format_line(record)

        self.mended("log")
        return line

    def note(self, text: str) -> None:
        """Append a note of the black box itself."""
        self.record(Note(time_s=time.time(), text=text))

    def fault(self, name: str, fault: BaseException) -> None:
        """Report a fault to the monitor; note it, unless the log itself is at fault."""
        if name in self._faults:
            return
        self._faults[name] = detail = f"{name}: {fault}"
        if not name.startswith("log"):
            self.note(detail)
        self.send(SelfReport(detail=detail))

    def mended(self, name: str) -> None:
        """Forget a fault."""
        self._faults.pop(name, None)

    def has_room(self, name: str, folder: Path) -> bool:
        """Return whether the disk of a folder, which need not exist yet, has enough
        space; if not, report it.
        """
        place = next(path for path in (folder, *folder.parents) if path.exists())
        try:
            free_bytes = shutil.disk_usage(place).free
            if free_bytes < LEAST_FREE_BYTES:
                raise OSError(
                    f"{place}: {from_si(free_bytes, 'gb'):.2f} GB free; below 1 GB"
                    " nothing is kept"
                )
        except OSError as fault:
            self.fault(name, fault)
            return False

        self.mended(name)
        return True

    def sign_of_life(self) -> None:
        """Send the monitor a sign of life, with the present faults."""
        self.send(Alive(faults=tuple(self._faults.values())))

    def send(self, message: CompanionMessage) -> None:
        """Send the monitor a message, unless it has ended."""
        with suppress(ChannelClosedError):  # the black box notices it when it listens
            self._channel.send(message)

    def sync(self, now_s: float) -> None:
        """If a sync is due, check the disk and the last sync, and begin the next
        one.
        """
        if now_s < self.sync_due_s:
            return

        self.sync_due_s = now_s + CHECK_S
        if self.has_room("disk", self._folder):
            self.mended("withdrawal")  # the next one can be kept

        if self._syncing is not None:
            if not self._syncing.done():
                return

            if (fault := self._syncing.exception()) is not None:
                self.fault("log on disk", fault)
            else:
                self.mended("log on disk")

        self._syncing = self._thread.submit(self._log.sync)

    def close(self) -> None:
        """Wait for the last sync, and close the log."""
        self._thread.shutdown()
        self._log.close()
