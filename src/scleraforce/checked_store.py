"""Zarr 3 groups that are written part by part, resumable, and checked when they are read.

Zarr writes a chunk to a temporary name and renames it, so an existing chunk is whole, and a killed run's missing chunks
are known. At the end the SHA-256 of every chunk goes into the group's attributes, in the order of the chunks: this
finds a chunk in the place of another one, which its own checksum (CRC-32C) cannot.

Zarr itself never reads a user's files: they are read as regular ones within a size, checked, and decoded from memory
with the expected codecs, never with the file's, and only if it states the size of a chunk.
"""

import json
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.codecs import Crc32cCodec, ZstdCodec
from zarr.core.buffer.cpu import Buffer
from zarr.storage import MemoryStore

from scleraforce.errors import InputError
from scleraforce.plain_json import parse_json
from scleraforce.whole_files import KINDS, MIB, read_bytes

METADATA_FILE = "zarr.json"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
FIXED = ("shape", "data_type", "chunk_grid", "chunk_key_encoding", "fill_value", "codecs", "zarr_format", "node_type")
HASHES = "sha256"  # the attribute with the hashes of an array's chunks, for each array
MAX_ARRAY_SIZE = 8192 * MIB


@dataclass(frozen=True)
class StoredArray:
    """The properties of an array in a store; `dtype` is NumPy's name, `compressed` chunks are Zstandard."""

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
        """The largest size of a chunk's file."""
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
        """Return the file of a chunk within the store; missing indices are 0.

        >>> StoredArray("slices", (465, 40, 140), (200, 40, 140), "uint8").file((1,))
        'slices/c/1/0/0'
        """
        return "/".join([self.name, "c", *map(str, index), *["0"] * (len(self.shape) - len(index))])

    def create(self, group: zarr.Group) -> zarr.Array[Any]:
        """Create the array in a group, or replace it; chunks of zeros are written, too: a missing chunk is not done."""
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
        """Return the difference between the content of a `zarr.json` and this array; None if it fits."""
        if not isinstance(metadata, dict):
            return "not an object"
        for key in FIXED:
            found, wanted = (json.dumps(record.get(key), sort_keys=True) for record in (metadata, self._metadata))
            if found != wanted:
                return f"{key} {found[:60]}, expected {wanted}"
        return None

    def decode(self, chunks: Mapping[tuple[int, ...], bytes]) -> NDArray[Any]:
        """Return the array from the bytes of its chunks, zeros by default; codecs raise any exception on damage."""
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


