"""The paper's data set from nothing."""

from pathlib import Path
from time import perf_counter

from scleraforce.base.worker_processes import available_cores
from scleraforce.lab.training.slice_dataset import generate_dataset
from speed.record import Row, Table, spread
from speed.run import Run

DATASET = "paper.zarr"  # in the run's folder
GOAL_S = 12.0
PAPER_S_AN_IMAGE = 0.47
SETTINGS = """`scleraforce generate` of the paper's study: plan, walls, sections,
slices, a complete store; processes are started anew each time. The paper's own figure
is quoted, 0.47 s an image on its laptop of 2020."""


def measure(run: Run) -> Table:
    """Generate the data set, twice."""
    seconds = []
    images = 0

    for number in range(run.count(2, 1)):
        start = perf_counter()
        images = generate_dataset(
            run.study, run.folder / (DATASET if not number else f"{number}.zarr")
        ).images
        seconds.append(perf_counter() - start)

    row = Row(
        what=f"{images:,} images from nothing",
        unit="s",
        **spread(seconds),
        beside="the paper (quoted)",
        beside_value=images * PAPER_S_AN_IMAGE,
        goal=GOAL_S,
        settings=f"{available_cores()} processes",
        more={"images a second": images / spread(seconds)["value"]},
    )
    return Table("The data set", SETTINGS, (row,))


def made_dataset(run: Run) -> Path:
    """Return the data set of this run; make it where its part was not run."""
    path = run.folder / DATASET
    if not path.exists():
        generate_dataset(run.study, path)
    return path
