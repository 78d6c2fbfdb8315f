"""Processes that simulate the units of a data set; those that follow each other share their factored wall."""

from collections.abc import Callable, Generator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from scleraforce.dataset.plan import plan_dataset
from scleraforce.dataset.samples import SampleSimulator
from scleraforce.processes import work_units
from scleraforce.study import Study

__all__ = ["simulate_units"]

Slices = NDArray[np.uint8]


def simulate_units(
    study: Study, youngs_modulus_pa: float, units: Sequence[int], workers: int
) -> Generator[tuple[int, Slices], None, None]:
    """Simulate units of the study's plan in `workers` processes; yield (unit, slices) as they are done.

    Raises:
        ScleraforceError: what a worker raised; SolverError where a worker died.
    """
    return work_units(partial(_prepare, study, youngs_modulus_pa), units, workers)


def _prepare(study: Study, youngs_modulus_pa: float) -> Callable[[int], Slices]:
    """Return what simulates a unit."""
    plan = plan_dataset(study)
    simulator = SampleSimulator(study, youngs_modulus_pa, plan)
    return lambda unit: simulator.slices(plan.unit(unit))
