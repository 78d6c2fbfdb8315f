"""Accuracy and speed of the wall of revolution: the tables of docs/physics.md.

    python benchmarks/bench_axisymmetric.py [--solid] [--rows N]

`--solid` compares it with 3-D finite strain, needles at 0 to 50 deg and dents to 4 mm:
some 20 s an eye; `--rows` keeps the first N rows of each table. Times are of one core.
"""

import argparse
from itertools import islice, product
from time import process_time

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from reference_walls import (
    DeadPressureWall,
    cut_section,
    polar_path,
    shift_in_plane,
    spread_needle,
)
from scleraforce.mechanics.axisymmetric_wall import (
    AxisymmetricPath,
    AxisymmetricWall,
    BaseShift,
    EvenWall,
    axisymmetric_path,
    base_shift,
)
from scleraforce.mechanics.contact_and_section import Contact, ScanPlane, WallSection
from scleraforce.mechanics.finite_strain_wall import FiniteWall, LoadPath
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.load_path_tracing import PathEnd, pressurise, trace_load_path
from scleraforce.mechanics.loads_and_supports import needle_at
from scleraforce.mechanics.meridian_elements import MeridianSize, meridian_mesh
from scleraforce.records.globe import CONSTANT_PRESSURE, study_law
from scleraforce.records.study import GlobeStudy

Floats = NDArray[np.float64]

RADIUS_M = 12e-3
NU = 0.45
NEEDLE_RADIUS_M = 0.35e-3
GAP_M = 0.5e-3
WINDOW_M = (7e-3, 4e-3)  # half the width, and the depth, in which sections are compared
# mm, MPa, Pa: the share in `polar` comes from these
EYES = (
    (0.5, 0.25, 266.0),
    (0.8, 0.38, 266.0),
    (0.8, 0.27, 400.0),
)
OTHERS = ((0.4, 0.35, 300.0), (0.65, 0.22, 150.0), (0.9, 0.5, 500.0))
POLAR_DEG = (0.0, 25.0, 35.0, 45.0, 50.0)
DENTS_M = np.array([0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0]) * 1e-3
FINE_TIPS_M = np.linspace(0.1e-3, 5e-3, 50)
R2_FORCES_N = np.array([5, 10, 15, 20, 25, 30, 40, 50, 60]) * 1e-3
R2_TIPS_MM = {
    (0.8, 0.27, 35): (0.144, 0.309, 0.505, 0.750, 1.073, 1.502, 2.541, 3.503, 4.379),
    (0.8, 0.38, 35): (0.102, 0.215, 0.342, 0.488, 0.660, 0.872, 1.484, 2.319, 3.125),
    (0.5, 0.22, 35): (0.422, 1.141, 1.941, 2.663, 3.343, 4.001, 5.289, 6.562),
    (0.8, 0.38, 0): (0.106, 0.222, 0.353, 0.503, 0.680, 0.897, 1.528, 2.393, 3.233),
    (0.8, 0.38, 50): (0.102, 0.215, 0.342, 0.487, 0.657, 0.865, 1.456, 2.265, 3.057),
}


def print_paths(rows: int | None) -> None:
    """Print the time of a path of 30 states to 7.5 mm, and the error of its forces
    against a fine mesh.
    """
    tips_m = np.linspace(0.25e-3, 7.5e-3, 30)
    print(
        "one path: t mm, E MPa, IOP Pa, elements, s, largest F/E mm^2, largest error of"
        " the force %"
    )
    walls = ((0.35, 0.2, 0.0), (0.35, 0.2, 266.0), *EYES, (0.9, 0.2, 533.0))

    for thickness_mm, modulus_mpa, iop_pa in walls[:rows]:
        forces: dict[int, Floats] = {}
        for elements in (200, 64, 48, 32):
            start = process_time()
            wall = EvenWall(
                RADIUS_M,
                1e-3 * thickness_mm,
                NU,
                NEEDLE_RADIUS_M,
                size=MeridianSize(elements),
            )
            iop_ratio = 1e-6 * iop_pa / modulus_mpa
            path = axisymmetric_path(wall, iop_ratio, PathEnd(tips_m=tips_m))
            seconds = process_time() - start
            forces[elements] = path.force_ratio_m2[1:]
            error = 100.0 * np.abs(forces[elements] / forces[200] - 1.0).max()
            largest = 1e6 * forces[elements].max()
            print(
                f"  {thickness_mm} {modulus_mpa} {iop_pa:3g} {elements:4d}"
                f" {seconds:.3f} {largest:.3f} {error:.3f}"
            )


