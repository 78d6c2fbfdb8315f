"""The library on disk: a Zarr 3 group, every array checked by CRC-32C, written path by path, and resumable.

A load path is a chunk of each array that it has a part in. Zarr writes a chunk to a temporary name and renames it, so
a chunk that exists is whole, and a killed run still has to do what is missing.
"""

import json
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.codecs import Crc32cCodec

from scleraforce.errors import InputError
from scleraforce.library.base_plane import base_stiffness
from scleraforce.library.plan import LibraryPlan
from scleraforce.library.responses import Library

__all__ = ["complete_store", "create_store", "missing_units", "open_library", "write_unit"]

SCHEMA = "scleraforce-library-1"
FORCES, CURVES, SUPPORT_FORCES = "force_ratio", "curves", "support_force_ratio"
AXES = ("thickness_m", "iop_ratio", "tip_m")
VERSIONS = ("scleraforce", "numpy", "scipy", "zarr")
ATTRIBUTES = {"schema", "complete", "plan", "plan_hash", "key", "seed", "versions"}


def create_store(path: Path, plan: LibraryPlan) -> None:
    """Create the store with its axes and no paths, or take up what a killed run of the same plan has left.

    Raises:
        InputError: `path` holds something else, another library, or a complete one.
    """
    attributes = _describe(plan)
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        group = _continued(path, attributes)
    else:
        group = zarr.open_group(path.absolute(), mode="w", zarr_format=3)
        group.update_attributes(attributes)
    for name in AXES:  # the same bytes each time, so a run killed right here does no harm
        values = getattr(plan, name)
        _create_array(group, name, values.shape, values.shape, "float64")[:] = values
    shape = (len(plan.thickness_m), len(plan.iop_ratio), len(plan.tip_m))
    curves = (*shape, 2, plan.nodes, 2)
    supports = (*plan.support_shape, plan.support_tips)
    for name, size, dtype in (
        (CURVES, curves, "float32"),
        (FORCES, shape, "float64"),
        (SUPPORT_FORCES, supports, "float64"),
    ):
        if name not in group:
            axes = len(plan.place(_first_unit(plan, name)))
            _create_array(group, name, size, (1,) * axes + size[axes:], dtype)


def missing_units(path: Path, plan: LibraryPlan) -> list[int]:
    """Return the numbers of the load paths that are not in the store, or cannot be read there."""
    group = _open_group(path, "r")
    return [unit for unit in range(plan.units) if not _done(group, path, plan, unit)]


def write_unit(
    path: Path, plan: LibraryPlan, unit: int, force_d: NDArray[np.float64], curves_dbnc: NDArray[np.float32]
) -> None:
    """Write one load path: F/E (tip,), m^2, and the boundaries (tip, boundary, node, 2), m, where they are kept."""
    group = _open_group(path, "r+")
    values: dict[str, NDArray[Any]] = {FORCES: force_d, CURVES: curves_dbnc, SUPPORT_FORCES: force_d}
    for name in _arrays_of(plan, unit):
        _array(group, path, name).with_config({"write_empty_chunks": True})[plan.place(unit)] = values[name]


def complete_store(path: Path, plan: LibraryPlan) -> None:
    """Mark the store as complete, and clear what killed runs have left beside their chunks.

    Raises:
        InputError: paths are missing.
    """
    if missing := missing_units(path, plan):
        raise InputError(f"{path}: {len(missing)} of {plan.units} load paths are missing; make it again")
    for leftover in path.rglob("*.partial"):
        leftover.unlink(missing_ok=True)
    _open_group(path, "r+").attrs["complete"] = True


def open_library(path: Path) -> Library:
    """Read a complete library; every chunk's checksum is checked.

    Raises:
        InputError: nothing there, no library, not complete, or damaged.
    """
    group = _open_group(path, "r")
    attributes = _attributes(group, path)
    if attributes["complete"] is not True:
        raise InputError(f"{path}: not complete; the same `scleraforce library` completes it")
    if sha256(str(attributes["plan"]).encode()).hexdigest() != attributes["plan_hash"]:
        raise InputError(f"{path}: its plan does not match its hash: the store is damaged; make it again")
    plan = json.loads(attributes["plan"])
    arrays = {name: _read(group, path, name) for name in (*AXES, FORCES, CURVES, SUPPORT_FORCES)}
    thickness_m, iop_ratio, tip_m = (arrays[name] for name in AXES)
    polar_rad, stiffness_atpd = base_stiffness(thickness_m, iop_ratio, tip_m, arrays[FORCES], arrays[SUPPORT_FORCES])
    return Library(
        thickness_m=thickness_m,
        iop_ratio=iop_ratio,
        tip_m=tip_m,
        force_ratio_tpd=arrays[FORCES],
        curves_tpdbnc=arrays[CURVES],
        radius_m=float(plan["radius_m"]),
        poisson_ratio=float(plan["poisson_ratio"]),
        needle_radius_m=float(plan["needle_radius_m"]),
        max_force_ratio=float(plan["grid"]["max_force_ratio_m2"]),
        polar_rad=polar_rad,
        stiffness_atpd=stiffness_atpd,
        contact_polar_rad=float(plan["contact_polar_rad"]),
    )


