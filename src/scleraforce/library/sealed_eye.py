"""Sealed globes: the state of the library whose pressure solves the globe's law, at a
dent or under a force; one eye.

A sealed globe at a dent is the open one at the pressure P with level(P) = level(P0) +
rate dV, and dV the volume that the library has for each state (`records.globe`,
docs/library.md). Of several solutions the lowest counts: loading meets it first. All
pressures are over E, all arguments are arrays (sample,) that broadcast.

Under a force a higher pressure leaves a shallower dent, which displaces less. So the
error of the law rises with the pressure, by jumps where a wall snaps through: compiled
loops find the root by bisection, one eye at a time, and between the last two pressures
by a straight line.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.compiled_loops import compiled, compiled_in_place, compiled_part
from scleraforce.base.units import HumanUnit
from scleraforce.library.range_checks import check_inside, inside_ends
from scleraforce.library.response_splines import (
    SUPPORT,
    SplineTables,
    first_place,
    spline_weights,
    value_of,
)
from scleraforce.records import globe as globe_laws
from scleraforce.records.globe import CONSTANT_PRESSURE, PressureLaw

level_of = compiled_in_place(globe_laws.level_of)
level_growth = compiled_in_place(globe_laws.level_growth)
pressure_of_level = compiled_in_place(globe_laws.pressure_of_level)


class _WallLibrary(Protocol):
    """What a sealed eye needs of a `wall_responses.Library`, which makes such eyes."""

    @property
    def thickness_m(self) -> Floats: ...
    @property
    def tip_m(self) -> Floats: ...
    @property
    def max_force_ratio(self) -> float: ...
    @property
    def tables(self) -> SplineTables: ...
    def check_walls(self, thickness_m: Floats, iop_ratio: Floats) -> Floats: ...
    def iop_ratio_ends(self, thickness_m: Floats) -> tuple[Floats, Floats]: ...
    def forces(
        self, thickness_m: Floats, iop_ratio: Floats, tip_m: Floats
    ) -> Floats: ...
    def tips(
        self, thickness_m: Floats, iop_ratio: Floats, force_ratio: Floats
    ) -> Floats: ...


@compiled
def pressures_at_dents(
    tables: SplineTables,
    thickness_m: Floats,
    tip_m: Floats,
    rate: Floats,
    is_logarithmic: bool,
    ratio: Floats,
) -> None:
    """Put the pressures over E at dents (sample,) in place of those without the
    needle.
    """
    for n in range(len(ratio)):
        ratio[n] = pressure_at_dent(
            tables, (thickness_m[n], ratio[n], tip_m[n]), rate[n], is_logarithmic
        )


@compiled_part
def pressure_at_dent(
    tables: SplineTables,
    state: tuple[float, float, float],
    rate: float,
    is_logarithmic: bool,
) -> float:
    """Return the pressure over E at a dent; NaN where none of the library solves the
    law.

    `state`: thickness, pressure over E without the needle, and dent.
    """
    thickness_m, resting, tip_m = state
    if rate == 0.0:
        return float(resting)

    t, of_t = spline_weights(tables.thickness, np.log(thickness_m))
    d, of_d = spline_weights(tables.tip, tip_m)
    tensions = tables.tensions
    path = np.zeros(2 * tables.tensions)

    for i in range(SUPPORT):
        for j in range(SUPPORT):
            path -= (
                rate
                * of_t[i]
                * of_d[j]
                * tables.volumes_along_tension[(t + i) * tables.tips + d + j]
            )

    for p in range(tensions):
        level = level_of(
            np.exp(tables.log_tension[p]) * thickness_m / tables.radius_m,
            is_logarithmic,
        )
        path[p] += level
        path[tensions + p] += level_growth(level, is_logarithmic)

    log_tension = first_place(
        tables.log_tension, path, level_of(resting, is_logarithmic)
    )
    return float(np.exp(log_tension) * thickness_m / tables.radius_m)


# of the volume: the pressure of an end of the bracket lies beyond the solution
SPARE = 1e-3


class SealedEye(NamedTuple):
    """A sealed eye under a force: wall, resting pressure over E, F/E and its globe's
    law.

    `along`: weights over the tension of its wall's paths (p, 2 d); `path` (2 d,) is
    workspace.
    """

    thickness_m: float
    resting: float
    force_ratio: float
    rate: float
    is_logarithmic: bool
    along: Floats
    path: Floats


@compiled
def pressures_under_forces(
    tables: SplineTables,
    eyes_ns: Floats,
    is_logarithmic: bool,
    tolerance: float,
    found: Floats,
) -> None:
    """Write the pressure over E of each eye (sample,); `tolerance` is that of its
    logarithm.

    `eyes_ns`: thickness, resting pressure over E, F/E, the globe's rate, and the
    library's lowest and highest pressure.
    """
    columns = tables.paths.shape[1]
    along = np.empty((tables.tensions, columns))
    path = np.empty(columns)

    for n in range(len(found)):
        thickness_m, resting, force_ratio, rate, lowest, highest = eyes_ns[:, n]
        _paths_of_thickness(tables, thickness_m, along)
        eye = SealedEye(
            thickness_m, resting, force_ratio, rate, is_logarithmic, along, path
        )
        found[n] = _pressure(tables, eye, lowest, highest, tolerance)


@compiled_part
def _pressure(
    tables: SplineTables,
    eye: SealedEye,
    lowest: float,
    highest: float,
    tolerance: float,
) -> float:
    resting = eye.resting
    rate = eye.rate
    most = _displaced(tables, eye, resting)
    bound = pressure_of_level(
        level_of(resting, eye.is_logarithmic) + rate * (1.0 + SPARE) * most,
        eye.is_logarithmic,
    )

    if rate > 0.0:
        low = np.log(resting)
        high = np.log(min(max(bound, resting), highest))
        below = -rate * most
    else:
        low = np.log(lowest)
        high = np.log(resting)
        below = _missing(tables, eye, low)

    above = _missing(tables, eye, high)
    if above <= 0.0:
        high = np.log(highest)
        above = _missing(tables, eye, high)

    if below >= 0.0:
        return float(np.exp(low))
    if above <= 0.0:
        return float(np.exp(high))

    while high - low > tolerance:
        middle = 0.5 * (low + high)
        missing = _missing(tables, eye, middle)
        if missing < 0.0:
            low = middle
            below = missing
        else:
            high = middle
            above = missing

    return float(np.exp(low - below * (high - low) / (above - below)))


@compiled_part
def _missing(tables: SplineTables, eye: SealedEye, log_ratio: float) -> float:
    """Return the error of the law at a pressure."""
    ratio = np.exp(log_ratio)
    risen = level_of(ratio, eye.is_logarithmic) - level_of(
        eye.resting, eye.is_logarithmic
    )
    return float(risen - eye.rate * _displaced(tables, eye, ratio))


@compiled_part
def _displaced(tables: SplineTables, eye: SealedEye, ratio: float) -> float:
    """Return the volume that the force displaces at a pressure over E, m^3."""
    first, weights = spline_weights(
        tables.tension, np.log(ratio * tables.radius_m / eye.thickness_m)
    )
    path = eye.path
    eye.path[:] = 0.0

    for number in range(SUPPORT):
        for column in range(len(path)):
            path[column] += weights[number] * eye.along[first + number, column]

    tip = first_place(tables.tip_m, path, eye.force_ratio)
    tip = tables.tip_m[-1] if np.isnan(tip) else tip
    return value_of(tables, tables.volumes, eye.thickness_m, ratio, tip)


@compiled_part
def _paths_of_thickness(
    tables: SplineTables, thickness_m: float, along: Floats
) -> None:
    """Write the weights over the tension of a wall's paths (p, 2 d)."""
    first, weights = spline_weights(tables.thickness, np.log(thickness_m))
    along[:] = 0.0

    for number in range(SUPPORT):
        for tension in range(tables.tensions):
            row = tables.paths[(first + number) * tables.tensions + tension]
            for column in range(len(row)):
                along[tension, column] += weights[number] * row[column]