def print_r2(rows: int | None) -> None:
    """Print the tips of reference problem R2: dead pressure, a Gaussian, needle at the
    pole.
    """
    print(
        "R2: t mm, E MPa, polar angle of the 3-D figure; tip in mm, and % from the"
        " figure"
    )
    for (thickness_mm, modulus_mpa, polar_deg), expected_mm in islice(
        R2_TIPS_MM.items(), rows
    ):
        mesh = meridian_mesh(
            RADIUS_M, 1e-3 * thickness_mm, NEEDLE_RADIUS_M, 0.5 * np.pi, MeridianSize()
        )
        loaded = AxisymmetricWall(mesh, NU)
        spread_needle(loaded, lambda d: np.exp(-0.5 * (d / 0.35e-3) ** 2))
        wall = DeadPressureWall(loaded)
        pressure = 266e-6 / modulus_mpa
        end_m = 1e-3 * expected_mm[-1] + 0.3e-3
        path = trace_load_path(
            wall,
            pressurise(wall, pressure),
            pressure,
            PathEnd(tips_m=np.linspace(0.1e-3, end_m, 60)),
        )
        forces = 1e-6 * R2_FORCES_N[: len(expected_mm)] / modulus_mpa
        tips_mm = 1e3 * CubicSpline(path.force, path.tip_m)(forces)
        off = 100.0 * (tips_mm / np.array(expected_mm) - 1.0)
        print(
            f"  {thickness_mm} {modulus_mpa} {polar_deg:2d}  {np.round(tips_mm, 3)} "
            f" {np.round(off, 1)}"
        )


def print_sealed(rows: int | None) -> None:
    """Print pressure and force of a sealed globe relative to an open one."""
    tips_m = np.array([0.5e-3, 1e-3, 1.5e-3])
    print(
        "sealed: t mm, E MPa, IOP Pa, support deg; pressure / IOP and force / force of"
        " the open globe at 0.5, 1, 1.5 mm"
    )

    for (thickness_mm, modulus_mpa, iop_pa), support_deg in islice(
        product(EYES, (90.0, 170.0)), rows
    ):
        wall = EvenWall(
            RADIUS_M,
            1e-3 * thickness_mm,
            NU,
            NEEDLE_RADIUS_M,
            support_rad=np.radians(support_deg),
            size=MeridianSize(80),
        )
        iop_ratio = 1e-6 * iop_pa / modulus_mpa
        globes = (
            CONSTANT_PRESSURE,
            study_law(GlobeStudy("sealed")).over(1e6 * modulus_mpa),
        )
        opened, sealed = (
            axisymmetric_path(wall, iop_ratio, PathEnd(tips_m=tips_m), globe)
            for globe in globes
        )
        pressure = sealed.iop_ratio[1:] / sealed.iop_ratio[0]
        force = sealed.force_ratio_m2[1:] / opened.force_ratio_m2[1:]
        print(
            f"  {thickness_mm} {modulus_mpa} {iop_pa:g} {support_deg:3g} "
            f" {pressure.round(2)}  {force.round(2)}"
        )


def solid_path(
    thickness_mm: float, modulus_mpa: float, iop_pa: float, contact: Contact
) -> tuple[FiniteWall, LoadPath]:
    """Return the 3-D wall of the default graded mesh and its path to a dent of 4.2
    mm.
    """
    wall = FiniteWall(graded_mesh(RADIUS_M, 1e-3 * thickness_mm, contact), NU)
    path = wall.load_path(
        needle_at(wall.mesh, contact, NEEDLE_RADIUS_M),
        PathEnd(max_force=1e3, max_tip_m=4.2e-3),
        youngs_modulus_pa=1e6 * modulus_mpa,
        iop_pa=iop_pa,
        density_kg_m3=0.0,
    )

    return wall, path


