"""Build a library on all cores or on a Dask cluster, and keep it in the user's cache.

The cache is the folder that the system keeps for such files (`XDG_CACHE_HOME`, or ~/.cache, on Linux), below
`scleraforce`. A library is built beside its place and renamed when it is whole. A process that finds another one
building the same library waits for it; an interrupted build is continued by the next.
"""

import shutil
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np
from filelock import FileLock
from numpy.typing import NDArray
from platformdirs import user_cache_path

from scleraforce.errors import InputError
from scleraforce.library.plan import LibraryPlan, plan_library
from scleraforce.library.responses import Library
from scleraforce.library.store import (
    create_library,
    open_library,
    write_library_unit,
)
from scleraforce.mechanics.axisymmetric import axisymmetric_path
from scleraforce.mechanics.meridian import MeridianSize
from scleraforce.processes import available_cores, work_units
from scleraforce.study import Study

Floats = NDArray[np.float64]

SOLVED_FORCES = 2.0  # over the largest F/E of the library: what is done beyond it is not felt below


class SolvedPath(NamedTuple):
    """F/E (tip,), m^2, displaced volume (tip,), m^3, and boundaries (tip, boundary, node, 2), m, of a unit."""

    force_d: NDArray[np.float64]
    displaced_d: NDArray[np.float64]
    curves_dbnc: NDArray[np.float32]


@dataclass(frozen=True)
class Building:
    """The outcome of a run: paths in the library, paths that this run solved, its duration."""

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
) -> Building:
    """Build the library of a study, or the remaining part of an interrupted run.

    The result is the same, byte for byte, for any number of workers and interruptions. Processes are spawned: a script
    that calls this keeps its own work under `if __name__ == "__main__"`.

    Args:
        study: the study.
        out: place of the store; an incomplete store of the same plan is completed.
        workers: processes, or those of a cluster (`cluster_workers`); by default one for each core of this process.
        progress: called with the number of paths that are newly done (or found done, at the start).
        solve: solves a path; by default `solve_path`.

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
    return Building(plan.units, len(todo), perf_counter() - start)


def solve_path(plan: LibraryPlan, unit: int) -> SolvedPath:
    """Return the path of a unit, with an open globe, to twice the library's largest force; beyond it is extrapolated.

    Raises:
        SolverError: the path cannot be followed to its last tip.
    """
    thickness_m, iop_ratio = plan.wall(unit)
    tips_m = plan.tip_m if unit < plan.paths else plan.tip_m[: plan.support_tips]
    path = axisymmetric_path(
        plan.radius_m,
        thickness_m,
        plan.poisson_ratio,
        plan.needle_radius_m,
        iop_ratio,
        tips_m=tips_m[1:],
        max_force_ratio_m2=SOLVED_FORCES * plan.grid.max_force_ratio_m2,
        support_rad=plan.support_rad(unit),
        stiffening=plan.stiffening_of(unit),
        size=MeridianSize(plan.grid.elements, plan.grid.layers),
    )
    force_d, displaced_d, curves_dbnc = (
        _gone_on(values, path.tip_m, tips_m) for values in (path.force_ratio_m2, path.displaced_m3, path.curves_sbnc)
    )
    return SolvedPath(force_d, displaced_d, curves_dbnc.astype(np.float32))


def _gone_on(values: NDArray[np.float64], solved_m: NDArray[np.float64], tips_m: NDArray[np.float64]) -> Floats:
    """Return values (solved tip, ...) at all tips (tip,): beyond the last one on the line through the last two."""
    slope = (values[-1] - values[-2]) / (solved_m[-1] - solved_m[-2])
    beyond_m = tips_m[len(solved_m) :] - solved_m[-1]
    return np.concatenate([values, values[-1] + np.multiply.outer(beyond_m, slope)])


KEY_LETTERS = 32  # of the key, in a file name


def library_cache() -> Path:
    """Return the folder of the cache."""
    return user_cache_path("scleraforce") / "libraries"


def cached_library(
    study: Study,
    *,
    folder: Path | None = None,
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
    solve: PathSolver | None = None,
) -> Library:
    """Return the library of a study; the first time it is built, which takes a minute or two.

    `folder` is the cache, by default the user's; `progress` is called only if the library has to be built. The other
    arguments are those of `build_library`.

    Raises:
        InputError: the cache cannot be written.
        SolverError: a path could not be followed.
    """
    folder = folder or library_cache()
    place = folder / f"{version('scleraforce')}-{plan_library(study).key[:KEY_LETTERS]}.zarr"
    if found := _stored(place):
        return found
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with FileLock(place.with_suffix(".lock")):  # it ends with the process that holds it
            if found := _stored(place):  # somebody else has built it meanwhile
                return found
            _build(study, place, workers, progress, solve)
    except OSError as fault:
        raise InputError(f"{folder}: {fault.strerror}; XDG_CACHE_HOME names another folder for caches") from fault
    return open_library(place)


def _stored(place: Path) -> Library | None:
    """Return the library of a place; None if it is missing or damaged."""
    if place.is_dir():
        with suppress(InputError):
            return open_library(place)
    return None


def _build(
    study: Study,
    place: Path,
    workers: int | None,
    progress: Callable[[int], None] | None,
    solve: PathSolver | None,
) -> None:
    """Build a library, or finish an interrupted run, and put it into its place."""
    begun = place.with_suffix(".begun")
    try:
        build_library(study, begun, workers=workers, progress=progress, solve=solve)
    except InputError:  # what was left there cannot be continued
        shutil.rmtree(begun, ignore_errors=True)
        build_library(study, begun, workers=workers, progress=progress, solve=solve)
    if place.exists():
        shutil.rmtree(place)  # it was damaged
    begun.rename(place)
