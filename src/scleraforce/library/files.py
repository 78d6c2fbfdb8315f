"""The library in one file, `library.npz`, as a model folder carries it (NumPy only)."""

from dataclasses import Field, fields, replace
from io import BytesIO
from math import prod
from os import PathLike
from pathlib import Path
from typing import IO, Any
from zipfile import ZIP_STORED, ZipFile, ZipInfo

import numpy as np
from numpy.lib.format import read_array, read_array_header_1_0, read_array_header_2_0, read_magic, write_array

from scleraforce.errors import InputError
from scleraforce.library.responses import Library
from scleraforce.whole_files import KINDS, read_bytes

__all__ = ["load_library", "save_library"]

AXES = {
    "thickness_m": 1, "tension": 1, "tip_m": 1, "force_ratio_tpd": 3, "displaced_tpd": 3, "curves_tpdbnc": 6,
    "undented_tpbnc": 5,
    "polar_rad": 1, "stiffness_atpd": 4,
}  # fmt: skip
ENCRYPTED = 1  # a bit of a ZIP entry's flags


def save_library(library: Library, path: Path | IO[bytes]) -> None:
    """Write a library; equal libraries give equal bytes. The file is for a folder whose hashes are checked."""
    with ZipFile(path, "w") as archive:
        for item in _stored():
            with archive.open(ZipInfo(f"{item.name}.npy"), "w", force_zip64=True) as file:
                write_array(file, np.asarray(getattr(library, item.name)), allow_pickle=False)


def load_library(path: str | PathLike[str], content: bytes | None = None) -> Library:
    """Read a library that `save_library` has written.

    Args:
        path: the file.
        content: its bytes, where they have been read (and checked) already.

    Raises:
        InputError: the file is missing, damaged, or no library.
    """
    data = read_bytes(Path(path), replace(KINDS["model file"], error=InputError)) if content is None else content
    try:
        with ZipFile(BytesIO(data)) as archive:
            found: dict[str, Any] = {item.name: _read(archive, item.name, len(data)) for item in _stored()}
        return Library(**found)
    except Exception as fault:  # whatever zipfile and NumPy raise where a file is damaged
        raise InputError(f"{path}: not a response library of this version ({fault})") from fault


def _stored() -> list[Field[Any]]:
    """What of a library is stored; the rest follows from it."""
    return [item for item in fields(Library) if item.init]


def _read(archive: ZipFile, name: str, most: int) -> Any:
    """Read an array of at most so many bytes, as it is written here; one without axes is a number."""
    entry = archive.getinfo(f"{name}.npy")
    if entry.compress_type != ZIP_STORED or entry.flag_bits & ENCRYPTED or entry.file_size > most:
        raise ValueError(f"{name}: compressed, encrypted or larger than the file")
    data = archive.read(entry)
    file = BytesIO(data)
    read_header = {(1, 0): read_array_header_1_0, (2, 0): read_array_header_2_0}[read_magic(file)]
    shape, _, dtype = read_header(file)
    wanted = "float32" if name in ("curves_tpdbnc", "undented_tpbnc") else "float64"
    size = prod(shape) * np.dtype(wanted).itemsize
    if dtype != np.dtype(wanted) or len(shape) != AXES.get(name, 0) or size != len(data) - file.tell():
        raise ValueError(f"{name}: {dtype} {shape} in {len(data)} bytes")
    array = read_array(BytesIO(data), allow_pickle=False)
    return array if array.ndim else float(array)
