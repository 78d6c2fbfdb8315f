"""Measure the cost of a data set over its size and processes, and extrapolate to a
cluster.

    python benchmarks/bench_scale.py [--seconds S] [--images N ...] [--processes P ...]
        [--study FILE]

Every row is a run in a process of its own: images of the paper's study, 20 a contact. A
size that would take more than `--seconds`, by the rates of smaller ones, is not run:
its time is extrapolated from the two largest that were, and its row says so. The next
table has the cost of one unit of work for the worker, the writing process and the
scheduler of a Dask cluster (on this machine, with empty work). The last table is
computed from these figures, not measured.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np

from scleraforce.base.worker_processes import (
    available_cores,
    cluster_workers,
    work_units,
)
from scleraforce.lab.training.slice_dataset import (
    create_dataset,
    generate_dataset,
    plan_dataset,
    unit_samples,
)
from scleraforce.records.study import (
    DatasetGroup,
    Study,
    format_study,
    parse_study,
    read_study,
)

SIZES = (1_000, 10_000, 100_000, 1_000_000)
IMAGES_OF_A_CONTACT = 20
MB = 2**20
UNITS = 100  # that the costs of a unit are measured on
# of the cluster that is computed
CORES = 1_000
SLICES = 100_000_000
# images of the largest data set that can be read (8 GiB of values)
LARGEST_SET = 1_500_000


@dataclass(frozen=True)
class Run:
    """One data set: seconds, and the largest memory of the process that writes and of a
    worker, in bytes.
    """

    images: int
    processes: int
    seconds: float
    writer: int
    worker: int


def sized(study: Study, images: int) -> Study:
    """Return the study with a number of images, spread evenly over its groups, 20 a
    contact.
    """
    groups = study.dataset.group
    spread = [
        images // len(groups) + (number < images % len(groups))
        for number in range(len(groups))
    ]
    group: tuple[DatasetGroup, ...] = tuple(
        replace(each, images=count) for each, count in zip(groups, spread, strict=True)
    )
    contacts = max(2, images // len(groups) // IMAGES_OF_A_CONTACT)

    return parse_study(
        format_study(
            replace(
                study, dataset=replace(study.dataset, group=group, contacts=contacts)
            )
        )
    )


def run_here(images: int, processes: int, study: Study) -> Run:
    """Make a data set in a temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        seconds = generate_dataset(
            sized(study, images), Path(folder) / "dataset", workers=processes
        ).seconds

    peaks = (
        1024 * resource.getrusage(who).ru_maxrss
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return Run(images, processes, seconds, *peaks)


def run_apart(images: int, processes: int, study: Path | None) -> Run:
    """Do the same in a process of its own, whose memory is then that of this data set
    alone.
    """
    words = [
        sys.executable,
        __file__,
        "--one",
        str(images),
        str(processes),
        *(["--study", str(study)] if study else []),
    ]
    return Run(
        **json.loads(
            subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True).stdout
        )
    )


def print_rows(
    sizes: Sequence[int], processes: Sequence[int], limit_s: float, study: Path | None
) -> float:
    """Print a row for each size and number of processes; return the seconds of a core
    for one more image.
    """
    print(
        f"{'images':>9}{'processes':>11}{'s':>10}{'images/s':>10}"
        f"{'writer, MB':>12}{'worker, MB':>12}"
    )
    of_an_image_s = []

    for count in processes:
        done: list[Run] = []
        for images in sizes:
            expected_s = _extrapolated(done, images)
            if expected_s > limit_s:
                print(
                    f"{images:9d}{count:11d}{expected_s:10.0f}"
                    f"{images / expected_s:10.0f}  extrapolated, not run"
                )
                continue

            done.append(run_apart(images, count, study))
            last = done[-1]
            print(
                f"{images:9d}{count:11d}{last.seconds:10.1f}"
                f"{images / last.seconds:10.0f}{last.writer / MB:12.0f}"
                f"{last.worker / MB:12.0f}",
                flush=True,
            )

        if len(done) > 1:
            of_an_image_s.append(_slope_s(done) * min(count, available_cores()))

    return min(of_an_image_s)


def _slope_s(done: Sequence[Run]) -> float:
    """Return the seconds for one more image, by the two largest runs; by the largest
    where noise turns them round.
    """
    smaller, larger = done[-2:]
    slope_s = (larger.seconds - smaller.seconds) / (larger.images - smaller.images)
    return slope_s if slope_s > 0.0 else larger.seconds / larger.images


