"""One virtual eye in three dimensions at finite strain: its load path, and what the B-scan plane sees of it."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from figures.eyes import FigureEye
from scleraforce.errors import SolverError
from scleraforce.imaging.plane import Section
from scleraforce.imaging.section import cut_section
from scleraforce.mechanics.study_path import BentEye, bend_eye
from scleraforce.recording.virtual_eye import PhantomEye

__all__ = ["ComputedEye", "compute_eye"]

# Dents go no further: an eye that gives way before its largest force bears what it bears there. The next one is tried
# where a wall that has lost its symmetry is not found beyond.
DEEPEST_M = (7e-3, 6e-3, 5e-3)
ROOM = 1e-4  # of a force, below the end of the path


@dataclass(frozen=True)
class ComputedEye:
    """An eye whose load path is known: `largest_n` is the force that its frames go up to."""

    eye: PhantomEye
    bent: BentEye
    largest_n: float

    def sections(self, forces_n: Sequence[float]) -> list[Section]:
        """Return the sections for needle forces in N."""
        mesh, path, plane = self.bent.mesh, self.bent.path, self.eye.plane
        return [cut_section(mesh, plane, path.displacement_nc(force_n)) for force_n in forces_n]

    def tips_m(self, forces_n: Sequence[float]) -> list[float]:
        """Return the depth of the dent for needle forces in N."""
        return [self.bent.path.tip_m(force_n) for force_n in forces_n]


def compute_eye(drawn: FigureEye) -> ComputedEye:
    """Compute an eye's path up to the study's largest force, or as far as the deepest dent that can be computed.

    Raises:
        SolverError: no equilibrium was found on the way to the least deep of the dents that are tried.
    """
    for deepest_m in DEEPEST_M[:-1]:
        with suppress(SolverError):
            return _computed(drawn, deepest_m)
    return _computed(drawn, DEEPEST_M[-1])


def _computed(drawn: FigureEye, deepest_m: float) -> ComputedEye:
    eye, max_force_n = drawn.eye, drawn.study.needle.max_force_n
    bent = bend_eye(
        drawn.study,
        eye.plane.contact,
        thickness_m=eye.thickness_m,
        youngs_modulus_pa=eye.youngs_modulus_pa,
        iop_pa=eye.iop_pa,
        max_force_n=max_force_n,
        max_tip_m=deepest_m,
    )
    return ComputedEye(eye, bent, min(max_force_n, bent.path.max_force_n * (1.0 - ROOM)))
