"""The needle: its size, the place of its contact, and its lean."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from scleraforce.base.errors import StudyError
from scleraforce.records.fields import (
    TableForm,
    Unit,
    allowed_bounds,
    check_fields,
    check_number,
    check_value,
    formed,
    not_in_files,
    optional_quantity,
    quantity,
)

# Outer diameters of hypodermic needles: ISO 9626 (normal wall) of 10 to 34 gauge, the
# Birmingham gauge of 35 and 36.
GAUGE_DIAMETER_M = {
    10: 3.4e-3,
    11: 3.0e-3,
    12: 2.7e-3,
    13: 2.4e-3,
    14: 2.1e-3,
    15: 1.8e-3,
    16: 1.6e-3,
    17: 1.4e-3,
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
    35: 0.127e-3,
    36: 0.102e-3,
}

GAUGE_KEY = "gauge"
GAP_KEY = "slice_gap_m"
_GAP = allowed_bounds("gap_m")
_EITHER_GAP = Unit(low=-(_GAP.high or 0.0), high=_GAP.high)
LEAN_KEY = "lean_rad"
_LEAN = allowed_bounds(LEAN_KEY)

_GAUGE_FORM = TableForm(
    {GAUGE_KEY: (int, Unit(low=min(GAUGE_DIAMETER_M), high=max(GAUGE_DIAMETER_M)))},
    lambda stated: gauge_diameter_m(stated[GAUGE_KEY]),
    lambda diameter_m: {GAUGE_KEY: nearest_gauge(diameter_m)},
    needed=(GAUGE_KEY,),
)


def _read_lean(stated: Mapping[str, Any]) -> tuple[float, float] | None:
    return lean_ends(stated.get(LEAN_KEY))


def _write_lean(ends_rad: tuple[float, float] | None) -> Mapping[str, Any]:
    return {LEAN_KEY: one_lean(ends_rad)}


@dataclass(frozen=True, kw_only=True)
class Needle:
    """A needle on an eye; None: not declared.

    Attributes:
        diameter_m: of its shaft. None: that of the model's needle.
        gap_m: distance of the one B-scan plane from its axis. None: between the ends
            that the model was trained for, which widens the interval; several planes
            show it. Below 0: of one of several planes, on the other side of the needle
            than the left of its lateral axis, as seen from outside the eye.
        polar_rad: polar angle of the contact, from the pole. None: anywhere.
        azimuth_rad: of the contact, about the pole. Nothing to a reading, as its walls
            are of revolution; the place of a virtual eye's contact. None: 0.
        lean_rad: the ends of the angle between its axis and the wall's normal. None: as
            in the calibration, else as the shaft in the picture, else along the normal.
        lean_azimuth_rad: direction in which it leans on its way up, from the B-scan's
            lateral axis. None: any.

    Raises:
        StudyError: a value is out of bounds, or a direction without a lean.

    >>> import scleraforce as sf
    >>> sf.Needle(diameter_m=0.7e-3, gap_m=0.4e-3).gauge
    22
    """

    diameter_m: float | None = formed(_GAUGE_FORM)
    gap_m: float | None = formed(
        TableForm(
            {GAP_KEY: (float, _GAP)},
            lambda stated: stated.get(GAP_KEY),
            lambda gap_m: {GAP_KEY: gap_m},
        )
    )
    polar_rad: float | None = optional_quantity(
        "polar_angle_rad", key="polar_angle_rad"
    )
    azimuth_rad: float | None = not_in_files()
    lean_rad: tuple[float, float] | None = formed(
        TableForm({LEAN_KEY: (float, _LEAN)}, _read_lean, _write_lean)
    )
    lean_azimuth_rad: float | None = quantity(None, None, -6.3, 6.3)

    def __post_init__(self) -> None:
        check_fields(self)
        if self.diameter_m is not None and not 0.0 < self.diameter_m < 0.1:
            raise StudyError(
                f"diameter_m: {self.diameter_m:g}; give the outer diameter in metres"
            )
        if self.gap_m is not None:
            check_number("gap_m", self.gap_m, _EITHER_GAP)
        if self.lean_rad is not None:
            self._check_lean(self.lean_rad)
        if self.lean_azimuth_rad is not None and self.lean_rad is None:
            raise StudyError(
                "lean_azimuth_rad: of a needle that leans; give lean_rad as well, or"
                " leave it out"
            )

    def _check_lean(self, ends_rad: object) -> None:
        """Raise a `StudyError` unless a lean has two ends within its bounds."""
        if not isinstance(ends_rad, tuple) or len(ends_rad) != 2:
            raise StudyError(
                f"{LEAN_KEY}: {ends_rad!r:.40}; give its two ends, (0.1, 0.1) of a lean"
                " that is known exactly"
            )
        for end_rad in ends_rad:
            check_value(LEAN_KEY, end_rad, _LEAN)
        if not ends_rad[0] <= ends_rad[1]:
            raise StudyError(f"{LEAN_KEY}: {ends_rad}; the smaller end comes first")

    @property
    def gauge(self) -> int | None:
        """The gauge of this diameter, or the nearest; None: not declared."""
        return None if self.diameter_m is None else nearest_gauge(self.diameter_m)


def gauge_diameter_m(gauge: int) -> float:
    """Return the outer diameter of a needle of a gauge; raises `StudyError`.

    >>> gauge_diameter_m(22)
    0.0007
    """
    if gauge not in GAUGE_DIAMETER_M:
        raise StudyError(
            f"gauge: {gauge}; give {min(GAUGE_DIAMETER_M)} to {max(GAUGE_DIAMETER_M)}"
        )
    return GAUGE_DIAMETER_M[gauge]


def is_gauge(diameter_m: float) -> bool:
    """Return whether a diameter is that of a gauge, but for 2 %."""
    usual_m = GAUGE_DIAMETER_M[nearest_gauge(diameter_m)]
    return abs(diameter_m - usual_m) <= 0.02 * usual_m


def lean_ends(lean_rad: float | None) -> tuple[float, float] | None:
    """Return the ends of a lean that is known exactly; None stays None."""
    return None if lean_rad is None else (lean_rad, lean_rad)


def one_lean(ends_rad: tuple[float, float] | None) -> float | None:
    """Return the lean of two ends that are the same, else None."""
    return ends_rad[0] if ends_rad is not None and ends_rad[0] == ends_rad[1] else None


def nearest_gauge(diameter_m: float) -> int:
    """Return the gauge of a needle.

    >>> nearest_gauge(0.7e-3)
    22
    """
    return min(
        GAUGE_DIAMETER_M,
        key=lambda gauge: abs(GAUGE_DIAMETER_M[gauge] - diameter_m),
    )