def _describe(plan: LibraryPlan) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "complete": False,
        "plan": plan.recipe,
        "plan_hash": sha256(plan.recipe.encode()).hexdigest(),
        "key": plan.key,
        "seed": None,  # nothing is drawn
        "versions": {name: version(name) for name in VERSIONS},
    }


def _continued(path: Path, attributes: dict[str, Any]) -> zarr.Group:
    """Open the store of a killed run that the run of `attributes` may complete."""
    try:
        found = _attributes(_open_group(path, "r"), path)
    except InputError as fault:
        raise InputError(f"{path}: holds something else than a library; choose another path") from fault
    if found["complete"]:
        raise InputError(f"{path}: a complete library; remove it or choose another path")
    for name in ("plan", "key", "versions"):
        if found[name] != attributes[name]:
            raise InputError(f"{path}: begun with another {name}; remove it or choose another path")
    return _open_group(path, "r+")


def _create_array(
    group: zarr.Group, name: str, shape: tuple[int, ...], chunks: tuple[int, ...], dtype: str
) -> zarr.Array[Any]:
    return group.create_array(
        name, shape=shape, chunks=chunks, dtype=dtype, filters=None, compressors=[Crc32cCodec()], overwrite=True
    )


def _open_group(path: Path, mode: Any) -> zarr.Group:
    if not path.is_dir():
        raise InputError(f"{path}: no such library; `scleraforce library --out {path}` makes one")
    try:
        return zarr.open_group(path.absolute(), mode=mode, zarr_format=3)
    except (OSError, ValueError, KeyError, TypeError) as fault:
        raise InputError(f"{path}: not a library of scleraforce: {fault}") from fault


def _attributes(group: zarr.Group, path: Path) -> dict[str, Any]:
    attributes = dict(group.attrs)
    if attributes.get("schema") != SCHEMA:
        raise InputError(f"{path}: schema {attributes.get('schema')!r}; this version reads {SCHEMA!r}")
    if missing := ATTRIBUTES - attributes.keys():
        raise InputError(f"{path}: attributes {', '.join(sorted(missing))} are missing; make it again")
    return attributes


def _array(group: zarr.Group, path: Path, name: str) -> zarr.Array[Any]:
    try:
        array = group[name]
    except (OSError, ValueError, KeyError, TypeError) as fault:
        raise InputError(f"{path / name}: the array is missing or its zarr.json is damaged") from fault
    if not isinstance(array, zarr.Array):
        raise InputError(f"{path / name}: not an array")
    if not any(isinstance(codec, Crc32cCodec) for codec in array.compressors):
        raise InputError(f"{path / name}: without checksums; make it again")
    return array


def _read(group: zarr.Group, path: Path, name: str) -> NDArray[Any]:
    array = _array(group, path, name)
    if array.nchunks_initialized != array.nchunks:  # Zarr would read what is missing as zeros
        missing = array.nchunks - array.nchunks_initialized
        raise InputError(f"{path / name}: {missing} of {array.nchunks} chunks are missing; make it again")
    try:
        return np.asarray(array[:])
    except Exception as fault:  # whatever a codec raises, the array cannot be read
        raise InputError(f"{path / name}: damaged ({fault}); make it again") from fault


def _arrays_of(plan: LibraryPlan, unit: int) -> tuple[str, ...]:
    """Return the arrays that a unit has a part in."""
    return (CURVES, FORCES) if unit < plan.paths else (SUPPORT_FORCES,)


def _first_unit(plan: LibraryPlan, name: str) -> int:
    return plan.paths if name == SUPPORT_FORCES else 0


def _done(group: zarr.Group, path: Path, plan: LibraryPlan, unit: int) -> bool:
    """Whether all chunks of a path are there and can be read."""
    place = plan.place(unit)
    for name in _arrays_of(plan, unit):
        array = _array(group, path, name)
        chunk = path.joinpath(
            name, "c", *map(str, place), *["0"] * (array.ndim - len(place))
        )  # Zarr 3, default chunk keys
        try:
            if not chunk.exists():
                return False
            array[place]
        except Exception:  # whatever a codec raises, the path has to be made again
            return False
    return True
