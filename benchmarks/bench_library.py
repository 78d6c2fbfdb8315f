"""Measure the response library: cost of building, accuracy of interpolation and file,
slices a second.

    python benchmarks/bench_library.py [HELD_OUT] [--study FILE]

Interpolation is compared with HELD_OUT load paths (40 by default) of walls anywhere in
the library's ranges, none on its grid, at 53 dents each: tip and visible boundaries
(0.3 to 9 mm from the needle axis) at the force, force at the tip. Of a study only its
own grid is built, else also three others.
"""

import argparse
import resource
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.worker_processes import available_cores
from scleraforce.library import Library, load_library, save_library
from scleraforce.library.library_plan import plan_library
from scleraforce.library.library_store import build_library, open_library
from scleraforce.library.plane_cut import (
    Framing,
    fill_boundaries,
    highest_depths,
    wall_boundaries,
)
from scleraforce.mechanics.axisymmetric_wall import (
    AxisymmetricPath,
    EvenWall,
    axisymmetric_path,
)
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.meridian_elements import MeridianSize
from scleraforce.records.study import Study, read_study

# thicknesses, tensions, tips
GRIDS = (
    (8, 12, 56),
    (10, 16, 56),
    (10, 20, 56),
    (12, 24, 72),
)
VISIBLE_M = (0.3e-3, 9e-3)  # of the needle axis
SLICES = 2000
ROUNDS = 5
# states, and a contact beside the pole, at which a stored library is compared
STORED = 4000
CONTACT_RAD = 0.6

Floats = NDArray[np.float64]
Grid = tuple[int, int, int]


