"""The library in one file, `library.npz`, as a model folder carries it (NumPy only).

Its walls, and the factors of its forces, are stored in a reduced basis
(`library.stiffened_walls`) and unpacked when they are needed. Their largest errors were
measured when the file was written, and are stored in it. The steps of the basis change
smoothly along the last axis of the rows (the tips, the polar angles): their second
differences are stored, and all is deflated.
"""

from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from io import BytesIO
from math import prod
from os import PathLike
from pathlib import Path
from typing import IO, Any
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np
from numpy.lib.format import (
    read_array,
    read_array_header_1_0,
    read_array_header_2_0,
    read_magic,
    write_array,
)
from numpy.typing import NDArray

from scleraforce.base.arrays import Reals
from scleraforce.base.errors import InputError
from scleraforce.base.whole_files import KINDS, MIB, read_bytes
from scleraforce.library.stiffened_walls import (
    STEP_TYPES,
    LateSteps,
    ReducedCurves,
    ReducedRows,
    Steps,
    StiffenedWalls,
    reduce_rows,
)
from scleraforce.library.wall_responses import Library

AXES = {
    "thickness_m": 1,
    "tension": 1,
    "tip_m": 1,
    "radius_m": 0,
    "poisson_ratio": 0,
    "needle_radius_m": 0,
    "max_force_ratio": 0,
    "polar_rad": 1,
    "contact_polar_rad": 0,
}
# arrays of each stiffening, and their numbers of axes
WALLS = {
    "stiffening": 1,
    "force_ratio_btpd": 4,
    "displaced_btpd": 4,
    "undented_btpbnc": 6,
}
# float32, not reduced: its slope by the pressure counts where it moves by less than 1
# um
UNDENTED = "undented_btpbnc"
ENCRYPTED = 1  # a bit of a ZIP entry's flags
HEAD_BYTES = 256  # of an array: its type and shape take 128
FOR_THE_BASIS = 0.9  # of an error; the rest is for what float32 rounds


@dataclass(frozen=True, kw_only=True)
class StoredErrors:
    """Largest differences of a stored library from the computed one, at its states.

    `curves_m` is of a point of a wall, along each axis; `stiffness` of the factor of a
    force.
    """

    curves_m: float
    stiffness: float


@dataclass(frozen=True, kw_only=True)
class _ReducedArray:
    """An array that is stored in a reduced basis.

    `name` begins the names of its entries; `error` is the entry with its largest error,
    at most `largest_error`. Its first `row_axes` axes make its rows, the other
    `value_axes` the values of a row.
    """

    name: str
    error: str
    row_axes: int
    value_axes: int
    largest_error: float


CURVES = _ReducedArray(
    name="curves",
    error="curves_error_m",
    row_axes=4,
    value_axes=3,
    largest_error=0.02e-6,
)
STIFFNESS = _ReducedArray(
    name="stiffness",
    error="stiffness_error",
    row_axes=2,
    value_axes=2,
    largest_error=1e-6,
)


def save_library(library: Library, path: Path | IO[bytes]) -> StoredErrors:
    """Write a library; equal libraries give equal bytes. The file is for a folder whose
    hashes are checked.

    Raises:
        InputError: the library is too large for a model folder, or cannot be stored
            with the allowed error.
    """
    walls = library.walls
    _check_size(prod(walls.curves.shape))
    curves, of_curves = _reduced(CURVES, walls.curves.whole())
    stiffness, of_stiffness = _reduced(
        STIFFNESS, np.moveaxis(library.stiffness_atpd, 0, 2)
    )
    plain = {name: np.asarray(getattr(library, name)) for name in AXES}
    plain |= {name: np.asarray(getattr(walls, name)) for name in WALLS}

    with ZipFile(path, "w") as archive:
        for name, array in {**plain, **curves, **stiffness}.items():
            entry = ZipInfo(f"{name}.npy")
            entry.compress_type = ZIP_DEFLATED
            with archive.open(entry, "w", force_zip64=True) as file:
                write_array(file, array, allow_pickle=False)

    return StoredErrors(curves_m=of_curves, stiffness=of_stiffness)


def load_library(path: str | PathLike[str], content: bytes | None = None) -> Library:
    """Read a library that `save_library` has written; `content`: its bytes, if they are
    read (and checked) already. Then the steps of its curves are inflated at the first
    need.

    Raises:
        InputError: the file is missing, damaged, or not a library.
    """
    data = (
        read_bytes(Path(path), replace(KINDS["model file"], error=InputError))
        if content is None
        else content
    )
    try:
        with (
            ZipFile(BytesIO(data)) as archive,
            np.errstate(over="ignore", invalid="ignore"),
        ):
            # `Library` checks
            left = KINDS["model file"].max_bytes
            for entry in archive.infolist():
                left -= entry.file_size
                if (
                    entry.compress_type != ZIP_DEFLATED
                    or entry.flag_bits & ENCRYPTED
                    or left < 0
                ):
                    raise ValueError(
                        f"{entry.filename}: not deflated, encrypted, or too large"
                    )

            found: dict[str, Any] = {
                name: _plain(archive, name, axes) for name, axes in AXES.items()
            }
            of_walls: dict[str, Any] = {
                name: _plain(archive, name, axes) for name, axes in WALLS.items()
            }
            shape = tuple(
                len(found[name]) for name in ("thickness_m", "tension", "tip_m")
            )
            rows, values = _stored(
                archive, data, CURVES, (len(of_walls["stiffening"]), *shape)
            )
            curves = ReducedCurves(
                rows,
                (len(of_walls["stiffening"]), *shape, *values),
                file_sha256=sha256(data).hexdigest(),
            )
            if content is None:
                _ = rows.tables  # nobody has checked them

            rows, values = _stored(
                archive, data, STIFFNESS, shape[: STIFFNESS.row_axes]
            )
            stiffness_tpad = (
                rows.rows()
                .astype(np.float32)
                .reshape(*shape[: STIFFNESS.row_axes], *values)
            )
            found["stiffness_atpd"] = np.ascontiguousarray(
                np.moveaxis(stiffness_tpad, 2, 0), dtype=np.float64
            )
            first = float(of_walls["stiffening"][0])

            return Library(
                walls=StiffenedWalls(**of_walls, curves=curves),
                stiffening=first,
                **found,
            )
    except (
        Exception
    ) as fault:  # whatever zipfile and NumPy raise where a file is damaged
        raise InputError(
            f"{path}: not a response library of this version ({fault}); train the model"
            " again"
        ) from fault


