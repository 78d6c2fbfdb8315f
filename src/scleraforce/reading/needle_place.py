"""The needle's place from one frame: contact, dent, gap and lean, each with its 90 %
interval.

The values are the fit's, a normal posterior about its unknowns. The picture may not
tell one, which is then missing (None): without a dent all are, and so is an unknown
whose posterior is hardly narrower than its prior. A gap that was given is one more
observation. To the fit's own uncertainty comes that of its model: walls are uneven, and
bend otherwise beside the pole.
"""

from dataclasses import dataclass, fields, replace
from math import hypot, radians
from typing import Any

import numpy as np

from scleraforce.base.normal_distribution import NINETY_PERCENT
from scleraforce.base.units import HumanUnit, from_si
from scleraforce.fit import unknowns
from scleraforce.fit.one_frame import BoundaryFit, law_of, library_walls
from scleraforce.fit.planes_of_a_moment import SpatialPlace
from scleraforce.fit.prior_of_an_eye import Prior
from scleraforce.library.wall_responses import Library
from scleraforce.records.fields import allowed_bounds
from scleraforce.records.setup import Setup
from scleraforce.wall.needle_in_frame import SeenNeedle

Error = tuple[float, float, float]

# of the prior's standard deviation: a wider posterior is hardly the picture's
NARROWER = 0.5
LEAST_DENT = 3.0  # standard deviations of it: no shallower one counts
# Of walls of the library beside walls in 3-D (`python -m figures places`, seeds 2, 43,
# 47): standard deviations in m, and per m of dent, and how many times as large they are
# of walls that are not even, which do not show the gap.
CONTACT_ERROR = (60e-6, 0.015, 2.0)
DEPTH_ERROR = (20e-6, 0.03, 2.0)
DENT_ERROR = (20e-6, 0.03, 2.0)
GAP_ERROR = (40e-6, 0.01, 4.0)
SHAFT_SD_RAD = radians(1.0)  # of a shaft's angle in a picture
STEP = 1e-3  # of derivatives, in standard deviations


@dataclass(frozen=True)
class PlaceValue:
    """A length or angle, in m or rad, with the ends of its 90 % interval."""

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, value: float, sd: float, least: float = -np.inf) -> "PlaceValue":
        """Return the place of a normal distribution, its interval cut off at
        `least`.
        """
        return cls(
            value,
            max(value - NINETY_PERCENT * float(sd), least),
            value + NINETY_PERCENT * float(sd),
        )

    def in_unit(self, unit: HumanUnit) -> tuple[float, list[float]]:
        """Return the value and the ends of its interval in a unit."""
        return from_si(self.value, unit), [
            from_si(self.low, unit),
            from_si(self.high, unit),
        ]

    @property
    def unsigned(self) -> "PlaceValue":
        """The place of the absolute value."""
        ends = abs(self.low), abs(self.high)
        return PlaceValue(
            abs(self.value), 0.0 if self.low < 0.0 < self.high else min(ends), max(ends)
        )


@dataclass(frozen=True, kw_only=True)
class NeedlePlace:
    """The needle's place as one frame tells it; None: it does not.

    `contact_m`: the contact's lateral place from the frame's middle; `contact_depth_m`:
    of the dented surface at the contact, below the frame's top; `dent_m`: its depth
    from the undented wall at the pressure under the needle; `gap_m`: distance of the
    plane from the needle's axis; `lean_rad`: angle in the plane from the wall's normal
    at the contact to a shaft in the picture, above 0 towards growing columns on its way
    up.
    """

    contact_m: PlaceValue | None = None
    contact_depth_m: PlaceValue | None = None
    dent_m: PlaceValue | None = None
    gap_m: PlaceValue | None = None
    lean_rad: PlaceValue | None = None

    def as_json(self) -> dict[str, Any]:
        """Return the keys in the JSON of `read`; an angle has no sign there."""
        found: dict[str, Any] = {}
        for item in fields(self):
            name, _, si_unit = item.name.rpartition("_")
            unit: HumanUnit = "deg" if si_unit == "rad" else "mm"
            place = getattr(self, item.name)
            place = place and place.unsigned if unit == "deg" else place
            value, ends = place.in_unit(unit) if place else (None, None)
            found |= {f"{name}_{unit}": value, f"{name}_{unit}_interval": ends}

        return found


