"""The tables of README.md."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from real_tissue.porcine import (
    IOP_PA,
    MODULI_PA,
    SIZE,
    PunchedEye,
    modulus_by_shell_theory,
    modulus_of_slope,
    pushed,
    small_load_modulus,
)
from real_tissue.punch import Pushed
from real_tissue.rigidity import (
    NEEDLE_M,
    NU,
    RADIUS_M,
    distension_modulus,
    laws,
    mmhg_per_ul,
    open_path,
    own_mmhg_per_ul,
    own_pressure,
)
from real_tissue.shells import point, pressure_ratio, shallow, sphere
from real_tissue.walls import PressedWall, disc_wall, fine_meridian, pressed_wall
from scleraforce.base.errors import SolverError
from scleraforce.base.units import from_si, to_si
from scleraforce.mechanics.axisymmetric_wall import EvenWall, axisymmetric_path
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.records.globe import sealed_law

SHELL_MODULUS_PA = 0.25e6
THICKNESSES_MM = (0.05, 0.15, 0.25, 0.5, 0.8)
TENSIONS = (0.0, 1.0, 4.0)
# p R/(E h): above it a wall nears its burst, and no closed form is meant for it
LARGEST_STRETCHING = 0.25
RIGIDITIES = {0.0: "open", 0.0042: "k = 0.0042", 0.03: "k = 0.03"}
DENTS_MM = (0.3, 0.5, 1.0)
PRESSURES_MMHG = (2.0, 15.0, 30.0)
# thickness in m, E and resting pressure in Pa: the eye of docs/physics.md
EXAMPLE = (
    0.6e-3,
    0.45e6,
    266.0,
)
# 15 to 50 mmHg over five or four steps of 100 ul
PORCINE_MMHG_PER_UL = (
    35.0 / 500.0,
    35.0 / 400.0,
)


def pressed(
    thickness_m: float, pressure: float, disc_m: float = NEEDLE_M
) -> PressedWall:
    """Return our whole sphere of middle radius 12 mm, pressed at both poles over discs,
    under p/E.
    """
    mesh = fine_meridian(RADIUS_M + 0.5 * thickness_m, thickness_m, disc_m)
    return pressed_wall(disc_wall(mesh, disc_m, NU, symmetric=True), pressure)


def shells(rows: int | None = None) -> str:
    """Stiffness of a pressurised sphere for small loads: closed forms, and ours over
    them.
    """
    head = [
        "t, mm",
        "tension τ",
        "pR/(Et)",
        "Vella, point",
        "disc",
        "**ours**",
        "over the disc",
        "whole sphere",
        "and shear",
        "and sizes under pressure",
    ]
    found: list[list[str]] = []

    for thickness_mm in THICKNESSES_MM:
        for tension in TENSIONS:
            thickness_m = 1e-3 * thickness_mm
            pressure = pressure_ratio(tension, thickness_m, RADIUS_M, NU)
            if pressure * RADIUS_M / thickness_m > LARGEST_STRETCHING:
                continue
            if rows is not None and len(found) == rows:
                return _table(head, found)

            ours = pressed(thickness_m, pressure)
            closed = [
                shallow(thickness_m, RADIUS_M, pressure, NEEDLE_M, NU),
                sphere(thickness_m, RADIUS_M, pressure, NEEDLE_M, NU, shear=False),
                sphere(thickness_m, RADIUS_M, pressure, NEEDLE_M, NU),
                sphere(ours.thickness_m, ours.radius_m, pressure, NEEDLE_M, NU),
            ]
            stiffness = [
                point(thickness_m, RADIUS_M, pressure, NU),
                closed[0],
                ours.stiffness_m,
            ]
            found.append(
                [
                    f"{thickness_mm:g}",
                    f"{tension:g}",
                    f"{pressure * RADIUS_M / thickness_m:.3f}",
                ]
                + [f"{SHELL_MODULUS_PA * value:.3g}" for value in stiffness]
                + [
                    f"{100.0 * (ours.stiffness_m / value - 1.0):+.1f} %"
                    for value in closed
                ]
            )

    return _table(head, found)


def punch(rows: int | None = None) -> str:
    """E of the stiffness that was measured on porcine sclera, by how it is pressed and
    what the globe is.
    """
    head = [
        "how the sclera is pressed",
        *(f"E, MPa, {name}" for name in RIGIDITIES.values()),
    ]
    found = [
        [
            "shell theory without pressure, uniform over the disc",
            _mpa(modulus_by_shell_theory(130.0)),
            "",
            "",
        ],
        [
            "ours without pressure, uniform, small load",
            _mpa(small_load_modulus(bonded=False, iop_pa=0.0)),
            "",
            "",
        ],
        [
            "ours at 15 mmHg, uniform, small load",
            _mpa(small_load_modulus(bonded=False)),
            "",
            "",
        ],
        [
            "ours at 15 mmHg, disc bonded to the wall, small load",
            _mpa(small_load_modulus(bonded=True)),
            "",
            "",
        ],
    ]

    if rows is not None:
        return _table(head, found[:rows])

    paths = {
        rigidity: {
            modulus: path
            for modulus in MODULI_PA
            if (path := _pushed(modulus, rigidity)) is not None
        }
        for rigidity in RIGIDITIES
    }
    for dent_mm in DENTS_MM:
        moduli = [
            modulus_of_slope(paths[rigidity], 1e-3 * dent_mm) for rigidity in RIGIDITIES
        ]
        found.append(
            [
                f"flat punch, slope at {dent_mm:g} mm",
                *(_mpa(modulus) for modulus in moduli),
            ]
        )

    return _table(head, found)


def _pushed(modulus_pa: float, rigidity: float) -> Pushed | None:
    """Return the path; None where the pressure of so soft a wall runs away at once."""
    try:
        return pushed(modulus_pa, rigidity)
    except SolverError:
        return None


def punch_spread(rows: int | None = None) -> str:
    """Sensitivity to measured sizes, nu and support: E from the slope at 1 mm, and by
    shell theory.
    """
    head = ["one thing otherwise", "E, MPa, flat punch at 1 mm", "E, MPa, shell theory"]
    cases: dict[str, tuple[PunchedEye, float, bool]] = {
        "the means": (SIZE, 130.0, False),
        "0.11 N/mm": (SIZE, 110.0, False),
        "0.15 N/mm": (SIZE, 150.0, False),
        "t = 0.89 mm": (replace(SIZE, thickness_m=0.89e-3), 130.0, False),
        "t = 1.17 mm": (replace(SIZE, thickness_m=1.17e-3), 130.0, False),
        "R = 7.37 mm": (replace(SIZE, radius_m=7.37e-3), 130.0, False),
        "R = 8.35 mm": (replace(SIZE, radius_m=8.35e-3), 130.0, False),
        "nu = 0.49": (replace(SIZE, poisson_ratio=0.49), 130.0, False),
        "a whole sphere between two punches": (SIZE, 130.0, True),
    }
    found = []

    for name, (size, stiffness, symmetric) in list(cases.items())[:rows]:
        paths = {
            modulus: pushed(modulus, size=size, symmetric=symmetric)
            for modulus in MODULI_PA[1:4]
        }
        modulus = modulus_of_slope(paths, 1e-3, stiffness)
        found.append(
            [name, _mpa(modulus), _mpa(modulus_by_shell_theory(stiffness, size))]
        )

    return _table(head, found)


def punch_pressures(rows: int | None = None) -> str:
    """Rise of the stiffness below the flat punch with pressure at constant E, and E by
    shell theory.
    """
    head = [
        "eye pressure, mmHg",
        "slope at 1 mm, N/mm",
        "touched, % of the punch",
        "E by shell theory, MPa",
    ]
    found = []

    for iop_mmhg in (5.0, 10.0, 15.0, 20.0, 30.0)[:rows]:
        opened: Pushed = pushed(0.2e6, iop_pa=to_si(iop_mmhg, "mmhg"))
        slope = 0.2e6 * float(np.interp(1e-3, opened.dent_m, opened.slope_m()))
        touched = 100.0 * float(np.interp(1e-3, opened.dent_m, opened.touched))
        found.append(
            [
                f"{iop_mmhg:g}",
                f"{1e-3 * slope:.3f}",
                f"{touched:.0f}",
                _mpa(modulus_by_shell_theory(slope)),
            ]
        )

    return _table(head, found)


def volumes(rows: int | None = None) -> str:
    """DP/dV of the measured laws and of the model's own wall."""
    head = [
        "",
        "as printed",
        "k, mmHg^⅓/µl",
        *(f"dP/dV at {pressure:g} mmHg" for pressure in PRESSURES_MMHG),
    ]
    found = []

    for law in laws():
        slopes = [
            mmhg_per_ul(float(law.globe.stiffness(to_si(pressure, "mmhg"))))
            for pressure in PRESSURES_MMHG
        ]
        found.append(
            [
                law.name,
                law.printed,
                f"{law.rigidity:.4f}",
                *(f"{slope:.3f}" for slope in slopes),
            ]
        )

    walls = {
        "model, half-sphere, 0.7 mm, 0.25 MPa": (0.7e-3, 0.25e6, True),
        "model, whole sphere, 0.7 mm, 0.25 MPa": (0.7e-3, 0.25e6, False),
        "model, whole sphere, 0.8 mm, 1.2 MPa": (0.8e-3, 1.2e6, False),
    }
    for name, (thickness_m, modulus_pa, half) in walls.items():
        own = [
            own_mmhg_per_ul(thickness_m, modulus_pa, pressure, half=half)
            for pressure in PRESSURES_MMHG
        ]
        found.append([name, "", "", *(f"{slope:.3f}" for slope in own)])

    human = mmhg_per_ul(float(laws()[0].globe.stiffness(IOP_PA)))
    for name, wanted in (
        (
            "E that a whole sphere of 0.8 mm needs for van der Werff's, MPa",
            (human, human),
        ),
        ("for the porcine 35 mmHg in 400 to 500 µl, MPa", PORCINE_MMHG_PER_UL),
    ):
        moduli = [
            _mpa(distension_modulus(0.8e-3, 15.0, value))
            for value in dict.fromkeys(wanted)
        ]
        found.append([name, "", "", "", " to ".join(moduli), ""])

    return _table(head, found[:rows])


