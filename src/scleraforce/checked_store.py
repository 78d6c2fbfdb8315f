"""Zarr 3 groups that are written part by part, resumable, and checked when they are read.

Every array has a CRC-32C. Zarr writes a chunk to a temporary name and renames it, so a chunk that exists is whole, and
a killed run still has to do what is missing. A group is marked as complete at the end.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.abc.codec import BytesBytesCodec
from zarr.codecs import Crc32cCodec

from scleraforce.errors import InputError

__all__ = ["CheckedStore", "create_array", "is_readable"]


@dataclass(frozen=True)
class CheckedStore:
    """One kind of store: how messages call it, what its metadata must have, what makes it.

    Attributes:
        noun: what it is, "data set".
        command: the command of scleraforce that makes it; `verb` is the same in a sentence.
        schema: of its format; another one is refused.
        required: attributes that it must have beside the schema.
        same: attributes that a run must share with the one that it continues.
        error: the exception that is raised.
    """

    noun: str
    command: str
    verb: str
    schema: str
    required: frozenset[str]
    same: tuple[str, ...]
    error: type[InputError]

    def open_group(self, path: Path, mode: Literal["r", "r+"] = "r") -> zarr.Group:
        """Open a store that exists; nothing but its being a Zarr group is checked."""
        if not path.is_dir():
            raise self.error(f"{path}: no such {self.noun}; `scleraforce {self.command} --out {path}` makes one")
        try:
            return zarr.open_group(path.absolute(), mode=mode, zarr_format=3)
        except (OSError, ValueError, KeyError, TypeError) as fault:
            raise self.error(f"{path}: not a {self.noun} of scleraforce: {fault}") from fault

    def attributes(self, group: zarr.Group, path: Path) -> dict[str, Any]:
        """Return the metadata of a store, complete or not."""
        attributes = dict(group.attrs)
        if attributes.get("schema") != self.schema:
            raise self.error(f"{path}: schema {attributes.get('schema')!r}; this version reads {self.schema!r}")
        if missing := self.required - attributes.keys():
            raise self.error(f"{path}: attributes {', '.join(sorted(missing))} are missing; {self.verb} it again")
        return attributes

    def complete_attributes(self, group: zarr.Group, path: Path) -> dict[str, Any]:
        """Return the metadata of a store that is complete."""
        attributes = self.attributes(group, path)
        if attributes["complete"] is not True:
            raise self.error(f"{path}: not complete; the same `scleraforce {self.command}` completes it")
        return attributes

    def begin(self, path: Path, attributes: Mapping[str, Any]) -> zarr.Group:
        """Create a store that is not complete, or open what a killed run with the same attributes has left."""
        if _occupied(path):
            return self._continued(path, attributes)
        try:
            path.mkdir(parents=True, exist_ok=True)
            described = {"schema": self.schema, "complete": False, **attributes}
            return zarr.create_group(path.absolute(), zarr_format=3, attributes=described)
        except OSError as fault:
            raise self.error(f"{path}: {fault.strerror}") from fault

    def finish(self, path: Path) -> None:
        """Mark a store as complete, and clear what killed runs have left beside their chunks."""
        for leftover in path.rglob("*.partial"):
            leftover.unlink(missing_ok=True)
        self.open_group(path, "r+").attrs["complete"] = True

    def array(self, group: zarr.Group, path: Path, name: str) -> zarr.Array[Any]:
        """Return an array of a store, with a checksum; its values are read later."""
        try:
            array = group[name]
        except (OSError, ValueError, KeyError, TypeError) as fault:
            raise self.error(f"{path / name}: the array is missing or its zarr.json is damaged") from fault
        if not isinstance(array, zarr.Array):
            raise self.error(f"{path / name}: not an array")
        if not any(isinstance(codec, Crc32cCodec) for codec in array.compressors):
            raise self.error(f"{path / name}: without checksums; {self.verb} it again")
        return array

    def whole_array(self, group: zarr.Group, path: Path, name: str) -> zarr.Array[Any]:
        """Return an array none of whose chunks is missing (Zarr would read it as zeros)."""
        array = self.array(group, path, name)
        if array.nchunks_initialized != array.nchunks:
            missing = array.nchunks - array.nchunks_initialized
            raise self.error(f"{path / name}: {missing} of {array.nchunks} chunks are missing; {self.verb} it again")
        return array

    def read(self, array: zarr.Array[Any], place: Path) -> NDArray[Any]:
        """Return the values of an array that stands at `place`; the message names the chunk that is damaged."""
        try:
            return np.asarray(array[:])
        except Exception as fault:  # whatever a codec raises, the array cannot be read
            again = f"{self.verb} the {self.noun} again"
            raise self.error(f"{_damaged(array, place)}: damaged ({fault}); {again}") from fault

    def _continued(self, path: Path, attributes: Mapping[str, Any]) -> zarr.Group:
        try:
            found = self.attributes(self.open_group(path), path)
        except self.error as fault:
            raise self.error(f"{path}: holds something else than a {self.noun}; choose another path") from fault
        if found["complete"]:
            raise self.error(f"{path}: a complete {self.noun}; remove it or choose another path")
        for name in self.same:
            if found.get(name) != attributes[name]:
                raise self.error(f"{path}: begun with another {name}; remove it or choose another path")
        return self.open_group(path, "r+")


def create_array(
    group: zarr.Group,
    name: str,
    shape: tuple[int, ...],
    chunks: tuple[int, ...],
    dtype: str,
    *compressors: BytesBytesCodec,
) -> zarr.Array[Any]:
    """Create an array with a checksum, or replace it; chunks of zeros are written, too: what is missing is not done."""
    return group.create_array(
        name,
        shape=shape,
        chunks=chunks,
        dtype=dtype,
        filters=None,
        compressors=[*compressors, Crc32cCodec()],
        config={"write_empty_chunks": True},
        overwrite=True,
    )


def _chunk_path(array: zarr.Array[Any], place: Path, index: tuple[int, ...]) -> Path:
    """Return the file of a chunk, where the indices that are left out are 0 (Zarr 3 specification, default keys)."""
    return place.joinpath("c", *map(str, index), *["0"] * (array.ndim - len(index)))


def is_readable(array: zarr.Array[Any], place: Path, index: tuple[int, ...], part: Any) -> bool:
    """Return whether a chunk is there and the part of the array that it holds can be read."""
    if not _chunk_path(array, place, index).exists():
        return False
    try:
        array[part]
    except Exception:  # whatever a codec raises, the part has to be made again
        return False
    return True


def _occupied(path: Path) -> bool:
    """Whether something stands at `path`; an empty directory, or one with a killed run's temporary file, is free."""
    if not path.exists():
        return False
    return not path.is_dir() or any(entry.suffix != ".partial" for entry in path.iterdir())


def _damaged(array: zarr.Array[Any], place: Path) -> Path:
    """Return the file of the first chunk that cannot be read."""
    for index in np.ndindex(array.cdata_shape):
        try:
            array.blocks[index]
        except Exception:  # as above
            return _chunk_path(array, place, index)
    return place
