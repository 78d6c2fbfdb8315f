"""Build a library on all cores or on a Dask cluster: plan it, solve what the store lacks, mark it complete."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.library.plan import LibraryPlan, plan_library
from scleraforce.library.store import complete_library, create_library, missing_library_units, write_library_unit
from scleraforce.mechanics.axisymmetric.mesh import MeridianSize
from scleraforce.mechanics.axisymmetric.path import axisymmetric_path
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
    """What a run has done: paths in the library, those of them solved by this run, its duration."""

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
    """Build the library of a study, or the part of it that an interrupted run has left to do.

    The result is the same, byte for byte, for any number of workers and interruptions. Processes are spawned: a script
    that calls this keeps its own work under `if __name__ == "__main__"`.

    Args:
        study: the study.
        out: where the store goes; an incomplete store of the same plan is completed.
        workers: processes, or those of a cluster (`cluster_workers`); None: one for each core that this process may
            use.
        progress: called with the number of paths that are newly done (or found done, at the start).
        solve: what solves a path, for tests; None: `solve_path`.

    Raises:
        InputError: `out` holds something else, another or a complete library.
        SolverError: a path could not be followed.
    """
    start = perf_counter()
    if workers is not None and workers < 1:
        raise InputError(f"workers: {workers}; give at least 1")
    report = progress or (lambda _: None)
    plan = plan_library(study)
    create_library(out, plan)
    todo = missing_library_units(out, plan)
    report(plan.units - len(todo))
    prepare = partial(partial, solve or solve_path, plan)
    with closing(work_units(prepare, todo, workers or available_cores())) as results:
        for unit, path in results:
            write_library_unit(out, plan, unit, *path)
            report(1)
    complete_library(out, plan)
    return Building(plan.units, len(todo), perf_counter() - start)


def solve_path(plan: LibraryPlan, unit: int) -> SolvedPath:
    """Return the path of a unit, with an open globe.

    It is solved up to a force of twice the largest that the library is asked for, and goes straight on from there.

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
