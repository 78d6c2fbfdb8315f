"""Zarr 3 groups that are written part by part, resumable, and checked when they are read.

Zarr writes a chunk to a temporary name and renames it, so a chunk that exists is whole, and a killed run still has to
do what is missing. At the end the SHA-256 of every chunk goes into the group's attributes, in the order of the chunks:
a chunk that stands in the place of another one is found, which its own checksum cannot tell.

Zarr itself never reads what somebody gives: files are read as regular ones within a size, checked, and then decoded
from memory.
"""

import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import zarr
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.plain_json import parse_json
from scleraforce.stored_array import METADATA_FILE, StoredArray
from scleraforce.whole_files import KINDS, MIB, read_bytes

HASHES = "sha256"  # the attribute with the hashes of an array's chunks, for each array
MAX_ARRAY_SIZE = 8192 * MIB


@dataclass(frozen=True)
class CheckedStore:
    """One kind of store: how messages call it, what its metadata must have, what makes it.

    Attributes:
        noun: what it is, "data set".
        command: the command of scleraforce that makes it; `verb` is the same in a sentence.
        schema: of its format; another one is refused.
        required: attributes that it must have beside the schema.
        same: attributes that a run must share with the one that it continues.
        others: by the beginning of their schemas, what other stores are and what they are for.
        error: the exception that is raised.
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

    def begin(self, path: Path, attributes: Mapping[str, Any]) -> zarr.Group:
        """Create a store that is not complete, or open what a killed run with the same attributes has left."""
        with self.writing(path):
            if _occupied(path):
                return self._continued(path, attributes)
            path.mkdir(parents=True, exist_ok=True)
            described = {"schema": self.schema, "complete": False, **attributes}
            return zarr.create_group(path.absolute(), zarr_format=3, attributes=described)

    def write(self, path: Path, array: StoredArray, part: Any, values: NDArray[Any]) -> None:
        """Write a part of an array: whole chunks."""
        with self.writing(path):
            found = zarr.open_array(path.absolute() / array.name, mode="r+", zarr_format=3)
            found.with_config({"write_empty_chunks": True})[part] = values  # what is missing is not done yet

    def finish(self, path: Path, arrays: Sequence[StoredArray]) -> None:
        """Mark a store as complete, with the hashes of its chunks, and clear what killed runs have left beside them."""
        hashes = {array.name: [sha256(self._chunk(path, array, at)).hexdigest() for at in array.places]
                  for array in arrays}  # fmt: skip
        with self.writing(path):
            for leftover in path.rglob("*.partial"):
                leftover.unlink(missing_ok=True)
            group = zarr.open_group(path.absolute(), mode="r+", zarr_format=3)
            group.update_attributes({HASHES: hashes, "complete": True})

    def check_array(self, path: Path, attributes: Mapping[str, Any], array: StoredArray) -> None:
        """Check that an array of a complete store is what it must be and that none of its chunks is missing."""
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
        """Return the values of an array; the message names the chunk that is damaged."""
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
        """Return whether a chunk is there and can be read; indices that are left out are 0."""
        try:
            return array.decodes(self._chunk(path, array, index))
        except self.error:
            return False

    @contextmanager
    def writing(self, path: Path) -> Iterator[None]:
        """Turn what the system says while a store is written into one line.

        Raises:
            InputError: `error`: the folder cannot be written to, or the disk is full.
        """
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
            raise self.error(f"{path}: {HASHES}: not those of the {count} chunks of {array.name}; {self.verb} it again")
        return found

    def _chunk(self, path: Path, array: StoredArray, index: tuple[int, ...]) -> bytes:
        kind = replace(KINDS["store chunk"], error=self.error, max_bytes=array.max_file_size)
        return read_bytes(path / array.file(index), kind)


def _occupied(path: Path) -> bool:
    """Whether something stands at `path`; an empty directory, or one with a killed run's temporary file, is free."""
    if not path.exists():
        return False
    return not path.is_dir() or any(entry.suffix != ".partial" for entry in path.iterdir())


def _ordinary(path: Path) -> bool:
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:  # a link to nowhere, or a temporary file that has gone
        return not path.is_symlink()
    return stat.S_ISREG(mode) or stat.S_ISDIR(mode)
