"""Measure the cost of a data set over its size and processes, and what one unit of work
costs whom.

    python -m speed.scale [--images N ...] [--processes P ...]

Every row is a run in a process of its own: images of the paper's study, 20 a contact.
The next table has the cost of one unit of work for the worker, the writing process and
the scheduler of a Dask cluster (on this machine, with empty work), and how many cores
one command and one scheduler keep busy: that is computed from these figures, not
measured.
"""

import argparse
import json
import resource
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np
from distributed import LocalCluster

from markdown_tables import markdown
from scleraforce.base.worker_processes import cluster_workers, work_units
from scleraforce.lab.training.slice_dataset import (
    create_dataset,
    generate_dataset,
    plan_dataset,
    unit_samples,
)
from scleraforce.records.study import Study, format_study, parse_study
from speed.children import ask_module

SIZES = (1_000, 10_000, 100_000)
IMAGES_OF_A_CONTACT = 20
UNITS = 100  # that the costs of a unit are measured on


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--images", type=int, nargs="+", default=SIZES)
    parser.add_argument("--processes", type=int, nargs="+", default=(1, 2, 3, 4))
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:  # a row, for the process that prints them all
        print(json.dumps(_run(given.images[0], given.processes[0])))
        return

    rows = []
    of_an_image_s = []
    for processes in given.processes:
        taken_s = []
        for images in given.images:
            words = ["--one", "--images", str(images), "--processes", str(processes)]
            row, _ = ask_module("speed.scale", *words)
            taken_s.append(row["s"])
            rows.append([images, processes, images / row["s"], *row.values()])

        # of one more image, on the line through the sizes
        slope_s = float(np.polyfit(given.images, taken_s, 1)[0])
        of_an_image_s.append(processes * slope_s)

    head = ["images", "processes", "images a second", "s", "writer, MB", "worker, MB"]
    print(markdown(head, rows), end="\n\n")
    unit = unit_samples(_sized(20_000))[0].stop
    writes_s, completes_s = _writing_s()
    scheduled_s = _scheduling_s()
    simulated_s = unit * min(of_an_image_s)
    costs = {
        f"{unit} images simulated by a core, ms": 1e3 * simulated_s,
        "written, ms": 1e3 * writes_s,
        "read again and hashed, ms": 1e3 * completes_s,
        "scheduled and sent back, ms": 1e3 * scheduled_s,
        "cores that one command keeps busy": simulated_s / (writes_s + completes_s),
        "cores that one scheduler keeps busy": simulated_s / scheduled_s,
    }
    print(markdown(["a unit of work", ""], costs.items()))


def _run(images: int, processes: int) -> dict[str, float]:
    """Make a data set in a temporary folder; return its seconds and the largest memory
    of the process that writes and of a worker.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "dataset"
        made = generate_dataset(_sized(images), path, workers=processes)

    kinds = {"writer": resource.RUSAGE_SELF, "worker": resource.RUSAGE_CHILDREN}
    peaks = {
        name: resource.getrusage(kind).ru_maxrss / 1024 for name, kind in kinds.items()
    }
    return {"s": made.seconds, **peaks}


def _sized(images: int) -> Study:
    """Return the paper's study with about a number of images, spread evenly over its
    groups, 20 a contact.
    """
    study = Study()
    count = max(1, images // len(study.dataset.group))
    groups = tuple(replace(group, images=count) for group in study.dataset.group)
    contacts = max(2, count // IMAGES_OF_A_CONTACT)
    dataset = replace(study.dataset, group=groups, contacts=contacts)
    return parse_study(format_study(replace(study, dataset=dataset)))


def _writing_s() -> tuple[float, float]:
    """Return the seconds in which a unit is written, and then read again and hashed
    when the data set is complete.
    """
    study = _sized(UNITS * 200)
    units = unit_samples(study)
    rows = study.slice.rows
    images = np.zeros((units[0].stop, rows, study.slice.columns), dtype=np.uint8)
    images[:, rows // 4 : rows // 2] = 255

    with TemporaryDirectory() as folder:
        store = create_dataset(
            Path(folder) / "dataset",
            study,
            study.eye.youngs_modulus_pa,
            None,
            plan_dataset(study),
        )

        def write() -> None:
            for unit, samples in enumerate(units):
                store.write(unit, {"slices": images[: samples.stop - samples.start]})

        written_s = _seconds(write)
        return written_s / len(units), _seconds(store.finish) / len(units)


def _scheduling_s() -> float:
    """Return the seconds of an empty unit on a Dask cluster of two threads."""
    start: Callable[..., LocalCluster] = LocalCluster  # not annotated there
    with start(n_workers=1, threads_per_worker=2, dashboard_address=None) as cluster:
        workers = cluster_workers(str(cluster.scheduler_address))
        list(work_units(does_nothing, range(UNITS), workers))
        taken_s = _seconds(
            lambda: list(work_units(does_nothing, range(20 * UNITS), workers))
        )
        return taken_s / (20 * UNITS)


def does_nothing() -> Callable[[int], int]:
    """Work that gives a unit back."""
    return int


def _seconds(work: Callable[[], object]) -> float:
    start_s = perf_counter()
    work()
    return perf_counter() - start_s


if __name__ == "__main__":
    main()
