"""Generate a data set on all cores or on a cluster: plan it, simulate what the store lacks, mark it complete.

Workers of linear mechanics share their factored wall with the next unit.
"""

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from scleraforce.cluster import ClusterWorkers
from scleraforce.dataset.modulus import CalibratedModulus
from scleraforce.dataset.plan import DatasetPlan, draft_plan, plan_dataset
from scleraforce.dataset.samples import SampleSimulator, library_slices, near_library
from scleraforce.dataset.store import complete_dataset, create_dataset, missing_dataset_units, write_dataset_unit
from scleraforce.errors import DatasetError
from scleraforce.library import Library
from scleraforce.processes import available_cores, work_units
from scleraforce.study import Study, format_study, parse_study
from scleraforce.study.unused import refuse_unused

Slices = NDArray[np.uint8]


@dataclass(frozen=True)
class Generation:
    """What a run has done: samples in the data set, those of them simulated by this run, its duration."""

    images: int
    simulated: int
    seconds: float

    @property
    def images_per_second(self) -> float:
        """Rate of this run."""
        return self.simulated / self.seconds


def generate_dataset(
    study: Study,
    out: Path,
    *,
    youngs_modulus_pa: float | None = None,
    calibration: CalibratedModulus | None = None,
    library: Library | None = None,
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Generation:
    """Simulate the data set of a study, or the part of it that an interrupted run has left to do.

    The result is the same, byte for byte, for any number of workers and interruptions. The workers are spawned: a
    script that calls this keeps its own work under `if __name__ == "__main__"`.

    Args:
        study: the study.
        out: where the store goes; an incomplete store of the same study is completed.
        youngs_modulus_pa: Young's modulus; None: the study's, or the one of `calibration`.
        calibration: where the modulus comes from, recorded in the store.
        library: responses at finite strain to draw from; None: linear mechanics.
        workers: processes of linear mechanics, or the workers of a cluster (`cluster_workers`); None: a process for
            each core that this one may use. Drawing from a library is done by a cluster or here.
        progress: called with the number of samples that are newly done (or found done, at the start).

    Raises:
        DatasetError: `out` holds something else, another run, or a complete data set.
        StudyError: the study has keys that its mechanics does not use (`study.unused`).
        ScleraforceError: the study cannot be simulated.
    """
    start = perf_counter()
    if workers is not None and workers < 1:
        raise DatasetError(f"workers: {workers}; must be at least 1")
    mechanics = "linear" if library is None else "finite-strain"
    refuse_unused(study, "generate", mechanics)
    modulus = youngs_modulus_pa or (calibration.youngs_modulus_pa if calibration else study.eye.youngs_modulus_pa)
    report = progress or (lambda _: None)
    study = parse_study(format_study(study))  # as the store keeps it: rounded to 15 digits in human units
    plan = plan_dataset(study)
    create_dataset(out, study, modulus, calibration, plan, mechanics)
    todo = missing_dataset_units(out, plan, study)
    missing = sum(len(range(*plan.unit(unit).indices(plan.images))) for unit in todo)
    report(plan.images - missing)
    workers = workers or available_cores()
    with closing(
        simulate_units(study, modulus, todo, workers)
        if library is None
        else draw_units(study, modulus, plan, todo, library, workers)
    ) as results:
        for unit, images in results:
            write_dataset_unit(out, plan, study, unit, images)
            report(len(images))
    complete_dataset(out, plan, study)
    return Generation(plan.images, missing, perf_counter() - start)


def simulate_units(
    study: Study, youngs_modulus_pa: float, units: Sequence[int], workers: int
) -> Generator[tuple[int, Slices], None, None]:
    """Simulate units of the study's plan by workers; yield (unit, slices) as they are done.

    Raises:
        ScleraforceError: what a worker raised; SolverError where a worker died.
    """
    return work_units(partial(_simulating, study, youngs_modulus_pa), units, workers)


def draw_units(
    study: Study, youngs_modulus_pa: float, plan: DatasetPlan, units: Sequence[int], library: Library, workers: int
) -> Generator[tuple[int, Slices], None, None]:
    """Draw units of the study's plan from the library; yield (unit, slices) as they are done.

    It is done by the workers of a cluster, or in this process: it takes less time than processes take to start.

    Raises:
        DatasetError: the library is one of another eye or needle.
        InputError: a sample lies outside the library; names the value and the range.
    """
    prepare = partial(_drawing, study, youngs_modulus_pa, near_library(study, plan, library))
    if isinstance(workers, ClusterWorkers):
        return work_units(prepare, units, workers)
    draw = prepare()
    return ((unit, draw(unit)) for unit in units)


def _simulating(study: Study, youngs_modulus_pa: float) -> Callable[[int], Slices]:
    """Return what simulates a unit."""
    draft, simulator = draft_plan(study), SampleSimulator(study, youngs_modulus_pa)
    return lambda unit: simulator.slices(draft.unit(unit))


def _drawing(study: Study, youngs_modulus_pa: float, library: Library) -> Callable[[int], Slices]:
    """Return what draws a unit."""
    draft = draft_plan(study)
    return lambda unit: library_slices(study, youngs_modulus_pa, draft.unit(unit), library)
