"""What stiffening tissue does to a reading: the forces and fits of docs/physics.md.

Walls of revolution of 0.6 mm, radius 12 mm, needle at the pole, with stiffening b, are
fitted by walls without stiffening: with the best E, or with E and the rigidity k of the
globe. They fit the outer surface, moved in depth, under 10, 20 and 30 mN; each surface
under 2 to 40 mN is then read as the force of the nearest one. Printed are E over the
true one, k, the root mean square error of the force and the largest, in mN. No light,
no noise, no prior. Some minutes on one core.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import click
import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import least_squares

from figures.accuracy import rms
from figures.printing import ROWS, listed, print_table
from figures.pushed_walls import NEEDLE_RADIUS_M, NU, RADIUS_M, THICKNESS_M, Floats
from scleraforce.base.errors import SolverError
from scleraforce.base.units import to_si
from scleraforce.mechanics.axisymmetric_wall import EvenWall, axisymmetric_path
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.records.globe import sealed_law

# of the sections in view: from the needle axis to half of a slice
SEEN_M = np.linspace(0.0, 7e-3, 71)
SHOWN_M = np.array([0.3, 1.0, 1.5, 2.0]) * 1e-3
FORCES_N = np.arange(2.0, 41.0, 2.0) * 1e-3
CALIBRATED_N = np.array([10e-3, 20e-3, 30e-3])
TIPS_M = np.concatenate([np.arange(1, 20) * 5e-5, np.arange(10, 41) * 1e-4])
END_N = 60e-3
FINE = 1201  # forces among which a section is looked for
FAR = 1e3  # error of a wall without equilibrium, in 10 um


@dataclass(frozen=True)
class StiffEye:
    """Modulus in MPa, resting pressure in mmHg, rigidity k (0: open), stiffening b."""

    modulus_mpa: float
    iop_mmhg: float
    rigidity: float
    stiffening: float = 0.0


EYES = (
    StiffEye(0.4, 2.0, 0.0),
    StiffEye(0.4, 2.0, 0.02),
    StiffEye(1.2, 18.0, 0.02),
)
STIFFENINGS = (0.0, 1.0, 3.0, 10.0, 30.0)


class Wall:
    """The path of an eye as functions of dent and force."""

    def __init__(self, eye: StiffEye) -> None:
        """Follow the path to 60 mN."""
        modulus_pa = 1e6 * eye.modulus_mpa
        path = axisymmetric_path(
            EvenWall(
                RADIUS_M, THICKNESS_M, NU, NEEDLE_RADIUS_M, stiffening=eye.stiffening
            ),
            to_si(eye.iop_mmhg, "mmhg") / modulus_pa,
            PathEnd(tips_m=TIPS_M, max_force=END_N).over(modulus_pa),
            sealed_law(to_si(eye.rigidity, "mmhg13_per_ul")).over(modulus_pa),
        )
        forces_n = modulus_pa * path.force_ratio_m2
        self.force_n = PchipInterpolator(path.tip_m, forces_n)
        self.tip_m = PchipInterpolator(forces_n, path.tip_m)
        depths_sn = np.array(
            [np.interp(SEEN_M, *curve.T) for curve in path.curves_sbnc[:, 0]]
        )
        self._surface = PchipInterpolator(
            path.tip_m, depths_sn - depths_sn.mean(axis=1, keepdims=True)
        )
        self._strongest_n = forces_n[-1]

    def surface_m(self, force_n: Floats) -> Floats:
        """Return the outer surface under forces, (force, place) in m."""
        tips_m = self.tip_m(np.minimum(force_n, self._strongest_n))
        return np.asarray(self._surface(tips_m))

    def read_n(self, surfaces_m: Floats) -> Floats:
        """Return the forces whose surfaces are nearest to some, (surface,) in N."""
        forces_n = np.linspace(0.0, self._strongest_n, FINE)
        apart = np.square(self.surface_m(forces_n) - surfaces_m[:, None]).sum(axis=-1)
        return np.asarray(forces_n[apart.argmin(axis=1)])


def fitted_eye(eye: StiffEye, seen_m: Floats, free: int) -> StiffEye:
    """Return the eye without stiffening whose surfaces are nearest; `free` 1: E alone,
    2: E and k.
    """

    def changed(x: Floats) -> StiffEye:
        rigidity = float(x[1]) if free == 2 else eye.rigidity
        return StiffEye(eye.modulus_mpa * float(x[0]), eye.iop_mmhg, rigidity)

    def error(x: Floats) -> Floats:
        """In 10 um."""
        try:
            wall = Wall(changed(x))
        except SolverError:  # no equilibrium, or the pressure runs away
            return np.full(seen_m.size, FAR)
        return 1e5 * (wall.surface_m(CALIBRATED_N) - seen_m).ravel()

    found = least_squares(
        error,
        [1.05, max(eye.rigidity, 0.003)][:free],
        bounds=([0.3, 0.0][:free], [6.0, 0.2][:free]),
        x_scale=[1.0, 0.02][:free],
        diff_step=[1e-3] * free,
    )
    return changed(found.x)


def stiffening_rows(rows: int | None) -> Iterator[list[object]]:
    """Yield forces at dents, and what each fit leaves."""
    for plain, stiffening in product(EYES[:rows], STIFFENINGS[:rows]):
        eye = StiffEye(plain.modulus_mpa, plain.iop_mmhg, plain.rigidity, stiffening)
        wall = Wall(eye)
        shown_m = SHOWN_M[wall.tip_m(FORCES_N[-1]) >= SHOWN_M]
        cells = [listed(1e3 * wall.force_n(shown_m), ".1f")]

        for free in (1, 2):
            other = fitted_eye(eye, wall.surface_m(CALIBRATED_N), free)
            read_n = Wall(other).read_n(wall.surface_m(FORCES_N))
            left_mn = 1e3 * (read_n - FORCES_N)
            over = other.modulus_mpa / eye.modulus_mpa
            cells.append(f"{over:.2f}, {other.rigidity:.3f}")
            cells.append(f"{rms(left_mn):.2f}, {np.abs(left_mn).max():.2f}")

        yield [eye.modulus_mpa, eye.iop_mmhg, eye.rigidity, stiffening, *cells]


@click.command(help=__doc__)
@ROWS
def main(rows: int | None) -> None:
    """Print the table."""
    eye = ["E, MPa", "IOP, mmHg", "k", "b", "mN at 0.3, 1, 1.5, 2 mm below 40 mN"]
    fits = ["E, k: E alone fitted", "left, mN", "E, k: both fitted", "left, mN"]
    print_table([*eye, *fits], stiffening_rows(rows))
