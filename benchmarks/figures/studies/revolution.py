"""The wall of revolution beside finer meshes and 3-D: the figures of docs/physics.md,
"Wall of revolution".

Forces of paths to 7.5 mm, by the number of elements, beside those of 200. Then six eyes
in 3-D finite strain, needles at 0 to 50 deg, dents to 4 mm: the largest errors of the
tip at equal force, and of the section, with neither correction of `polar_path`, with
either and with both. Some 20 s an eye.
"""

from collections.abc import Iterator
from itertools import islice, product

import click
import numpy as np
from scipy.interpolate import CubicSpline

from figures.printing import ROWS, print_table
from figures.pushed_walls import NEEDLE_RADIUS_M, NU, RADIUS_M, Floats, push
from reference_walls import cut_section, polar_path, shift_in_plane
from scleraforce.mechanics.axisymmetric_wall import (
    AxisymmetricPath,
    BaseShift,
    EvenWall,
    axisymmetric_path,
    base_shift,
)
from scleraforce.mechanics.contact_and_section import Contact, ScanPlane, WallSection
from scleraforce.mechanics.finite_strain_wall import FiniteWall
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.meridian_elements import MeridianSize

GAP_M = 0.5e-3
WINDOW_M = (7e-3, 4e-3)  # half the width, and the depth, in which sections are compared
# mm, MPa, Pa; of the first three comes the share of stiffening in `polar_path`
EYES = (
    (0.5, 0.25, 266.0),
    (0.8, 0.38, 266.0),
    (0.8, 0.27, 400.0),
    (0.4, 0.35, 300.0),
    (0.65, 0.22, 150.0),
    (0.9, 0.5, 500.0),
)
EXTREMES = ((0.35, 0.2, 0.0), (0.35, 0.2, 266.0), (0.9, 0.2, 533.0))
ELEMENTS = (200, 64, 48, 32)
PATH_TIPS_M = np.linspace(0.25e-3, 7.5e-3, 30)
POLAR_DEG = (0.0, 25.0, 35.0, 45.0, 50.0)
DENTS_M = np.array([0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0]) * 1e-3
FINE_TIPS_M = np.linspace(0.1e-3, 5e-3, 50)


def element_rows(rows: int | None) -> Iterator[list[object]]:
    """Yield the largest error of the force of coarser meshes, in %."""
    walls = (*EXTREMES[:2], *EYES[:3], EXTREMES[2])
    for thickness_mm, modulus_mpa, iop_pa in walls[:rows]:
        forces = [
            axisymmetric_path(
                EvenWall(
                    RADIUS_M,
                    1e-3 * thickness_mm,
                    NU,
                    NEEDLE_RADIUS_M,
                    size=MeridianSize(elements),
                ),
                1e-6 * iop_pa / modulus_mpa,
                PathEnd(tips_m=PATH_TIPS_M),
            ).force_ratio_m2[1:]
            for elements in ELEMENTS
        ]
        off = [100.0 * np.abs(force / forces[0] - 1.0).max() for force in forces[1:]]
        cells = [f"{error:.3f}" for error in off]
        yield [thickness_mm, modulus_mpa, iop_pa, *cells]


class ReducedWall:
    """A path of revolution read at a force ratio, with or without the base's shift."""

    def __init__(self, path: AxisymmetricPath, shift: BaseShift | None) -> None:
        self._force = CubicSpline(path.tip_m, path.force_ratio_m2)
        self._curves = CubicSpline(path.tip_m, path.curves_sbnc)
        self._shift = shift
        self._iop_ratio = float(path.iop_ratio[0])

    def tip_m(self, force_ratio: float) -> float:
        """Return the first tip that carries a force ratio."""
        return float(self._force.solve(force_ratio, extrapolate=False).min())

    def section(self, force_ratio: float) -> WallSection:
        """Return the section along the meridian."""
        curves_bnc = self._curves(self.tip_m(force_ratio))
        lateral_bn = np.sqrt(np.maximum(curves_bnc[..., 0] ** 2 - GAP_M**2, 0.0))
        left_bnc, right_bnc = (
            self._side(side * lateral_bn, curves_bnc[..., 1], force_ratio)
            for side in (-1.0, 1.0)
        )
        met_bn = curves_bnc[..., 0] >= GAP_M
        outer, inner = (
            np.concatenate([left_nc[met_n][::-1], right_nc[met_n]])
            for left_nc, right_nc, met_n in zip(
                left_bnc, right_bnc, met_bn, strict=True
            )
        )
        return WallSection(outer, inner)

    def _side(self, lateral_bn: Floats, depth_bn: Floats, force_ratio: float) -> Floats:
        points_bnc = np.stack([lateral_bn, depth_bn], axis=-1)
        if self._shift is None:
            return points_bnc

        return points_bnc + shift_in_plane(
            self._shift, self._iop_ratio, force_ratio, lateral_bn, GAP_M, 0.0
        )


