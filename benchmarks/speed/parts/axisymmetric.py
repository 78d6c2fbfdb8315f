"""The wall of revolution: one path, and the library of all of them."""

from dataclasses import replace
from time import perf_counter
from typing import Any

from scleraforce.base.worker_processes import available_cores
from scleraforce.library.library_plan import plan_library
from scleraforce.library.library_store import build_library, solve_path
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_strain_wall import bend_eye
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.records.study import Study
from speed.record import Row, Table, spread
from speed.run import Run, in_turns

# in the run's folder
LIBRARY = "library.zarr"
EVEN = "even.zarr"
PATH_GOAL_S = 0.05
LIBRARY_GOAL_S = 8.0
PATHS_AT_ONCE = 8  # from thin to thick walls
SOLID = "one path in three dimensions"
SOLID_EYE: dict[str, Any] = {
    "thickness_m": 0.6e-3,
    "youngs_modulus_pa": 0.3e6,
    "iop_pa": 266.0,
}
SETTINGS = """Load paths of a neo-Hookean wall under the needle at the pole, as the
response library tabulates them. Nobody else tabulates; the prototype that this project
was given took 24 s for 70 paths on two cores, on another day."""


def measure(run: Run) -> Table:
    """Time single paths in turns with one in 3-D, and the library of the study."""
    study = run.study
    even = replace(study, library=replace(study.library, stiffenings=1))
    plan = plan_library(even)
    whole = plan_library(study)
    solve_path(plan, 0)
    some = run.count(PATHS_AT_ONCE, 2)
    units = [plan.units * number // some for number in range(some)]
    work = {
        "one axisymmetric path": lambda: [solve_path(plan, unit) for unit in units],
        SOLID: lambda: bend_eye(
            study,
            Contact(polar_rad=0.6),
            PathEnd(max_force=run.count(30, 3) * 1e-3),
            **SOLID_EYE,
        ),
    }
    taken = in_turns(work, run.count(2, 1))
    path_s = spread(
        [seconds / len(units) for seconds in taken["one axisymmetric path"]]
    )
    solid_s = spread(taken[SOLID])
    even_s = _library_seconds(even, run, EVEN)
    library_s = _library_seconds(study, run, LIBRARY)
    cores = available_cores()

    return Table(
        "Axisymmetric paths and the library",
        SETTINGS,
        (
            Row(
                what="one axisymmetric path",
                unit="s",
                **path_s,
                beside=SOLID,
                beside_value=solid_s["value"],
                goal=PATH_GOAL_S,
                settings=(
                    f"mean of {len(units)} of the library's walls, {plan.grid.tips}"
                    " dents each; one process, compiled loops"
                ),
            ),
            Row(
                what=SOLID,
                unit="s",
                **solid_s,
                settings="`bend_eye` on the graded mesh, 0.6 mm, to 30 mN",
            ),
            Row(
                what=f"library of {plan.units} paths, tissue that does not stiffen",
                value=even_s,
                unit="s",
                beside=f"{plan.units} paths one after the other",
                beside_value=plan.units * path_s["value"],
                goal=LIBRARY_GOAL_S,
                settings=(
                    f"`scleraforce library`, {cores} processes, from their start to the"
                    " complete store; made once"
                ),
            ),
            Row(
                what=(
                    f"library of {whole.units} paths, tissue of"
                    f" {study.library.stiffenings} stiffenings"
                ),
                value=library_s,
                unit="s",
                settings="the default library",
            ),
        ),
    )


def _library_seconds(study: Study, run: Run, name: str) -> float:
    start = perf_counter()
    built = build_library(study, run.folder / name)
    if built.solved != built.paths:
        raise RuntimeError(f"{built.solved} paths were solved, not {built.paths}")
    return perf_counter() - start