class Reduced:
    """A path of revolution read at a force ratio, with or without the shift of
    `polar`.
    """

    def __init__(self, path: AxisymmetricPath, shift: BaseShift | None) -> None:
        self._force, self._curves = (
            CubicSpline(path.tip_m, values)
            for values in (path.force_ratio_m2, path.curves_sbnc)
        )
        self._shift = shift
        self._iop_ratio = float(path.iop_ratio[0])

    def tip_m(self, force_ratio: float) -> float:
        """Return the first tip that carries a force ratio."""
        return float(self._force.solve(force_ratio, extrapolate=False).min())

    def section(self, force_ratio: float) -> WallSection:
        """Return the section along the meridian."""
        curves_bnc = self._curves(self.tip_m(force_ratio))
        lateral_bn = np.sqrt(np.maximum(curves_bnc[..., 0] ** 2 - GAP_M**2, 0.0))
        sides = []

        for side in (-1.0, 1.0):
            points = np.stack([side * lateral_bn, curves_bnc[..., 1]], axis=-1)
            if self._shift is not None:
                points += shift_in_plane(
                    self._shift,
                    self._iop_ratio,
                    force_ratio,
                    side * lateral_bn,
                    GAP_M,
                    0.0,
                )

            sides.append(points)

        met = curves_bnc[..., 0] >= GAP_M
        return WallSection(
            *(
                np.concatenate([sides[0][b][met[b]][::-1], sides[1][b][met[b]]])
                for b in (0, 1)
            )
        )


def distance_m(points: Floats, curve: Floats) -> float:
    """Return the largest distance of points in the window from a curve."""
    shown = points[(np.abs(points[:, 0]) < WINDOW_M[0]) & (points[:, 1] < WINDOW_M[1])]
    places = np.linspace(0.0, len(curve) - 1.0, 20 * len(curve))
    dense = np.stack(
        [np.interp(places, np.arange(len(curve)), curve[:, k]) for k in (0, 1)], axis=1
    )

    return max(
        float(np.linalg.norm(dense - point, axis=1).min()) for point in shown[::4]
    )


def print_solid(rows: int | None) -> None:
    """Print tips at equal force and sections, with neither, either and both corrections
    of `polar`.
    """
    print(
        "3-D: t mm, E MPa, IOP Pa, polar deg; without, with stiffening, with shift,"
        " with both: tip %, section mm"
    )
    for (thickness_mm, modulus_mpa, iop_pa), polar_deg in islice(
        product(EYES + OTHERS, POLAR_DEG), rows
    ):
        contact = Contact(polar_rad=float(np.radians(polar_deg)))
        wall, solid = solid_path(thickness_mm, modulus_mpa, iop_pa, contact)
        even = EvenWall(RADIUS_M, 1e-3 * thickness_mm, NU, NEEDLE_RADIUS_M)
        shift = base_shift(even, contact.polar_rad)
        report = []

        for moved, angle in product((None, shift), (0.0, contact.polar_rad)):
            ratio = 1e-6 * iop_pa / modulus_mpa
            reduced = Reduced(polar_path(even, ratio, angle, FINE_TIPS_M), moved)
            tips = []
            sections = []

            for dent_m, force_n in zip(
                DENTS_M, CubicSpline(solid.tips_m, solid.forces_n)(DENTS_M), strict=True
            ):
                force_ratio = 1e-6 * float(force_n) / modulus_mpa
                tips.append(100.0 * (reduced.tip_m(force_ratio) / dent_m - 1.0))
                cut = cut_section(
                    wall.mesh,
                    ScanPlane(contact, gap_m=GAP_M),
                    solid.displacement_at_tip_nc(dent_m),
                )
                made = reduced.section(force_ratio)
                sections.append(
                    max(
                        distance_m(cut.outer, made.outer),
                        distance_m(cut.inner, made.inner),
                    )
                )

            report.append(
                f"{tips[int(np.argmax(np.abs(tips)))]:+.1f} {1e3 * max(sections):.3f}"
            )

        print(
            f"  {thickness_mm} {modulus_mpa} {iop_pa:g} {polar_deg:2g} "
            f" {' | '.join(report)}",
            flush=True,
        )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--solid", action="store_true")
    parser.add_argument("--rows", type=int, help="only the first N of each table")
    given = parser.parse_args()
    print_paths(given.rows)
    print_r2(given.rows)
    print_sealed(given.rows)

    if given.solid:
        print_solid(given.rows)


if __name__ == "__main__":
    main()