def iop_ratio_under_force(
    library: _WallLibrary,
    thickness_m: Floats,
    iop_ratio: Floats,
    force_ratio: Floats,
    globe: PressureLaw,
    tolerance: float = 1e-7,
) -> Floats:
    """Return the pressure over E under forces F/E (sample,), m^2; the library's highest
    where it rises beyond.

    Where a force is more than a wall carries, the dent counts as the library's deepest.
    `iop_ratio`: the pressure without the needle over E; the globe is over E.
    `tolerance`: of the logarithm of the pressure.
    """
    walls = np.broadcast_arrays(thickness_m, iop_ratio, force_ratio, globe.rate)
    found: Floats = walls[1].astype(np.float64)
    (sealed,) = np.nonzero((walls[3] != 0.0) & (walls[2] > 0.0))
    if not len(sealed):
        return found

    eyes_ns = np.array([values[sealed] for values in walls], dtype=np.float64)
    library.check_walls(eyes_ns[0], eyes_ns[1])
    eyes_ns = np.vstack([eyes_ns, library.iop_ratio_ends(eyes_ns[0])])
    pressures = np.empty(len(sealed))
    pressures_under_forces(
        library.tables, eyes_ns, globe.is_logarithmic, tolerance, pressures
    )
    found[sealed] = pressures

    return found


