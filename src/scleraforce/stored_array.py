"""One array of a store: what its metadata must be, and its chunks as bytes (Zarr 3).

Every chunk ends with its CRC-32C. What is read has been checked before: a chunk is decoded from memory with the codecs
that are expected, never with those that a file asks for, and only where it says to have the size of a chunk.
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.codecs import Crc32cCodec, ZstdCodec
from zarr.core.buffer.cpu import Buffer
from zarr.storage import MemoryStore

from scleraforce.whole_files import MIB

METADATA_FILE = "zarr.json"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
FIXED = ("shape", "data_type", "chunk_grid", "chunk_key_encoding", "fill_value", "codecs", "zarr_format", "node_type")


@dataclass(frozen=True)
class StoredArray:
    """What an array of a store is.

    Attributes:
        name: of its folder.
        shape: of the array.
        chunks: shape of a chunk.
        dtype: NumPy's name of its type.
        compressed: whether chunks are compressed (Zstandard).
    """

    name: str
    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    dtype: str
    compressed: bool = False

    @property
    def size(self) -> int:
        """Bytes of all its values in memory."""
        return prod(self.shape) * np.dtype(self.dtype).itemsize

    @property
    def chunk_size(self) -> int:
        """Bytes of the values of a chunk in memory."""
        return prod(self.chunks) * np.dtype(self.dtype).itemsize

    @property
    def max_file_size(self) -> int:
        """A file of more bytes is no chunk of this array."""
        return max(MIB, 2 * self.chunk_size)

    @property
    def grid(self) -> tuple[int, ...]:
        """Number of chunks along each axis."""
        return tuple(-(-size // chunk) for size, chunk in zip(self.shape, self.chunks, strict=True))

    @property
    def places(self) -> Iterable[tuple[int, ...]]:
        """Indices of all chunks, the last fastest."""
        return np.ndindex(self.grid)

    def file(self, index: tuple[int, ...]) -> str:
        """Return the file of a chunk within the store; indices that are left out are 0.

        >>> StoredArray("slices", (465, 40, 140), (200, 40, 140), "uint8").file((1,))
        'slices/c/1/0/0'
        """
        return "/".join([self.name, "c", *map(str, index), *["0"] * (len(self.shape) - len(index))])

    def create(self, group: zarr.Group) -> zarr.Array[Any]:
        """Create the array in a group, or replace it; chunks of zeros are written, too: what is missing is not done."""
        return group.create_array(
            self.name,
            shape=self.shape,
            chunks=self.chunks,
            dtype=self.dtype,
            filters=None,
            compressors=[*([ZstdCodec(level=3)] if self.compressed else []), Crc32cCodec()],
            config={"write_empty_chunks": True},
            overwrite=True,
        )

    def difference(self, metadata: Any) -> str | None:
        """Return what in the content of a `zarr.json` is not that of this array; None where all fits."""
        if not isinstance(metadata, dict):
            return "not an object"
        for key in FIXED:
            found, wanted = (json.dumps(record.get(key), sort_keys=True) for record in (metadata, self._metadata))
            if found != wanted:
                return f"{key} {found[:60]}, expected {wanted}"
        return None

    def decode(self, chunks: Mapping[tuple[int, ...], bytes]) -> NDArray[Any]:
        """Return the array from the bytes of its chunks (those that are left out are zeros).

        Raises:
            Exception: whatever a codec raises where a chunk is damaged.
        """
        content: dict[str, Any] = {}
        array = self.create(zarr.create_group(MemoryStore(content), zarr_format=3))
        for index, data in chunks.items():
            if self.compressed and _decoded_bytes(data) != self.chunk_size:
                raise ValueError(f"a chunk of {self.chunk_size} bytes that would decode to {_decoded_bytes(data)}")
            content[self.file(index)] = Buffer.from_bytes(data)
        return np.asarray(array[:])

    def decodes(self, data: bytes) -> bool:
        """Return whether the bytes of a chunk can be decoded."""
        try:
            StoredArray(self.name, self.chunks, self.chunks, self.dtype, self.compressed).decode(
                {(0,) * len(self.chunks): data}
            )
        except Exception:  # whatever a codec raises
            return False
        return True

    @cached_property
    def _metadata(self) -> dict[str, Any]:
        content: dict[str, Any] = {}
        self.create(zarr.create_group(MemoryStore(content), zarr_format=3))
        metadata: dict[str, Any] = json.loads(content[f"{self.name}/{METADATA_FILE}"].to_bytes())
        return metadata


def _decoded_bytes(data: bytes) -> int | None:
    """Return the size that a Zstandard frame says to have when it is decoded (RFC 8878, section 3.1.1.1).

    >>> _decoded_bytes(bytes.fromhex("28b52ffda00017110054"))
    1120000
    """
    if data[:4] != ZSTD_MAGIC or len(data) < 5:
        return None
    descriptor = data[4]
    single, flag = descriptor >> 5 & 1, descriptor >> 6
    start = 5 + (1 - single) + (0, 1, 2, 4)[descriptor & 3]
    width = (single, 2, 4, 8)[flag]
    if not width:
        return None
    return int.from_bytes(data[start : start + width], "little") + (256 if width == 2 else 0)
