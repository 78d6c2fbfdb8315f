"""How far the response library is off: the figures of docs/library.md.

Load paths of walls anywhere in the library's ranges, none on its grid, at 53 dents
each: the force at the tip, tip and visible boundaries (0.3 to 9 mm from the needle
axis) at the force. The library is that of the user's cache.
"""

from collections.abc import Iterator
from typing import NamedTuple

import click
import numpy as np

from figures.printing import STUDY, listed, print_table, whole_number
from figures.pushed_walls import Floats
from scleraforce.library import Library
from scleraforce.library.library_plan import plan_library
from scleraforce.library.library_store import cached_library
from scleraforce.mechanics.axisymmetric_wall import (
    AxisymmetricPath,
    EvenWall,
    axisymmetric_path,
)
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.meridian_elements import MeridianSize
from scleraforce.records.study import Study

VISIBLE_M = (0.3e-3, 9e-3)  # of the needle axis
SHARES = (50.0, 99.0, 100.0)  # percentiles


class LibraryErrors(NamedTuple):
    """Absolute errors of many states: force and tip relative, curves in m."""

    forces: Floats
    tips: Floats
    curves_m: Floats


def draw_walls(study: Study, count: int) -> Iterator[tuple[float, float]]:
    """Yield thickness, m, and IOP ratio; the logarithm of the tension is even."""
    rng = np.random.default_rng(0)
    thickness_m = rng.uniform(*study.library.thickness_m.bounds, count)
    low, high = np.log(study.library.tension.bounds)
    tension = np.exp(rng.uniform(low, high, count))
    ratio = tension * thickness_m / study.eye.radius_m
    yield from zip(thickness_m.tolist(), ratio.tolist(), strict=True)


def other_path(study: Study, thickness_m: float, iop_ratio: float) -> AxisymmetricPath:
    """Solve a path at dents that the library does not hold."""
    plan = plan_library(study)
    even_m = np.linspace(0.1e-3, 0.99 * plan.grid.max_tip_m, 50)
    wall = EvenWall(
        plan.radius_m,
        thickness_m,
        plan.poisson_ratio,
        plan.needle_radius_m,
        size=MeridianSize(plan.grid.elements, plan.grid.layers),
    )
    end = PathEnd(
        tips_m=np.concatenate([[1e-5, 3e-5, 6e-5], even_m]),
        max_force=plan.grid.max_force_ratio_m2,
    )
    return axisymmetric_path(wall, iop_ratio, end)


def library_errors(
    library: Library, thickness_m: float, iop_ratio: float, path: AxisymmetricPath
) -> LibraryErrors:
    """Return the errors at each tip, and at each force that is first reached there."""
    tips_m = path.tip_m[1:]
    forces = path.force_ratio_m2[1:]
    thickness_s = np.full(len(tips_m), thickness_m)
    ratio_s = np.full(len(tips_m), iop_ratio)
    of_force = library.at_tip(thickness_s, ratio_s, tips_m).force_ratio / forces - 1.0
    first = np.maximum.accumulate(np.r_[0.0, forces[:-1]]) < forces
    asked = first & (forces < 0.999 * library.largest_force_ratio(thickness_s, ratio_s))
    found = library.curves(thickness_s[asked], ratio_s[asked], forces[asked])
    expected = path.curves_sbnc[1:][asked]
    near = (expected[..., 0] > VISIBLE_M[0]) & (expected[..., 0] < VISIBLE_M[1])
    away_m = np.linalg.norm(found.curves_sbnc - expected, axis=-1)

    return LibraryErrors(
        np.abs(of_force),
        np.abs(found.tip_m / tips_m[asked] - 1.0),
        np.where(near, away_m, 0.0).max(axis=(1, 2)),
    )


@click.command(help=__doc__)
@whole_number("--walls", 16, "Walls off the grid.")
@STUDY
def main(walls: int, study: Study) -> None:
    """Print the table."""
    library = cached_library(study).for_contact(0.0)
    parts = [
        library_errors(library, *wall, other_path(study, *wall))
        for wall in draw_walls(study, walls)
    ]
    names = ("force at a tip, %", "tip at a force, %", "boundaries, um")
    columns = zip(names, zip(*parts, strict=True), (1e2, 1e2, 1e6), strict=True)
    print_table(
        ["error", "median, 99 %, largest"],
        (
            [name, listed(unit * np.percentile(np.concatenate(part), SHARES), ".4f")]
            for name, part, unit in columns
        ),
    )
