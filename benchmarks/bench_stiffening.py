"""Measure the effect of stiffening tissue on a reading: the tables of docs/physics.md.

    python benchmarks/bench_stiffening.py [--rows N]

Walls of revolution of 0.6 mm, radius 12 mm, needle at the pole, with stiffening b, are
fitted by walls without stiffening: with the best E, or with E and the rigidity k of the
globe. First the force at given dents is fitted, then the section: E (and k) fit the
outer surface, moved in depth, under 10, 20 and 30 mN, and each surface under 2 to 40 mN
is then read as the force of the nearest one. No light, no noise, no prior. `--rows`
keeps the first N eyes and values of b. Some minutes on one core.
"""

import argparse

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.optimize import least_squares

from scleraforce.base.errors import SolverError
from scleraforce.base.units import to_si
from scleraforce.mechanics.axisymmetric_wall import EvenWall, axisymmetric_path
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.records.globe import sealed_law

Floats = NDArray[np.float64]

RADIUS_M = 12e-3
THICKNESS_M = 0.6e-3
NU = 0.45
NEEDLE_RADIUS_M = 0.35e-3
EYES = ((0.4, 2.0, 0.0), (0.4, 2.0, 0.02), (1.2, 18.0, 0.02))  # MPa, mmHg, k; 0 is open
STIFFENINGS = (0.0, 1.0, 3.0, 10.0, 30.0)
SHOWN_M = np.array([0.3, 1.0, 1.5, 2.0]) * 1e-3
SEEN_M = np.linspace(0.0, 7e-3, 71)  # from the needle axis: half of a slice
FORCES_N = np.arange(2.0, 41.0, 2.0) * 1e-3
CALIBRATED_N = np.array([10e-3, 20e-3, 30e-3])
TIPS_M = np.concatenate([np.arange(1, 20) * 5e-5, np.arange(10, 41) * 1e-4])
END_N = 60e-3
FINE = 1201  # forces among which a section is looked for


class Wall:
    """The path of an eye as functions of dent and force."""

    def __init__(
        self, modulus_mpa: float, iop_mmhg: float, rigidity: float, b: float
    ) -> None:
        """Follow the path to 60 mN."""
        modulus_pa = 1e6 * modulus_mpa
        path = axisymmetric_path(
            EvenWall(RADIUS_M, THICKNESS_M, NU, NEEDLE_RADIUS_M, stiffening=b),
            to_si(iop_mmhg, "mmhg") / modulus_pa,
            PathEnd(tips_m=TIPS_M, max_force=END_N).over(modulus_pa),
            sealed_law(to_si(rigidity, "mmhg13_per_ul")).over(modulus_pa),
        )
        self.force_n = PchipInterpolator(path.tip_m, modulus_pa * path.force_ratio_m2)
        self.tip_m = PchipInterpolator(modulus_pa * path.force_ratio_m2, path.tip_m)
        depths_sn = np.array(
            [np.interp(SEEN_M, *curve.T) for curve in path.curves_sbnc[:, 0]]
        )
        self._surface = PchipInterpolator(
            path.tip_m, depths_sn - depths_sn.mean(axis=1, keepdims=True)
        )
        self.deepest_m = path.tip_m[-1]
        self.strongest_n = modulus_pa * path.force_ratio_m2[-1]

    def surface_m(self, force_n: Floats) -> Floats:
        """Return the outer surface under forces, (force, place) in m."""
        surface_m: Floats = self._surface(
            self.tip_m(np.minimum(force_n, self.strongest_n))
        )
        return surface_m

    def read_n(self, surfaces_m: Floats) -> Floats:
        """Return the forces whose surfaces are nearest to some, (surface,) in N."""
        forces_n = np.linspace(0.0, self.strongest_n, FINE)
        apart = np.square(self.surface_m(forces_n) - surfaces_m[:, None]).sum(axis=-1)
        nearest_n: Floats = forces_n[apart.argmin(axis=1)]
        return nearest_n


def fitted(
    eye: tuple[float, float, float], wall: Wall, free: int, *, by_section: bool
) -> tuple[Wall, str]:
    """Return the wall without stiffening that is nearest, and its E over the true one
    and k; `free` 1: E alone.
    """
    modulus_mpa, iop_mmhg, rigidity = eye
    tips_m = wall.tip_m(FORCES_N)
    seen_m = wall.surface_m(CALIBRATED_N)

    def error(x: Floats) -> Floats:
        """In mN, or in 10 um."""
        size = seen_m.size if by_section else len(tips_m)
        try:
            other = Wall(
                modulus_mpa * x[0], iop_mmhg, x[1] if free == 2 else rigidity, 0.0
            )
        except SolverError:  # no equilibrium, or the pressure runs away
            return np.full(size, 1e3)

        if by_section:
            return 1e5 * (other.surface_m(CALIBRATED_N) - seen_m).ravel()

        return 1e3 * (other.force_n(np.minimum(tips_m, other.deepest_m)) - FORCES_N)

    start = [1.05, max(rigidity, 0.003)][:free]
    low = [0.3, 0.0][:free]
    high = [6.0, 0.2][:free]
    x = least_squares(
        error,
        start,
        bounds=(low, high),
        x_scale=[1.0, 0.02][:free],
        diff_step=[1e-3] * free,
    ).x
    k = x[1] if free == 2 else rigidity

    return Wall(modulus_mpa * x[0], iop_mmhg, k, 0.0), f"{x[0]:.2f} {k:.3f}"


def print_row(eye: tuple[float, float, float], b: float) -> None:
    """Print forces at dents, and what each fit leaves: root mean square and largest
    error of the force in mN.
    """
    wall = Wall(*eye, b)
    shown_m = SHOWN_M[wall.tip_m(FORCES_N[-1]) >= SHOWN_M]
    print(
        f"  {eye[0]} {eye[1]:g} {eye[2]} {b:g} "
        f" {(1e3 * wall.force_n(shown_m)).round(1)}",
        end="",
    )
    tips_m = wall.tip_m(FORCES_N)
    seen_m = wall.surface_m(FORCES_N)

    for by_section in (False, True):
        for free in (1, 2):
            other, said = fitted(eye, wall, free, by_section=by_section)
            read_n = (
                other.read_n(seen_m)
                if by_section
                else other.force_n(np.minimum(tips_m, other.deepest_m))
            )
            left_mn = 1e3 * (read_n - FORCES_N)
            print(
                f"  {said} {np.sqrt(np.mean(left_mn**2)):.2f}"
                f" {np.abs(left_mn).max():.2f}",
                end="",
                flush=True,
            )

    print()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--rows", type=int)
    rows = parser.parse_args().rows
    print(
        "E MPa, IOP mmHg, k, b; mN at dents of 0.3, 1, 1.5, 2 mm below 40 mN; then for"
        " each fit of a wall with b = 0"
    )
    print(
        "(by force E, E and k; by section E, E and k): E over its own, k, error of the"
        " force in mN, its largest"
    )

    for eye in EYES[:rows]:
        for b in STIFFENINGS[:rows]:
            print_row(eye, b)


if __name__ == "__main__":
    main()
