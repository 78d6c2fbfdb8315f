"""Speed of the data set: what an image costs, and the paper's 19,200 from nothing.

    python benchmarks/bench_dataset.py [--workers N] [--stages] [--study FILE]

Stages: CPU milliseconds of one core, the least of five. Whole: seconds by the clock, and of all processors.
`--stages` leaves the whole out.
"""

import argparse
import os
import resource
import tempfile
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from least_time import least_s
from scleraforce.learning.dataset import plan_dataset
from scleraforce.learning.generate import generate_dataset
from scleraforce.mechanics.contact import Contact, ScanPlane
from scleraforce.mechanics.linear import LinearWall
from scleraforce.mechanics.mesh import build_mesh
from scleraforce.mechanics.section import cut_sections
from scleraforce.mechanics.slices import fill_section, slice_window
from scleraforce.study import Range, Study, read_study

IMAGES = 20  # of one contact, as in the paper's study
PAPER_IMAGES, PAPER_HOURS = 19_200, 2.5


def open_study(study: Study) -> Study:
    """Return a study with gap, tilt, direction and framing open."""
    ranges = {
        "gap_m": Range(min=0.35e-3, max=1e-3),
        "tilt_rad": Range(min=-0.1, max=0.1),
        "direction_rad": Range(min=-3.0, max=3.0),
        "framing_lateral_m": Range(min=-1e-3, max=1e-3),
        "framing_depth_m": Range(min=-2e-4, max=2e-4),
    }
    return replace(study, dataset=replace(study.dataset, **ranges))  # type: ignore[arg-type]  # fields by name


def print_stages(study: Study) -> None:
    """Print what each step costs."""
    images = sum(group.images for group in study.dataset.group)
    mesh = build_mesh(study.eye.radius_m, 5e-4, study.mesh.divisions, study.mesh.level)
    wall = LinearWall(mesh, study.eye.poisson_ratio)
    contacts = [Contact(polar_rad=0.6, azimuth_rad=0.1 * k) for k in range(8)]
    needle_nc = wall.needle_cnc(contacts[:1], 0.35e-3)[0]
    modes = np.stack([266.0 * wall.pressure_nc, needle_nc]) / 0.25e6
    forces = np.linspace(0.0, 0.06, IMAGES + 1)
    weights = np.stack([np.ones_like(forces), forces], axis=-1)[None]
    own = [ScanPlane(contacts[0], gap_m=0.5e-3, direction_rad=0.3 * k, tilt_rad=0.01 * (k - 10)) for k in range(IMAGES)]
    pairs = np.ones((IMAGES, 2, 2))
    pairs[:, 0, 1], pairs[:, 1, 1] = 0.0, forces[1:]
    section = cut_sections(mesh, own[:1], modes, weights)[0][IMAGES // 2]
    window = slice_window(study.slice, 0.0)
    stages = {
        f"plan of {images:,} samples": least_s(lambda: plan_dataset(study), 5),
        "wall: mesh, stiffness, factor": least_s(lambda: LinearWall(mesh, study.eye.poisson_ratio), 2),
        "needle at one contact": least_s(lambda: wall.needle_cnc(contacts, 0.35e-3), 5) / len(contacts),
        "section, plane shared by 20": least_s(lambda: cut_sections(mesh, own[:1], modes, weights), 5) / IMAGES,
        "section, own plane": least_s(lambda: cut_sections(mesh, own, modes, pairs), 5) / IMAGES,
        "slice": least_s(lambda: [fill_section(section, window) for _ in range(100)], 5) / 100,
    }
    for name, seconds in stages.items():
        print(f"{name:32}{1e3 * seconds:10.3f} ms")


def print_whole(name: str, study: Study, workers: int | None) -> None:
    """Generate a data set in a temporary folder and print its speed."""
    with tempfile.TemporaryDirectory() as folder:
        before = _processor_seconds()
        done = generate_dataset(study, Path(folder) / "dataset.zarr", workers=workers)
        used = _processor_seconds() - before
        size = sum(file.stat().st_size for file in Path(folder).rglob("*") if file.is_file())
    print(
        f"{name:32}{done.images:8d} images{done.seconds:8.1f} s{used:8.1f} s of processors"
        f"{done.images_per_second:8.0f} images/s{size / 1e6:8.1f} MB"
        f"{done.images_per_second * PAPER_HOURS * 3600 / PAPER_IMAGES:7.0f} x the paper"
    )


def _processor_seconds() -> float:
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int)
    parser.add_argument("--stages", action="store_true", help="only the stages")
    parser.add_argument("--study", type=Path, help="the paper's where none is given")
    options = parser.parse_args()
    study = read_study(options.study) if options.study else Study()
    print_stages(study)
    if not options.stages:
        print_whole(str(options.study or "the paper's study"), study, options.workers)
        print_whole("all ranges open", open_study(study), options.workers)


if __name__ == "__main__":
    main()
