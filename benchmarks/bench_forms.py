"""The graded mesh against finer ones, and what the form of an eye, its pressure and the
needle's tilt do to a dent.

    python benchmarks/bench_forms.py [--fine] [--rows N] [--forces N]
        [--finest CORE RINGS]

prints the tables of docs/physics.md ("Eyes that are not spheres"); `--fine` adds load
paths on finer meshes, `--rows` and `--forces` keep the first N walls or eyes and the
first N forces.
"""

import argparse
from dataclasses import replace
from itertools import islice, product
from math import radians
from resource import RUSAGE_SELF, getrusage
from time import process_time
from typing import Any

import numpy as np

from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_strain_wall import LoadPath, bend_eye
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.hexahedral_mesh import HexMesh
from scleraforce.mechanics.linear_wall import LinearWall, tip_displacement
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.records.study import (
    EyeStudy,
    FormStudy,
    MechanicsStudy,
    MeshStudy,
    NeedleStudy,
    Study,
)
from scleraforce.records.study_of_eye import RegionStudy, WaveStudy

RADIUS_M = 12e-3
NEEDLE_RADIUS_M = 0.35e-3
IOP_PA = 266.0
CONTACT = Contact(polar_rad=radians(35))
GRIDS = ((6, 10), (6, 14), (6, 20), (8, 18))
EFFECT_FORCES_MN = (10.0, 30.0, 50.0)
PATH_FORCES_MN = (5.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0)


def leaning(direction_deg: float) -> NeedleStudy:
    """A needle tilted by 10 degrees towards a direction."""
    return NeedleStudy(
        tilt_rad=radians(10.0), tilt_direction_rad=radians(direction_deg)
    )


def thicker(fraction: float) -> FormStudy:
    """A wall thicker at the contact and thinner on the other side."""
    return FormStudy(
        wave=(
            WaveStudy(
                amplitude_fraction=fraction, degree=1, polar_rad=CONTACT.polar_rad
            ),
        )
    )


EFFECTS: dict[str, dict[str, Any]] = {
    "even half-sphere": {},
    "semi-axes 1.06, 1, 0.94": {"form": FormStudy((1.06, 1.0, 0.94))},
    "semi-axes 0.94, 1, 1.06": {"form": FormStudy((0.94, 1.0, 1.06))},
    "wall 12 % thicker at the needle": {"form": thicker(0.12)},
    "wall 12 % thinner at the needle": {"form": thicker(-0.12)},
    "cornea of 0.6 E": {"form": FormStudy(region=(RegionStudy(modulus_ratio=0.6),))},
    "cornea of 1.4 E": {"form": FormStudy(region=(RegionStudy(modulus_ratio=1.4),))},
    "force leans 10° away from the pole": {"needle": leaning(0.0)},
    "force leans 10° to the pole": {"needle": leaning(180.0)},
    "force leans 10° sideways": {"needle": leaning(90.0)},
    "pressure as a dead load": {
        "mechanics": MechanicsStudy("finite-strain", follower=False)
    },
    "no weight": {"eye": EyeStudy(density_kg_m3=0.0)},
}


def linear_tip(mesh: HexMesh, contact: Contact) -> float:
    """Linear displacement of the tip under the product's needle, per N at 1 Pa."""
    wall = LinearWall(mesh, 0.45)
    return tip_displacement(
        mesh, contact, wall.needle_cnc([contact], NEEDLE_RADIUS_M)[0]
    )


def bent(
    study: Study, thickness_m: float, modulus_pa: float, max_force_mn: float
) -> LoadPath:
    """The load path of one eye at the common contact and pressure."""
    return bend_eye(
        study,
        CONTACT,
        PathEnd(max_force=max_force_mn / 1e3),
        thickness_m=thickness_m,
        youngs_modulus_pa=modulus_pa,
        iop_pa=IOP_PA,
    )


def tips_mm(eye: LoadPath, forces_mn: tuple[float, ...]) -> list[float]:
    """The tip's displacement at forces."""
    return [eye.tip_m(force_mn / 1e3) * 1e3 for force_mn in forces_mn]


def print_linear(rows: int | None, finest: tuple[int, int]) -> None:
    """Linear tips of several grids over that of a very fine one."""
    print(
        f"linear tip, per cent off {finest[0]} x {finest[1]};",
        " ".join(f"{core} x {rings}" for core, rings in GRIDS),
    )

    for thickness_m, polar_deg in islice(
        product((0.4e-3, 0.5e-3, 0.8e-3), (0.0, 35.0, 50.0)), rows
    ):
        contact = Contact(polar_rad=radians(polar_deg), azimuth_rad=0.3)
        fine = linear_tip(graded_mesh(RADIUS_M, thickness_m, contact, *finest), contact)
        tips = [
            linear_tip(graded_mesh(RADIUS_M, thickness_m, contact, *grid), contact)
            for grid in GRIDS
        ]
        print(
            f"{thickness_m * 1e3:.1f} mm, {polar_deg:.0f} deg:",
            np.round((np.array(tips) / fine - 1) * 100, 2),
        )


def print_paths(fine: bool, rows: int | None, forces_mn: tuple[float, ...]) -> None:
    """Paths to the last force: unknowns, states, processor time, memory, tips."""
    for thickness_m, modulus_pa in ((0.8e-3, 0.38e6), (0.5e-3, 0.22e6))[:rows]:
        for core, rings in GRIDS[1:] if fine else GRIDS[1:2]:
            start = process_time()
            eye = bent(
                Study(mesh=MeshStudy(core=core, rings=rings)),
                thickness_m,
                modulus_pa,
                forces_mn[-1],
            )
            seconds = process_time() - start
            memory_gb = getrusage(RUSAGE_SELF).ru_maxrss / 1e6
            print(
                f"{thickness_m * 1e3:.1f} mm, {modulus_pa / 1e6} MPa, {core} x"
                f" {rings}:",
                f"{eye.mesh.points_nc.size} unknowns,",
                f"{len(eye.tips_m)} states, {seconds:.1f} s, {memory_gb:.2f} GB;",
                np.round(tips_mm(eye, forces_mn), 3),
            )


def print_effects(rows: int | None, forces_mn: tuple[float, ...]) -> None:
    """Tips of a wall of 0.65 mm, 0.25 MPa, 2 mmHg, with one thing changed at a time."""
    plain = None
    for name, changes in islice(EFFECTS.items(), rows):
        eye = bent(replace(Study(), **changes), 0.65e-3, 0.25e6, forces_mn[-1])
        tips = np.array(tips_mm(eye, forces_mn))
        plain = tips if plain is None else plain
        cells = [
            f"{tip:.2f} ({100 * (tip / of - 1):+.1f} %)"
            for tip, of in zip(tips, plain, strict=True)
        ]
        print(
            f"| {name} |",
            " | ".join(cells),
            f"| {eye.pressure_pa(forces_mn[-1] / 1e3):.0f} Pa",
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fine", action="store_true")
    parser.add_argument("--rows", type=int, help="only the first N of each table")
    parser.add_argument("--forces", type=int, help="only the first N")
    parser.add_argument(
        "--finest", type=int, nargs=2, default=(12, 28), metavar=("CORE", "RINGS")
    )
    options = parser.parse_args()
    print_linear(options.rows, tuple(options.finest))
    print_paths(options.fine, options.rows, PATH_FORCES_MN[: options.forces])
    print_effects(options.rows, EFFECT_FORCES_MN[: options.forces])
