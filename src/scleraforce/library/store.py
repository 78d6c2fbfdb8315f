"""The library on disk, written path by path, resumable, every array checked (`checked_store`).

A load path is a chunk of each array that it has a part in.
"""

from hashlib import sha256
from importlib.metadata import version
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scleraforce.arrays import Floats
from scleraforce.checked_store import CheckedStore, StoredArray, StoreKind
from scleraforce.errors import InputError
from scleraforce.library.base import base_stiffness
from scleraforce.library.plan import LibraryPlan, parse_plan
from scleraforce.library.responses import Library, library_of
from scleraforce.library.stiffened import StiffenedWalls, WholeCurves

FORCES, DISPLACED, CURVES, SUPPORT_FORCES = "force_ratio", "displaced_m3", "curves", "support_force_ratio"
AXES = ("stiffening", "thickness_m", "tension", "tip_m")
VERSIONS = ("scleraforce", "numpy", "scipy", "zarr")
KIND = StoreKind(
    noun="library",
    command="library",
    verb="make",
    parts="load paths",
    schema="scleraforce-library-4",
    recipe="plan",
    required=frozenset({"complete", "plan", "plan_hash", "key", "seed", "versions"}),
    same=("plan", "key", "versions"),
    others={"scleraforce-dataset": "a data set and no response library; `train --kind classifier` learns from it"},
    error=InputError,
)


def library_store(path: Path, plan: LibraryPlan) -> CheckedStore:
    """Return the store of a plan; each load path, free or supported, is a unit with a chunk of each of its arrays."""
    units = [
        dict.fromkeys((CURVES, DISPLACED, FORCES) if unit < plan.paths else (SUPPORT_FORCES,), plan.place(unit))
        for unit in range(plan.units)
    ]
    return CheckedStore(KIND, path, _arrays(plan), units)


def create_library(path: Path, plan: LibraryPlan) -> CheckedStore:
    """Create the store with its axes and no paths, or continue an interrupted run of the same plan.

    Raises:
        InputError: `path` holds something else, another library, or a complete one.
    """
    store = library_store(path, plan)
    described = {
        "plan": plan.recipe,
        "plan_hash": sha256(plan.recipe.encode()).hexdigest(),
        "key": plan.key,
        "seed": None,  # nothing is drawn
        "versions": {name: version(name) for name in VERSIONS},
    }
    store.begin(described, {name: getattr(plan, name) for name in AXES})
    return store


def write_library_unit(
    store: CheckedStore, unit: int, force_d: Floats, displaced_d: Floats, curves_dbnc: NDArray[np.float32]
) -> None:
    """Write the stored part of one load path (`build.SolvedPath`)."""
    store.write(unit, {FORCES: force_d, DISPLACED: displaced_d, CURVES: curves_dbnc, SUPPORT_FORCES: force_d})


def open_library(path: str | PathLike[str]) -> Library:
    """Read a complete library; every chunk's checksum is checked.

    Raises:
        InputError: missing, not a library, not complete, or damaged.

    >>> import scleraforce as sf
    >>> library = sf.open_library("responses")
    >>> print(f"a wall of {library.radius_m * 1e3:g} mm radius")
    a wall of 12 mm radius
    """
    path = Path(path)
    attributes = KIND.complete_attributes(path)
    plan = parse_plan(attributes["plan"], f"{path}: plan")
    store = CheckedStore(KIND, path, _arrays(plan), attributes=attributes)
    store.check()
    arrays = {name: store.read(name) for name in store.arrays}
    for name in AXES:
        if not np.allclose(arrays[name], getattr(plan, name), rtol=1e-12, atol=0.0):
            raise InputError(f"{path / name}: not the values of its plan: the store is damaged; make it again")
    stiffening, thickness_m, tension, tip_m = (arrays[name] for name in AXES)
    forces, displaced, curves = arrays[FORCES], arrays[DISPLACED], WholeCurves(arrays[CURVES])
    resting = np.ascontiguousarray(arrays[CURVES][:, :, :, 0])
    walls = StiffenedWalls(
        stiffening=stiffening, force_ratio_btpd=forces, displaced_btpd=displaced, undented_btpbnc=resting, curves=curves
    )
    polar_rad, stiffness_atpd = base_stiffness(thickness_m, tension, tip_m, forces[0], arrays[SUPPORT_FORCES])
    of_plan = ("radius_m", "poisson_ratio", "needle_radius_m", "contact_polar_rad")
    others = {name: arrays[name] for name in AXES[1:]} | {name: getattr(plan, name) for name in of_plan}
    others |= {
        "max_force_ratio": plan.grid.max_force_ratio_m2,
        "polar_rad": polar_rad,
        "stiffness_atpd": stiffness_atpd,
    }
    return library_of(walls, **others)


def _arrays(plan: LibraryPlan) -> dict[str, StoredArray]:
    """Return the arrays of a library by name: the axes, and what a load path has a chunk of."""
    shape = (len(plan.stiffening), len(plan.thickness_m), len(plan.tension), len(plan.tip_m))
    supports = (*plan.support_shape, plan.support_tips)
    axes = [StoredArray(name, (size,), (size,), "float64") for name, size in zip(AXES, shape, strict=True)]
    paths = (
        StoredArray(CURVES, (*shape, 2, plan.nodes, 2), (1, 1, 1, shape[3], 2, plan.nodes, 2), "float32"),
        StoredArray(FORCES, shape, (1, 1, 1, shape[3]), "float64"),
        StoredArray(DISPLACED, shape, (1, 1, 1, shape[3]), "float64"),
        StoredArray(SUPPORT_FORCES, supports, (1, 1, 1, *supports[3:]), "float64"),
    )
    return {array.name: array for array in (*axes, *paths)}