def draw_walls(
    study: Study, count: int, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Thickness (wall,), m, and IOP ratio (wall,), the logarithm of the tension evenly
    spread.
    """
    grid = study.library
    thickness_m = rng.uniform(*grid.thickness_m.bounds, count)
    low, high = np.log(grid.tension.bounds)
    tension = np.exp(rng.uniform(low, high, count))
    return thickness_m, tension * thickness_m / study.eye.radius_m


def held_out_path(study: Study, wall: tuple[float, float]) -> AxisymmetricPath:
    """Solve a path at dents that the library does not hold."""
    plan = plan_library(study)
    tips_m = np.concatenate(
        [[1e-5, 3e-5, 6e-5], np.linspace(0.1e-3, 0.99 * plan.grid.max_tip_m, 50)]
    )
    even = EvenWall(
        plan.radius_m,
        wall[0],
        plan.poisson_ratio,
        plan.needle_radius_m,
        size=MeridianSize(plan.grid.elements, plan.grid.layers),
    )
    end = PathEnd(tips_m=tips_m, max_force=plan.grid.max_force_ratio_m2)

    return axisymmetric_path(even, wall[1], end)


def errors(
    library: Library, wall: tuple[float, float], path: AxisymmetricPath
) -> tuple[Floats, Floats, Floats]:
    """Relative error of the force at each tip; of the tip, and of the curves in m, at
    each force first reached.
    """
    tips_m = path.tip_m[1:]
    forces = path.force_ratio_m2[1:]
    thickness, ratio = (np.full(len(tips_m), value) for value in wall)
    of_force = library.at_tip(thickness, ratio, tips_m).force_ratio / forces - 1.0
    first = np.maximum.accumulate(np.r_[0.0, forces[:-1]]) < forces
    asked = first & (forces < 0.999 * library.largest_force_ratio(thickness, ratio))
    found = library.curves(thickness[asked], ratio[asked], forces[asked])
    expected = path.curves_sbnc[1:][asked]
    visible = (expected[..., 0] > VISIBLE_M[0]) & (expected[..., 0] < VISIBLE_M[1])
    off_m = np.where(
        visible, np.linalg.norm(found.curves_sbnc - expected, axis=-1), 0.0
    ).max(axis=(1, 2))

    return np.abs(of_force), np.abs(found.tip_m / tips_m[asked] - 1.0), off_m


def build(paper: Study, grid: Grid) -> tuple[Library, float, float]:
    """Build a library; return it, the elapsed seconds and the processor seconds."""
    thicknesses, tensions, tips = grid
    finer = replace(
        paper.library, thicknesses=thicknesses, tensions=tensions, tips=tips
    )
    study = replace(paper, library=finer)

    with TemporaryDirectory() as folder:
        before = cpu_seconds()
        seconds = build_library(study, Path(folder) / "library.zarr").seconds
        return (
            open_library(Path(folder) / "library.zarr").for_contact(0.0),
            seconds,
            cpu_seconds() - before,
        )


def cpu_seconds() -> float:
    """Return the processor seconds of this process and its finished children."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return process_time() + children.ru_utime + children.ru_stime


def print_accuracy(study: Study, grids: tuple[Grid, ...], held_out: int) -> Library:
    """Build libraries of several grids and print their errors; return that of the
    study.
    """
    walls = list(
        zip(*draw_walls(study, held_out, np.random.default_rng(0)), strict=True)
    )
    with ProcessPoolExecutor(available_cores(), get_context("spawn")) as pool:
        paths = list(pool.map(partial(held_out_path, study), walls))

    print(
        f"{'grid':>10} {'build':>7} {'CPU':>6}   error at {held_out} other walls:"
        " median, 99 %, largest"
    )
    print(
        f"{'t x p x d':>10} {'s':>7} {'s':>6}   {'force at tip, %':>23} "
        f" {'tip at force, %':>23}  {'curves, um':>20}"
    )
    own = None

    for grid in grids:
        library, seconds, cpu = build(study, grid)
        found = zip(
            *(errors(library, *pair) for pair in zip(walls, paths, strict=True)),
            strict=True,
        )
        force, tip, curve = (
            np.percentile(np.concatenate(part), [50.0, 99.0, 100.0]) for part in found
        )
        cells = [
            " ".join(f"{100 * value:7.4f}" for value in part) for part in (force, tip)
        ]
        micrometres = " ".join(f"{1e6 * value:6.2f}" for value in curve)
        name = "x".join(map(str, grid))
        print(
            f"{name:>10} {seconds:7.1f} {cpu:6.1f}   {cells[0]}  {cells[1]} "
            f" {micrometres}",
            flush=True,
        )

        if grid == grid_of(study):
            own = library

    assert own is not None
    return own


def grid_of(study: Study) -> Grid:
    """Return how many thicknesses, IOP ratios and tips the study asks for."""
    return study.library.thicknesses, study.library.tensions, study.library.tips


def print_rates(study: Study, library: Library) -> None:
    """Print the time that each step from eyes to labelled slices takes of one core."""
    near = library.within(VISIBLE_M[1])
    rng = np.random.default_rng(1)
    thickness, ratio = draw_walls(study, SLICES, rng)
    force = rng.uniform(0.0, 0.999, SLICES) * near.largest_force_ratio(thickness, ratio)
    gap = rng.uniform(0.35e-3, 1e-3, SLICES)
    tilt = rng.uniform(-0.09, 0.09, SLICES)
    print(
        "\n         framing   curves  unloaded top  boundaries  filling  us of one core"
        " a slice"
    )

    for name, turn in (("moved, scaled", 0.0), ("turned as well", 0.09)):
        framing = Framing(
            rng.uniform(-1e-3, 1e-3, SLICES),
            rng.uniform(0.2e-3, 0.8e-3, SLICES),
            rng.uniform(0.95, 1.05, SLICES),
            rng.uniform(-turn, turn, SLICES),
        )
        taken = []

        for _ in range(ROUNDS):
            times = [process_time()]
            walls = near.curves(thickness, ratio, force).curves_sbnc
            times.append(process_time())
            highest_depths(
                near.at_tip(thickness, ratio, np.zeros(SLICES)).curves_sbnc[:, 0],
                gap,
                tilt,
            )
            times.append(process_time())
            boundaries = wall_boundaries(walls, gap, tilt, framing, study.slice)
            times.append(process_time())
            fill_boundaries(boundaries.depth_sbc, study.slice)
            times.append(process_time())
            taken.append(np.diff(times))

        steps = np.min(taken, axis=0) / SLICES * 1e6
        cells = "{:8.1f} {:13.1f} {:11.1f} {:8.1f}".format(*steps)
        print(
            f"{name:>16} {cells}  {1e6 / steps.sum():,.0f} slices a second;"
            f" {boundaries.folded.sum()} fold over"
        )


def print_stored(study: Study, library: Library) -> None:
    """Print how large the library is in a model folder, and by how much it is off at
    its states and elsewhere.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "library.npz"
        told = save_library(library, path)
        size = path.stat().st_size
        found = load_library(path)

    thickness, ratio = draw_walls(study, STORED, rng := np.random.default_rng(2))
    tips = rng.uniform(0.0, 1.0, STORED) ** 1.5 * library.tip_m[-1]
    off_m = np.abs(
        found.shapes(thickness, ratio, tips).astype(np.float64)
        - library.shapes(thickness, ratio, tips)
    )
    force, known = (
        eyes.for_contact(CONTACT_RAD).forces(thickness, ratio, tips)
        for eyes in (found, library)
    )
    print(
        f"\nlibrary.npz: {size:,} bytes; curves {1e6 * told.curves_m:.3f} um off at"
        f" states, {1e6 * off_m.max():.3f} at {STORED} others (rms"
        f" {1e6 * np.sqrt(np.mean(off_m**2)):.4f}); factors of the force"
        f" {told.stiffness:.1e}, forces {np.abs(force / known - 1.0).max():.1e}"
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parser.add_argument("held_out", type=int, nargs="?", default=40)
    parser.add_argument(
        "--study",
        type=Path,
        help="the paper's where none is given, and three other grids",
    )
    given = parser.parse_args()
    study = read_study(given.study) if given.study else Study()
    library = print_accuracy(
        study, (grid_of(study),) if given.study else GRIDS, given.held_out
    )
    print_stored(study, library)
    print_rates(study, library)


if __name__ == "__main__":
    main()
