"""Our mechanics beside published theory and measurement: the tables of
benchmarks/real_tissue/README.md.

Half a minute on one core. The stamp above the tables is that of the page.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, product

import click

from figures.printing import ROWS, print_table
from figures.pushed_walls import NEEDLE_RADIUS_M, NU, RADIUS_M
from provenance.stamps import new_stamp
from real_tissue.porcine import IOP_PA, modulus_by_shell_theory, small_load_modulus
from real_tissue.rigidity import (
    distension_modulus,
    globe_path,
    laws,
    mmhg_per_ul,
    own_mmhg_per_ul,
)
from real_tissue.shells import point, pressure_ratio, shallow, sphere
from real_tissue.walls import PressedWall, disc_wall, fine_meridian, pressed_wall
from scleraforce.base.units import from_si, to_si
from scleraforce.records.globe import CONSTANT_PRESSURE, sealed_law

SHELL_MODULUS_PA = 0.25e6
THICKNESSES_MM = (0.05, 0.15, 0.25, 0.5, 0.8)
TENSIONS = (0.0, 1.0, 4.0)
# p R/(E h): above it a wall nears its burst, and no closed form is meant for it
LARGEST_STRETCHING = 0.25
PRESSURES_MMHG = (2.0, 15.0, 30.0)
# thickness in m, E and resting pressure in Pa: the eye of docs/physics.md
EXAMPLE = (0.6e-3, 0.45e6, 266.0)
# 15 to 50 mmHg over five or four steps of 100 ul
PORCINE_MMHG_PER_UL = (35.0 / 500.0, 35.0 / 400.0)
Rows = Iterator[list[str]]


@dataclass(frozen=True)
class Sphere:
    """A whole sphere of middle radius 12 mm, pressed at both poles over the needle's
    disc: thickness in m, p/E, and ours.
    """

    thickness_m: float
    pressure: float
    ours: PressedWall

    @property
    def closed(self) -> tuple[float, float, float, float]:
        """Stiffness by the closed forms, each of which adds one effect, in m."""
        ours = self.ours
        rest = (self.thickness_m, RADIUS_M, self.pressure, NEEDLE_RADIUS_M, NU)
        grown = (ours.thickness_m, ours.radius_m, *rest[2:])
        plain = sphere(*rest, shear=False)
        return shallow(*rest), plain, sphere(*rest), sphere(*grown)

    @property
    def off_percent(self) -> list[float]:
        """Our stiffness over each closed form's, in %."""
        return [100.0 * (self.ours.stiffness_m / form - 1.0) for form in self.closed]


def pressed(thickness_m: float, tension: float) -> Sphere:
    """Return our sphere under Vella's tension."""
    pressure = pressure_ratio(tension, thickness_m, RADIUS_M, NU)
    mesh = fine_meridian(RADIUS_M + 0.5 * thickness_m, thickness_m, NEEDLE_RADIUS_M)
    wall = disc_wall(mesh, NEEDLE_RADIUS_M, NU, symmetric=True)
    return Sphere(thickness_m, pressure, pressed_wall(wall, pressure))


def stretching(thickness_m: float, tension: float) -> float:
    """Return p R/(E h) for Vella's tension."""
    return pressure_ratio(tension, thickness_m, RADIUS_M, NU) * RADIUS_M / thickness_m


def shells() -> Rows:
    """Stiffness of a pressurised sphere for small loads: closed forms, and ours over
    them.
    """
    first = ["t, mm", "tension τ", "pR/(Et)", "Vella, point", "disc", "**ours**"]
    yield [
        *first,
        "over the disc",
        "whole sphere",
        "and shear",
        "and sizes under pressure",
    ]
    for thickness_mm, tension in product(THICKNESSES_MM, TENSIONS):
        thickness_m = 1e-3 * thickness_mm
        if stretching(thickness_m, tension) <= LARGEST_STRETCHING:
            wall = pressed(thickness_m, tension)
            vella = point(thickness_m, RADIUS_M, wall.pressure, NU)
            stiffness = (vella, wall.closed[0], wall.ours.stiffness_m)
            yield [
                f"{thickness_mm:g}",
                f"{tension:g}",
                f"{stretching(thickness_m, tension):.3f}",
                *(f"{SHELL_MODULUS_PA * value:.3g}" for value in stiffness),
                *(f"{off:+.1f} %" for off in wall.off_percent),
            ]


