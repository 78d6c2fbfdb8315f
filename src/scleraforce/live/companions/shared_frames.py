"""The last frames, in memory shared by the monitor's processes: one writes, the others
read.
"""

import mmap
import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from scleraforce.base.arrays import Bytes, Counts
from scleraforce.base.errors import InputError
from scleraforce.base.units import from_si

PROC = Path("/proc")
GROUPS = Path("/sys/fs/cgroup")
# Limit and usage of a group by its controllers; of version 2 without names.
LIMITS = {
    "": ("memory.max", "memory.current"),
    "memory": ("memory.limit_in_bytes", "memory.usage_in_bytes"),
}
# for the processes beside the monitor: models, library, what is written
SPARED_BYTES = 512 * 2**20


def available_bytes(proc: Path = PROC, groups: Path = GROUPS) -> int | None:
    """Return the least memory that the machine and the control groups of this process
    leave; None if unknown.
    """
    left = list[int]()
    with suppress(OSError, ValueError, KeyError):
        left.append(1024 * _numbers(proc / "meminfo")["MemAvailable:"])

    with suppress(OSError):
        for _, controllers, path in (
            line.split(":", 2)
            for line in (proc / "self" / "cgroup").read_text().splitlines()
        ):
            place = Path(path.strip("/"))
            for group in (place, *place.parents) if controllers in LIMITS else ():
                with suppress(OSError, ValueError):  # "max": there is no limit
                    folder = groups / controllers / group
                    most, used = (
                        int((folder / name).read_text()) for name in LIMITS[controllers]
                    )
                    cached = _numbers(folder / "memory.stat")
                    left.append(
                        most
                        - used
                        + cached.get(
                            "total_inactive_file", cached.get("inactive_file", 0)
                        )
                    )

    return max(0, min(left)) if left else None


def _numbers(file: Path) -> dict[str, int]:
    """Return the numbers of a file with one a line, behind its name."""
    return {
        words[0]: int(words[1])
        for words in map(str.split, file.read_text().splitlines())
        if words
    }


@dataclass(frozen=True, kw_only=True)
class RingPlace:
    """The place of a ring: the descriptor of its memory, its number of frames, and
    their pixels.
    """

    descriptor: int
    frames: int
    rows: int
    columns: int


class FrameRing:
    """The last `frames` frames of one size, numbered from 1; 16 bits a pixel, in a file
    without a name (Linux).

    Its maker takes all of the memory at once. Taken page by page as frames come, it
    would delay each of the first ones, and a system that runs out of memory would kill
    the process. Only the frames' numbers are mapped: pixels are read and written, so
    that the ring is in no process's resident memory. A reader that is too late for a
    frame gets None, never a part of another one.
    """

    def __init__(self, place: RingPlace) -> None:
        self.place = place
        self.frames = place.frames
        self.shape = (place.rows, place.columns)
        self._numbers = np.frombuffer(
            mmap.mmap(place.descriptor, 8 * place.frames), dtype=np.int64
        )

    @classmethod
    def create(cls, frames: int, rows: int, columns: int) -> Self:
        """Return a new ring, for `FrameRing(ring.place)` in another process; raise
        InputError if memory is short.
        """
        size = frames * (8 + 2 * rows * columns)
        available = available_bytes()
        if available is not None and size > available - SPARED_BYTES:
            raise InputError(
                f"memory: the last {frames} frames of {rows} x {columns} pixels take"
                f" {from_si(size, 'mb'):,.0f} MB and other processes"
                f" {from_si(SPARED_BYTES, 'mb'):.0f} MB;"
                f" {from_si(available, 'mb'):,.0f} MB are there; give the scanner's own"
                " `rows` and `columns`, or end other programs"
            )

        descriptor = os.memfd_create("scleraforce-frames")
        try:
            os.posix_fallocate(descriptor, 0, size)
        except OSError as fault:
            os.close(descriptor)
            raise InputError(
                f"memory: {fault.strerror} for the last {frames} frames of {rows} x"
                f" {columns} pixels, {from_si(size, 'mb'):.0f} MB; end other programs"
            ) from fault

        return cls(
            RingPlace(descriptor=descriptor, frames=frames, rows=rows, columns=columns)
        )

    def put(self, number: int, pixels: Bytes | Counts) -> None:
        """Keep a frame (row, column) in place of the oldest one."""
        if pixels.shape != self.shape:  # NumPy would repeat a row
            raise ValueError(
                f"a frame of {pixels.shape}; the ring has frames of {self.shape}"
            )

        slot = number % self.frames
        counts = np.ascontiguousarray(pixels, dtype=np.uint16)
        self._numbers[slot] = 0
        written = os.pwrite(
            self.place.descriptor,
            counts.data,
            self._numbers.nbytes + slot * counts.nbytes,
        )
        self._numbers[slot] = number if written == counts.nbytes else 0

    def get(self, number: int) -> Counts | None:
        """Return a copy of a frame (row, column); None if it is gone or has not come
        yet.
        """
        slot = number % self.frames
        if number < 1 or self._numbers[slot] != number:
            return None

        pixels = np.empty(self.shape, dtype=np.uint16)
        os.preadv(
            self.place.descriptor,
            [pixels.data],
            self._numbers.nbytes + slot * pixels.nbytes,
        )

        return pixels if self._numbers[slot] == number else None
