"""One virtual eye in three dimensions at finite strain: its load path, and what the B-scan plane sees of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, sin

from figures.eyes import FigureEye
from scleraforce.eye.form import form_mesh
from scleraforce.eye.mesh import HexMesh
from scleraforce.eye.study_mesh import study_mesh
from scleraforce.imaging.plane import Section
from scleraforce.imaging.section import cut_section
from scleraforce.mechanics.finite_strain import FiniteWall, LoadPath
from scleraforce.mechanics.needle import needle_at
from scleraforce.mechanics.quadrature import gauss_points
from scleraforce.recording.virtual_eye import PhantomEye
from scleraforce.study import Study

__all__ = ["ComputedEye", "compute_eye"]

DEEPEST_M = 7e-3  # dents go no further: an eye that gives way before its largest force bears what it bears there
ROOM = 1e-4  # of a force, below the end of the path
CORE, RINGS = 8, 20  # of the mesh: tip displacements are within 1 % of those of one with twice the elements


@dataclass(frozen=True)
class ComputedEye:
    """An eye whose load path is known: `largest_n` is the force that its frames go up to."""

    eye: PhantomEye
    mesh: HexMesh
    path: LoadPath
    largest_n: float

    def sections(self, forces_n: Sequence[float]) -> list[Section]:
        """Return the sections for needle forces in N."""
        return [cut_section(self.mesh, self.eye.plane, self.path.displacement_nc(force_n)) for force_n in forces_n]

    def tips_m(self, forces_n: Sequence[float]) -> list[float]:
        """Return the depth of the dent for needle forces in N."""
        return [self.path.tip_m(force_n) for force_n in forces_n]


def compute_eye(drawn: FigureEye) -> ComputedEye:
    """Compute an eye's path up to the study's largest force, or as far as the deepest dent.

    Raises:
        SolverError: no equilibrium was found on the way.
    """
    eye, study = drawn.eye, fine(drawn.study)
    contact = eye.plane.contact
    formed = form_mesh(study_mesh(study, eye.thickness_m, contact), study.form, contact)
    factor_ep = formed.modulus_factor(gauss_points(3, formed.mesh.order + 1)[0])
    wall = FiniteWall(formed.mesh, study.eye.poisson_ratio, modulus_factor_ep=factor_ep)
    tilt, around = study.needle.tilt_rad, study.needle.tilt_direction_rad
    axis = -cos(tilt) * contact.normal + sin(tilt) * (cos(around) * contact.meridian + sin(around) * contact.parallel)
    needle = needle_at(formed.mesh, contact, study.needle.outer_diameter_m / 2, axis)
    path = wall.load_path(
        needle,
        youngs_modulus_pa=eye.youngs_modulus_pa,
        iop_pa=eye.iop_pa,
        density_kg_m3=study.eye.density_kg_m3,
        max_force_n=study.needle.max_force_n,
        max_tip_m=DEEPEST_M,
    )
    largest_n = min(study.needle.max_force_n, path.max_force_n * (1.0 - ROOM))
    return ComputedEye(eye, formed.mesh, path, largest_n)


def fine(study: Study) -> Study:
    """Return a study with the mesh of these eyes."""
    return replace(study, mesh=replace(study.mesh, kind="graded", core=CORE, rings=RINGS, layers=1, order=2))
