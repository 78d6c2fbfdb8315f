"""The needle's lean: what is declared, what a frame shows, and what it does to a
force.
"""

from dataclasses import dataclass
from math import atan, cos, degrees, hypot, inf, radians, tan

from scleraforce.records.remark import Remark
from scleraforce.records.setup import Setup

# largest lean of a needle whose lean is not known: injections come at 15 to 45 degrees
MOST_LEAN_RAD = radians(45.0)

FRICTIONS = (0.0, 0.3, inf)  # the last one sticks

# Relative, of N: the lean's direction from the pole (6 % rms of 28 virtual eyes) and 2
# degrees of its declaration.
LEAN_SD = hypot(0.06, radians(2.0))

SAME_LEAN_RAD = radians(2.0)  # leans that differ by less are one

SEEN_LEAN_ERROR_RAD = radians(6.0)  # of a shaft in a picture, and of the normal there

NOT_CALIBRATED = Remark(
    "lean-not-calibrated",
    "the calibration does not know its needle's lean: the interval spans 0 to 45"
    " degrees",
    ("lean_rad",),
)


@dataclass(frozen=True)
class NeedleLean:
    """The lean of a needle: ends of the angle between it and the wall's normal, None if
    nothing says it.

    `factors`: the force along the needle over the one that E gives, the least, the
    likeliest and the largest, with a relative standard deviation beside.
    """

    ends_rad: tuple[float, float] | None
    factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
    sd: float = 0.0
    remarks: tuple[Remark, ...] = ()

    @classmethod
    def of(cls, setup: Setup, seen_rad: float | None) -> "NeedleLean":
        """Return the declared lean, else that of the eye's calibration, else that of a
        shaft in the picture.

        `seen_rad`: the angle from the normal to the shaft, towards growing columns on
        its way up.

        >>> from scleraforce.records.needle import Needle
        >>> leaning = Setup(needle=Needle(lean_rad=(0.2, 0.2)))
        >>> (remark,) = NeedleLean.of(leaning, 0.5).remarks
        >>> seen, declared = remark.words.split(", ")
        >>> seen
        'the needle leans by 29 degrees in the picture (above 0: right)'
        >>> declared
        'the declared lean allows -11 to 11'
        """
        calibrated = setup.eye.calibrated_lean_rad
        stated = (
            setup.needle.lean_rad
            if calibrated is None
            else setup.needle.lean_rad or (calibrated, calibrated)
        )

        ends = (
            stated
            if stated is not None or seen_rad is None
            else (abs(seen_rad), abs(seen_rad))
        )
        if ends is None:
            return cls(None)

        remarks = (
            ()
            if stated is None
            else _contradicted(stated, setup.needle.lean_azimuth_rad, seen_rad)
        )
        absorbed = calibrated is None and setup.eye.has_calibrated_modulus
        if absorbed and stated is None:  # as in the calibration, whatever that was
            return cls(ends)

        before = (0.0, MOST_LEAN_RAD) if absorbed else (calibrated or 0.0,) * 2
        likeliest = 1.0 if absorbed else 1.0 / cos(sum(ends) / 2)
        if not absorbed and max(abs(end - before[0]) for end in ends) <= SAME_LEAN_RAD:
            return cls(ends, (likeliest,) * 3, 0.0, remarks)

        factors = [
            _along(end, friction)
            / (_along(other, friction) * (1.0 if absorbed else cos(other)))
            for end in ends
            for other in before
            for friction in FRICTIONS
        ]
        sd = LEAN_SD * hypot(tan(sum(ends) / 2), tan(sum(before) / 2))

        return cls(
            ends,
            (min(factors), likeliest, max(factors)),
            sd,
            (*remarks, *[NOT_CALIBRATED] * absorbed),
        )


def _along(lean_rad: float, friction: float) -> float:
    """Return the force along a needle over its part along the normal."""
    push_rad = min(lean_rad, atan(friction))
    return cos(lean_rad - push_rad) / cos(push_rad)


def _contradicted(
    ends_rad: tuple[float, float], azimuth_rad: float | None, seen_rad: float | None
) -> tuple[Remark, ...]:
    """Return a remark if a shaft in the picture contradicts a lean between two ends."""
    if seen_rad is None:
        return ()

    sides = (-1.0, 1.0) if azimuth_rad is None else (cos(azimuth_rad),)
    allowed = [atan(tan(end) * side) for end in ends_rad for side in sides]
    if (
        min(allowed) - SEEN_LEAN_ERROR_RAD
        <= seen_rad
        <= max(allowed) + SEEN_LEAN_ERROR_RAD
    ):
        return ()

    shown, low, high = map(degrees, (seen_rad, min(allowed), max(allowed)))
    allows = f"the declared lean allows {low:.0f} to {high:.0f}"
    words = (
        f"the needle leans by {shown:.0f} degrees in the picture (above 0: right),"
        f" {allows}"
    )
    return (Remark("lean-contradicted", words, ("lean_rad",)),)
