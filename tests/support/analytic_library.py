"""A made-up eye with a closed form, libraries of it, and a small library of solved
walls.
"""

import os
import signal
import time
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from waiting import HANGS_S

from scleraforce.base.errors import SolverError
from scleraforce.library import Library
from scleraforce.library.library_plan import plan_library
from scleraforce.library.library_store import solve_path
from scleraforce.library.stiffened_walls import StiffenedWalls, WholeCurves
from scleraforce.recordings.force_errors import LABEL_SD_N, ZERO_PRIOR, FrameForces
from scleraforce.records.study import LibraryStudy, Range, ReaderStudy, Study

RADIUS_M = 12e-3
AXES_AND_SIZES = (
    "thickness_m",
    "tension",
    "tip_m",
    "radius_m",
    "poisson_ratio",
    "needle_radius_m",
)


def node_angles(nodes):
    """Angles of the nodes from the needle axis, denser there."""
    return 0.5 * np.pi * np.linspace(0.0, 1.0, nodes) ** 1.5


ANGLES = node_angles(81)
POLAR_RAD = np.radians([0.0, 10.0, 20.0, 30.0, 40.0, 50.0])


def force_ratio(thickness_m, iop_ratio, tip_m):
    """F/E in m^2: a shell that softens beyond 1 mm, pressure on the dent; the force
    falls where that is low.
    """
    shell = 2.6 * thickness_m**2 / RADIUS_M * tip_m * np.exp(-tip_m / 1.2e-3)
    ridge = 0.12 * (thickness_m / RADIUS_M) ** 1.5 * tip_m**2
    return shell + ridge + np.pi * iop_ratio * RADIUS_M * tip_m


def curves(thickness_m, iop_ratio, tip_m, angles=ANGLES):
    """Curves (..., boundary, node, 2), m, of arguments that broadcast; a node for each
    angle.
    """
    thickness_m, iop_ratio, tip_m = (
        np.asarray(v)[..., None, None] for v in (thickness_m, iop_ratio, tip_m)
    )
    radius = RADIUS_M - thickness_m * np.array([[0.0], [1.0]])
    grown = iop_ratio * RADIUS_M**2 / (4.0 * thickness_m)
    width = np.sqrt(RADIUS_M * thickness_m) * (0.7 + 60.0 * tip_m)
    arc = RADIUS_M * angles
    inward = tip_m * np.exp(-0.5 * (arc / width) ** 2) * np.ones_like(radius)
    r = (radius + grown) * np.sin(angles) - 0.15 * inward * np.sin(2 * angles)
    depth = RADIUS_M - (radius + grown) * np.cos(angles) + inward

    return np.stack([r, depth], axis=-1)


def displaced_m3(thickness_m, iop_ratio, tip_m):
    """Volume that the dent displaces in m^3: wider in thicker walls and under more
    pressure, and with its depth.
    """
    width = np.sqrt(RADIUS_M * thickness_m) * (1.0 + 20.0 * np.sqrt(iop_ratio))
    return np.pi * width**2 * tip_m * (1.0 + 100.0 * tip_m)


def stiffness(polar_rad):
    """Factor of the force for a contact beside the pole."""
    return 1.0 + 0.1 * polar_rad**2


def with_walls(library, **changed):
    """The library with other arrays of its walls."""
    return replace(library, walls=replace(library.walls, **changed))


def analytic_library(thicknesses=9, ratios=11, tips=40, nodes=81):
    """The library of this eye; of few `nodes` where only forces are asked for."""
    t = np.geomspace(0.35e-3, 0.9e-3, thicknesses)
    tension = np.geomspace(1e-3, 0.21, ratios)
    d = 7.5e-3 * np.linspace(0.0, 1.0, tips) ** 1.5
    grid = list(np.meshgrid(t, tension, d, indexing="ij"))
    grid[1] = grid[1] * grid[0] / RADIUS_M  # IOP/E
    walls = curves(*grid, node_angles(nodes)).astype(np.float32)

    return Library(
        thickness_m=t,
        tension=tension,
        tip_m=d,
        stiffening=0.0,
        radius_m=RADIUS_M,
        poisson_ratio=0.45,
        walls=StiffenedWalls(
            stiffening=np.zeros(1),
            force_ratio_btpd=force_ratio(*grid)[None],
            displaced_btpd=displaced_m3(*grid)[None],
            undented_btpbnc=np.ascontiguousarray(walls[None, :, :, 0]),
            curves=WholeCurves(walls[None]),
        ),
        needle_radius_m=0.35e-3,
        max_force_ratio=0.5e-6,
        polar_rad=POLAR_RAD,
        stiffness_atpd=np.stack(
            [np.full(grid[0].shape, stiffness(polar)) for polar in POLAR_RAD]
        ),
        contact_polar_rad=0.0,
    )


def bulging(library, rise_m=6e-3, power=1):
    """The library of walls that rise more in their middle: by 120 um at a tension of
    0.02, and elsewhere with a power of the tension.
    """
    undented = library.undented_tpbnc.copy()
    angle = np.arctan2(undented[0, 0, 0, :, 0], RADIUS_M - undented[0, 0, 0, :, 1])
    rise = 0.02 * rise_m * (library.tension / 0.02) ** power
    undented[..., 1] -= rise[:, None, None] * np.cos(angle) ** 2
    return with_walls(library, undented_btpbnc=undented[None])


