"""One virtual eye in three dimensions at finite strain: its load paths, and what the
B-scan plane sees of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from figures.eyes import FigureEye, Lean
from scleraforce.lab.virtual_eye import (
    BentSections,
    SectionsAt,
    TurnedSections,
    farthest_turn_rad,
    scan_plane,
    turned_eyes,
)
from scleraforce.mechanics.finite_strain_wall import FiniteWall, LoadPath, bend_eye
from scleraforce.mechanics.graded_mesh import graded_eye
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.loads_and_supports import NeedleLoad, needle_at, tip_at
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study
from virtual_eyes import wall_of

# dents go no further: an eye that gives way before its largest force bears what it
# bears there
DEEPEST_M = 7e-3
ROOM = 1e-4  # of a force, below the end of the path


@dataclass(frozen=True)
class ComputedEye:
    """An eye whose load path is known, or the eyes of `turned_eyes`; its frames have
    forces up to `largest_n`.
    """

    setup: Setup
    study: Study
    bent: tuple[LoadPath, ...]
    largest_n: float

    @property
    def sections_at(self) -> SectionsAt:
        """Gives the sections for needle forces in N up to the largest."""
        eyes = turned_eyes(self.setup, self.study)
        knots = [
            BentSections(*turned, bent=bent)
            for turned, bent in zip(eyes, self.bent, strict=True)
        ]

        return (
            knots[0]
            if len(knots) == 1
            else TurnedSections(knots, farthest_turn_rad(self.study.phantom))
        )

    def tips_m(self, forces_n: Sequence[float]) -> list[float]:
        """Return the depth of the dent for needle forces in N, with the eye as at the
        start.
        """
        return [self.bent[0].tip_m(force_n) for force_n in forces_n]


def compute_eye(drawn: FigureEye) -> ComputedEye:
    """Compute an eye's path up to the study's largest force, or as far as the deepest
    dent, or as it is found.

    Raises:
        SolverError: the eye cannot bear its pressure.
    """
    max_force_n = drawn.study.needle.max_force_n
    if drawn.lean is None:
        bent = tuple(
            bend(eye, study, _end(max_force_n))
            for eye, study in turned_eyes(drawn.setup, drawn.study)
        )
    else:
        bent = (bend_leaning(drawn.setup, drawn.study, drawn.lean, max_force_n),)

    reached_n = min(one.max_force_n for one in bent)
    return ComputedEye(
        drawn.setup, drawn.study, bent, min(max_force_n, reached_n * (1.0 - ROOM))
    )


def bend(setup: Setup, study: Study, end: PathEnd) -> LoadPath:
    """Compute the load path of an eye up to its end."""
    wall = wall_of(setup)
    return bend_eye(
        study,
        scan_plane(setup).contact,
        end,
        thickness_m=wall.thickness_m,
        youngs_modulus_pa=wall.youngs_modulus_pa,
        iop_pa=wall.iop_pa,
    )


def _end(max_force_n: float) -> PathEnd:
    """Return the end of a path that may be lost before: the pressure runs away, or the
    wall has lost its symmetry.
    """
    return PathEnd(max_force=max_force_n, max_tip_m=DEEPEST_M, as_far_as_found=True)


def bend_leaning(
    setup: Setup, study: Study, lean: Lean, max_force_n: float
) -> LoadPath:
    """Compute the path of a plain eye under a needle that leans; a sensor along the
    needle feels its forces.

    The force is uniform over the needle's disc, seen along the needle, and keeps its
    direction (`Lean.push_rad`) and its place on the wall; the dent is the tip's way
    along the normal.
    """
    contact = scan_plane(setup).contact
    axis, push = (
        contact.leaning_axis(angle, lean.direction_rad)
        for angle in (lean.angle_rad, lean.push_rad)
    )
    mesh = graded_eye(study, wall_of(setup).thickness_m, contact)
    along = (
        needle_at(mesh, contact, 0.5 * study.needle.outer_diameter_m, axis).load_nc
        @ axis
    )
    path = FiniteWall(mesh, study.eye.poisson_ratio).load_path(
        NeedleLoad(along[:, None] * push, tip_at(mesh, contact, -contact.normal)),
        _end(max_force_n / lean.felt),
        youngs_modulus_pa=setup.eye.modulus_pa,
        iop_pa=wall_of(setup).iop_pa,
        density_kg_m3=study.eye.density_kg_m3,
    )

    return replace(path, forces_n=lean.felt * path.forces_n)