def punch() -> Rows:
    """E of the stiffness that was measured on porcine sclera, by how it is pressed."""
    yield ["how the sclera is pressed", "E, MPa"]
    loads = {
        "shell theory without pressure, uniform over the disc": (
            modulus_by_shell_theory()
        ),
        "ours without pressure, uniform, small load": small_load_modulus(
            bonded=False, iop_pa=0.0
        ),
        "ours at 15 mmHg, uniform, small load": small_load_modulus(bonded=False),
        "ours at 15 mmHg, disc bonded to the wall, small load": small_load_modulus(
            bonded=True
        ),
    }
    for name, modulus_pa in loads.items():
        yield [name, _mpa(modulus_pa)]


def volumes() -> Rows:
    """DP/dV of the measured laws and of the model's own wall."""
    pressures = (f"dP/dV at {pressure:g} mmHg" for pressure in PRESSURES_MMHG)
    yield ["", "as printed", "k, mmHg^⅓/µl", *pressures]
    for law in laws():
        slopes = (law.mmhg_per_ul(pressure) for pressure in PRESSURES_MMHG)
        cells = (f"{slope:.3f}" for slope in slopes)
        yield [law.name, law.printed, f"{law.rigidity:.4f}", *cells]

    walls = {
        "model, half-sphere, 0.7 mm, 0.25 MPa": (0.7e-3, 0.25e6, True),
        "model, whole sphere, 0.7 mm, 0.25 MPa": (0.7e-3, 0.25e6, False),
        "model, whole sphere, 0.8 mm, 1.2 MPa": (0.8e-3, 1.2e6, False),
    }
    for name, (thickness_m, modulus_pa, half) in walls.items():
        own = (
            own_mmhg_per_ul(thickness_m, modulus_pa, pressure, half=half)
            for pressure in PRESSURES_MMHG
        )
        yield [name, "", "", *(f"{slope:.3f}" for slope in own)]

    human = mmhg_per_ul(float(laws()[0].globe.stiffness(IOP_PA)))
    for name, wanted in (
        ("E that a whole sphere of 0.8 mm needs for van der Werff's, MPa", (human,)),
        ("for the porcine 35 mmHg in 400 to 500 µl, MPa", PORCINE_MMHG_PER_UL),
    ):
        moduli = (distension_modulus(0.8e-3, 15.0, value) for value in wanted)
        yield [name, "", "", "", " to ".join(map(_mpa, moduli)), ""]


def sealed_dents() -> Rows:
    """Pressure and force at a dent: open, and by measured laws."""
    thickness_m, modulus_pa, iop_pa = EXAMPLE
    yield ["dent, mm", "open", "k = 0.0042", "k = 0.03"]
    globes = [
        CONSTANT_PRESSURE,
        *(
            sealed_law(to_si(rigidity, "mmhg13_per_ul")).over(modulus_pa)
            for rigidity in (0.0042, 0.03)
        ),
    ]
    for dent_mm in (0.8, 1.4, 2.0):
        cells = []
        for globe in globes:
            path = globe_path(thickness_m, iop_pa / modulus_pa, 1e-3 * dent_mm, globe)
            under_pa = modulus_pa * float(path.iop_ratio[-1])
            force_mn = 1e3 * modulus_pa * float(path.force_ratio_m2[-1])
            cells.append(f"{under_pa:.0f} Pa, {force_mn:.1f} mN")

        yield [f"{dent_mm:g}", *cells]


def _mpa(modulus_pa: float) -> str:
    return f"{from_si(modulus_pa, 'mpa'):.2f}"


TABLES = {
    "shells": shells,
    "punch": punch,
    "volumes": volumes,
    "sealed_dents": sealed_dents,
}


@click.command(help=__doc__)
@click.argument("tables", nargs=-1, type=click.Choice(list(TABLES)))
@ROWS
def main(tables: tuple[str, ...], rows: int | None) -> None:
    """Print the tables, all where none is named."""
    print(new_stamp("python -m figures real-tissue"))
    for name in tables or TABLES:
        table = TABLES[name]()
        print(f"\n{name}\n")
        print_table(next(table), islice(table, rows))
