"""The library in one file, `library.npz`, as a model folder carries it (NumPy only)."""

from dataclasses import fields
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import IO, Any
from zipfile import BadZipFile, ZipFile, ZipInfo

import numpy as np
from numpy.lib.format import read_array, write_array

from scleraforce.errors import InputError
from scleraforce.library.responses import Library

__all__ = ["load_library", "save_library"]


def save_library(library: Library, path: Path | IO[bytes]) -> None:
    """Write a library; equal libraries give equal bytes. The file is for a folder whose hashes are checked."""
    with ZipFile(path, "w") as archive:
        for item in fields(library):
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
    try:
        with ZipFile(path if content is None else BytesIO(content)) as archive:
            found: dict[str, Any] = {item.name: _read(archive, item.name) for item in fields(Library)}
    except (OSError, EOFError, ValueError, KeyError, BadZipFile) as fault:
        raise InputError(f"{path}: not a response library of this version ({fault})") from fault
    return Library(**found)


def _read(archive: ZipFile, name: str) -> Any:
    """Read an array; one without axes is a number."""
    with archive.open(f"{name}.npy") as file:
        array = read_array(file, allow_pickle=False)
    return array if array.ndim else float(array)
