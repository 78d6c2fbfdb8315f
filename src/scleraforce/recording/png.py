"""Write frames as PNG without compressing them: speckle hardly shrinks, and time is short while a monitor runs."""

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

SIGNATURE = b"\x89PNG\r\n\x1a\n"


class PngBuffer:
    """Makes 16-bit grey PNGs of frames of one size, in memory that is taken once.

    Each line is a stored block of the zlib stream (RFC 1950, RFC 1951 section 3.2.4), so only pixels and checksums
    change from frame to frame. Compressing takes 15 times as long and saves a third (docs/black_box.md). Chunks and
    filters: PNG specification, third edition, sections 5.3 and 9.2.

    Args:
        rows: of the frames.
        columns: of the frames, at most 32,767.
    """

    def __init__(self, rows: int, columns: int) -> None:
        line_bytes = 1 + 2 * columns
        self._lines = np.zeros((rows, line_bytes), dtype=np.uint8)  # each begins with its filter: none
        self._blocks = np.zeros((rows, 5 + line_bytes), dtype=np.uint8)
        self._blocks[-1, 0] = 1  # the last one
        self._blocks[:, 1:5] = np.frombuffer(struct.pack("<HH", line_bytes, line_bytes ^ 0xFFFF), dtype=np.uint8)
        size = 2 + self._blocks.size + 4
        header = _chunk(b"IHDR", struct.pack(">IIBBBBB", columns, rows, 16, 0, 0, 0, 0))
        begin = SIGNATURE + header + struct.pack(">I", size) + b"IDAT\x78\x01"
        self._png = np.frombuffer(bytearray(begin + bytes(size + 2) + _chunk(b"IEND", b"")), dtype=np.uint8)
        self._data = self._png[len(begin) - 6 : len(begin) + size - 2]  # from IDAT to its checksum
        self._check = self._png[len(begin) + size - 2 :][:4]

    def encode(self, pixels: NDArray[np.uint16]) -> memoryview:
        """Return the PNG of a frame (row, column); the next call overwrites it."""
        if pixels.shape != (len(self._lines), self._lines.shape[1] // 2):
            raise ValueError(f"a frame of {pixels.shape}")
        self._lines[:, 1:] = pixels.astype(">u2").view(np.uint8)
        self._blocks[:, 5:] = self._lines
        self._data[6:-4] = self._blocks.ravel()
        self._data[-4:] = np.frombuffer(struct.pack(">I", zlib.adler32(self._lines.data)), dtype=np.uint8)
        self._check[:] = np.frombuffer(struct.pack(">I", zlib.crc32(self._data.data)), dtype=np.uint8)
        return self._png.data


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
