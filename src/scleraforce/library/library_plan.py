"""The plan of a library: its axes, and the load paths that make it.

There is a path for each stiffening of the tissue, thickness and tension, p R/(E t), and
forces alone for some walls of the first stiffening with the support nearer to the
needle axis or farther from it (`library.moving_base` needs them).
"""

import json
from dataclasses import asdict, dataclass, fields
from hashlib import sha256
from typing import Any

import numpy as np

from scleraforce.base.arrays import Floats, Places
from scleraforce.base.errors import InputError
from scleraforce.base.plain_json import parse_json
from scleraforce.mechanics.tissue_material import burst_tension
from scleraforce.records.study import Choice, LibraryStudy, Range, Sampled, Study

# number of the way in which load paths are computed: raise it when they move
METHOD = 1
TIP_GRADING = 1.5  # tips are like the numbers 0, 1, 2 ... to this power
LARGEST_POLAR_DEG = 55.0  # of a contact
# beside 90: where its base may lie
SUPPORTS_DEG = (
    35.0,
    40.0,
    55.0,
    70.0,
    110.0,
    125.0,
    140.0,
    145.0,
)
# how many of the library's thicknesses and tensions are picked at most
SUPPORT_THICKNESSES = 4
SUPPORT_TENSIONS = 6
# b, below which states change evenly with it, and above with its logarithm
LITTLE_STIFFENING = 0.2
# deeper dents run into the base where it is nearest: the factor stays as it is there
SUPPORT_TIP_M = 6e-3


@dataclass(frozen=True, kw_only=True)
class PlannedPath:
    """A load path to solve: its wall, tissue, clamp (angle from the needle axis), and
    tips (d,), m.
    """

    thickness_m: float
    iop_ratio: float
    stiffening: float
    support_rad: float
    tip_m: Floats


@dataclass(frozen=True, kw_only=True)
class LibraryPlan:
    """Everything that the load paths of a library depend on."""

    radius_m: float
    poisson_ratio: float
    needle_radius_m: float
    contact_polar_rad: float
    grid: LibraryStudy

    @property
    def stiffening(self) -> Floats:
        """Stiffenings b (b,): even in ln(1 + 5 b)."""
        low, high = stiffening_place(np.array(self.grid.stiffening.bounds))
        places = np.linspace(low, high, self.grid.stiffenings)
        return np.clip(
            LITTLE_STIFFENING * np.expm1(places), *self.grid.stiffening.bounds
        )

    @property
    def thickness_m(self) -> Floats:
        """Wall thicknesses (t,), m."""
        return np.geomspace(*self.grid.thickness_m.bounds, self.grid.thicknesses)

    @property
    def tension(self) -> Floats:
        """Tensions p R/(E t) (p,): even in log(tension / (burst - tension))."""
        low, high = self.grid.tension.bounds
        burst = burst_tension(self.poisson_ratio)
        odds = np.geomspace(
            low / (burst - low), high / (burst - high), self.grid.tensions
        )
        return np.clip(burst * odds / (1.0 + odds), low, high)

    @property
    def tip_m(self) -> Floats:
        """Tips at which every path is stored (d,), m; the first is 0."""
        return (
            self.grid.max_tip_m * np.linspace(0.0, 1.0, self.grid.tips) ** TIP_GRADING
        )

    @property
    def nodes(self) -> int:
        """Nodes of a boundary."""
        return 2 * self.grid.elements + 1

    @property
    def paths(self) -> int:
        """Number of load paths whose forces and curves are kept: the first of all
        units.
        """
        return self.grid.stiffenings * self.grid.thicknesses * self.grid.tensions

    @property
    def units(self) -> int:
        """Number of load paths to solve."""
        return self.paths + int(np.prod(self.support_shape))

    @property
    def support_shape(self) -> tuple[int, int, int]:
        """Supports, thicknesses and tensions of the paths with another support."""
        thicknesses, tensions = self._with_supports
        return len(SUPPORTS_DEG), len(thicknesses), len(tensions)

    @property
    def _with_supports(self) -> tuple[Places, Places]:
        """Indices of the thicknesses and tensions that have paths with other
        supports.
        """
        grid = self.grid
        return evenly_picked(grid.thicknesses, SUPPORT_THICKNESSES), evenly_picked(
            grid.tensions, SUPPORT_TENSIONS
        )

    @property
    def support_tips(self) -> int:
        """Number of tips of the paths with other supports, the first ones of the
        library.
        """
        return max(2, int(np.searchsorted(self.tip_m, SUPPORT_TIP_M, side="right")))

    def place(self, unit: int) -> tuple[int, ...]:
        """Return the place of a unit: (stiffening, thickness, tension), or (support,
        thickness, tension).
        """
        shape = self.grid.stiffenings, self.grid.thicknesses, self.grid.tensions
        within = (
            (unit, shape)
            if unit < self.paths
            else (unit - self.paths, self.support_shape)
        )

        return tuple(int(number) for number in np.unravel_index(*within))

    def path(self, unit: int) -> PlannedPath:
        """Return the load path of a unit.

        >>> path = plan_library(Study()).path(0)
        >>> f"{path.thickness_m:.3g} {path.iop_ratio:.3g}"
        '0.00035 5.83e-06'
        """
        first, thickness, tension = self.place(unit)
        stiffening = float(self.stiffening[0])
        support_rad = 0.5 * np.pi
        tip_m = self.tip_m

        if unit < self.paths:
            stiffening = float(self.stiffening[first])
        else:
            support_rad = float(np.radians(SUPPORTS_DEG[first]))
            tip_m = tip_m[: self.support_tips]
            thicknesses, tensions = self._with_supports
            thickness = int(thicknesses[thickness])
            tension = int(tensions[tension])

        thickness_m = float(self.thickness_m[thickness])
        iop_ratio = float(self.tension[tension]) * thickness_m / self.radius_m
        return PlannedPath(
            thickness_m=thickness_m,
            iop_ratio=iop_ratio,
            stiffening=stiffening,
            support_rad=support_rad,
            tip_m=tip_m,
        )

    @property
    def recipe(self) -> str:
        """The plan as JSON, the same for equal plans."""
        return json.dumps(asdict(self), sort_keys=True)

    @property
    def key(self) -> str:
        """SHA-256, in hexadecimal, of the recipe and of `METHOD`.

        A library is reused as long as the key is the same, so `METHOD` has to rise with
        each change of the mechanics that moves load paths. The fingerprint of the
        shipped reader moves with the load paths, and its test says when `METHOD` has to
        rise.
        """
        return sha256(f"{METHOD} {self.recipe}".encode()).hexdigest()