@dataclass(frozen=True)
class CheckedStore:
    """One kind of store: its names in messages, its required metadata, and the command that makes it.

    `same` attributes must not change when a run continues another one; `others` says, by the beginning of a schema,
    what other stores are for.
    """

    noun: str
    command: str
    verb: str
    schema: str
    required: frozenset[str]
    same: tuple[str, ...]
    others: Mapping[str, str]
    error: type[InputError]

    def attributes(self, path: Path) -> dict[str, Any]:
        """Return the metadata of a store, complete or not."""
        if not path.is_dir():
            raise self.error(f"{path}: no such {self.noun}; `scleraforce {self.command} --out {path}` makes one")
        record = self._json(path / METADATA_FILE)
        attributes = record.get("attributes") if isinstance(record, dict) else None
        if not isinstance(attributes, dict) or record.get("node_type") != "group":
            raise self.error(f"{path}: not a {self.noun} of scleraforce")
        if attributes.get("schema") != self.schema:
            found = str(attributes.get("schema"))[:60]
            if other := next((text for schema, text in self.others.items() if found.startswith(schema)), None):
                raise self.error(f"{path}: {other}")
            raise self.error(f"{path}: schema {found!r}; this version reads {self.schema!r}")
        if missing := self.required - attributes.keys():
            raise self.error(f"{path}: attributes {', '.join(sorted(missing))} are missing; {self.verb} it again")
        return attributes

    def complete_attributes(self, path: Path) -> dict[str, Any]:
        """Return the metadata of a store that is complete."""
        attributes = self.attributes(path)
        if attributes["complete"] is not True:
            raise self.error(f"{path}: not complete; the same `scleraforce {self.command}` completes it")
        return attributes

    def begin(
        self,
        path: Path,
        attributes: Mapping[str, Any],
        arrays: Iterable[StoredArray],
        known: Mapping[str, NDArray[Any]],
    ) -> None:
        """Create an incomplete store with the `known` arrays, or continue a killed run with the same attributes."""
        with self.writing(path):
            if _occupied(path):
                group = self._continued(path, attributes)
            else:
                path.mkdir(parents=True, exist_ok=True)
                described = {"schema": self.schema, "complete": False, **attributes}
                group = zarr.create_group(path.absolute(), zarr_format=3, attributes=described)
            for array in arrays:
                if array.name in known:
                    array.create(group)[:] = known[array.name]
                elif array.name not in group:
                    array.create(group)

    def write(self, path: Path, array: StoredArray, part: Any, values: NDArray[Any]) -> None:
        """Write a part of an array: whole chunks."""
        with self.writing(path):
            found = zarr.open_array(path.absolute() / array.name, mode="r+", zarr_format=3)
            found.with_config({"write_empty_chunks": True})[part] = values  # what is missing is not done yet

    def finish(self, path: Path, arrays: Sequence[StoredArray], missing: int, parts: str) -> None:
        """Mark a store without `missing` units as complete, with the hashes of its chunks; clear temporary files."""
        if missing:
            raise self.error(f"{path}: {missing} of {parts} are missing; {self.verb} it again")
        hashes = {array.name: [sha256(self._chunk(path, array, at)).hexdigest() for at in array.places]
                  for array in arrays}  # fmt: skip
        with self.writing(path):
            for leftover in path.rglob("*.partial"):
                leftover.unlink(missing_ok=True)
            group = zarr.open_group(path.absolute(), mode="r+", zarr_format=3)
            group.update_attributes({HASHES: hashes, "complete": True})

    def check_array(self, path: Path, attributes: Mapping[str, Any], array: StoredArray) -> None:
        """Check the type, shape and presence of all chunks of an array of a complete store."""
        if array.size > MAX_ARRAY_SIZE:
            raise self.error(f"{path / array.name}: {array.size // MIB} MiB of values, at most "
                             f"{MAX_ARRAY_SIZE // MIB} are read (docs/files.md)")  # fmt: skip
        if wrong := array.difference(self._json(path / array.name / METADATA_FILE)):
            raise self.error(f"{path / array.name}: {wrong}; {self.verb} it again")
        count = len(self._hashes(path, attributes, array))
        missing = sum(not (path / array.file(index)).exists() for index in array.places)
        if missing:
            raise self.error(f"{path / array.name}: {missing} of {count} chunks are missing; {self.verb} it again")

    def read(self, path: Path, attributes: Mapping[str, Any], array: StoredArray) -> NDArray[Any]:
        """Return the values of an array; the message names the damaged chunk."""
        self.check_array(path, attributes, array)
        again = f"{self.verb} the {self.noun} again"
        chunks = {}
        for index, expected in zip(array.places, self._hashes(path, attributes, array), strict=True):
            chunks[index] = self._chunk(path, array, index)
            if sha256(chunks[index]).hexdigest() != expected:
                raise self.error(f"{path / array.file(index)}: damaged (it is not the chunk of this place); {again}")
        try:
            return array.decode(chunks)
        except Exception as fault:  # whatever a codec raises, the array cannot be read
            bad = next((index for index, data in chunks.items() if not array.decodes(data)), ())
            raise self.error(f"{path / array.file(bad)}: damaged ({fault}); {again}") from fault

    def is_readable(self, path: Path, array: StoredArray, index: tuple[int, ...]) -> bool:
        """Return whether a chunk exists and can be read; missing indices are 0."""
        try:
            return array.decodes(self._chunk(path, array, index))
        except self.error:
            return False

    @contextmanager
    def writing(self, path: Path) -> Iterator[None]:
        """Turn the system's errors while a store is written into one line."""
        try:
            yield
        except OSError as fault:
            raise self.error(f"{path}: {fault.strerror or fault}") from fault

    def _continued(self, path: Path, attributes: Mapping[str, Any]) -> zarr.Group:
        try:
            found = self.attributes(path)
        except self.error as fault:
            raise self.error(f"{path}: holds something else than a {self.noun}; choose another path") from fault
        if found["complete"]:
            raise self.error(f"{path}: a complete {self.noun}; remove it or choose another path")
        for name in self.same:
            if found.get(name) != attributes[name]:
                raise self.error(f"{path}: begun with another {name}; remove it or choose another path")
        if special := next((entry for entry in path.rglob("*") if not _ordinary(entry)), None):
            raise self.error(f"{special}: neither a regular file nor a folder; remove {path} or choose another path")
        return zarr.open_group(path.absolute(), mode="r+", zarr_format=3)

    def _json(self, path: Path) -> Any:
        try:
            hint = f"a {self.noun} of scleraforce has this file"
            return parse_json(read_bytes(path, replace(KINDS["store metadata"], error=self.error, hint=hint)))
        except ValueError as fault:
            raise self.error(f"{path}: not a {self.noun} of scleraforce: {fault}") from fault

    def _hashes(self, path: Path, attributes: Mapping[str, Any], array: StoredArray) -> list[Any]:
        hashes = attributes.get(HASHES)
        found = hashes.get(array.name) if isinstance(hashes, dict) else None
        count = sum(1 for _ in array.places)
        if not isinstance(found, list) or len(found) != count:
            raise self.error(
                f"{path}: {HASHES}: not the hashes of the {count} chunks of {array.name}; {self.verb} it again"
            )
        return found

    def _chunk(self, path: Path, array: StoredArray, index: tuple[int, ...]) -> bytes:
        kind = replace(KINDS["store chunk"], error=self.error, max_bytes=array.max_file_size)
        return read_bytes(path / array.file(index), kind)


def _occupied(path: Path) -> bool:
    """Return whether `path` is taken; an empty directory, or one with a killed run's temporary file, is free."""
    if not path.exists():
        return False
    return not path.is_dir() or any(entry.suffix != ".partial" for entry in path.iterdir())


def _ordinary(path: Path) -> bool:
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:  # a link to nowhere, or a temporary file that has gone
        return not path.is_symlink()
    return stat.S_ISREG(mode) or stat.S_ISDIR(mode)


def _decoded_bytes(data: bytes) -> int | None:
    """Return the decoded size that a Zstandard frame states (RFC 8878, section 3.1.1.1).

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
