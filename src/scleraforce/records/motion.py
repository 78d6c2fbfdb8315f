"""The motion of a virtual needle."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Motion:
    """How a needle moves between the forces of a virtual recording, which are the
    turning points of its force.

    Attributes:
        rate_hz: frames a second.
        ramp_n_per_s: rate of change of the force.
        hold_s: time at each turning point.
        puncture_n: elastic force at which the needle goes through the wall, after the
            others; its travel is then recorded. None: it does not.

    >>> import scleraforce as sf
    >>> sf.Motion(rate_hz=100.0).hold_s
    1.0
    """

    rate_hz: float
    ramp_n_per_s: float = 0.02
    hold_s: float = 1.0
    puncture_n: float | None = None