def iop_ratio_at_dent(
    library: _WallLibrary,
    thickness_m: Floats,
    iop_ratio: Floats,
    tip_m: Floats,
    globe: PressureLaw,
) -> Floats:
    """Return the pressure over E at dents (sample,); NaN where no pressure of the
    library solves the law.

    It then runs away (`mechanics.equilibrium.SealedDent`), or rises beyond the library.
    Dents count from the undented wall at that pressure. `iop_ratio` is the pressure
    without the needle over E; the globe is over E, and its rate a number or (sample,).
    Walls without the needle, and dents, outside the library raise `InputError`.
    """
    library.check_walls(thickness_m, iop_ratio)
    check_inside("tip", tip_m, 0.0, float(library.tip_m[-1]), "mm")
    inside = (
        inside_ends(thickness_m, library.thickness_m),
        inside_ends(tip_m, library.tip_m),
    )
    eyes = np.broadcast_arrays(*inside, globe.rate, iop_ratio)
    thickness, tip, rate, ratio = (np.array(part, dtype=np.float64) for part in eyes)
    pressures_at_dents(
        library.tables, thickness, tip, rate, globe.is_logarithmic, ratio
    )

    return ratio


# of the search for the deepest dent: each round divides the interval around it
DENTS = 400
ROUNDS = 2


@dataclass(frozen=True, eq=False)
class LibraryEye:
    """One eye of a `Library` (`Library.eye`). Dents count from the undented wall at the
    pressure under the needle.

    `iop_pa` is the pressure without the needle. Arguments of the methods are numbers or
    arrays, answers of their shape.
    """

    library: _WallLibrary
    thickness_m: float
    youngs_modulus_pa: float
    iop_pa: float
    globe: PressureLaw = CONSTANT_PRESSURE

    @cached_property
    def max_dent_m(self) -> float:
        """Deepest dent, m: the library's, or where the pressure of a sealed globe runs
        away or leaves the library.
        """
        low = 0.0
        high = float(self.library.tip_m[-1])

        for _ in range(ROUNDS):
            dents_m = np.linspace(low, high, DENTS)
            beyond = np.isnan(self._ratios(dents_m))
            if not beyond.any():
                return high

            low, high = (float(dents_m[np.argmax(beyond) - back]) for back in (1, 0))

        return low

    @cached_property
    def max_force_n(self) -> float:
        """Largest force of the dents up to `max_dent_m`, N, at most the library's
        F/E.
        """
        forces_n = self.force_n(np.linspace(0.0, self.max_dent_m, DENTS))
        return min(
            float(forces_n.max()), self.library.max_force_ratio * self.youngs_modulus_pa
        )

    def force_n(self, dent_m: Floats | float) -> Floats:
        """Return the force, N, on dents, m; beyond `max_dent_m` raise `InputError`."""
        dents_m = self._checked("dent", dent_m, self.max_dent_m, "mm", "mm")
        forces: Floats = self.library.forces(
            *self._walls(self._ratios(dents_m)), dents_m
        )
        return (forces * self.youngs_modulus_pa).reshape(np.shape(dent_m))[()]

    def dent_m(self, force_n: Floats | float) -> Floats:
        """Return the dent, m, under forces, N: the first one on loading; above
        `max_force_n` raise `InputError`.
        """
        ratios = (
            self._checked("force", force_n, self.max_force_n, "mn", "mN")
            / self.youngs_modulus_pa
        )
        resting = np.full(len(ratios), self.iop_pa / self.youngs_modulus_pa)
        globe = self.globe.over(self.youngs_modulus_pa)
        under = iop_ratio_under_force(
            self.library, *self._walls(resting), ratios, globe
        )
        dents_m = np.minimum(
            self.library.tips(*self._walls(under), ratios), self.max_dent_m
        )

        return dents_m.reshape(np.shape(force_n))[()]

    def pressure_pa(self, dent_m: Floats | float) -> Floats:
        """Return the pressure under the needle, Pa, at dents, m; errors as of
        `force_n`.
        """
        ratios = self._ratios(
            self._checked("dent", dent_m, self.max_dent_m, "mm", "mm")
        )
        return (ratios * self.youngs_modulus_pa).reshape(np.shape(dent_m))[()]

    def _walls(self, iop_ratio: Floats) -> tuple[Floats, Floats]:
        return np.full(len(iop_ratio), self.thickness_m), iop_ratio

    def _ratios(self, dents_m: Floats) -> Floats:
        resting = np.full(len(dents_m), self.iop_pa / self.youngs_modulus_pa)
        return iop_ratio_at_dent(
            self.library,
            *self._walls(resting),
            dents_m,
            self.globe.over(self.youngs_modulus_pa),
        )

    @staticmethod
    def _checked(
        name: str, values: Floats | float, most: float, unit: HumanUnit, printed: str
    ) -> Floats:
        found = np.asarray(values, dtype=np.float64).reshape(-1)
        check_inside(name, found, 0.0, most, unit, printed, "this eye's")
        return np.clip(found, 0.0, most)
