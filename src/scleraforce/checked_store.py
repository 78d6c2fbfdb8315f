"""Zarr 3 groups that are written part by part, resumable, and checked when they are read.

Chunks become visible whole; at the end the SHA-256 of each, in their order, goes into the group's attributes. Zarr
never reads a user's files: they are read as regular ones, checked, and decoded with the expected codecs only.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from hashlib import sha256
from itertools import zip_longest
from math import prod
from os.path import lexists
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from fastcrc import crc32
from numcodecs import Zstd
from numpy.typing import NDArray
from zarr.codecs import Crc32cCodec, ZstdCodec
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

    def size(self, shape: tuple[int, ...]) -> int:
        """Return the bytes of values of a shape, of the array's or its chunks', in memory."""
        return prod(shape) * np.dtype(self.dtype).itemsize

    @property
    def places(self) -> Iterable[tuple[int, ...]]:
        """Indices of all chunks, the last fastest."""
        return np.ndindex(*(-(-size // chunk) for size, chunk in zip(self.shape, self.chunks, strict=True)))

    def part(self, index: tuple[int, ...]) -> tuple[slice, ...]:
        """Return the part of the array in a chunk; missing indices are 0."""
        along = zip_longest(index, self.chunks, self.shape, fillvalue=0)
        return tuple(slice(n * chunk, min((n + 1) * chunk, size)) for n, chunk, size in along)

    def file(self, index: tuple[int, ...]) -> str:
        """Return the file of a chunk within the store; missing indices are 0.

        >>> StoredArray("slices", (465, 40, 140), (200, 40, 140), "uint8").file((1,))
        'slices/c/1/0/0'
        """
        return "/".join([self.name, "c", *map(str, index), *["0"] * (len(self.shape) - len(index))])

    def create(self, group: zarr.Group) -> zarr.Array[Any]:
        """Create the array in a group, or replace it; chunks of zeros are written, too: a missing chunk is not done."""
        return group.create_array(
            self.name, shape=self.shape, chunks=self.chunks, dtype=self.dtype, filters=None,
            compressors=[*([ZstdCodec(level=3)] if self.compressed else []), Crc32cCodec()],
            config={"write_empty_chunks": True}, overwrite=True,
        )  # fmt: skip

    def difference(self, metadata: Any) -> str | None:
        """Return the difference between the content of a `zarr.json` and this array; None if it fits."""
        if not isinstance(metadata, dict):
            return "not an object"
        for key in FIXED:
            found, wanted = (json.dumps(record.get(key), sort_keys=True) for record in (metadata, self._metadata))
            if found != wanted:
                return f"{key} {found[:60]}, expected {wanted}"
        return None

    def decoded(self, data: bytes) -> NDArray[Any]:
        """Return the values of a chunk: little-endian, perhaps compressed, their CRC-32C behind them."""
        data, check = data[:-4], data[-4:]
        if crc32.iscsi(data) != int.from_bytes(check, "little"):
            raise ValueError("its check sum is wrong")
        expected = self.size(self.chunks)
        if self.compressed and (size := _decoded_bytes(data)) != expected:
            raise ValueError(f"a chunk of {expected} bytes that would decode to {size}")
        values = Zstd().decode(data) if self.compressed else data
        return np.frombuffer(values, np.dtype(self.dtype).newbyteorder("<")).reshape(self.chunks)

    @cached_property
    def _metadata(self) -> dict[str, Any]:
        content: dict[str, Any] = {}
        self.create(zarr.create_group(MemoryStore(content), zarr_format=3))
        metadata: dict[str, Any] = json.loads(content[f"{self.name}/{METADATA_FILE}"].to_bytes())
        return metadata


@dataclass(frozen=True, kw_only=True)
class StoreKind:
    """One kind of store: its names in messages, its required metadata, and the command that makes it.

    `recipe` is the attribute with the text that a store is made from; beside it is the text's SHA-256. `same`
    attributes must not change when a run continues another one; `others` says, by the beginning of a schema, what other
    stores are for; `parts` is the noun of its units.
    """

    noun: str
    command: str
    verb: str
    parts: str
    schema: str
    recipe: str
    required: frozenset[str]
    same: tuple[str, ...]
    others: Mapping[str, str]
    error: type[InputError]

    def attributes(self, path: Path) -> dict[str, Any]:
        """Return the metadata of a store, complete or not."""
        if not path.is_dir():
            raise self.error(f"{path}: no such {self.noun}; `scleraforce {self.command} --out {path}` makes one")
        record = self.json(path)
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
        """Return the metadata of a store that is complete, and whose recipe is the one that it was made from."""
        attributes = self.attributes(path)
        if attributes["complete"] is not True:
            raise self.error(f"{path}: not complete; the same `scleraforce {self.command}` completes it")
        text = attributes[self.recipe]
        # Of the text as it was written: a later version may know more keys, and format the same study differently.
        if not isinstance(text, str) or sha256(text.encode()).hexdigest() != attributes[f"{self.recipe}_hash"]:
            raise self.error(f"{path}: its {self.recipe} does not match its hash: damaged; {self.verb} it again")
        return attributes

    def json(self, folder: Path) -> Any:
        """Return the content of the `zarr.json` of a folder."""
        path = folder / METADATA_FILE
        try:
            hint = f"a {self.noun} of scleraforce has this file"
            return parse_json(read_bytes(path, replace(KINDS["store metadata"], error=self.error, hint=hint)))
        except ValueError as fault:
            raise self.error(f"{path}: not a {self.noun} of scleraforce: {fault}") from fault


@dataclass(frozen=True)
class CheckedStore:
    """A store of a kind in a folder.

    `units`: for each unit of work, the index of its chunk in each of its arrays, by name; missing indices are 0.
    `attributes`: the metadata of a complete store.
    """

    kind: StoreKind
    path: Path
    arrays: Mapping[str, StoredArray]
    units: Sequence[Mapping[str, tuple[int, ...]]] = ()
    attributes: Mapping[str, Any] = field(default_factory=dict)

    def begin(self, attributes: Mapping[str, Any], known: Mapping[str, NDArray[Any]]) -> None:
        """Create an incomplete store with the `known` arrays, or continue a killed run with the same attributes."""
        with self._writing():
            path = self.path  # an empty folder, or one with a killed run's temporary file, is free
            if path.exists() and (not path.is_dir() or any(entry.suffix != ".partial" for entry in path.iterdir())):
                group = self._continued(attributes)
            else:
                self.path.mkdir(parents=True, exist_ok=True)
                described = {"schema": self.kind.schema, "complete": False, **attributes}
                group = zarr.create_group(self.path.absolute(), zarr_format=3, attributes=described)
            for name, array in self.arrays.items():
                if name in known:
                    array.create(group)[:] = known[name]
                elif name not in group:
                    array.create(group)

    def missing(self) -> list[int]:
        """Return the numbers of the units of which a chunk is missing or cannot be read."""
        chunks = ([self._is_readable(name, index) for name, index in unit.items()] for unit in self.units)
        return [number for number, readable in enumerate(chunks) if not all(readable)]

    def write(self, unit: int, values: Mapping[str, NDArray[Any]]) -> None:
        """Write the chunks of a unit, given by the names of the arrays."""
        with self._writing():
            for name, index in self.units[unit].items():
                part = self.arrays[name].part(index)
                found = zarr.open_array(self.path.absolute() / name, mode="r+", zarr_format=3)
                found = found.with_config({"write_empty_chunks": True})  # what is missing is not done yet
                found[part] = values[name].reshape([along.stop - along.start for along in part])

    def finish(self) -> None:
        """Mark a store without missing units as complete, with the hashes of its chunks; clear temporary files."""
        if missing := len(self.missing()):
            lost = f"{missing} of {len(self.units)} {self.kind.parts} are missing"
            raise self.kind.error(f"{self.path}: {lost}; {self.kind.verb} it again")
        arrays = self.arrays.items()
        hashes = {name: [sha256(self._chunk(one, at)).hexdigest() for at in one.places] for name, one in arrays}
        with self._writing():
            for leftover in self.path.rglob("*.partial"):
                leftover.unlink(missing_ok=True)
            group = zarr.open_group(self.path.absolute(), mode="r+", zarr_format=3)
            group.update_attributes({HASHES: hashes, "complete": True})

    def check(self) -> None:
        """Check the type, shape and presence of all chunks of all arrays of a complete store."""
        for name in self.arrays:
            self._checked_hashes(name)

    def read(self, name: str) -> NDArray[Any]:
        """Return the values of an array; the message names the damaged chunk."""
        array, hashes = self.arrays[name], self._checked_hashes(name)
        values = np.empty(array.shape, array.dtype)
        for index, expected in hashes.items():
            data, part = self._chunk(array, index), array.part(index)
            try:
                if sha256(data).hexdigest() != expected:
                    raise ValueError("it is not the chunk of this place")
                values[part] = array.decoded(data)[tuple(slice(along.stop - along.start) for along in part)]
            except (ValueError, RuntimeError) as fault:
                again = f"{self.kind.verb} the {self.kind.noun} again"
                raise self.kind.error(f"{self.path / array.file(index)}: damaged ({fault}); {again}") from fault
        return values

    def _checked_hashes(self, name: str) -> dict[tuple[int, ...], Any]:
        array, places, place = self.arrays[name], list(self.arrays[name].places), self.path / name
        again = f"{self.kind.verb} it again"
        if (size := array.size(array.shape)) > MAX_ARRAY_SIZE:
            most = f"at most {MAX_ARRAY_SIZE // MIB} are read (docs/files.md)"
            raise self.kind.error(f"{place}: {size // MIB} MiB of values, {most}")
        if wrong := array.difference(self.kind.json(place)):
            raise self.kind.error(f"{place}: {wrong}; {again}")
        hashes = self.attributes.get(HASHES)
        found = hashes.get(name) if isinstance(hashes, dict) else None
        if not isinstance(found, list) or len(found) != len(places):
            wrong = f"{HASHES}: not the hashes of the {len(places)} chunks of {name}"
            raise self.kind.error(f"{self.path}: {wrong}; {again}")
        if missing := sum(not (self.path / array.file(index)).exists() for index in places):
            raise self.kind.error(f"{place}: {missing} of {len(places)} chunks are missing; {again}")
        return dict(zip(places, found, strict=True))

    def _is_readable(self, name: str, index: tuple[int, ...]) -> bool:
        try:
            self.arrays[name].decoded(self._chunk(self.arrays[name], index))
        except (self.kind.error, ValueError, RuntimeError):
            return False
        return True

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as fault:
            raise self.kind.error(f"{self.path}: {fault.strerror or fault}") from fault

    def _continued(self, attributes: Mapping[str, Any]) -> zarr.Group:
        path, kind = self.path, self.kind
        try:
            found = kind.attributes(path)
        except kind.error as fault:
            raise kind.error(f"{path}: holds something else than a {kind.noun}; choose another path") from fault
        if found["complete"]:
            raise kind.error(f"{path}: a complete {kind.noun}; remove it or choose another path")
        for name in kind.same:
            if found.get(name) != attributes[name]:
                raise kind.error(f"{path}: begun with another {name}; remove it or choose another path")
        for entry in path.rglob("*"):
            if not entry.is_file() and not entry.is_dir() and lexists(entry):  # else a temporary file that has gone
                raise kind.error(f"{entry}: neither a regular file nor a folder; remove {path} or choose another path")
        return zarr.open_group(path.absolute(), mode="r+", zarr_format=3)

    def _chunk(self, array: StoredArray, index: tuple[int, ...]) -> bytes:
        kind = replace(KINDS["store chunk"], error=self.kind.error, max_bytes=max(MIB, 2 * array.size(array.chunks)))
        return read_bytes(self.path / array.file(index), kind)


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