NOWHERE = NeedlePlace()


def places_of(
    fit: BoundaryFit,
    prior: Prior,
    library: Library,
    setup: Setup,
    needle: SeenNeedle | None,
) -> NeedlePlace:
    """Return what a frame's fit tells of the needle's place; `setup` and `prior`: as in
    the fit.
    """
    lean = None
    if (angle_rad := shaft_lean(fit, needle)) is not None:
        lean = PlaceValue.of(angle_rad, hypot(fit.sd[unknowns.ROTATION], SHAFT_SD_RAD))

    dent_m = float(fit.unknown[unknowns.TIP])
    if dent_m < LEAST_DENT * hypot(fit.sd[unknowns.TIP], DENT_ERROR[0]):
        return NeedlePlace(lean_rad=lean)

    def with_error(sd: float, error: Error) -> float:
        uneven = error[2] if fit.is_uneven else 1.0
        return hypot(sd, uneven * error[0], uneven * error[1] * dent_m)

    def place(
        which: int, error: Error, given: bool = False, least: float = -np.inf
    ) -> PlaceValue | None:
        sd = with_error(float(fit.sd[which]), error)
        told = given or sd < NARROWER * prior.sd[which]
        return (
            PlaceValue.of(float(fit.unknown[which]), min(sd, prior.sd[which]), least)
            if told
            else None
        )

    depth_m, depth_sd_m = contact_depth(fit, prior, library)
    return NeedlePlace(
        contact_m=place(unknowns.LATERAL, CONTACT_ERROR),
        contact_depth_m=PlaceValue.of(depth_m, with_error(depth_sd_m, DEPTH_ERROR)),
        dent_m=place(unknowns.TIP, DENT_ERROR, least=0.0),
        gap_m=place(unknowns.GAP, GAP_ERROR, setup.needle.gap_m is not None, 0.0),
        lean_rad=lean,
    )


def in_space(places: NeedlePlace, place: SpatialPlace) -> NeedlePlace:
    """Return the places of one of several planes with the lean that they show together,
    the angle in space.
    """
    if place.lean_rad is None:
        return replace(places, lean_rad=None)

    return replace(
        places,
        lean_rad=PlaceValue.of(
            place.lean_rad, hypot(max(place.tilt_sd_rad), SHAFT_SD_RAD), 0.0
        ),
    )


def contact_depth(
    fit: BoundaryFit, prior: Prior, library: Library
) -> tuple[float, float]:
    """Return the depth of the dented surface on the needle's axis below the frame's
    top, m, and its SD.
    """
    unknown_su = np.concatenate([fit.unknown[None], fit.unknown + STEP * fit.spread])
    on_axis_m = library.shapes(
        *library_walls(library, unknown_su, law_of(prior.globe).pressure)
    )[:, 0, 0, 1]
    upright_m = np.exp(unknown_su[:, unknowns.SIZE]) * on_axis_m
    places_m = (
        upright_m * np.cos(unknown_su[:, unknowns.ROTATION])
        + unknown_su[:, unknowns.DEPTH]
    )

    return float(places_m[0]), float(np.linalg.norm(places_m[1:] - places_m[0]) / STEP)


def shaft_lean(fit: BoundaryFit | None, needle: SeenNeedle | None) -> float | None:
    """Return the angle from the wall's normal to the shaft in the picture, towards
    growing columns on its way up.

    None if no shaft is seen, or one that no needle has: farther off the normal than a
    lean may be declared.
    """
    if needle is None or fit is None:
        return None
    seen_rad = needle.angle_rad - float(fit.unknown[unknowns.ROTATION])
    return (
        seen_rad if abs(seen_rad) <= (allowed_bounds("lean_rad").high or 0.0) else None
    )
