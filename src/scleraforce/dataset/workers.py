"""Workers that make the units of a data set; those of linear mechanics share their factored wall with the next."""

from collections.abc import Callable, Generator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from scleraforce.cluster import ClusterWorkers
from scleraforce.dataset.library_samples import library_slices, near_library
from scleraforce.dataset.plan import DatasetPlan, draft_plan
from scleraforce.dataset.samples import SampleSimulator
from scleraforce.library import Library
from scleraforce.processes import work_units
from scleraforce.study import Study

Slices = NDArray[np.uint8]


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