def sealed_dents(rows: int | None = None) -> str:
    """Pressure and force at a dent: open, with the model's own volume held, and by the
    measured law.
    """
    thickness_m, modulus_pa, iop_pa = EXAMPLE
    head = [
        "dent, mm",
        "open",
        "the half-sphere's own volume held",
        "the whole sphere's",
        "k = 0.0042",
        "k = 0.03",
    ]
    found = []

    for dent_mm in (0.8, 1.4, 2.0)[:rows]:
        tip_m = 1e-3 * dent_mm
        own = [
            own_pressure(thickness_m, modulus_pa, iop_pa, tip_m, half=half)
            for half in (True, False)
        ]
        cells = [
            _state(pressure, _force(pressure, tip_m)) for pressure in (iop_pa, *own)
        ]

        for rigidity in (0.0042, 0.03):
            globe = sealed_law(to_si(rigidity, "mmhg13_per_ul")).over(modulus_pa)
            wall = EvenWall(RADIUS_M, thickness_m, NU, NEEDLE_M)
            end = PathEnd(tips_m=np.array([tip_m]))
            closed = axisymmetric_path(wall, iop_pa / modulus_pa, end, globe)
            cells.append(
                _state(
                    modulus_pa * float(closed.iop_ratio[-1]),
                    modulus_pa * closed.force_ratio_m2[-1],
                )
            )

        found.append([f"{dent_mm:g}", *cells])

    return _table(head, found)


def _force(pressure_pa: float, tip_m: float) -> float:
    thickness_m, modulus_pa, _ = EXAMPLE
    return modulus_pa * float(
        open_path(thickness_m, pressure_pa / modulus_pa, tip_m).force_ratio_m2[-1]
    )


def _state(pressure_pa: float, force_n: float) -> str:
    return f"{pressure_pa:.0f} Pa, {from_si(force_n, 'mn'):.1f} mN"


def _mpa(modulus_pa: float | None) -> str:
    return "none" if modulus_pa is None else f"{from_si(modulus_pa, 'mpa'):.2f}"


def _table(head: list[str], rows: Iterable[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


TABLES = {
    "shells": shells,
    "punch": punch,
    "punch_spread": punch_spread,
    "punch_pressures": punch_pressures,
    "volumes": volumes,
    "sealed_dents": sealed_dents,
}
