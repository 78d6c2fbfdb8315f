"""The needle: its gauge and place."""

from dataclasses import dataclass

from scleraforce.base.errors import StudyError
from scleraforce.records.fields import (
    check_fields,
    optional_quantity,
    quantity,
    required,
)

# Outer diameters of hypodermic needles, ISO 9626 (normal wall).
GAUGE_DIAMETER_M = {
    18: 1.2e-3,
    19: 1.1e-3,
    20: 0.9e-3,
    21: 0.8e-3,
    22: 0.7e-3,
    23: 0.6e-3,
    24: 0.55e-3,
    25: 0.5e-3,
    26: 0.45e-3,
    27: 0.4e-3,
    28: 0.36e-3,
    29: 0.33e-3,
    30: 0.3e-3,
    31: 0.25e-3,
    32: 0.23e-3,
    33: 0.2e-3,
    34: 0.18e-3,
}


@dataclass(frozen=True, kw_only=True)
class NeedleInfo:
    """The needle: gauge, distance of the one B-scan plane from its axis; polar angle of
    the contact and lean, if known.

    `lean_rad`: angle between its axis and the wall's normal; `lean_azimuth_rad`:
    direction in which it leans on its way up, from the B-scan's lateral axis.
    """

    gauge: int = required(low=10, high=36)
    slice_gap_m: float | None = optional_quantity("gap_m")
    polar_angle_rad: float | None = optional_quantity("polar_angle_rad")
    lean_rad: float | None = optional_quantity("lean_rad")
    lean_azimuth_rad: float | None = quantity(None, None, -6.3, 6.3)

    def __post_init__(self) -> None:
        check_fields(self)
        if self.lean_azimuth_rad is not None and self.lean_rad is None:
            raise StudyError(
                "lean_azimuth_rad: of a needle that leans; give lean_rad as well, or"
                " leave it out"
            )


def nearest_gauge(outer_diameter_m: float) -> int:
    """Return the gauge of a needle.

    >>> nearest_gauge(0.7e-3)
    22
    """
    return min(
        GAUGE_DIAMETER_M,
        key=lambda gauge: abs(GAUGE_DIAMETER_M[gauge] - outer_diameter_m),
    )
