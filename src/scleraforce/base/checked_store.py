"""Zarr 3 groups that are written part by part, resumable, and checked when they are
read.

Zarr encodes and decodes in memory only, in the layout that the study determines. Files
are read as regular ones of a limited size, and written whole. At the end the SHA-256 of
each chunk, in their order, goes into the group's attributes.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from hashlib import sha256
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numcodecs import Zstd
from numpy.typing import NDArray
from zarr.abc.buffer import Buffer
from zarr.buffer import cpu
from zarr.codecs import Crc32cCodec, ZstdCodec
from zarr.storage import MemoryStore

from scleraforce.base.errors import InputError
from scleraforce.base.plain_json import parse_json
from scleraforce.base.whole_files import KINDS, MIB, read_bytes, write_whole

METADATA_FILE = "zarr.json"
HASHES = "sha256"  # the attribute with the hashes of an array's chunks, for each array
MAX_ARRAY_SIZE = 8192 * MIB
CRC_BYTES = 4
PART = ".part"  # of the temporary files of `write_whole`
Layout = dict[str, Any]


def layout(
    shape: tuple[int, ...],
    chunks: tuple[int, ...],
    dtype: str,
    *,
    compressed: bool = False,
) -> Layout:
    """Return the arguments of Zarr's `create_array`: chunks with CRC-32C, written even
    if they are all zeros.
    """
    compressors = [ZstdCodec(level=3), Crc32cCodec()] if compressed else [Crc32cCodec()]
    return {
        "shape": shape,
        "chunks": chunks,
        "dtype": dtype,
        "filters": None,
        "compressors": compressors,
        "config": {"write_empty_chunks": True},
    }


@dataclass(frozen=True, kw_only=True)
class StoreKind:
    """One kind of store: its noun in messages, the command that makes it, the noun of
    its units, its schema.

    `recipe` is the attribute with the text that a store is made from; beside it is the
    text's SHA-256. `others` says, by the beginning of a schema, what other stores are
    for.
    """

    noun: str
    command: str
    parts: str
    schema: str
    recipe: str
    others: Mapping[str, str]
    error: type[InputError]

    def attributes(self, path: Path) -> dict[str, Any]:
        """Return the metadata of a store, complete or not."""
        if not path.is_dir():
            raise self.error(
                f"{path}: no such {self.noun}; `scleraforce {self.command}"
                f" out={path}` makes one"
            )

        foreign = f"{path}: not a {self.noun} of scleraforce"
        hint = f"a {self.noun} of scleraforce has this file"
        metadata = replace(KINDS["store metadata"], error=self.error, hint=hint)

        try:
            record = parse_json(read_bytes(path / METADATA_FILE, metadata))
        except ValueError as fault:
            raise self.error(f"{foreign}: {fault}") from fault

        attributes = record.get("attributes") if isinstance(record, dict) else None
        if not isinstance(attributes, dict) or record.get("node_type") != "group":
            raise self.error(foreign)

        if (schema := str(attributes.get("schema"))[:60]) != self.schema:
            unknown = f"schema {schema!r}; this version reads {self.schema!r}"
            other = (
                text for start, text in self.others.items() if schema.startswith(start)
            )
            raise self.error(f"{path}: {next(other, unknown)}")

        found: dict[str, Any] = attributes
        return found

    def complete_attributes(self, path: Path) -> dict[str, Any]:
        """Return the metadata of a store that is complete, and whose recipe is the one
        that it was made from.
        """
        attributes = self.attributes(path)
        if attributes.get("complete") is not True:
            raise self.error(
                f"{path}: not complete; the same `scleraforce {self.command}`"
                " completes it"
            )

        text = attributes.get(self.recipe)
        # Of the text as it was written: a later version may know more keys, and format
        # the same study differently.
        if not isinstance(text, str) or sha256(
            text.encode()
        ).hexdigest() != attributes.get(f"{self.recipe}_hash"):
            raise self.error(
                f"{path}: its {self.recipe} does not match its hash: damaged; make it"
                " again"
            )

        return attributes


class CheckedStore:
    """A store of a kind in a folder, with its arrays in the memory of Zarr.

    `units`: for each unit of work, the index of its chunk in each of its arrays, by
    name; missing indices are 0. `attributes`: the metadata of a complete store.
    """

    def __init__(
        self,
        kind: StoreKind,
        path: Path,
        layouts: Mapping[str, Layout],
        units: Sequence[Mapping[str, tuple[int, ...]]] = (),
        attributes: Mapping[str, Any] | None = None,
    ) -> None:
        """Touches no file."""
        self._kind = kind
        self._path = path
        self._units = units
        self._attributes = attributes or {}
        self._files: dict[
            str, Buffer
        ] = {}  # what Zarr has in memory, by the places in the folder
        self._group = zarr.create_group(MemoryStore(self._files), zarr_format=3)
        self.arrays = {
            name: self._group.create_array(name, **given)
            for name, given in layouts.items()
        }

    def begin(
        self, attributes: Mapping[str, Any], known: Mapping[str, NDArray[Any]]
    ) -> None:
        """Create an incomplete store with the `known` arrays, or continue a killed run
        with the same attributes.
        """
        path = self._path
        kind = self._kind

        # An empty folder, or one with a killed run's temporary file, is free.
        if path.exists() and (
            not path.is_dir() or any(entry.suffix != PART for entry in path.iterdir())
        ):
            try:
                found = kind.attributes(path)
            except kind.error as fault:
                raise kind.error(
                    f"{path}: holds something else than a {kind.noun}; choose another"
                    " path"
                ) from fault

            if found.get("complete") is not False:
                raise kind.error(
                    f"{path}: a complete {kind.noun}; remove it or choose another path"
                )
            if other := next(
                (name for name in attributes if found.get(name) != attributes[name]),
                None,
            ):
                raise kind.error(
                    f"{path}: begun with another {other}; remove it or choose another"
                    " path"
                )

        for name, values in known.items():
            self.arrays[name][:] = values

        self._write({"schema": kind.schema, "complete": False, **attributes})

    def missing(self) -> list[int]:
        """Return the numbers of the units of which a chunk is missing or cannot be
        read.
        """
        chunks = (
            [self._is_readable(name, index) for name, index in unit.items()]
            for unit in self._units
        )
        return [number for number, readable in enumerate(chunks) if not all(readable)]

    def write(self, unit: int, values: Mapping[str, NDArray[Any]]) -> None:
        """Write the chunks of a unit, given by the names of the arrays; first axes of
        length 1 may be left out.
        """
        for name, index in self._units[unit].items():
            self.arrays[name].blocks[index] = np.array(
                values[name], ndmin=self.arrays[name].ndim
            )
        self._write()

    def finish(self) -> None:
        """Mark a store without missing units as complete, with the hashes of its
        chunks; clear temporary files.
        """
        if missing := len(self.missing()):
            lost = f"{missing} of {len(self._units)} {self._kind.parts} are missing"
            raise self._kind.error(f"{self._path}: {lost}; make it again")

        for leftover in self._path.rglob(f"*{PART}"):
            with suppress(OSError):
                leftover.unlink()

        hashes = {
            name: [
                sha256(self._read(name, index)).hexdigest()
                for index in np.ndindex(array.cdata_shape)
            ]
            for name, array in self.arrays.items()
        }
        self._write(
            {**self._kind.attributes(self._path), HASHES: hashes, "complete": True}
        )

    def read(self, name: str) -> NDArray[Any]:
        """Return the values of an array; the message names the damaged chunk."""
        array = self.arrays[name]
        hashes = self._attributes.get(HASHES)
        place = self._path / name

        if array.nbytes > MAX_ARRAY_SIZE:
            most = f"at most {MAX_ARRAY_SIZE // MIB} are read (docs/files.md)"
            raise self._kind.error(
                f"{place}: {array.nbytes // MIB} MiB of values, {most}"
            )

        expected = hashes.get(name) if isinstance(hashes, dict) else None
        if not isinstance(expected, list) or len(expected) != array.nchunks:
            wrong = f"{HASHES}: not the hashes of the {array.nchunks} chunks of {name}"
            raise self._kind.error(f"{self._path}: {wrong}; make it again")

        try:
            for index, digest in zip(
                np.ndindex(array.cdata_shape), expected, strict=True
            ):
                place = self._path / _file(array, index)
                if sha256(self._load(name, index)).hexdigest() != digest:
                    raise ValueError("it is not the chunk of this place")

            place = self._path / name
            return np.asarray(array[:])
        except (ValueError, RuntimeError) as fault:
            raise self._kind.error(
                f"{place}: damaged ({fault}); make the {self._kind.noun} again"
            ) from fault
        finally:
            self._files.clear()

    def _is_readable(self, name: str, index: tuple[int, ...]) -> bool:
        try:
            self._load(name, index)
            return self.arrays[name].blocks[index] is not None
        except (self._kind.error, ValueError, RuntimeError):
            return False
        finally:
            self._files.clear()

    def _load(self, name: str, index: tuple[int, ...]) -> bytes:
        """Return the bytes of a chunk's file, and put them where Zarr decodes them."""
        array = self.arrays[name]
        data = self._read(name, index)

        if len(array.compressors) > 1:
            # Zarr sets no limit: what decodes to more than a chunk is refused here
            Zstd().decode(data[:-CRC_BYTES], np.empty(array.chunks, array.dtype))

        self._files[_file(array, index)] = cpu.Buffer.from_bytes(data)
        return data

    def _read(self, name: str, index: tuple[int, ...]) -> bytes:
        array = self.arrays[name]
        hint = f"make the {self._kind.noun} again"
        most = max(MIB, 2 * prod(array.chunks) * array.dtype.itemsize)
        kind = replace(
            KINDS["store chunk"], error=self._kind.error, max_bytes=most, hint=hint
        )

        return read_bytes(self._path / _file(array, index), kind)

    def _write(self, attributes: Mapping[str, Any] | None = None) -> None:
        """Write what Zarr has in memory, and the store's attributes, into the
        folder.
        """
        if attributes:
            self._group.update_attributes(dict(attributes))
        for name, content in self._files.items():
            try:
                (self._path / name).parent.mkdir(parents=True, exist_ok=True)
            except OSError as fault:
                raise self._kind.error(
                    f"{self._path / name}: {fault.strerror}"
                ) from fault

            write_whole(content.to_bytes(), self._path / name)

        self._files.clear()


def _file(array: zarr.Array[Any], index: tuple[int, ...]) -> str:
    """Return the file of a chunk within the store; missing indices are 0.

    >>> shape, chunks = (465, 40, 140), (200, 40, 140)
    >>> array = zarr.create_array(
    ...     {}, name="slices", shape=shape, chunks=chunks, dtype="uint8"
    ... )
    >>> _file(array, (1,))
    'slices/c/1/0/0'
    """
    return "/".join(
        [array.basename, "c", *map(str, index), *["0"] * (array.ndim - len(index))]
    )
