"""Our mechanics beside published theory and measurement: the tables of
benchmarks/real_tissue/README.md, and docs/images/real_tissue.png.

Some minutes on one core, most of it for the flat punch. The stamp above the tables is
that of the page.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice, product
from pathlib import Path

import click
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from figures.printing import ROWS, picture, print_table
from figures.pushed_walls import NEEDLE_RADIUS_M, NU, RADIUS_M
from provenance.stamps import new_stamp
from real_tissue.porcine import (
    IOP_PA,
    MODULI_PA,
    SIZE,
    STIFFNESS_N_M,
    modulus_by_shell_theory,
    modulus_of_slope,
    pushed,
    small_load_modulus,
)
from real_tissue.punch import Pushed
from real_tissue.rigidity import (
    distension_modulus,
    globe_path,
    laws,
    mmhg_per_ul,
    own_mmhg_per_ul,
    own_pressure,
)
from real_tissue.shells import point, pressure_ratio, shallow, sphere
from real_tissue.walls import PressedWall, disc_wall, fine_meridian, pressed_wall
from scleraforce.base.errors import SolverError
from scleraforce.base.units import from_si, to_si
from scleraforce.front.report.figure_files import (
    AMBER,
    BLACK,
    BLUE,
    GREY,
    RED,
    inches,
    styled,
    write_figure,
)
from scleraforce.records.globe import CONSTANT_PRESSURE, sealed_law

SHELL_MODULUS_PA = 0.25e6
THICKNESSES_MM = (0.05, 0.15, 0.25, 0.5, 0.8)
TENSIONS = (0.0, 1.0, 4.0)
# p R/(E h): above it a wall nears its burst, and no closed form is meant for it
LARGEST_STRETCHING = 0.25
RIGIDITIES = {0.0: "open", 0.0042: "k = 0.0042", 0.03: "k = 0.03"}
DENTS_MM = (0.3, 0.5, 1.0)
PRESSURES_MMHG = (2.0, 15.0, 30.0)
# thickness in m, E and resting pressure in Pa: the eye of docs/physics.md
EXAMPLE = (0.6e-3, 0.45e6, 266.0)
# 15 to 50 mmHg over five or four steps of 100 ul
PORCINE_MMHG_PER_UL = (35.0 / 500.0, 35.0 / 400.0)
# of the picture: lines of the left half, tensions of the right half
LINES_MM = {0.15: (BLUE, "o"), 0.5: (AMBER, "s"), 0.8: (RED, "^")}
DRAWN = {0.0: "-", 2.0: "--"}
DRAWN_MM = (0.05, 0.1, 0.15, 0.2, 0.25, 0.35, 0.5, 0.65, 0.8)
FORMS = {
    "shallow shell": (GREY, "v"),
    "whole sphere": (BLUE, "o"),
    "whole sphere, shear": (RED, "s"),
}

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
    """E of the stiffness that was measured on porcine sclera, by how it is pressed and
    what the globe is.
    """
    names = (f"E, MPa, {name}" for name in RIGIDITIES.values())
    yield ["how the sclera is pressed", *names]
    small = {
        "shell theory without pressure, uniform over the disc": modulus_by_shell_theory(
            STIFFNESS_N_M
        ),
        "ours without pressure, uniform, small load": small_load_modulus(
            bonded=False, iop_pa=0.0
        ),
        "ours at 15 mmHg, uniform, small load": small_load_modulus(bonded=False),
        "ours at 15 mmHg, disc bonded to the wall, small load": small_load_modulus(
            bonded=True
        ),
    }
    for name, modulus_pa in small.items():
        yield [name, _mpa(modulus_pa), "", ""]

    paths: dict[float, dict[float, Pushed]] = {}
    for rigidity in RIGIDITIES:
        found = {modulus: _pushed(modulus, rigidity) for modulus in MODULI_PA}
        paths[rigidity] = {key: path for key, path in found.items() if path}

    for dent_mm in DENTS_MM:
        moduli = (modulus_of_slope(path, 1e-3 * dent_mm) for path in paths.values())
        yield [f"flat punch, slope at {dent_mm:g} mm", *map(_mpa, moduli)]


def _pushed(modulus_pa: float, rigidity: float) -> Pushed | None:
    """Return the path; None where the pressure of so soft a wall runs away at once."""
    try:
        return pushed(modulus_pa, rigidity)
    except SolverError:
        return None


def punch_spread() -> Rows:
    """Sensitivity to measured sizes, nu and support: E from the slope at 1 mm, and by
    shell theory.
    """
    yield ["one thing otherwise", "E, MPa, flat punch at 1 mm", "E, MPa, shell theory"]
    cases = {
        "the means": (SIZE, STIFFNESS_N_M),
        "0.11 N/mm": (SIZE, 110.0),
        "0.15 N/mm": (SIZE, 150.0),
        "t = 0.89 mm": (replace(SIZE, thickness_m=0.89e-3), STIFFNESS_N_M),
        "t = 1.17 mm": (replace(SIZE, thickness_m=1.17e-3), STIFFNESS_N_M),
        "R = 7.37 mm": (replace(SIZE, radius_m=7.37e-3), STIFFNESS_N_M),
        "R = 8.35 mm": (replace(SIZE, radius_m=8.35e-3), STIFFNESS_N_M),
        "nu = 0.49": (replace(SIZE, poisson_ratio=0.49), STIFFNESS_N_M),
        "a whole sphere between two punches": (
            replace(SIZE, symmetric=True),
            STIFFNESS_N_M,
        ),
    }
    for name, (size, stiffness_n_m) in cases.items():
        paths = {modulus: pushed(modulus, size=size) for modulus in MODULI_PA[1:4]}
        modulus = modulus_of_slope(paths, 1e-3, stiffness_n_m)
        shell = modulus_by_shell_theory(stiffness_n_m, size)
        yield [name, _mpa(modulus), _mpa(shell)]


def punch_pressures() -> Rows:
    """Rise of the stiffness below the flat punch with pressure at constant E, and E by
    shell theory.
    """
    first = ["eye pressure, mmHg", "slope at 1 mm, N/mm", "touched, % of the punch"]
    yield [*first, "E by shell theory, MPa"]
    for iop_mmhg in (5.0, 10.0, 15.0, 20.0, 30.0):
        path = pushed(0.2e6, iop_pa=to_si(iop_mmhg, "mmhg"))
        slope = 0.2e6 * float(np.interp(1e-3, path.dent_m, path.slope_m()))
        touched = 100.0 * np.interp(1e-3, path.dent_m, path.touched)
        shell = _mpa(modulus_by_shell_theory(slope))
        yield [f"{iop_mmhg:g}", f"{1e-3 * slope:.3f}", f"{touched:.0f}", shell]


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
    """Pressure and force at a dent: open, with the model's own volume held, and by the
    measured law.
    """
    thickness_m, modulus_pa, iop_pa = EXAMPLE
    held = ["the half-sphere's own volume held", "the whole sphere's"]
    yield ["dent, mm", "open", *held, "k = 0.0042", "k = 0.03"]
    for dent_mm in (0.8, 1.4, 2.0):
        tip_m = 1e-3 * dent_mm
        half_pa, whole_pa = (
            own_pressure(*EXAMPLE, tip_m, half=half) for half in (True, False)
        )
        states = [
            (pressure, CONSTANT_PRESSURE) for pressure in (iop_pa, half_pa, whole_pa)
        ]
        states += [
            (iop_pa, sealed_law(to_si(rigidity, "mmhg13_per_ul")).over(modulus_pa))
            for rigidity in (0.0042, 0.03)
        ]
        cells = []
        for pressure_pa, globe in states:
            path = globe_path(thickness_m, pressure_pa / modulus_pa, tip_m, globe)
            under_pa = modulus_pa * float(path.iop_ratio[-1])
            force_mn = 1e3 * modulus_pa * float(path.force_ratio_m2[-1])
            cells.append(f"{under_pa:.0f} Pa, {force_mn:.1f} mN")

        yield [f"{dent_mm:g}", *cells]


def _mpa(modulus_pa: float | None) -> str:
    return "none" if modulus_pa is None else f"{from_si(modulus_pa, 'mpa'):.2f}"


TABLES = {
    "shells": shells,
    "punch": punch,
    "punch_spread": punch_spread,
    "punch_pressures": punch_pressures,
    "volumes": volumes,
    "sealed_dents": sealed_dents,
}


@styled
def draw() -> Figure:
    """Draw the stiffness against the tension, and how far ours lies from the closed
    forms.
    """
    figure = Figure(figsize=inches(170, 72))
    left, right = figure.subplots(1, 2, width_ratios=[1.15, 1.0])
    draw_stiffness(left)
    draw_differences(right)
    for axes, place in ((left, "lower right"), (right, "lower left")):
        axes.legend(loc=place, fontsize=6.5)
    return figure


def draw_stiffness(axes: Axes) -> None:
    """Draw stiffness over that of Vella's point force without pressure."""
    for thickness_mm, (colour, marker) in LINES_MM.items():
        thickness_m = 1e-3 * thickness_mm
        unit = point(thickness_m, RADIUS_M, 0.0, NU)
        tensions = [
            tension
            for tension in np.linspace(0.0, 4.0, 9)
            if stretching(thickness_m, tension) < LARGEST_STRETCHING
        ]
        walls = [pressed(thickness_m, tension) for tension in tensions]
        closed = [wall.closed[2] / unit for wall in walls]
        ours = [wall.ours.stiffness_m / unit for wall in walls]
        name = f"ours, {thickness_mm:g} mm"
        axes.plot(tensions, closed, color=colour)
        axes.plot(tensions, ours, marker, color=colour, markersize=4, label=name)

    # the same curve for every thickness
    tensions = np.linspace(0.0, 4.0, 41).tolist()
    pressures = [pressure_ratio(tension, 0.15e-3, RADIUS_M, NU) for tension in tensions]
    vella = np.array([point(0.15e-3, RADIUS_M, pressure, NU) for pressure in pressures])
    name = "Vella et al. 2012, thin shell, point force"
    axes.plot(tensions, vella / vella[0], "--", color=BLACK, label=name)
    axes.plot([], [], color=GREY, label="whole sphere with shear, needle's disc")
    axes.set(
        xlabel="tension τ = pR²/(4√(E t B))",
        ylabel="stiffness over 4 E t² / (R √(3(1 - ν²)))",
        xlim=(-0.1, 4.1),
        ylim=(0.0, 3.3),
        title="A small load on a pressurised sphere",
    )


