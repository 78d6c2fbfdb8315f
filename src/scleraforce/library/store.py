"""The library on disk, written path by path, resumable, every array checked (`checked_store`).

A load path is a chunk of each array that it has a part in.
"""

import json
from hashlib import sha256
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from scleraforce.checked_store import CheckedStore, create_array, is_readable
from scleraforce.errors import InputError
from scleraforce.library.base_plane import base_stiffness
from scleraforce.library.plan import LibraryPlan
from scleraforce.library.responses import Library

__all__ = ["complete_store", "create_store", "missing_units", "open_library", "write_unit"]

FORCES, CURVES, SUPPORT_FORCES = "force_ratio", "curves", "support_force_ratio"
AXES = ("thickness_m", "iop_ratio", "tip_m")
VERSIONS = ("scleraforce", "numpy", "scipy", "zarr")
STORE = CheckedStore(
    noun="library",
    command="library",
    verb="make",
    schema="scleraforce-library-1",
    required=frozenset({"complete", "plan", "plan_hash", "key", "seed", "versions"}),
    same=("plan", "key", "versions"),
    error=InputError,
)


def create_store(path: Path, plan: LibraryPlan) -> None:
    """Create the store with its axes and no paths, or take up what a killed run of the same plan has left.

    Raises:
        InputError: `path` holds something else, another library, or a complete one.
    """
    group = STORE.begin(path, _describe(plan))
    for name in AXES:  # the same bytes each time, so a run killed right here does no harm
        values = getattr(plan, name)
        create_array(group, name, values.shape, values.shape, "float64")[:] = values
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
            create_array(group, name, size, (1,) * axes + size[axes:], dtype)


def missing_units(path: Path, plan: LibraryPlan) -> list[int]:
    """Return the numbers of the load paths that are not in the store, or cannot be read there."""
    group = STORE.open_group(path)
    return [unit for unit in range(plan.units) if not _done(group, path, plan, unit)]


def write_unit(
    path: Path, plan: LibraryPlan, unit: int, force_d: NDArray[np.float64], curves_dbnc: NDArray[np.float32]
) -> None:
    """Write one load path: F/E (tip,), m^2, and the boundaries (tip, boundary, node, 2), m, where they are kept."""
    group = STORE.open_group(path, "r+")
    values: dict[str, NDArray[Any]] = {FORCES: force_d, CURVES: curves_dbnc, SUPPORT_FORCES: force_d}
    for name in _arrays_of(plan, unit):
        array = STORE.array(group, path, name)
        array.with_config({"write_empty_chunks": True})[plan.place(unit)] = values[name]


def complete_store(path: Path, plan: LibraryPlan) -> None:
    """Mark the store as complete, and clear what killed runs have left beside their chunks.

    Raises:
        InputError: paths are missing.
    """
    if missing := missing_units(path, plan):
        raise InputError(f"{path}: {len(missing)} of {plan.units} load paths are missing; make it again")
    STORE.finish(path)


def open_library(path: str | PathLike[str]) -> Library:
    """Read a complete library; every chunk's checksum is checked.

    Raises:
        InputError: nothing there, no library, not complete, or damaged.
    """
    path = Path(path)
    group = STORE.open_group(path)
    attributes = STORE.complete_attributes(group, path)
    if sha256(str(attributes["plan"]).encode()).hexdigest() != attributes["plan_hash"]:
        raise InputError(f"{path}: its plan does not match its hash: the store is damaged; make it again")
    plan = json.loads(attributes["plan"])
    names = (*AXES, FORCES, CURVES, SUPPORT_FORCES)
    arrays = {name: STORE.read(STORE.whole_array(group, path, name), path / name) for name in names}
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
        "plan": plan.recipe,
        "plan_hash": sha256(plan.recipe.encode()).hexdigest(),
        "key": plan.key,
        "seed": None,  # nothing is drawn
        "versions": {name: version(name) for name in VERSIONS},
    }


def _arrays_of(plan: LibraryPlan, unit: int) -> tuple[str, ...]:
    """Return the arrays that a unit has a part in."""
    return (CURVES, FORCES) if unit < plan.paths else (SUPPORT_FORCES,)


def _first_unit(plan: LibraryPlan, name: str) -> int:
    return plan.paths if name == SUPPORT_FORCES else 0


def _done(group: zarr.Group, path: Path, plan: LibraryPlan, unit: int) -> bool:
    """Whether all chunks of a path are there and can be read."""
    place = plan.place(unit)
    arrays = {name: STORE.array(group, path, name) for name in _arrays_of(plan, unit)}
    return all(is_readable(array, path / name, place, place) for name, array in arrays.items())
