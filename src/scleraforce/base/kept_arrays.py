"""Arrays that are computed once for a user and kept in the user's cache: a later
process reads them in a tenth of the time.

The name of a file is a hash of all that its array follows from. A file is believed if
it is whole (CRC-32), and lies in a folder that nobody but the user writes to. An array
that cannot be kept is computed again: nothing else depends on it.
"""

import zlib
from collections.abc import Callable
from contextlib import suppress
from hashlib import sha256
from math import prod
from pathlib import Path

import numpy as np
from platformdirs import user_cache_path

from scleraforce.base.arrays import Singles
from scleraforce.base.errors import InputError
from scleraforce.base.private_folder import folder_fault, make_private, read_own
from scleraforce.base.whole_files import renamed_when_whole

ENDING = ".float32"
SUM_BYTES = 4  # of the CRC-32, in front of the values
MOST_FILES = 20  # the oldest are removed: some 6 MB each
LEAST_VALUES = 2**18  # fewer are computed as fast as they are read


def kept_array(
    origin: tuple[str | bytes, ...],
    shape: tuple[int, ...],
    compute: Callable[[], Singles],
) -> Singles:
    """Return an array (*shape), from the user's cache if it is there; else compute and
    keep it.

    `origin` has everything that decides its values: hashes of files and sources,
    versions, numbers as bytes.
    """
    folder = user_cache_path("scleraforce") / "arrays"
    if prod(shape) < LEAST_VALUES or folder_fault(folder) is not None:
        return compute()

    path = folder / f"{_key(origin, shape)}{ENDING}"
    array = _read(path, shape)
    if array is None:
        array = compute()
        # no place, or no right to write there
        with suppress(OSError, InputError):
            _keep(array, path)

    return array


def _key(origin: tuple[str | bytes, ...], shape: tuple[int, ...]) -> str:
    """Return the hash of what decides an array; parts cannot run into one another."""
    return sha256(repr((origin, shape)).encode()).hexdigest()


def _read(path: Path, shape: tuple[int, ...]) -> Singles | None:
    """Return the array of a file; None if there is none, or a damaged one."""
    try:
        content = read_own(path)
    except OSError:
        return None

    values = memoryview(content)[SUM_BYTES:]
    expected = np.dtype(np.float32).itemsize * prod(shape)
    if len(values) != expected or _sum(values) != content[:SUM_BYTES]:
        return None

    # a copy is aligned and can be written to, as computed ones: loops are compiled for
    # such arrays
    return np.frombuffer(values, dtype=np.float32).reshape(shape).copy()


def _keep(array: Singles, path: Path) -> None:
    """Write an array whole or not at all, and remove the oldest ones."""
    make_private(path.parent)
    values = np.ascontiguousarray(array, dtype=np.float32).tobytes()
    with renamed_when_whole(path) as part:
        part.write_bytes(_sum(values) + values)

    kept = sorted(path.parent.glob(f"*{ENDING}"), key=_age)
    for old in kept[:-MOST_FILES]:
        old.unlink(missing_ok=True)


def _age(path: Path) -> float:
    return path.stat().st_mtime


def _sum(values: bytes | memoryview) -> bytes:
    return zlib.crc32(values).to_bytes(SUM_BYTES, "little")