def draw_differences(axes: Axes) -> None:
    """Draw how far our stiffness is from that of closed forms, at two tensions, over
    the thickness.
    """
    for tension, dashes in DRAWN.items():
        found = []
        for thickness_mm in DRAWN_MM:
            disc, whole, _, grown = pressed(1e-3 * thickness_mm, tension).off_percent
            found.append((disc, whole, grown))

        for off, (colour, marker) in zip(
            np.transpose(found), FORMS.values(), strict=True
        ):
            axes.plot(
                DRAWN_MM,
                off,
                color=colour,
                linestyle=dashes,
                marker=marker,
                markersize=3,
            )

        label = f"τ = {tension:g}"
        axes.plot([], [], color=BLACK, linestyle=dashes, label=label)

    for name, (colour, marker) in FORMS.items():
        axes.plot([], [], color=colour, marker=marker, markersize=3, label=name)

    axes.axhspan(-2.0, 2.0, color=GREY, alpha=0.18, linewidth=0.0, label="2 %")
    axes.set(
        xlabel="thickness [mm], middle radius 12 mm",
        ylabel="ours against the closed form [%]",
        xlim=(0.0, 0.82),
        title="What the closed form leaves out",
    )


@click.command(help=__doc__)
@click.argument("tables", nargs=-1, type=click.Choice([*TABLES, "picture"]))
@ROWS
@picture("real_tissue.png")
def main(tables: tuple[str, ...], rows: int | None, out: Path) -> None:
    """Print the tables, all where none is named, or draw the picture."""
    print(new_stamp("python -m figures real-tissue"))
    for name in tables or TABLES:
        if name == "picture":
            write_figure(draw(), out)
        else:
            table = TABLES[name]()
            print(f"\n{name}\n")
            print_table(next(table), islice(table, rows))