def draw_walls(rng, count):
    """Thickness (count,) and IOP ratio (count,) anywhere in the library."""
    return rng.uniform(0.35e-3, 0.9e-3, count), np.exp(
        rng.uniform(np.log(8e-5), np.log(6e-3), count)
    )


def solve_analytic(plan, number):
    """Return a path of a plan like `library.library_store.solve_path`, for tests of the
    code around the solver.
    """
    path = plan.path(number)
    state = (
        path.thickness_m,
        path.iop_ratio * (1.0 + 0.05 * np.log1p(path.stiffening)),
        path.tip_m,
    )
    forces = force_ratio(*state) * (1.0 + 0.05 * np.cos(path.support_rad))

    found = curves(*state, node_angles(plan.nodes)).astype(np.float32)

    return forces, displaced_m3(*state), found


def solve_slowly(plan, number):
    """The same, for some paths a tenth of a second later: a worker may be killed while
    it is at one, and the others have work left.
    """
    if number < plan.paths:
        time.sleep(0.1)
    return solve_analytic(plan, number)


@dataclass(frozen=True)
class SolvesSome:
    """Solves `most` of the paths at least, and waits for ever at one of the rest; each
    leaves a mark in a folder.
    """

    folder: Path
    most: int

    def __call__(self, plan, number):
        if number < plan.paths:
            while len(list(self.folder.iterdir())) >= self.most:
                time.sleep(HANGS_S)
            (self.folder / str(number)).touch()
        return solve_analytic(plan, number)


def no_solution(plan, number):
    """A path that cannot be followed."""
    raise SolverError(f"path {number} of {plan.units}: no equilibrium")


def no_worker(_plan, _number):
    """The end of the process that is asked."""
    os.kill(os.getpid(), signal.SIGKILL)


STIFFENINGS = plan_library(
    Study()
).stiffening  # of the made-up library: 0, 0.5, 2.3, 8.4, 30


@cache
def solved_library(grid: LibraryStudy) -> Library:
    """Return the library of a study's load paths without other supports: beside the
    pole forces grow by a formula.
    """
    plan = plan_library(Study(library=grid))
    shape = (grid.stiffenings, grid.thicknesses, grid.tensions)
    forces, volumes, curves = (
        np.stack(each).reshape(*shape, *each[0].shape)
        for each in zip(
            *(solve_path(plan, unit) for unit in range(plan.paths)), strict=True
        )
    )
    walls = StiffenedWalls(
        stiffening=plan.stiffening,
        force_ratio_btpd=forces,
        displaced_btpd=volumes,
        undented_btpbnc=np.ascontiguousarray(curves[:, :, :, 0]),
        curves=WholeCurves(curves),
    )

    return Library(
        walls=walls,
        stiffening=float(walls.stiffening[0]),
        **{name: getattr(plan, name) for name in AXES_AND_SIZES},
        max_force_ratio=plan.grid.max_force_ratio_m2,
        polar_rad=POLAR_RAD,
        stiffness_atpd=np.stack(
            [np.full(forces.shape[1:], stiffness(polar)) for polar in POLAR_RAD]
        ),
        contact_polar_rad=0.0,
    )


def made_up_library(most: float = 30.0) -> Library:
    """The analytic library, small, with walls of five stiffenings from 0 on; stiffening
    walls bear more.
    """
    grid = LibraryStudy(stiffening=Range(min=0.0, max=most))
    stiffenings = plan_library(Study(library=grid)).stiffening
    count = grid.stiffenings
    soft = analytic_library(thicknesses=4, ratios=4, tips=5, nodes=9)
    factor = (1.0 + 0.2 * np.log1p(stiffenings))[:, None, None, None]
    walls = StiffenedWalls(
        stiffening=stiffenings,
        force_ratio_btpd=factor * soft.force_ratio_tpd,
        displaced_btpd=np.tile(soft.displaced_tpd, (count, 1, 1, 1)),
        undented_btpbnc=np.tile(soft.undented_tpbnc, (count, 1, 1, 1, 1, 1)),
        curves=WholeCurves(np.tile(soft.curves_tpdbnc(), (count, 1, 1, 1, 1, 1, 1))),
    )

    return replace(soft, walls=walls)


# eyes whose form and stated values have no errors
EXACT_EYES = ReaderStudy(
    uneven_share=0.0,
    iop_noise_fraction=0.0,
    thickness_noise_fraction=0.0,
    gap_noise_fraction=0.0,
    thickness_m=Range(min=500e-6, max=700e-6),
    iop_pa=Range(min=200.0, max=400.0),
)


def without_rests(
    forces_n: np.ndarray, rng: np.random.Generator, sd_n: float = LABEL_SD_N
) -> FrameForces:
    """Return true forces with noise, in the place of `interval_measurement.label_forces`."""
    noise_n = sd_n * rng.standard_normal(len(forces_n))
    return FrameForces(
        forces_n + noise_n, np.zeros(len(forces_n)), np.zeros(2), ZERO_PRIOR
    )
