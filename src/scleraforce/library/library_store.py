"""The library on disk: built on all cores or on a Dask cluster, read, and kept in the
user's cache.

It is written path by path, resumable, and every array is checked (`checked_store`); a
load path is a chunk of each array that it has a part in. The cache is the folder that
the system keeps for such files (`XDG_CACHE_HOME`, or ~/.cache, on Linux), below
`scleraforce`. A library is built beside its place and renamed when it is whole. A
process that finds another one building the same library waits for it; an interrupted
build is continued by the next.
"""

import shutil
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np
from filelock import FileLock
from numpy.typing import NDArray
from platformdirs import user_cache_path

from scleraforce.base.arrays import Floats
from scleraforce.base.checked_store import CheckedStore, Layout, StoreKind, layout
from scleraforce.base.errors import InputError
from scleraforce.base.worker_processes import available_cores, work_units
from scleraforce.library.library_plan import LibraryPlan, parse_plan, plan_library
from scleraforce.library.moving_base import base_stiffness
from scleraforce.library.stiffened_walls import StiffenedWalls, WholeCurves
from scleraforce.library.wall_responses import Library
from scleraforce.mechanics.axisymmetric_wall import EvenWall, axisymmetric_path
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.meridian_elements import MeridianSize
from scleraforce.records.study import Study

FORCES = "force_ratio"
DISPLACED = "displaced_m3"
CURVES = "curves"
SUPPORT_FORCES = "support_force_ratio"
AXES = ("stiffening", "thickness_m", "tension", "tip_m")
VERSIONS = ("scleraforce", "numpy", "scipy", "zarr")
KIND = StoreKind(
    noun="library",
    command="library",
    parts="load paths",
    schema="scleraforce-library-4",
    recipe="plan",
    others={
        "scleraforce-dataset": (
            "a data set and no response library; `train kind=classifier` learns from it"
        )
    },
    error=InputError,
)


def library_store(path: Path, plan: LibraryPlan) -> CheckedStore:
    """Return the store of a plan; each load path, free or supported, is a unit with a
    chunk of each of its arrays.
    """
    units = [
        dict.fromkeys(
            (CURVES, DISPLACED, FORCES) if unit < plan.paths else (SUPPORT_FORCES,),
            plan.place(unit),
        )
        for unit in range(plan.units)
    ]
    return CheckedStore(KIND, path, _layouts(plan), units)


