"""The virtual eyes of the figures, from fixed seeds that nothing else uses: plain half-spheres and harder ones."""

from dataclasses import dataclass, replace
from math import pi, radians

import numpy as np

from scleraforce.laboratory.virtual_eye import PhantomEye
from scleraforce.study import FormStudy, MechanicsStudy, MeshStudy, RegionStudy, Study, WaveStudy
from scleraforce.units import to_si

__all__ = ["GROUPS", "FigureEye", "draw_eyes"]

SEED = 20_261_121  # of the draws of this benchmark alone; those of 402_026 were looked at while the reader was made
GROUPS = ("plain", "harder")
FRAMES = 20
CORE, RINGS = 8, 20  # of the mesh: tip displacements are within 1 % of those of one with twice the elements


@dataclass(frozen=True)
class FigureEye:
    """One virtual eye: what it is, its study (form, tilt of the needle) and where its forces lie.

    `shares` are uniform between 0 and 1, one for each frame: the forces as shares of the largest one, which is the
    study's or, in an eye that gives way before, less (see `sections.bearable_force_n`).
    """

    group: str
    eye: PhantomEye
    study: Study
    shares: tuple[float, ...]
    seed: int

    def forces_n(self, largest_n: float) -> tuple[float, ...]:
        """Return the forces of the frames, in N, where the largest one is `largest_n`."""
        return tuple(share * largest_n for share in self.shares)


def draw_eyes(group: str, count: int, study: Study) -> tuple[FigureEye, ...]:
    """Draw the first `count` eyes of a group; more eyes leave those before as they are.

    Args:
        group: "plain" or "harder".
        count: how many.
        study: eye, scanner, needle and virtual laboratory of all; mesh and mechanics are those of the figures.
    """
    mesh = MeshStudy(kind="graded", core=CORE, rings=RINGS)
    study = replace(study, mesh=mesh, mechanics=MechanicsStudy(kind="finite-strain"))
    return tuple(_draw_eye(group, number, study) for number in range(1, count + 1))


def _draw_eye(group: str, number: int, study: Study) -> FigureEye:
    key = (SEED, GROUPS.index(group), number)
    rng = np.random.default_rng(key)
    eye = PhantomEye(
        id=f"{group}-{number:02d}",
        thickness_m=rng.uniform(0.45e-3, 0.85e-3),
        youngs_modulus_pa=rng.uniform(0.2e6, 0.5e6),
        iop_pa=to_si(rng.uniform(1.0, 4.0), "mmhg"),
        gap_m=rng.uniform(0.4e-3, 0.9e-3),
        polar_rad=radians(rng.uniform(25.0, 45.0)),
        azimuth_rad=rng.uniform(-pi, pi),
        direction_rad=rng.uniform(-pi, pi),
    )
    shares = tuple(rng.uniform(0.0, 1.0, FRAMES).tolist())
    own = study if group == "plain" else _harder(study, rng)
    return FigureEye(group, eye, own, shares, seed=int(np.random.default_rng((*key, 1)).integers(2**31)))


def _harder(study: Study, rng: np.random.Generator) -> Study:
    """Return the study of an eye that is no even half-sphere of one material, pushed by a needle that is tilted.

    Semi-axes within 6 % of the radius; a wall whose thickness waves by 12 % about an axis anywhere; a cornea of 0.6 to
    1.4 times the modulus; a needle up to 10 degrees off the normal, to any side.
    """
    form = FormStudy(
        semi_axes=tuple(rng.uniform(0.94, 1.06, 3).tolist()),
        wave=(
            WaveStudy(
                amplitude_fraction=float(rng.choice([-0.12, 0.12])),
                degree=int(rng.integers(1, 4)),
                polar_rad=float(np.arccos(rng.uniform(-1.0, 1.0))),
                azimuth_rad=rng.uniform(-pi, pi),
            ),
        ),
        region=(RegionStudy(modulus_ratio=rng.uniform(0.6, 1.4)),),
    )
    needle = replace(study.needle, tilt_rad=radians(rng.uniform(0.0, 10.0)), tilt_direction_rad=rng.uniform(-pi, pi))
    return replace(study, form=form, needle=needle)
