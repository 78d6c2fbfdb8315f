"""A reading: what one method, the network or the fit, says about a frame."""

from dataclasses import dataclass
from math import hypot, isfinite

from scleraforce.fitting.library_fit import BoundaryFit
from scleraforce.fitting.unknowns import LATERAL
from scleraforce.reader.force_distribution import stretched_interval, unstretched
from scleraforce.units import from_si

METHODS = ("network", "fit")


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Class probabilities, force (median) with its 90 % interval, and the contact's place from the frame's middle.

    `contact_sd_m` is how sure that place is where the method knows it (a standard deviation); without a dent the fit
    can hardly tell where the needle is.
    """

    probabilities: tuple[float, ...]
    force_n: float
    interval_n: tuple[float, float]
    contact_m: float
    contact_sd_m: float = 0.0

    @property
    def predicted(self) -> int:
        """The most probable class."""
        return max(range(len(self.probabilities)), key=self.probabilities.__getitem__)

    @property
    def width_n(self) -> float:
        """Width of the interval."""
        return self.interval_n[1] - self.interval_n[0]

    @property
    def finite(self) -> bool:
        """Whether every number is one, and the interval holds the force."""
        low, high = self.interval_n
        numbers = (*self.probabilities, self.force_n, low, high, self.contact_m, self.contact_sd_m)
        return all(map(isfinite, numbers)) and low <= self.force_n <= high


def fit_reading(fit: BoundaryFit, bounds_n: tuple[float, ...], factor: float = 1.0) -> Reading:
    """Return what a fit says, its uncertainty stretched about the median by a factor (`interval_factors`)."""
    return Reading(
        probabilities=fit.probabilities(unstretched(fit.force_n, bounds_n, factor)),
        force_n=fit.force_n,
        interval_n=stretched_interval(fit.force_n, fit.interval_n, factor),
        contact_m=fit.contact_m,
        contact_sd_m=float(fit.sd[LATERAL]),
    )


def disagreement(answer: Reading, check: Reading, names: tuple[str, str]) -> str | None:
    """Return a sentence where two methods differ by more than their intervals together, None where they agree.

    The intervals count as independent: their half widths towards each other add in squares. A check that is no number
    is no agreement.

    >>> from dataclasses import replace
    >>> near = Reading(probabilities=(0, 1, 0), force_n=0.010, interval_n=(0.009, 0.011), contact_m=0.0)
    >>> far = replace(near, force_n=0.013, interval_n=(0.011, 0.015))
    >>> disagreement(near, near, ("network", "fit"))
    >>> disagreement(near, far, ("network", "fit"))
    'the network reads 10.0 mN, the fit 13.0 mN: more apart than their intervals allow'
    """
    if not check.finite:
        return f"what the {names[1]} reads is no number: nothing checks the {names[0]}"
    low, high = sorted((answer, check), key=lambda reading: reading.force_n)
    together = hypot(low.interval_n[1] - low.force_n, high.force_n - high.interval_n[0])
    if high.force_n - low.force_n <= together:
        return None
    return (
        f"the {names[0]} reads {from_si(answer.force_n, 'mn'):.1f} mN, "
        f"the {names[1]} {from_si(check.force_n, 'mn'):.1f} mN: more apart than their intervals allow"
    )


def spanned_interval(answer: Reading, check: Reading) -> tuple[float, float]:
    """Return the interval from the lower end of both to the higher one; a check that is no number has none.

    >>> near = Reading(probabilities=(0, 1, 0), force_n=0.010, interval_n=(0.009, 0.011), contact_m=0.0)
    >>> far = Reading(probabilities=(0, 1, 0), force_n=0.013, interval_n=(0.012, 0.015), contact_m=0.0)
    >>> spanned_interval(near, far)
    (0.009, 0.015)
    """
    if not check.finite:
        return answer.interval_n
    (low, high), (other_low, other_high) = answer.interval_n, check.interval_n
    return min(low, other_low), max(high, other_high)