def create_library(path: Path, plan: LibraryPlan) -> CheckedStore:
    """Create the store with its axes and no paths, or continue an interrupted run of
    the same plan.

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
    store: CheckedStore,
    unit: int,
    force_d: Floats,
    displaced_d: Floats,
    curves_dbnc: NDArray[np.float32],
) -> None:
    """Write the stored part of one load path (`SolvedPath`)."""
    store.write(
        unit,
        {
            FORCES: force_d,
            DISPLACED: displaced_d,
            CURVES: curves_dbnc,
            SUPPORT_FORCES: force_d,
        },
    )


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
    store = CheckedStore(KIND, path, _layouts(plan), attributes=attributes)
    arrays = {name: store.read(name) for name in store.arrays}

    for name in AXES:
        if not np.allclose(arrays[name], getattr(plan, name), rtol=1e-12, atol=0.0):
            raise InputError(
                f"{path / name}: not the values of its plan: the store is damaged; make"
                " it again"
            )

    walls = StiffenedWalls(
        stiffening=arrays["stiffening"],
        force_ratio_btpd=arrays[FORCES],
        displaced_btpd=arrays[DISPLACED],
        undented_btpbnc=np.ascontiguousarray(arrays[CURVES][:, :, :, 0]),
        curves=WholeCurves(arrays[CURVES]),
    )
    thickness_m, tension, tip_m = (arrays[name] for name in AXES[1:])
    forces = arrays[FORCES][0]
    supported = arrays[SUPPORT_FORCES]
    polar_rad, stiffness_atpd = base_stiffness(
        thickness_m, tension, tip_m, forces, supported
    )

    return Library(
        thickness_m=thickness_m,
        tension=tension,
        tip_m=tip_m,
        walls=walls,
        stiffening=float(walls.stiffening[0]),
        radius_m=plan.radius_m,
        poisson_ratio=plan.poisson_ratio,
        needle_radius_m=plan.needle_radius_m,
        max_force_ratio=plan.grid.max_force_ratio_m2,
        polar_rad=polar_rad,
        stiffness_atpd=stiffness_atpd,
        contact_polar_rad=plan.contact_polar_rad,
    )


def _layouts(plan: LibraryPlan) -> dict[str, Layout]:
    """Return the layouts of a library's arrays: the axes, and what a load path has a
    chunk of.
    """
    shape = (
        len(plan.stiffening),
        len(plan.thickness_m),
        len(plan.tension),
        len(plan.tip_m),
    )
    supports = (*plan.support_shape, plan.support_tips)
    path = (1, 1, 1, shape[3])

    return {
        name: layout((size,), (size,), "float64")
        for name, size in zip(AXES, shape, strict=True)
    } | {
        CURVES: layout(
            (*shape, 2, plan.nodes, 2), (*path, 2, plan.nodes, 2), "float32"
        ),
        FORCES: layout(shape, path, "float64"),
        DISPLACED: layout(shape, path, "float64"),
        SUPPORT_FORCES: layout(supports, (1, 1, 1, *supports[3:]), "float64"),
    }


# over the largest F/E of the library: what is done beyond it is not felt below
SOLVED_FORCES = 2.0


class SolvedPath(NamedTuple):
    """F/E (tip,), m^2, displaced volume (tip,), m^3, and boundaries (tip, boundary,
    node, 2), m, of a unit.
    """

    force_d: Floats
    displaced_d: Floats
    curves_dbnc: NDArray[np.float32]


@dataclass(frozen=True)
class LibraryBuild:
    """The outcome of a run: paths in the library, paths that this run solved, its
    duration.
    """

    paths: int
    solved: int
    seconds: float


PathSolver = Callable[[LibraryPlan, int], SolvedPath]


def build_library(
    study: Study,
    out: Path,
    *,
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
    solve: PathSolver | None = None,
) -> LibraryBuild:
    """Build the library of a study, or the remaining part of an interrupted run.

    The result is the same, byte for byte, for any number of workers and interruptions.
    Processes are spawned: a script that calls this keeps its own work under `if
    __name__ == "__main__"`.

    Args:
        study: the study.
        out: place of the store; an incomplete store of the same plan is completed.
        workers: processes, here or on a cluster (`cluster_workers`); by default one for
            each core of this process.
        progress: called with the number of paths that are newly done (or found done, at
            the start).
        solve: solves a path, by default `solve_path`.

    Raises:
        InputError: `out` holds something else, another or a complete library.
        SolverError: a path could not be followed.
    """
    start = perf_counter()
    if workers is not None and workers < 1:
        raise InputError(f"workers: {workers}; give at least 1")

    report = progress or (lambda _: None)
    plan = plan_library(study)
    store = create_library(out, plan)
    todo = store.missing()
    report(plan.units - len(todo))
    prepare = partial(partial, solve or solve_path, plan)

    with closing(work_units(prepare, todo, workers or available_cores())) as results:
        for unit, path in results:
            write_library_unit(store, unit, *path)
            report(1)

    store.finish()
    return LibraryBuild(plan.units, len(todo), perf_counter() - start)


def solve_path(plan: LibraryPlan, unit: int) -> SolvedPath:
    """Return the path of a unit in an open globe, extrapolated beyond twice the
    library's largest force.
    """
    planned = plan.path(unit)
    wall = EvenWall(
        plan.radius_m,
        planned.thickness_m,
        plan.poisson_ratio,
        plan.needle_radius_m,
        planned.stiffening,
        planned.support_rad,
        MeridianSize(plan.grid.elements, plan.grid.layers),
    )
    end = PathEnd(
        tips_m=planned.tip_m[1:],
        max_force=SOLVED_FORCES * plan.grid.max_force_ratio_m2,
    )
    path = axisymmetric_path(wall, planned.iop_ratio, end)
    beyond_m = planned.tip_m[len(path.tip_m) :] - path.tip_m[-1]
    step_m = path.tip_m[-1] - path.tip_m[-2]

    def extrapolated(values: Floats) -> Floats:
        """Return values (solved tip, ...) at all tips: beyond the last one on the line
        through the last two.
        """
        return np.concatenate(
            [
                values,
                values[-1]
                + np.multiply.outer(beyond_m, (values[-1] - values[-2]) / step_m),
            ]
        )

    force_d = extrapolated(path.force_ratio_m2)
    displaced_d = extrapolated(path.displaced_m3)
    return SolvedPath(
        force_d, displaced_d, extrapolated(path.curves_sbnc).astype(np.float32)
    )


KEY_LETTERS = 32  # of the key, in a file name


def cached_library(
    study: Study,
    *,
    folder: Path | None = None,
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
    solve: PathSolver | None = None,
) -> Library:
    """Return the library of a study; the first time it is built, which takes a minute
    or two.

    `folder` is the cache, by default the user's; `progress` is called only if the
    library has to be built. Other arguments and errors as for `build_library`; a cache
    that cannot be written raises `InputError`.
    """
    folder = folder or user_cache_path("scleraforce") / "libraries"
    place = (
        folder
        / f"{version('scleraforce')}-{plan_library(study).key[:KEY_LETTERS]}.zarr"
    )
    if found := _stored(place):
        return found

    try:
        folder.mkdir(parents=True, exist_ok=True)
        with FileLock(place.with_suffix(".lock")):
            # it ends with the process that holds it
            if found := _stored(place):  # another process has built it meanwhile
                return found

            begun = place.with_suffix(".begun")
            build = partial(
                build_library,
                study,
                begun,
                workers=workers,
                progress=progress,
                solve=solve,
            )

            try:
                build()
            except InputError:  # the content of `begun` cannot be continued
                shutil.rmtree(begun, ignore_errors=True)
                build()

            if place.exists():
                shutil.rmtree(place)  # it was damaged

            begun.rename(place)
    except OSError as fault:
        raise InputError(
            f"{folder}: {fault.strerror}; XDG_CACHE_HOME names another folder for"
            " caches"
        ) from fault

    return open_library(place)


def _stored(place: Path) -> Library | None:
    """Return the library of a place; None if it is missing or damaged."""
    if place.is_dir():
        with suppress(InputError):
            return open_library(place)
    return None