def _check_size(values: int) -> None:
    """Check that this many values of float32 fit into a file of a model folder."""
    found = 4 * values
    most = KINDS["model file"].max_bytes
    if found > most:
        raise InputError(
            f"library: its curves have {found // MIB} MiB, a model folder may have"
            f" {most // MIB} MiB of them; make one of fewer thicknesses, tensions, tips"
            " or elements"
        )


def _reduced(
    stored: _ReducedArray, values: Reals
) -> tuple[dict[str, NDArray[Any]], float]:
    """Return the stored entries of an array, by name, and its largest error."""
    rows_rv = values.reshape(prod(values.shape[: stored.row_axes]), -1)
    reduced = reduce_rows(
        rows_rv,
        FOR_THE_BASIS * stored.largest_error,
        along=values.shape[stored.row_axes - 1],
    )

    error = float(
        np.abs(reduced.rows().astype(np.float32) - rows_rv.astype(np.float64)).max()
    )
    if error > stored.largest_error:
        raise InputError(
            f"library: {stored.name} up to {np.abs(values).max():.3g} would be off by"
            f" {error:.3g}, more than {stored.largest_error:g}"
        )

    basis = reduced.basis_kv.reshape(-1, *values.shape[stored.row_axes :])
    differences = {
        f"{stored.name}_{kind}": part
        for kind, part in zip(STEP_TYPES, reduced.tables, strict=True)
    }

    return {
        stored.error: np.asarray(error),
        f"{stored.name}_basis": basis,
        **differences,
    }, error


def _stored(
    archive: ZipFile, data: bytes, stored: _ReducedArray, rows: tuple[int, ...]
) -> tuple[ReducedRows, tuple[int, ...]]:
    """Read an array in a reduced basis with these lengths of its row axes; return its
    rows, whose steps are read from the file's bytes at the first need, and a row's
    shape.
    """
    error = _plain(archive, stored.error, 0)
    if not 0.0 <= error <= stored.largest_error:
        raise ValueError(
            f"{stored.error}: {error}; must be 0 to {stored.largest_error:g}"
        )

    basis = _read(archive, f"{stored.name}_basis", "float32", 1 + stored.value_axes)
    shapes = [_shape(archive, f"{stored.name}_{kind}", kind, 3) for kind in STEP_TYPES]
    wanted = (prod(rows[:-1]), rows[-1])
    parts = sum(shape[0] for shape in shapes)
    if {shape[1:] for shape in shapes} != {wanted} or parts != len(basis):
        raise ValueError(
            f"{stored.name}: steps {shapes} for {prod(rows)} rows of {len(basis)}"
        )

    _check_size(prod(rows) * prod(basis.shape[1:]))
    steps = LateSteps(partial(_inflated, data, stored.name))
    return (
        ReducedRows(basis.reshape(len(basis), prod(basis.shape[1:])), steps),
        basis.shape[1:],
    )


def _inflated(data: bytes, name: str) -> tuple[Steps, ...]:
    """Return the steps of an array in a reduced basis, from a library's bytes; raises
    `InputError`.
    """
    try:
        with ZipFile(BytesIO(data)) as archive:
            return tuple(
                _read(archive, f"{name}_{kind}", kind, 3) for kind in STEP_TYPES
            )
    except Exception as fault:  # as in `load_library`
        raise InputError(
            f"library: its {name} cannot be read ({fault}); train the model again"
        ) from fault


def _plain(archive: ZipFile, name: str, axes: int) -> Any:
    """Read an entry that is not reduced; an array without axes is a number."""
    array = _read(archive, name, "float32" if name == UNDENTED else "float64", axes)
    return array if array.ndim else float(array)


def _read(archive: ZipFile, name: str, wanted: str, axes: int) -> NDArray[Any]:
    """Read an array of a type and a number of axes."""
    _shape(archive, name, wanted, axes)
    return read_array(BytesIO(archive.read(f"{name}.npy")), allow_pickle=False)


def _shape(archive: ZipFile, name: str, wanted: str, axes: int) -> tuple[int, ...]:
    """Return the shape of an array from the begin of its entry; check its type and its
    number of axes.
    """
    entry = archive.getinfo(f"{name}.npy")
    with archive.open(entry) as file:
        head = BytesIO(file.read(HEAD_BYTES))

    read_header = {(1, 0): read_array_header_1_0, (2, 0): read_array_header_2_0}[
        read_magic(head)
    ]
    shape, _, dtype = read_header(head)
    size = prod(shape) * np.dtype(wanted).itemsize

    if (
        dtype != np.dtype(wanted)
        or len(shape) != axes
        or size != entry.file_size - head.tell()
    ):
        raise ValueError(f"{name}: {dtype} {shape} in {entry.file_size} bytes")

    return tuple(shape)