def distance_m(points: Floats, curve: Floats) -> float:
    """Return the largest distance of points in the window from a curve."""
    shown = points[(np.abs(points[:, 0]) < WINDOW_M[0]) & (points[:, 1] < WINDOW_M[1])]
    places = np.linspace(0.0, len(curve) - 1.0, 20 * len(curve))
    dense = np.stack(
        [np.interp(places, np.arange(len(curve)), line) for line in curve.T], axis=1
    )
    return max(
        float(np.linalg.norm(dense - point, axis=1).min()) for point in shown[::4]
    )


def solid_rows(rows: int | None) -> Iterator[list[object]]:
    """Yield the largest errors beside 3-D: tip in %, section in mm."""
    for eye, polar_deg in islice(product(EYES, POLAR_DEG), rows):
        thickness_mm, modulus_mpa, iop_pa = eye
        contact = Contact(polar_rad=float(np.radians(polar_deg)))
        wall = FiniteWall(graded_mesh(RADIUS_M, 1e-3 * thickness_mm, contact), NU)
        end = PathEnd(max_force=1e3, max_tip_m=4.2e-3)
        solid = push(wall, end, 1e6 * modulus_mpa, iop_pa, contact=contact)
        forces_n = CubicSpline(solid.tips_m, solid.forces_n)(DENTS_M)
        ratios = (1e-6 * forces_n / modulus_mpa).tolist()
        plane = ScanPlane(contact, gap_m=GAP_M)
        cuts = [
            cut_section(wall.mesh, plane, solid.displacement_at_tip_nc(dent_m))
            for dent_m in DENTS_M
        ]
        even = EvenWall(RADIUS_M, 1e-3 * thickness_mm, NU, NEEDLE_RADIUS_M)
        shift = base_shift(even, contact.polar_rad)
        cells = []

        for moved, angle in product((None, shift), (0.0, contact.polar_rad)):
            iop_ratio = 1e-6 * iop_pa / modulus_mpa
            path = polar_path(even, iop_ratio, angle, FINE_TIPS_M)
            reduced = ReducedWall(path, moved)
            off = np.array([reduced.tip_m(ratio) for ratio in ratios]) / DENTS_M - 1.0
            apart_m = [
                max(
                    distance_m(cut.outer, made.outer), distance_m(cut.inner, made.inner)
                )
                for cut, made in zip(cuts, map(reduced.section, ratios), strict=True)
            ]
            worst = 100.0 * off[np.argmax(np.abs(off))]
            cells.append(f"{worst:+.1f}, {1e3 * max(apart_m):.3f}")

        yield [*eye, polar_deg, *cells]


@click.command(help=__doc__)
@ROWS
def main(rows: int | None) -> None:
    """Print the tables."""
    wall = ["t, mm", "E, MPa", "IOP, Pa"]
    print("Largest error of the force, %\n")
    counts = [f"{elements} elements" for elements in ELEMENTS[1:]]
    print_table([*wall, *counts], element_rows(rows))
    print("\nBeside 3-D: tip, %, and section, mm\n")
    ways = ["uncorrected", "with stiffening", "with shift", "with both"]
    print_table([*wall, "polar, deg", *ways], solid_rows(rows))