def _extrapolated(done: Sequence[Run], images: int) -> float:
    """Return the seconds that a size would take, on the line through the two largest
    runs; 0 before there are two.
    """
    if len(done) < 2:
        return 0.0
    return done[-1].seconds + _slope_s(done) * (images - done[-1].images)


def writing_s(study: Study) -> tuple[float, float]:
    """Return the seconds in which a unit is written, and then read again and hashed
    when the data set is complete.
    """
    study = sized(study, UNITS * 200)
    plan = plan_dataset(study)
    size = study.slice.rows, study.slice.columns
    units = unit_samples(study)
    images = np.zeros((units[0].stop, *size), dtype=np.uint8)
    images[:, size[0] // 4 : size[0] // 2] = 255

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "dataset"
        store = create_dataset(path, study, study.eye.youngs_modulus_pa, None, plan)

        def write() -> None:
            for unit, samples in enumerate(units):
                store.write(unit, {"slices": images[: samples.stop - samples.start]})

        written_s = _seconds(write)
        return written_s / len(units), _seconds(store.finish) / len(units)


def scheduling_s() -> float | None:
    """Return the seconds of an empty unit on a Dask cluster of two threads; None
    without Dask.
    """
    try:
        with _cluster() as address:
            workers = cluster_workers(address)
            list(work_units(does_nothing, range(UNITS), workers))
            return _seconds(
                lambda: list(work_units(does_nothing, range(20 * UNITS), workers))
            ) / (20 * UNITS)
    except ImportError:
        return None


@contextmanager
def _cluster() -> Iterator[str]:
    from distributed import LocalCluster

    cluster: Callable[..., LocalCluster] = LocalCluster  # not annotated there
    with cluster(n_workers=1, threads_per_worker=2, dashboard_address=None) as made:
        yield str(made.scheduler_address)


def does_nothing() -> Callable[[int], int]:
    """Work that gives a unit back."""
    return int


def _seconds(work: Callable[[], object]) -> float:
    start = perf_counter()
    work()
    return perf_counter() - start


def print_cluster(of_an_image_s: float, study: Study) -> None:
    """Print what a unit costs whom, and what that makes of 10^8 slices on 1,000
    cores.
    """
    unit = unit_samples(sized(study, 20_000))[0].stop
    writes_s, completes_s = writing_s(study)
    scheduled_s = scheduling_s()
    print(
        f"\na unit of {unit} images: simulated in {1e3 * unit * of_an_image_s:.0f} ms"
        f" of a core, written in {1e3 * writes_s:.1f} ms, read again and hashed in"
        f" {1e3 * completes_s:.1f} ms; ",
        end="",
    )
    print(
        "no Dask here"
        if scheduled_s is None
        else f"scheduled and sent back in {1e3 * scheduled_s:.1f} ms"
    )
    units = SLICES / unit
    sets = -(-SLICES // LARGEST_SET)
    rows = {
        f"simulating, on {CORES:,} cores": units * unit * of_an_image_s / CORES,
        "writing and completing, by one process": units * (writes_s + completes_s),
        f"the same, by {sets} processes with a data set each": (
            units * (writes_s + completes_s) / sets
        ),
    }

    if scheduled_s is not None:
        rows["scheduling, by one scheduler"] = units * scheduled_s
        rows[f"the same, by {sets} schedulers"] = units * scheduled_s / sets

    print(
        f"\n{SLICES:,} slices, {units:,.0f} units: computed from the figures above,"
        " not run"
    )
    for name, seconds in rows.items():
        print(f"{name:52}{seconds:10.0f} s")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--seconds",
        type=float,
        default=300.0,
        help="a size that takes longer is not run (300)",
    )
    parser.add_argument("--images", type=int, nargs="+", default=SIZES)
    parser.add_argument("--processes", type=int, nargs="+", default=(1, 2, 3, 4))
    parser.add_argument("--study", type=Path, help="the paper's where none is given")
    parser.add_argument(
        "--one",
        type=int,
        nargs=2,
        metavar=("IMAGES", "PROCESSES"),
        help=argparse.SUPPRESS,
    )
    options = parser.parse_args()
    study = read_study(options.study) if options.study else Study()

    if options.one:
        images, processes = options.one
        print(json.dumps(vars(run_here(images, processes, study))))
        return

    if len(options.images) < 2:
        parser.error("--images: give at least two sizes")

    print_cluster(
        print_rows(
            sorted(options.images), options.processes, options.seconds, options.study
        ),
        study,
    )


if __name__ == "__main__":
    main()