def plan_library(study: Study) -> LibraryPlan:
    """Return the plan of a study: `[library]`, sizes and nu, and the middle of the
    needle's polar angles.
    """
    eye = study.eye
    needle = study.needle
    middle_rad = min(
        0.5 * sum(needle.polar_angle_rad.bounds), float(np.radians(LARGEST_POLAR_DEG))
    )
    highest = study.library.tension.bounds[1]

    burst = burst_tension(eye.poisson_ratio)
    if not highest < burst:
        raise InputError(
            f"library.tension: up to {highest:g}; must stay below {burst:.3g}, at which"
            " the wall bursts"
        )

    return LibraryPlan(
        radius_m=eye.radius_m,
        poisson_ratio=eye.poisson_ratio,
        needle_radius_m=0.5 * needle.outer_diameter_m,
        contact_polar_rad=middle_rad,
        grid=study.library,
    )


def parse_plan(recipe: str, name: str) -> LibraryPlan:
    """Return the plan of a recipe; `name` is used in messages."""
    try:
        given = parse_json(recipe)
        entries = given["grid"].items()
        grid: dict[str, Any] = {
            key: _sampled(entry) if isinstance(entry, dict) else entry
            for key, entry in entries
        }
        plan = LibraryPlan(**{**given, "grid": LibraryStudy(**grid)})
    except (InputError, ValueError, TypeError, LookupError, AttributeError) as fault:
        raise InputError(f"{name}: not the plan of a library ({fault})") from fault

    sizes = (plan.radius_m, plan.poisson_ratio, plan.needle_radius_m)
    if (
        plan.recipe != recipe
        or not _numbers(plan)
        or not _numbers(plan.grid)
        or not min(sizes) > 0.0
    ):
        raise InputError(f"{name}: not the plan of a library")

    return plan


def _numbers(record: LibraryPlan | LibraryStudy) -> bool:
    """Return True if every number field has its own type."""
    return all(
        type(getattr(record, item.name)) is item.type
        for item in fields(record)
        if item.type in (int, float)
    )


def _sampled(value: dict[str, Any]) -> Sampled:
    return Range(**value) if "min" in value else Choice(tuple(value["values"]))


def stiffening_place(stiffening: Floats) -> Floats:
    """Return the place of tissue on the axis of b, on which states change smoothly."""
    return np.log1p(stiffening / LITTLE_STIFFENING)


def evenly_picked(count: int, most: int) -> Places:
    """Return at most `most` numbers from first to last of `count`, evenly spaced."""
    return np.rint(np.linspace(0, count - 1, min(count, most))).astype(np.intp)
