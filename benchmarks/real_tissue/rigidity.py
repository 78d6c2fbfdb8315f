"""Pressure against volume: measured laws, and the model's own wall."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from figures.pushed_walls import NEEDLE_RADIUS_M, NU, RADIUS_M
from scleraforce.base.units import from_si, to_si
from scleraforce.mechanics.axisymmetric_wall import (
    AxisymmetricPath,
    AxisymmetricWall,
    EvenWall,
    axisymmetric_path,
)
from scleraforce.mechanics.load_path_tracing import PathEnd, pressurise
from scleraforce.mechanics.meridian_elements import MeridianSize, meridian_mesh
from scleraforce.mechanics.tissue_material import burst_tension
from scleraforce.records.globe import CONSTANT_PRESSURE, PressureLaw, sealed_law

Floats = NDArray[np.float64]

AT_MMHG = 15.0  # at which a logarithmic law has the slope of k
ONE_UL_M3 = 1e-9


@dataclass(frozen=True)
class Law:
    """A measured law: who, the rigidity as printed, and the globe; k in mmHg^(1/3)/ul
    at 15 mmHg.
    """

    name: str
    printed: str
    globe: PressureLaw
    rigidity: float

    def mmhg_per_ul(self, pressure_mmhg: float) -> float:
        """Return dP/dV at a pressure."""
        return mmhg_per_ul(float(self.globe.stiffness(to_si(pressure_mmhg, "mmhg"))))


def laws() -> list[Law]:
    """Return the laws of the page."""
    return [
        _cube_root("van der Werff 1981, enucleated human eyes", 0.03),
        _logarithmic("Friedenwald 1957, human eyes", 0.0215, np.log(10.0)),
        _logarithmic("Pallikaris 2005, 79 living eyes, if log10", 0.0126, np.log(10.0)),
        _logarithmic("the same, if natural", 0.0126, 1.0),
        _logarithmic(
            "Pierscionek 2007, 16 porcine eyes, if log10", 0.0022, np.log(10.0)
        ),
        _logarithmic("the same, if natural", 0.0022, 1.0),
    ]


def _cube_root(name: str, rigidity: float) -> Law:
    return Law(
        name,
        f"{rigidity:g} mmHg^⅓/µl",
        sealed_law(to_si(rigidity, "mmhg13_per_ul")),
        rigidity,
    )


def _logarithmic(name: str, printed: float, per_printed: float) -> Law:
    rigidity = printed * per_printed * np.cbrt(AT_MMHG) / 3.0
    globe = sealed_law(to_si(rigidity, "mmhg13_per_ul"), "logarithmic")
    return Law(name, f"{printed:g} /µl", globe, float(rigidity))


def mmhg_per_ul(pressure_pa_per_m3: float) -> float:
    """Return dP/dV in mmHg/ul."""
    return from_si(pressure_pa_per_m3 * ONE_UL_M3, "mmhg")


def own_mmhg_per_ul(
    thickness_m: float,
    modulus_pa: float,
    pressure_mmhg: float,
    *,
    half: bool,
) -> float:
    """Return dP/dV of the model's wall, mmHg/ul: a half-sphere with a clamped base, or
    a whole sphere.
    """
    ratio = to_si(pressure_mmhg, "mmhg") / modulus_pa
    if ratio * RADIUS_M / thickness_m > 0.9 * burst_tension(NU):
        return float("nan")

    wall = _wall(thickness_m, half=half)
    u = pressurise(wall, ratio)
    gradient = wall.volume(u)[1]
    compliance = float(gradient @ wall.factor(u, ratio)(gradient)) * (
        1.0 if half else 2.0
    )

    return mmhg_per_ul(modulus_pa / compliance)


def distension_modulus(
    thickness_m: float, pressure_mmhg: float, wanted_mmhg_per_ul: float
) -> float:
    """Return the E, Pa, with which a whole sphere of the model has a measured dP/dV at
    a pressure.
    """

    def missing(log_modulus: float) -> float:
        found = own_mmhg_per_ul(
            thickness_m, float(np.exp(log_modulus)), pressure_mmhg, half=False
        )
        return float(np.log(found / wanted_mmhg_per_ul))

    lowest = (
        to_si(pressure_mmhg, "mmhg")
        * RADIUS_M
        / thickness_m
        / (0.8 * burst_tension(NU))
    )
    return float(np.exp(brentq(missing, np.log(lowest), np.log(1e9), xtol=1e-6)))


def own_pressure(
    thickness_m: float, modulus_pa: float, iop_pa: float, tip_m: float, *, half: bool
) -> float:
    """Return the pressure, Pa, at a dent if the model's own wall held its volume: V(P,
    dent) = V(P0, no needle).
    """
    wall = _wall(thickness_m, half=half)
    at_rest = wall.volume(pressurise(wall, iop_pa / modulus_pa))[0]

    def missing(pressure_pa: float) -> float:
        ratio = pressure_pa / modulus_pa
        grown_m3 = (wall.volume(pressurise(wall, ratio))[0] - at_rest) * (
            1.0 if half else 2.0
        )
        return float(grown_m3 - globe_path(thickness_m, ratio, tip_m).displaced_m3[-1])

    return float(brentq(missing, iop_pa, 20.0 * iop_pa, xtol=1e-3))


def globe_path(
    thickness_m: float,
    iop_ratio: float,
    tip_m: float,
    globe: PressureLaw = CONSTANT_PRESSURE,
) -> AxisymmetricPath:
    """Return the path of the product's needle to one dent, by default of an open
    globe.
    """
    wall = EvenWall(RADIUS_M, thickness_m, NU, NEEDLE_RADIUS_M)
    return axisymmetric_path(wall, iop_ratio, PathEnd(tips_m=np.array([tip_m])), globe)


def _wall(thickness_m: float, *, half: bool) -> AxisymmetricWall:
    size = MeridianSize()
    mesh = meridian_mesh(RADIUS_M, thickness_m, NEEDLE_RADIUS_M, 0.5 * np.pi, size)
    return AxisymmetricWall(mesh, NU, symmetric=not half)
