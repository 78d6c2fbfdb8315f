"""Libraries of tissue of several stiffenings: a small one of walls that are solved, and one of made-up walls."""

from functools import cache

import numpy as np
from analytic_library import POLAR_RAD, analytic_library, stiffness

from scleraforce.library import Library
from scleraforce.library.build import solve_path
from scleraforce.library.family import library_of
from scleraforce.library.plan import plan_library
from scleraforce.library.stiffened import StiffenedWalls, WholeCurves
from scleraforce.study import LibraryStudy, Range, Study

__all__ = ["STIFFENINGS", "made_up_library", "solved_library"]

STIFFENINGS = plan_library(Study()).stiffening  # of the made-up library: 0, 0.5, 2.3, 8.4, 30


@cache
def solved_library(grid: LibraryStudy) -> Library:
    """The library of a study's load paths, without those of other supports: beside the pole forces grow as made up."""
    plan = plan_library(Study(library=grid))
    shape = (grid.stiffenings, grid.thicknesses, grid.tensions)
    forces, volumes, curves = (
        np.stack(each).reshape(*shape, *each[0].shape)
        for each in zip(*(solve_path(plan, unit) for unit in range(plan.paths)), strict=True)
    )
    walls = StiffenedWalls(
        stiffening=plan.stiffening,
        force_ratio_btpd=forces,
        displaced_btpd=volumes,
        undented_btpbnc=np.ascontiguousarray(curves[:, :, :, 0]),
        curves=WholeCurves(curves),
    )
    return library_of(
        walls,
        thickness_m=plan.thickness_m,
        tension=plan.tension,
        tip_m=plan.tip_m,
        radius_m=plan.radius_m,
        poisson_ratio=plan.poisson_ratio,
        needle_radius_m=plan.needle_radius_m,
        max_force_ratio=plan.grid.max_force_ratio_m2,
        polar_rad=POLAR_RAD,
        stiffness_atpd=np.stack([np.full(forces.shape[1:], stiffness(polar)) for polar in POLAR_RAD]),
        contact_polar_rad=0.0,
    )


def made_up_library(most: float = 30.0) -> Library:
    """The analytic library, small, with walls of five stiffenings from 0 on; those that stiffen bear more."""
    grid = LibraryStudy(stiffening=Range(min=0.0, max=most))
    stiffenings, count = plan_library(Study(library=grid)).stiffening, grid.stiffenings
    soft = analytic_library(thicknesses=4, ratios=4, tips=5, nodes=9)
    factor = (1.0 + 0.2 * np.log1p(stiffenings))[:, None, None, None]
    walls = StiffenedWalls(
        stiffening=stiffenings,
        force_ratio_btpd=factor * soft.force_ratio_tpd,
        displaced_btpd=np.tile(soft.displaced_tpd, (count, 1, 1, 1)),
        undented_btpbnc=np.tile(soft.undented_tpbnc, (count, 1, 1, 1, 1, 1)),
        curves=WholeCurves(np.tile(soft.curves_tpdbnc, (count, 1, 1, 1, 1, 1, 1))),
    )
    names = ("thickness_m", "tension", "tip_m", "radius_m", "poisson_ratio", "needle_radius_m", "max_force_ratio",
             "polar_rad", "stiffness_atpd", "contact_polar_rad")  # fmt: skip
    return library_of(walls, **{name: getattr(soft, name) for name in names})
